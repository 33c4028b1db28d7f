# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""A test programme, played to the device behind the topics and recorded while it plays."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
import math
from pathlib import Path
import signal
import threading

import numpy as np
from piezo_stack_sim.errors import InputError
from piezo_stack_sim.node.excite_limits import Limits
from piezo_stack_sim.node.excite_link import Link
from piezo_stack_sim.node.excite_lockstep import LockstepPlayer, never
from piezo_stack_sim.node.excite_wall import WallPlayer
from piezo_stack_sim.recording.recording import Recording
from piezo_stack_sim.recording.write import CsvWriter
import rclpy
from rclpy.signals import SignalHandlerOptions


@dataclass
class Outcome:
    """What was played: rows by file, remarks, and whether it was interrupted."""

    files: dict[Path, int] = field(default_factory=dict)
    remarks: list[str] = field(default_factory=list)
    interrupted: bool = False
    left_at: float = 0.0  # V or C


@dataclass(frozen=True)
class Session:
    """
    How programmes are played.

    Attributes
    ----------
    device : str
        Name of the node.
    drive : str
        ``voltage``, ``charge``, ``open`` or ``shorted``.
    charge_per_volt : float
        Turns the volts of a programme into coulombs when the drive is charge.
    limits : Limits
        In volts.
    clip : bool
        Whether to clip what exceeds the limits instead of refusing it.
    reset : bool
        Whether to relax a virtual device before each programme.
    rest : float
        Time at the safe voltage before each programme, s.
    rate : float, optional
        Commands a second (Hz).
    patience : float
        Seconds without an answer until the device counts as absent.

    """

    device: str = '/piezo_stack_node'
    drive: str = 'voltage'
    charge_per_volt: float = 1.0
    limits: Limits = Limits()
    clip: bool = False
    reset: bool = False
    rest: float = 0.0
    rate: float | None = None
    patience: float = 10.0


