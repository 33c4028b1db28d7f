# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""The devices under test, their clients, and the questions that are asked after every fault."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
import os
from pathlib import Path
import signal
import subprocess
import sys
import tempfile
import time

from piezo_stack_sim.errors import InputError
from piezo_stack_sim.node.soak.probe import Probe
from piezo_stack_sim.plant import load_device, Plant
from piezo_stack_sim.resources import config_file

# Hz, of the devices under test. An hour in lockstep is then 900,000 exchanges.
RATES = {'wall': 1000.0, 'lockstep': 250.0}
START = 300.0  # s; where the kernels have to be compiled first
PARAMS = 'ae0505d16.yaml'
VOLTAGE = 60.0  # V, of the proof by wall time
FLAT = 4.0 * 2**20  # bytes that a process may grow in a fault and still count as flat


@dataclass(frozen=True)
class Check:
    """What had to hold, what was measured, and whether it held."""

    must: str
    measured: str
    held: bool


@dataclass(frozen=True)
class Fault:
    """
    Something done to a device.

    ``done`` says what, ``stepping`` to which of the two devices, ``run`` does it
    on a `Stage` and returns the checks particular to it.

    """

    name: str
    stepping: str
    done: str
    run: Callable[[Stage], list[Check]]


class DeviceProcess:
    """A `piezo_stack_node` in a process of its own, its output kept in a file."""

    def __init__(self, stepping: str, folder: Path) -> None:
        self.name = f'/soak/{stepping}'
        self._log = folder / f'{stepping}.log'
        with open(self._log, 'wb') as stream:
            self.process = subprocess.Popen(
                [sys.executable, '-m', 'piezo_stack_sim.node.main', '--ros-args',
                 '-r', '__ns:=/soak', '-r', f'__node:={stepping}',
                 '--params-file', str(config_file(PARAMS)), '-p', f'rate:={RATES[stepping]}',
                 '-p', f'stepping:={stepping}'], stdout=stream, stderr=stream)
        end = time.monotonic() + START
        while 'ready:' not in self.output:
            if self.process.poll() is not None or time.monotonic() > end:
                self.end()
                raise InputError(f'soak: the node did not start: {self.output[-300:]}')
            time.sleep(0.02)

    @property
    def output(self) -> str:
        """Return what it has printed."""
        return self._log.read_text(encoding='utf-8', errors='replace')

    def memory(self) -> int:
        """Return how much memory is resident (bytes)."""
        try:
            fields = Path(f'/proc/{self.process.pid}/statm').read_text().split()
        except OSError:
            raise InputError('soak: this needs /proc, that is Linux, and a node that is '
                             f'alive: {self.output[-300:]}') from None
        return int(fields[1]) * os.sysconf('SC_PAGE_SIZE')

    def end(self) -> int:
        """Stop it as a service manager would; return its exit status."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGCONT)  # in case it is stopped
            self.process.terminate()
        try:
            return self.process.wait(20.0)
        except subprocess.TimeoutExpired:
            self.process.kill()
            return self.process.wait()


class Stage:
    """
    One device by wall time, one in lockstep, each started when first wanted.

    All faults of a kind are done to the same process, one after the other, as
    in a laboratory that leaves it running.

    Parameters
    ----------
    device_time : float
        Of the long run in lockstep (s).
    wall_time : float
        Of the long run by wall time (s).
    scale : float
        Length of the other faults, 1 for the full one.

    """

    def __init__(self, device_time: float, wall_time: float, scale: float) -> None:
        self.device_time = device_time
        self.wall_time = wall_time
        self.scale = scale
        self._parameters = load_device(str(config_file(PARAMS)))
        self.progress: Callable[[float], object] = lambda share: None
        self._folder = tempfile.TemporaryDirectory()
        self._devices: dict[str, DeviceProcess] = {}
        self._probes: dict[str, Probe] = {}

    def device(self, stepping: str) -> DeviceProcess:
        """Return the process of a device."""
        if stepping not in self._devices:
            self._devices[stepping] = DeviceProcess(stepping, Path(self._folder.name))
        return self._devices[stepping]

    def probe(self, stepping: str) -> Probe:
        """Return the client of a device that lives as long as the stage."""
        if stepping not in self._probes:
            probe = Probe(self.device(stepping).name, f'probe_{stepping}')
            self._probes[stepping] = probe
            probe.connect()
            probe.step_until_heard()
            probe.fresh()
            self.proof(stepping)  # everything that is made when first used is made now
        return self._probes[stepping]

    def plant(self, stepping: str) -> Plant:
        """Return the device without ROS, relaxed."""
        return Plant(self._parameters.replace(rate=RATES[stepping]))

    def count(self, full: float) -> int:
        """Return how many there are of something at the present scale."""
        return max(3, round(full * self.scale))

    def close(self) -> dict[str, int]:
        """End everything; return the exit status of each device."""
        for probe in self._probes.values():
            probe.close()
        status = {name: device.end() for name, device in self._devices.items()}
        self._folder.cleanup()
        return status

    # -- what must hold after every fault ------------------------------------------

    def proof(self, stepping: str) -> Check:
        """Command the device from reset and hold it to the simulation without ROS."""
        probe = self.probe(stepping)
        must = 'from reset it moves as the offline simulation does, to the bit'
        measured, expected = (self._by_commands(probe) if stepping == 'lockstep'
                              else self._by_steps(probe))
        largest = max(abs(a - b) for a, b in zip(measured, expected))
        same = measured == expected
        return Check(must, f'{len(measured)} samples, largest difference {1e9 * largest:.3g} nm',
                     same)

    def _by_commands(self, probe: Probe) -> tuple[list[float], list[float]]:
        commands = [0.5 * k if k < 150 else 75.0 - 0.25 * (k - 150) for k in range(300)]
        probe.fresh()
        displacement = probe.heard['displacement']
        displacement.keep = True
        for command in commands:
            probe.send('voltage_command', command)
        probe.wait(lambda: displacement.count >= len(commands), 'samples')
        displacement.keep = False
        plant = self.plant('lockstep')
        return displacement.kept, [plant.advance(u, 0.0).displacement for u in commands]

    def _by_steps(self, probe: Probe) -> tuple[list[float], list[float]]:
        """Step in a pause, and see from which step on the command acts: nothing promises it."""
        probe.call('pause', data=True)
        probe.call('reset')
        probe.listen(0.2)
        probe.forget()
        heard = [probe.heard['displacement'], probe.heard['voltage']]
        for topic in heard:
            topic.keep = True
        probe.send('voltage_command', VOLTAGE)
        steps = after = 0
        while after < 30:
            probe.call('step')
            steps += 1
            probe.wait(lambda: all(topic.count >= steps for topic in heard), 'samples')
            after += heard[1].last == VOLTAGE
        for topic in heard:
            topic.keep = False
        probe.call('pause', data=False)
        measured, voltages = (topic.kept for topic in heard)
        before = sum(v != VOLTAGE for v in voltages)
        plant = self.plant('wall')
        expected = [plant.hold(0.0).displacement for _ in range(before)]
        expected += [plant.advance(VOLTAGE, 0.0).displacement for _ in range(steps - before)]
        return measured, expected

    def no_time_lost(self, before: tuple, after: tuple) -> Check:
        """Compare two diagnostics: device time must have gone on as the clock of the day did."""
        passed = after[3] - before[3]
        lost = passed - (float(after[2]['time']) - float(before[2]['time']))
        # The time in diagnostics has six digits, and the two are rounded apart.
        allowed = 2.0 / RATES['wall'] + 1e-5 * float(after[2]['time'])
        return Check('no device time is lost', f'{1e3 * abs(lost):.1f} ms of {passed:.1f} s',
                     abs(lost) <= allowed)
