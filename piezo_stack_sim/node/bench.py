# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
How punctual the node is, what it costs, and how fast lockstep runs.

Every figure comes from processes of their own, as in real use, and the peer, a
plain rclpy node that publishes the same messages from a timer, is measured in
the same way and in the same run.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
import json
import os
import subprocess
import sys
import tempfile
import threading
import time

import numpy as np
from piezo_stack_sim.errors import InputError

RATES = (250.0, 1000.0, 2000.0, 4000.0)  # Hz
SETTLE = 1.0  # s between the start of a process and the start of its measurement
PATIENCE = 120.0  # s for a process to come up, compilation included
DEVICE, BARE = 'piezo_stack_node', 'bare rclpy node'
_CPUCLOCK_SCHED = 2  # of Linux: processor time of a process, in ns


@dataclass(frozen=True)
class Timing:
    """What a node that ticks at a rate costs, and how late its ticks are."""

    name: str
    rate: float  # Hz
    cpu: float  # share of one core
    ticks: int
    missed: int  # ticks that never happened
    late_p50: float  # s
    late_p99: float  # s
    late_p999: float  # s
    late_max: float  # s
    within_half_ms: float  # share of the ticks, those that never happened among them


@dataclass(frozen=True)
class Lockstep:
    """How fast a client in a process of its own gets samples of a device in lockstep."""

    exchanges_per_second: float  # each command waits for the sample before it
    round_trip_p50: float  # s
    round_trip_p99: float  # s
    burst_per_second: float  # many commands sent at once