class _Stop:
    """Whether the user has asked to stop, by Ctrl-C or SIGTERM."""

    def __init__(self) -> None:
        self.asked = False

    def __call__(self) -> bool:
        return self.asked

    @contextmanager
    def listening(self):
        """Turn the signals into a question that the players ask, so that nothing is torn."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return

        def note(number, frame):
            self.asked = True

        before = {number: signal.signal(number, note)
                  for number in (signal.SIGINT, signal.SIGTERM)}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)


@contextmanager
def _ros():
    """Have ROS initialised, without its own signal handlers, which would cut the connection."""
    if rclpy.ok():
        yield
        return
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    try:
        yield
    finally:
        rclpy.try_shutdown()


def excite(programmes: Callable[[float], Sequence[Recording]], names: Sequence[str], out: str,
           session: Session = Session(),
           progress: Callable[[str, int, int], None] = lambda name, done, total: None) -> Outcome:
    """
    Play programmes to a device and record a recording set.

    Parameters
    ----------
    programmes : callable
        Takes the rate (Hz) at which commands are played, returns recordings with commands (V,
        or C when ``session.charge_per_volt`` is 1 and the drive is charge).
    names : sequence of str
        The names that they will have.
    out : str
        Folder of the recording set; each programme becomes ``NAME.csv``, row by row.
    session : Session
        The device, its limits, how it is driven.
    progress : callable
        Called with the name of a programme, rows done and rows in all.

    Returns
    -------
    Outcome
        After Ctrl-C with ``interrupted`` set: what was recorded is kept.

    Raises
    ------
    InputError
        Nobody answers, a limit is exceeded, a file is in the way.

    """
    paths = [Path(out) / f'{name}.csv' for name in names]
    for path in paths:
        for taken in (path, path.with_name(f'{path.name}.gz')):
            if taken.exists():
                raise InputError(f'{taken}: exists already: remove it or choose another --out')
    stop, outcome = _Stop(), Outcome()
    with _ros(), stop.listening():
        link = Link(session.device, session.drive, session.patience)
        try:
            _run(link, programmes, paths, session, stop, outcome, progress)
        finally:
            link.close()
    outcome.interrupted = stop.asked
    return outcome


def _run(link: Link, programmes, paths, session: Session, stop: _Stop, outcome: Outcome,
         progress) -> None:
    if link.lockstep and session.rate and link.rate and (
            abs(session.rate / link.rate - 1.0) > 1e-9):
        raise InputError(f'--rate {session.rate:g}: {link.device} steps at {link.rate:g} Hz in '
                         'lockstep; leave --rate out or start the node with that rate')
    if session.drive == 'voltage' and session.limits.voltage is None and link.voltage_range:
        low, high = link.voltage_range
        session = replace(session, limits=replace(session.limits, voltage=(low, high)))
    player: LockstepPlayer | WallPlayer = (
        LockstepPlayer(link) if link.lockstep else WallPlayer(link, session.rate))
    if not link.lockstep:
        player.prepare()  # it may be what tells the rate
    played = []
    for recording in _made(programmes, player.rate, session, link):
        recording = _at_rate(recording, player.rate, link)
        recording, remarks = session.limits.enforce(recording, session.clip)
        played.append(recording)
        outcome.remarks += remarks
    if any(recording.has_force for recording in played):
        link.require_force()
    drive = link.drive
    link.set_drive(session.drive)
    try:
        if link.lockstep:
            player.prepare()
        _perform(_Stage(link, player, session, stop), played, paths, stop, outcome, progress)
    except BaseException:
        if drive is not None:
            with suppress(InputError):
                link.set_drive(drive)
        raise
    if drive is not None:
        link.set_drive(drive)


def _made(programmes, rate: float, session: Session, link: Link) -> Sequence[Recording]:
    try:
        return programmes(rate)
    except InputError as error:
        if session.rate is not None or link.lockstep:
            raise
        raise InputError(f'{error}; {link.device} runs at {rate:g} Hz, another rate of commands '
                         'can be chosen with --rate') from None


def _perform(stage: _Stage, played, paths, stop: _Stop, outcome: Outcome, progress) -> None:
    try:
        for recording, path in zip(played, paths):
            if not stop.asked:
                stage.approach()
            if not stop.asked:
                outcome.files[path] = stage.record(recording, path, progress)
    except BaseException:
        with suppress(InputError):  # what went wrong first is what the user has to know
            stage.leave()
        raise
    stage.leave()
    outcome.left_at = stage.value


def _at_rate(recording: Recording, rate: float, link: Link) -> Recording:
    if len(recording) < 2:
        raise InputError(f'{recording.name}: {len(recording)} rows: nothing to play')
    steps = np.diff(recording.time) * rate
    if not np.abs(steps - 1.0).max() <= 1e-3:  # NaN is not even, either
        raise InputError(
            f'{recording.name}: rows at {recording.rate:g} Hz: expected {rate:g} Hz, evenly, the '
            f'rate at which {link.device} is commanded')
    return recording


class _Stage:
    """Takes a device to a programme and back, always by a ramp."""

    def __init__(self, link: Link, player, session: Session, stop: _Stop) -> None:
        self._link, self._player, self._session, self._stop = link, player, session, stop
        self._driven = session.drive in ('voltage', 'charge')
        self._scale = session.charge_per_volt if session.drive == 'charge' else 1.0
        self._safe = session.limits.safe if self._driven else 0.0
        # Where the device stands now; one that does not tell is taken to be at rest.
        self.value = player.present.get(session.drive, 0.0) if self._driven else 0.0
        if not math.isfinite(self.value):
            raise InputError(f'{link.device}: its {session.drive} is {self.value:g}: nobody knows '
                             'from where to lead it to the programme; mend what publishes it')
        self._force = 0.0
        self._moved = False

    def _play(self, volts: np.ndarray, forces: np.ndarray, sink, stopped) -> int:
        commands = volts * self._scale if self._scale != 1.0 else volts
        self._moved = True
        try:
            return self._player.play(commands, forces, sink, stopped)
        finally:  # whatever went wrong: the ramp down begins where the device stands
            if self._player.sent is not None:
                self.value, self._force = self._player.sent

    def _ramp_to_safe(self, stopped) -> None:
        limits, rate = self._session.limits, self._player.rate
        volts = limits.ramp(self.value / self._scale, self._safe, rate)
        if self._force and not volts.size:
            volts = np.full(max(1, round(0.1 * rate)), self._safe)
        if volts.size:
            forces = self._force * (1.0 - np.arange(1, volts.size + 1) / volts.size)
            self._play(volts, forces, None, stopped)

    def approach(self) -> None:
        """Bring the device to rest at the safe voltage."""
        if self._session.reset:
            self._player.reset(self._safe * self._scale)
            self.value = self._safe * self._scale
        else:
            self._ramp_to_safe(self._stop)
        count = round(self._session.rest * self._player.rate)
        if count and not self._stop():
            self._play(np.full(count, self._safe), np.zeros(count), None, self._stop)

    def record(self, recording: Recording, path: Path, progress) -> int:
        """Play a programme and write what the device does; return the rows."""
        volts, forces = recording.command, recording.external_force
        if self._driven:
            # A programme that does not begin where the device rests is led up to, on record.
            up = self._session.limits.ramp(self._safe, float(volts[0]), self._player.rate)[:-1]
            volts, forces = np.append(up, volts), np.append(np.zeros(up.size), forces)
        columns = ['time']
        if self._driven:
            columns.append(f'{self._session.drive}_command')
        if recording.has_force:
            columns.append('external_force')
        kept = [0, *([1] if self._driven else []), *([2] if recording.has_force else [])]
        columns += self._link.channels
        written = 0
        if not self._link.lockstep:  # there, whoever commands brings a tick, which is noticed
            self._link.guard()
        with CsvWriter(path, columns, self._session.drive) as writer:
            def sink(rows):
                nonlocal written
                table = np.array(rows)
                writer.write(table[:, [*kept, *range(3, table.shape[1])]])
                written += len(rows)
                progress(recording.name, written, volts.size)
                self._link.require_alone()

            self._play(volts, forces, sink, self._stop)
        self._link.require_alone(awaited=True)
        return written

    def leave(self) -> None:
        """Leave the device at the safe voltage and without force."""
        if self._moved and (self._driven or self._force):
            self._ramp_to_safe(never)
