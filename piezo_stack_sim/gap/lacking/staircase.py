# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Whether a command that comes in steps is what is wrong with the displacement.

A converter with missing bits puts out the nearest of few levels.  Where nobody measured the
voltage, what the displacement misses is turned back into what the command must have missed, by
the answer of the device to a small step: that is a saw-tooth of the command, and of nothing else.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import math

import numpy as np
from piezo_stack_sim.gap.cores import parallel
from piezo_stack_sim.gap.lacking.back_coupling import Suspect
from piezo_stack_sim.gap.measured.evidence import Evidence, Track
from piezo_stack_sim.gap.quantities import significant
from piezo_stack_sim.plant import Device, simulate

LEVELS = np.arange(20.0, 2500.0, 0.1)  # steps in the span of the commands that are tried
ANSWER = 64  # rows after which a step has been answered
SMALL = 2e-3  # of the span, a step whose answer is taken: less than breaks an element
FAINT = 0.05  # part of the best answered frequency's power below which nothing is turned back
TOLD = 0.15  # part of what the command must have missed that steps tell; others tell a hundredth
CHANCE = 2.0  # times what chance tells, by the logarithm of how many steps are tried
SIZED = 0.3  # and part from which it is believed how large they are


def suspect_steps(device: Device, evidence: Evidence, cuts: Sequence[dict]) -> Suspect | None:
    """
    Return the drive if the displacement is wrong as for a command in steps, or None.

    Parameters
    ----------
    device : Device
        The re-tuned nominal device.
    evidence : Evidence
        The recordings.
    cuts : sequence of dict
        Of each track, from :func:`~piezo_stack_sim.gap.measured.where.block_residuals`.

    """
    missed = list(_missed(device, evidence, cuts))
    if not missed:
        return None
    steps = max(float(np.ptp(command)) for command, _ in missed) / LEVELS
    total = sum(float(back @ back) for _, back in missed)
    told = np.zeros(steps.size)
    for command, back in missed:
        told += _told(command, back, steps)
    best = int(np.argmax(told))
    rows = sum(back.size for _, back in missed)
    # Of few rows chance alone tells as much, of so many sizes that were tried.
    if told[best] < max(TOLD, CHANCE * math.log(steps.size) / rows) * total:
        return None
    # Rows as far apart as the steps, or steps finer than those tried, mislead on the size.
    size = f' of {significant(float(steps[best]), 2)} V' if told[best] > SIZED * total else ''
    return Suspect('drive', 'the displacement is wrong as if the command came in steps'
                   f'{size}: a converter misses bits')


def _missed(device: Device, evidence: Evidence, cuts: Sequence[dict]
            ) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield commands (n,) and by how much each must have changed other than it did (n - 1,)."""
    for track, cut in zip(evidence.tracks, cuts):
        wrong, noise = cut.get('through', cut.get('behind', (np.empty(0), 1.0)))
        command = track.recording.command
        if (wrong.size != command.size or 'drive' in cut or track.recording.drive != 'voltage'
                or np.ptp(command) <= 0.0 or np.var(wrong) < noise ** 2):
            continue  # thinned, or the voltage was measured, or nothing is wrong
        size = 2 * command.size
        answer = np.fft.rfft(_answer(device, track), size)
        power = np.abs(answer) ** 2
        change = np.fft.rfft(np.diff(wrong) / noise, size)
        yield command, np.fft.irfft(change * np.conj(answer) / (
            power + FAINT * power.max()), size)[:command.size - 1]


def _answer(device: Device, track: Track) -> np.ndarray:
    """Return by how much the displacement changes from row to row after a unit step (m/V)."""
    step = SMALL * float(np.ptp(track.recording.command))
    command = np.full(ANSWER + 1, step)
    command[0] = 0.0
    time = np.arange(ANSWER + 1) * track.recording.period
    return np.diff(simulate(device, time, command, drive='voltage').displacement) / step


def _told(command: np.ndarray, back: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """Return the power of ``back`` that each of some steps (V) of the command tells."""
    def one(step):
        saw = np.diff(np.rint(command / step) * step - command)
        return max(float(back @ saw), 0.0) ** 2 / max(float(saw @ saw), 1e-30)

    return np.concatenate(parallel(lambda some: [one(step) for step in some],
                                   np.array_split(steps, 8)))