@contextmanager
def _isolated() -> Iterator[dict[str, str]]:
    """Environment of a ROS graph that nobody else on this host hears."""
    domain = 1 + os.getpid() % 100
    yield {**os.environ, 'ROS_DOMAIN_ID': str(domain), 'PYTHONUNBUFFERED': '1',
           'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}


class _Role:
    """A process of `bench_roles`, ready to be measured."""

    def __init__(self, name: str, environment: dict[str, str], **arguments) -> None:
        began = time.monotonic()
        self._process = subprocess.Popen(
            [sys.executable, '-m', 'piezo_stack_sim.node.bench_roles', name,
             json.dumps(arguments)],
            env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        assert self._process.stdout
        # Whoever says nothing for so long is ended, and its last line read.
        guard = threading.Timer(PATIENCE, self._process.kill)
        guard.start()
        said = self._process.stdout.readline()
        guard.cancel()
        if said != 'ready\n':
            self.kill()
            raise InputError(f'bench: {name} did not start: '
                             f'{self._process.communicate()[1].strip()[-300:]}')
        self.start_time = time.monotonic() - began  # s

    def cpu_time(self) -> float:
        """Return the processor time used so far (s)."""
        clock = (~self._process.pid << 3) | _CPUCLOCK_SCHED  # as clock_getcpuclockid(3) makes it
        try:
            return time.clock_gettime(clock)
        except (AttributeError, OSError):
            raise InputError('bench: this needs the clock of another process, that is '
                             'Linux') from None

    def finish(self, terminate: bool = True) -> dict:
        """End the process, or wait until it does; return what it found."""
        if terminate:
            self._process.terminate()
        try:
            output, errors = self._process.communicate(timeout=PATIENCE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            raise InputError('bench: a process does not end') from None
        if self._process.returncode:
            raise InputError(f'bench: a process failed: {errors.strip()[-300:]}')
        return json.loads(output.splitlines()[-1])

    def kill(self) -> None:
        """End the process whatever it does."""
        if self._process.poll() is None:
            self._process.kill()
            self._process.wait()


def _share_of_core(role: _Role, seconds: float) -> float:
    time.sleep(SETTLE)
    wall, used = time.monotonic(), role.cpu_time()
    time.sleep(seconds)
    return (role.cpu_time() - used) / (time.monotonic() - wall)


def _timing(name: str, rate: float, cpu: float, lateness: np.ndarray, missed: int) -> Timing:
    lateness = lateness[lateness.size // 10:]  # start-up, imports of others on the host
    p50, p99, p999 = np.percentile(lateness, [50.0, 99.0, 99.9])
    return Timing(name, rate, cpu, int(lateness.size), missed, float(p50), float(p99),
                  float(p999), float(lateness.max()),
                  float(np.sum(lateness <= 0.5e-3) / (lateness.size + missed)))


def _measure(role_name: str, seconds: float, listen: str | None, **arguments):
    with _isolated() as environment:
        roles = []
        try:
            role = _Role(role_name, environment, **arguments)
            roles.append(role)
            if listen:
                topics = [f'{listen}/{t}' for t in
                          ('displacement', 'charge', 'force', 'voltage', 'state')]
                roles.append(_Role('listener', environment, topics=topics))
            cpu = _share_of_core(role, seconds)
            return cpu, role.finish()
        finally:
            for role in roles:
                role.kill()


def device_timing(rate: float = 1000.0, seconds: float = 5.0, actuators: int = 1,
                  listen: bool = False) -> Timing:
    """
    Measure the node.

    Parameters
    ----------
    rate : float
        Hz.
    seconds : float
        Length of the measurement.
    actuators : int
        Devices in the process; ticks of all of them count together.
    listen : bool
        Whether another process subscribes to all of its topics.

    Returns
    -------
    Timing
        Lateness against absolute deadlines.

    """
    cpu, found = _measure('device', seconds, '/piezo_stack_node' if listen else None,
                          rate=rate, actuators=actuators)
    name = DEVICE if actuators == 1 else f'{actuators} actuators'
    return _timing(name, rate, cpu, np.array(found['lateness']) * 1e-9, 0)


def bare_timing(rate: float = 1000.0, seconds: float = 5.0, publish: bool = True,
                listen: bool = False) -> Timing:
    """
    Measure a plain rclpy node that publishes the same messages, or its timer alone.

    Returns
    -------
    Timing
        Lateness against the grid that its earliest ticks lie on, which spares it
        its mean delay.

    """
    cpu, found = _measure('bare', seconds, '/bare' if listen else None, rate=rate,
                          publish=publish)
    ticks = np.array(found['ticks']) * 1e-9
    elapsed = ticks - ticks[0]
    numbers = np.round((elapsed - np.median(elapsed * rate % 1.0) / rate) * rate)
    offset = elapsed - numbers / rate
    lateness = offset - np.percentile(offset, 1.0)
    return _timing(BARE if publish else 'rclpy timer alone', rate, cpu, lateness,
                   int(numbers[-1] - numbers[0]) + 1 - ticks.size)


def cpu_ratio(device: Timing, bare: Timing) -> float:
    """Return how many times the bare node's processor time the device takes."""
    return device.cpu / bare.cpu


def sleep_timing(rate: float = 1000.0, seconds: float = 5.0) -> Timing:
    """
    Measure a loop that does nothing but sleep until each deadline, without ROS.

    Returns
    -------
    Timing
        How punctual this machine lets anybody be.

    """
    cpu, found = _measure('sleeper', seconds, None, rate=rate)
    return _timing('sleep, without ROS', rate, cpu, np.array(found['lateness']) * 1e-9, 0)


def rate_table(rates=RATES, seconds: float = 5.0) -> list[Callable[[], Timing]]:
    """
    Return what to measure: device, bare node, its timer and a mere sleep, at several rates (Hz).

    Last comes a process with eight devices.

    """
    jobs: list[Callable[[], Timing]] = []
    for rate in rates:
        jobs += [partial(device_timing, rate, seconds), partial(bare_timing, rate, seconds),
                 partial(bare_timing, rate, seconds, publish=False),
                 partial(sleep_timing, rate, seconds)]
    return [*jobs, partial(device_timing, 500.0, seconds, actuators=8)]


def lockstep_speed(exchanges: int = 5000, burst: int = 500) -> Lockstep:
    """Measure how fast a client in another process steps the device."""
    with _isolated() as environment:
        roles = []
        try:
            device = _Role('device', environment, rate=1000.0, stepping='lockstep')
            roles.append(device)
            client = _Role('client', environment, exchanges=exchanges, burst=burst)
            roles.append(client)
            found = client.finish(terminate=False)
        finally:
            for role in roles:
                role.kill()
    trips = np.array(found['round_trips']) * 1e-9
    return Lockstep(float(trips.size / trips.sum()), float(np.percentile(trips, 50.0)),
                    float(np.percentile(trips, 99.0)), found['burst_rate'])


def start_times() -> dict[str, float]:
    """
    Measure how long the node takes until it is ready.

    Returns
    -------
    dict of str to float
        ``cold``, with nothing compiled yet, and ``warm``, with everything compiled, in seconds.

    """
    with _isolated() as environment, tempfile.TemporaryDirectory() as cache:
        environment = {**environment, 'NUMBA_CACHE_DIR': cache}
        times = {}
        for name in ('cold', 'warm'):
            role = _Role('device', environment, rate=1000.0)
            times[name] = role.start_time
            role.finish()
            # What a node that runs on would have compiled beside its ticks.
            subprocess.run([sys.executable, '-m', 'piezo_stack_sim.plant.compilation', 'all'],
                           check=True, env=environment, capture_output=True)
        return times
