# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""The list of faults, and a run through them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
import os
import time

from piezo_stack_sim.errors import InputError
from piezo_stack_sim.node.soak import control, long, traffic
from piezo_stack_sim.node.soak.stage import Check, Fault, FLAT, Stage

FAULTS = (
    Fault('hour', 'lockstep', 'an hour of device time, as fast as it goes', long.hour),
    Fault('wall', 'wall', 'ten minutes by wall time, commanded at 100 Hz', long.wall),
    Fault('flood', 'wall', 'commands at 10 kHz for 3 s', traffic.flood),
    Fault('silence', 'wall', 'no command until the watchdog notices, then 2000 at once',
          traffic.silence),
    Fault('deaths', 'wall', 'drivers killed while they publish, and replaced', traffic.deaths),
    Fault('latecomers', 'wall', 'clients that join late and leave', traffic.latecomers),
    Fault('clock', 'wall', 'use_sim_time with a foreign /clock that jumps to and fro',
          control.clock_by_wall),
    Fault('second-clock', 'lockstep', 'somebody else publishes /clock too',
          control.clock_in_lockstep),
    Fault('stopped', 'wall', 'SIGSTOP for 2 s and for 50 ms, SIGCONT', control.stopped),
    Fault('parameters', 'lockstep', '1000 parameter changes, right and wrong, from two clients',
          control.parameters),
    Fault('clients', 'lockstep', '1200 calls of pause, step and reset from four clients at once',
          control.clients),
    Fault('rivals', 'lockstep', 'two drivers command at once', traffic.rivals),
    Fault('extremes', 'lockstep',
          'the whole voltage range, charges up to 1 C, kilonewtons, absurd numbers, NaN, inf',
          control.extremes),
)


@dataclass(frozen=True)
class Outcome:
    """What a fault did to a device."""

    name: str
    stepping: str
    done: str
    checks: tuple[Check, ...]
    seconds: float

    @property
    def held(self) -> bool:
        """Whether everything held that had to."""
        return all(check.held for check in self.checks)


def choose(names: tuple[str, ...]) -> list[Fault]:
    """
    Return faults by name, all if none is named.

    Raises
    ------
    InputError
        If there is no such fault.

    """
    known = {fault.name: fault for fault in FAULTS}
    for name in names:
        if name not in known:
            raise InputError(f'--only {name}: expected one of {", ".join(known)}')
    return [fault for fault in FAULTS if not names or fault.name in names]


def run(faults: list[Fault], device_time: float, wall_time: float, scale: float,
        progress: Callable[[str, float], object]) -> Iterator[Outcome]:
    """
    Do faults to devices, one after the other; yield what became of each.

    Parameters
    ----------
    faults : list of Fault
        What to do.
    device_time, wall_time : float
        Of the two long runs (s).
    scale : float
        Length of the others, 1 for the full one.
    progress : callable
        Takes the name of a fault and the share of it that is done.

    """
    # A graph of its own: what is done here must not reach a device in use.
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    os.environ.setdefault('ROS_DOMAIN_ID', str(1 + os.getpid() % 100))
    stage = Stage(device_time, wall_time, scale)
    began = time.monotonic()
    try:
        for fault in faults:
            progress(fault.name, 0.0)
            stage.progress = partial(progress, fault.name)
            yield _endure(stage, fault)
            progress(fault.name, 1.0)
    except BaseException:
        stage.close()
        raise
    status = stage.close()
    lines = ', '.join(f'{name}: status {code}' for name, code in status.items())
    yield Outcome('end', 'both', 'SIGTERM after all of it', (
        Check('the processes end cleanly', lines, not any(status.values())),),
        time.monotonic() - began)


def _endure(stage: Stage, fault: Fault) -> Outcome:
    device = stage.device(fault.stepping)
    stage.probe(fault.stepping)
    began, memory = time.monotonic(), device.memory()
    try:
        checks = fault.run(stage)
        checks.append(stage.proof(fault.stepping))
        grown = device.memory() - memory
        if not any(check.must == 'memory is flat' for check in checks):
            checks.append(Check('memory is flat', f'{grown / 2**10:+.0f} KiB', grown <= FLAT))
    except InputError as error:
        checks = [Check('the device answers', str(error), False)]
    return Outcome(fault.name, fault.stepping, fault.done, tuple(checks),
                   time.monotonic() - began)
