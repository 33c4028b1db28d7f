# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""What was commanded to a device and what it answered, as arrays in SI units."""

from dataclasses import dataclass, field, replace

import numpy as np

from piezo_stack_sim.errors import InputError
from piezo_stack_sim.recording.finding import Finding

DRIVES = ('voltage', 'charge', 'open', 'shorted')
MEASURED = ('voltage', 'charge', 'displacement')
UNITS = {
    'time': 's',
    'voltage_command': 'V',
    'charge_command': 'C',
    'external_force': 'N',
    'voltage': 'V',
    'charge': 'C',
    'displacement': 'm',
}


def _vector(values, what):
    """Return a read-only float64 vector; `what` names it in the message."""
    try:
        # A view: locking it leaves the caller's own array as it was, without a copy.
        array = np.asarray(values, dtype=float).view()
    except (TypeError, ValueError) as error:
        raise InputError(f'{what}: expected numbers') from error
    if array.ndim != 1:
        raise InputError(f'{what}: expected one dimension, got shape {array.shape}')
    array.flags.writeable = False
    return array


@dataclass(frozen=True, eq=False, repr=False)
class Recording:
    """
    One run of a device.

    Row k is sampled at ``time[k]``, just before ``command[k]`` takes effect; the command and the
    external force hold from their row to the next. A recording as it was read may contain NaN,
    gaps and times that go backwards; after preflight everything is finite, the times increase.

    Attributes
    ----------
    name : str
        The name within its set: the file's name without its endings.
    time : ndarray, shape (n,)
        Seconds.
    drive : str
        'voltage', 'charge', 'open' (leads open: the charge is held) or 'shorted'.
    command : ndarray, shape (n,)
        Volts or coulombs, after `drive`; without meaning for 'open' and 'shorted'.
    external_force : ndarray, shape (n,)
        Newtons, positive in the direction of extension; zeros when none was recorded.
    has_force : bool
        Whether the external force was recorded.
    measured : dict of str to ndarray, shape (n,)
        Any of 'voltage' (V, at the terminals), 'charge' (C) and 'displacement' (m).
    source : str
        The file or bag that it was read from; '' for none.
    rows : ndarray of int64, shape (n,), or None
        The row of `source` that each sample came from, as in `Finding.row`; 0 for a sample that
        preflight put in.
    findings : tuple of Finding
        What the reader had to say.
    arbitrary : bool
        Whether the displacement is in units of its own, such as volts of a sensor that nobody
        calibrated: preflight gives it the size that the device should have.
    scale : float
        Metres that a unit of an arbitrary displacement was given so far.
    start : tuple of float
        Voltage command (V) and external force (N) under which the device rested before the
        first row, where charge and displacement count from; preflight tells.
    before : tuple of float
        Voltages (V) that it had been led to before that, if it was not relaxed.
    timed : bool
        Whether the unit of the times is known, and not just taken to be seconds.
    stated : dict of str to (str, float)
        Channel to what gave its unit ('--unit', 'the header') and the factor to SI that it was
        multiplied by, of channels whose unit was given.
    unsure : dict of str to float
        Channel to the standard deviation (SI units) of what noise left in the inputs may make of
        its simulation.
    filled : dict of str to ndarray of bool, shape (n,)
        Channel to the rows whose value preflight put in, of channels that have such rows.

    Raises
    ------
    InputError
        When the drive or a channel is unknown, or the arrays differ in length.

    """

    name: str
    time: np.ndarray
    drive: str
    command: np.ndarray
    # None only as an argument: __post_init__ puts zeros there, and whether it was given.
    external_force: np.ndarray = None  # type: ignore[assignment]
    has_force: bool = None  # type: ignore[assignment]
    measured: dict = field(default_factory=dict)
    source: str = ''
    rows: np.ndarray | None = None
    findings: tuple[Finding, ...] = ()
    arbitrary: bool = False
    start: tuple[float, float] = (0.0, 0.0)
    before: tuple[float, ...] = ()
    unsure: dict[str, float] = field(default_factory=dict)
    timed: bool = False
    stated: dict[str, tuple[str, float]] = field(default_factory=dict)
    scale: float = 1.0
    filled: dict[str, np.ndarray] = field(default_factory=dict)

    def __post_init__(self):
        """Turn what was given into read-only vectors of one length."""
        where = self.source or self.name
        if self.drive not in DRIVES:
            raise InputError(f'{where}: drive {self.drive!r}: expected one of {", ".join(DRIVES)}')
        unknown = sorted(set(self.measured) - set(MEASURED))
        if unknown:
            raise InputError(
                f'{where}: measured channel {unknown[0]!r}: expected any of {", ".join(MEASURED)}'
            )
        time = _vector(self.time, f'{where}: time')
        has_force = self.external_force is not None if self.has_force is None else self.has_force
        force = np.zeros(time.size) if self.external_force is None else self.external_force
        vectors = {
            'time': time,
            'command': _vector(self.command, f'{where}: command'),
            'external_force': _vector(force, f'{where}: external_force'),
        }
        measured = {
            name: _vector(self.measured[name], f'{where}: {name}')
            for name in MEASURED if name in self.measured
        }
        for name, vector in {**vectors, **measured}.items():
            if vector.size != time.size:
                raise InputError(
                    f'{where}: {name} has {vector.size} rows, time has {time.size}'
                )
        if self.rows is not None:
            rows = np.asarray(self.rows, dtype=np.int64).view()
            if rows.shape != time.shape:
                raise InputError(f'{where}: rows have shape {rows.shape}, time {time.shape}')
            rows.flags.writeable = False
            object.__setattr__(self, 'rows', rows)
        # Of a channel that is left out, nothing was filled in.
        object.__setattr__(self, 'filled', {
            name: filled for name, filled in self.filled.items() if name in measured})
        for name, filled in self.filled.items():
            if filled.shape != time.shape:
                raise InputError(f'{where}: {name} has {filled.size} rows that were filled in or '
                                 f'not, time has {time.size}')
        for name, vector in vectors.items():
            object.__setattr__(self, name, vector)
        object.__setattr__(self, 'measured', measured)
        object.__setattr__(self, 'has_force', bool(has_force))
        object.__setattr__(self, 'findings', tuple(self.findings))

    def __repr__(self):
        """Return a line about it, without its numbers."""
        return (f'Recording({self.name!r}, {len(self)} rows, {self.duration:.4g} s, '
                f'{", ".join(self.columns())})')

    def __len__(self):
        """Return the number of rows."""
        return self.time.size

    @property
    def duration(self):
        """Return the time from the first to the last row, s."""
        return float(self.time[-1] - self.time[0]) if len(self) else 0.0

    @property
    def period(self):
        """Return the median time from row to row, s; NaN when there are fewer than two rows."""
        return float(np.median(np.diff(self.time))) if len(self) > 1 else float('nan')

    @property
    def rate(self):
        """Return the rows per second, Hz; NaN when there are fewer than two rows."""
        return 1.0 / self.period if self.period else float('nan')

    @property
    def command_name(self):
        """Return 'voltage_command' or 'charge_command', None for 'open' and 'shorted'."""
        named = self.drive in ('voltage', 'charge')
        return f'{self.drive}_command' if named else None

    def columns(self):
        """
        Return the columns of the file format.

        Returns
        -------
        dict of str to ndarray, shape (n,)
            time, the command if there is one, external_force if it was recorded, and what was
            measured, in the order of the file format.

        """
        columns = {'time': self.time}
        if self.command_name:
            columns[self.command_name] = self.command
        if self.has_force:
            columns['external_force'] = self.external_force
        return {**columns, **self.measured}

    def told(self, channel):
        """Return which rows of a channel were measured, shape (n,), or None for all of them."""
        filled = self.filled.get(channel)
        return None if filled is None else ~filled

    def replace(self, **changes):
        """Return a copy with some attributes changed."""
        return replace(self, **changes)

    def take(self, selection):
        """
        Return the rows of a selection.

        Parameters
        ----------
        selection : slice, or ndarray of int or bool
            What to index the rows with.

        Returns
        -------
        Recording

        """
        return self.replace(
            time=self.time[selection],
            command=self.command[selection],
            external_force=self.external_force[selection],
            measured={name: values[selection] for name, values in self.measured.items()},
            rows=None if self.rows is None else self.rows[selection],
            filled={name: rows[selection] for name, rows in self.filled.items()},
        )


