# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Preflight of cause and effect: no driver answers a command before it takes effect.

By the format a row is measured just before its command takes effect.  Many a logger writes a
command beside what was measured after it: then the device seems to know it a row ahead, which no
effect explains.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from piezo_stack_sim.recording.finding import Finding, found, NOTE, REPAIRED
from piezo_stack_sim.recording.recording import Recording
from piezo_stack_sim.recording.samples import without

# Power that one order of cause and effect may leave of what the other leaves.
_CLEAR = 0.5
# A jump of the command, in parts of its range and of what it usually changes by.
_JUMP, _UNUSUAL = 0.02, 20.0
# Part of what a jump does in two rows that shows in its own: before it takes effect, none.
_MOST, _HARDLY = 0.5, 0.2
# Times the noise by which jumps must show.
_SEEN = 10.0


def shows_at_once(recording: Recording) -> bool | None:
    """
    Tell whether a command shows in its own row.

    The driven quantity, the voltage or the charge, is explained by the command of its row, and
    by those of the two rows before: of a smooth command these tell the next, and nothing can be
    told.  Of what answers with dynamics and memory only jumps of the command are asked.

    Parameters
    ----------
    recording : Recording
        Of finite numbers.

    Returns
    -------
    bool or None
        None if the recording does not tell: the command is too smooth, or at rest, or nothing
        follows it fast enough.

    """
    if recording.drive not in recording.measured:
        told = (_jumps(recording.command, values) for values in recording.measured.values())
        return next((each for each in told if each is not None), None)
    if np.ptp(recording.command) == 0.0:
        return None
    command = recording.command / np.ptp(recording.command)
    answer = recording.measured[recording.drive]
    answer = answer[2:] / (np.ptp(answer) or 1.0)
    own = _left(answer, command[2:])
    before = _left(answer, command[1:-1], command[:-2])
    if own < _CLEAR * before:
        return True
    return False if _left(answer, command[1:-1]) < _CLEAR * own else None


def _jumps(command: np.ndarray, values: np.ndarray) -> bool | None:
    """Tell whether jumps of the command show in their own rows, None if they do in neither."""
    change = np.diff(command[:-1])
    size = np.abs(change)
    rows = np.flatnonzero((size > _JUMP * np.ptp(command)) & (size > _UNUSUAL * np.median(size)))
    if not rows.size:
        return None
    moves = np.diff(values)
    own = float(np.sum(moves[rows] * np.sign(change[rows])))
    later = float(np.sum(moves[rows + 1] * np.sign(change[rows])))
    both = own + later  # of either sign: nobody has asked yet how it was wired
    if both == 0.0 or abs(both) < _SEEN * np.median(np.abs(moves)) * np.sqrt(rows.size):
        return None
    share = own / both
    return True if share > _MOST else False if share < _HARDLY else None


def _left(answer: np.ndarray, *causes: np.ndarray) -> float:
    """Return the power of an answer that a constant and its causes leave."""
    columns = np.column_stack([np.ones(answer.size), *causes])
    left = answer - columns @ np.linalg.lstsq(columns, answer, rcond=None)[0]
    return float(left @ left)


def advance(recording: Recording, told: bool | None, others: Iterable[bool | None]
            ) -> tuple[Recording, list[Finding]]:
    """
    Let commands count from a row earlier where what is driven shows them in their own row.

    What is driven is left out where it is the command itself.

    Parameters
    ----------
    recording : Recording
        To mend.
    told : bool or None
        What :func:`shows_at_once` says of it.
    others : iterable of bool or None
        And of all recordings of the set: one that does not tell was logged as those that do.

    """
    findings = []
    if np.ptp(recording.command) and np.array_equal(
            recording.measured.get(recording.drive, ()), recording.command):
        # What was measured at the terminals is played: nothing is known of the driver.
        findings = [found(recording, None, NOTE, f'{recording.drive} is the command, row by row',
                          'it tells nothing of the driver and is not used as measured')]
        recording = without(recording, recording.drive)
    alike = {each for each in others if each is not None}
    if not told and (told is False or alike != {True}):
        return recording, findings
    where = 'in other recordings ' if told is None else ''
    why = f'{where}a command shows in its own row, before it takes effect'
    command = np.append(recording.command[1:], recording.command[-1])
    return recording.replace(command=command), [*findings, found(
        recording, None, REPAIRED, why, 'each command counts from the row before its own')]
