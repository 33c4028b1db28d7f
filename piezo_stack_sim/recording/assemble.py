# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""One Recording out of the columns or topics that a file turned out to have."""

from pathlib import Path

import numpy as np

from piezo_stack_sim.errors import InputError
from piezo_stack_sim.recording.finding import Finding, NOTE, shown
from piezo_stack_sim.recording.recording import DRIVES, MEASURED, Recording

COMMANDS = ('voltage_command', 'charge_command')
INPUTS = (*COMMANDS, 'external_force')
# 200 MB of float64: more than this is thinned out while reading.
MAX_VALUES = 25_000_000
_ENDINGS = ('.gz', '.csv', '.mcap', '.db3')


def recording_name(path):
    """Return a file's name without its endings, ``steps`` for ``steps.csv.gz``."""
    name = Path(path).name
    for ending in _ENDINGS:
        if name.lower().endswith(ending) and len(name) > len(ending):
            name = name[:-len(ending)]
    return name


def checked_drive(source, text):
    """Return a drive that a file names, or raise InputError."""
    drive = str(text).strip()
    if drive not in DRIVES:
        raise InputError(
            f'{source}: drive: {shown(drive)}: expected one of {", ".join(DRIVES)}'
        )
    return drive


def _active(values):
    """Return whether a command column ever commands anything."""
    return bool(np.any(np.nan_to_num(values) != 0.0))


def choose_drive(source, columns, stated=None):
    """
    Find out which command drives the device.

    Parameters
    ----------
    source : str
        The file, for messages.
    columns : dict of str to ndarray
        What was read; both commands may be among it.
    stated : str, optional
        The drive that the file itself states; another command must be zero throughout then.

    Returns
    -------
    tuple of (str, ndarray or None, list of Finding)
        The drive and its command; no command for open and shorted leads.

    Raises
    ------
    InputError
        No command, or two of them, or another one than stated.

    """
    present = [name for name in COMMANDS if name in columns]
    if stated:
        other = next((name for name in present if name != f'{stated}_command'
                      and _active(columns[name])), None)
        if other:
            raise InputError(f'{source}: the file says drive {stated}, but {other} commands '
                             f'something: a contradiction: correct one of them')
    if stated in ('open', 'shorted'):
        return stated, None, []
    if stated:
        present = [name for name in present if name == f'{stated}_command']
    if not present:
        wanted = ' or '.join(COMMANDS) if not stated else f'{stated}_command'
        leads = ('when the leads were open or shorted, say so in the file ("# drive: open" above '
                 'the header of a CSV file)' if not stated
                 else f'correct what it says, drive {stated}')
        raise InputError(f'{source}: no {wanted}: map one (--map '
                         f'{wanted.partition(" ")[0]}=...), or, {leads}')
    findings = []
    if len(present) == 2:
        active = [name for name in present if _active(columns[name])]
        if len(active) == 2:
            raise InputError(
                f'{source}: both {present[0]} and {present[1]} command something: a recording '
                'has one drive: split it where the drive changes, or remove the other column'
            )
        used = active[0] if active else present[0]
        idle = present[1 - present.index(used)]
        findings = [Finding(source, None, NOTE, f'{idle} is zero throughout', f'{used} is used')]
        present = [used]
    return present[0].partition('_')[0], columns[present[0]], findings


def assemble(source, columns, stated=None, rows=None, findings=(), name=None):
    """
    Put a Recording together.

    Parameters
    ----------
    source : str
        The file or bag.
    columns : dict of str to ndarray, shape (n,)
        Channels in SI units, with 'time'.
    stated : str, optional
        The drive that the file itself states.
    rows : ndarray, shape (n,), optional
        The row of the file that each sample came from.
    findings : sequence of Finding
        What reading found.
    name : str, optional
        The recording's name, by default the file's.

    Returns
    -------
    Recording

    Raises
    ------
    InputError
        No command, or two of them, or no row.

    """
    time = columns['time']
    if not len(time):
        raise InputError(f'{source}: no rows of data')
    drive, command, more = choose_drive(source, columns, stated)
    return Recording(
        name=recording_name(source) if name is None else name,
        time=time,
        drive=drive,
        command=np.zeros(len(time)) if command is None else command,
        external_force=columns.get('external_force'),
        measured={each: columns[each] for each in MEASURED if each in columns},
        source=source,
        rows=rows,
        findings=(*findings, *more),
    )


def thinned(source, kept, step, most):
    """Return the Finding about a recording of more than `most` numbers, thinned to fewer rows."""
    return Finding(
        source, None, NOTE,
        f'larger than {8 * most / 1e6:.3g} MB of numbers: one row in {step} was kept, '
        f'{kept} of them, with the mean of the inputs until the next; what was measured and is '
        'faster than half their rate is folded',
        'give a shorter part of it to use every row',
    )