@dataclass(frozen=True, eq=False)
class RecordingSet:
    """
    Recordings of one device.

    Attributes
    ----------
    name : str
        The name of the folder, or of the only file.
    recordings : tuple of Recording
        At least one; names are unique within the set. Each has its own rate.
    source : str
        The folder or file.
    findings : tuple of Finding
        What reading had to say about the set as a whole.

    """

    name: str
    recordings: tuple[Recording, ...]
    source: str = ''
    findings: tuple[Finding, ...] = ()

    def __post_init__(self):
        """Check that the names are unique."""
        object.__setattr__(self, 'recordings', tuple(self.recordings))
        object.__setattr__(self, 'findings', tuple(self.findings))
        seen = {}
        for recording in self.recordings:
            if recording.name in seen:
                raise InputError(
                    f'{self.source or self.name}: two recordings are called {recording.name!r} '
                    f'({seen[recording.name]} and {recording.source}): rename or remove one'
                )
            seen[recording.name] = recording.source
        if not self.recordings:
            raise InputError(f'{self.source or self.name}: no recording')

    def __len__(self):
        """Return the number of recordings."""
        return len(self.recordings)

    def __iter__(self):
        """Iterate over the recordings."""
        return iter(self.recordings)

    def __getitem__(self, name):
        """Return the recording of that name."""
        for recording in self.recordings:
            if recording.name == name:
                return recording
        raise KeyError(name)

    @property
    def channels(self):
        """Return the channels that at least one recording measured."""
        return tuple(
            name for name in MEASURED if any(name in each.measured for each in self.recordings)
        )

    def replace(self, **changes):
        """Return a copy with some attributes changed."""
        return replace(self, **changes)
