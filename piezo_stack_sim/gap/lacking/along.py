# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Whether the displacement is wrong by turns along the way: the cage of a bearing, a toothed scale.

A force that alternates with the place moves the end to and fro about where it should be, the same
at every passage, however fast and whichever way it comes.  A curve that bends once or twice over
the stroke is another matter: a sensor, a spring and the ceramic make such.
"""

from __future__ import annotations

import numpy as np
from piezo_stack_sim.gap.cores import parallel
from piezo_stack_sim.gap.lacking.back_coupling import Suspect
from piezo_stack_sim.gap.lacking.course import Course, LOUD
from piezo_stack_sim.gap.quantities import significant

TURNS = np.arange(2.5, 60.0, 0.05)  # turns in the stroke that are tried
TOLD = 0.5  # part of the gap that one pitch tells
ALONE = 2.0  # times what any tells that is not next to it: bends tell of all that are few
BESIDE = 0.15  # part by which those next to it differ


def suspect_pitch(course: Course | None, not_felt: bool = False) -> Suspect | None:
    """
    Return the block if the displacement is wrong by turns along the way, or None.

    Parameters
    ----------
    course : Course or None
        Of the displacement, of all tracks.
    not_felt : bool
        Whether the charge shows that no force on the stack moves the end: it is the sensor, then.

    """
    if course is None or course.gap < LOUD:
        return None
    stroke = max(float(np.ptp(way.moved)) for way in course.ways)
    wrong = np.concatenate([way.wrong - way.wrong.mean() for way in course.ways])
    told = np.concatenate(parallel(
        lambda some: [_told(course, wrong, stroke / turns) for turns in some],
        np.array_split(TURNS, 8)))
    best = int(np.argmax(told))
    apart = np.abs(TURNS / TURNS[best] - 1.0) > BESIDE
    if told[best] < TOLD * (1.0 - wrong.size / float(wrong @ wrong)) or (
            told[best] < ALONE * told[apart].max()):
        return None
    reason = ('the displacement is wrong by turns along the way, '
              f'{significant(1e6 * stroke / float(TURNS[best]), 2)} um apart: ')
    if not_felt:
        return Suspect('sensor', f'{reason}the marks of a scale, for the stack feels none of it')
    return Suspect('mechanical', f'{reason}a force that alternates, as of the cage of a bearing')


def _told(course: Course, wrong: np.ndarray, pitch: float) -> float:
    """Return the part of the power of a gap that a sine of a pitch (m) along the way tells."""
    def wave(way):
        columns = np.exp(2j * np.pi * way.moved / pitch)
        columns = columns - columns.mean()
        return np.column_stack([columns.real, columns.imag]) / way.noise

    waves = np.concatenate([wave(way) for way in course.ways])
    along = waves.T @ wrong
    return float(along @ np.linalg.lstsq(waves.T @ waves, along, rcond=None)[0]
                 ) / float(wrong @ wrong)
