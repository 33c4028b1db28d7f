# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What the course of the displacement tells of the block, whatever the cause: bursts.

Somebody knocks on the table, and what holds the sensor rings.  No command calls for it:
it comes in bursts, which nothing does that goes with the motion, and swings through zero
in each, which no reading does that jumps or sticks.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from piezo_stack_sim.gap.back_coupling import Suspect
from piezo_stack_sim.gap.course import Course, LOUD
from scipy import signal, stats

RINGS = -0.4  # least autocorrelation of what swings through zero
BURSTS = 12.0  # kurtosis of what comes in bursts; that of noise, which counts for none of it, is 3
UNTOLD = 0.8  # part of the gap that the motion must leave, if something else is to blame

_KNOCKED = Suspect('environment', 'the displacement rings in bursts that no command calls for, as '
                   'of knocks on the table')
_STUCK = Suspect('sensor', 'the displacement is wrong in short bursts that nothing calls for: its '
                 'readings jump or stick')


def suspect_bursts(cuts: Sequence[dict], course: Course | None) -> Suspect | None:
    """
    Return the environment if the displacement rings in bursts, the sensor if it jumps, or None.

    Parameters
    ----------
    cuts : sequence of dict
        Of each track, from :func:`~piezo_stack_sim.gap.where.block_residuals`.
    course : Course or None
        Of the displacement, of all tracks.

    """
    weights, dips, peaks = [], [], []
    for cut in cuts:
        wrong, noise = cut.get('through', cut.get('behind', (np.empty(0), 1.0)))
        if wrong.size < 16:
            continue
        gap = (wrong - wrong.mean()) / noise
        loud = float(np.mean(gap ** 2)) - 1.0
        if loud < LOUD:
            continue
        likeness = signal.correlate(gap, gap, method='fft')[gap.size - 1:]
        weights.append(loud * gap.size)
        dips.append(likeness[1:gap.size // 8].min() / (loud * gap.size))
        # What the bursts have of it: of a sum of independent parts the cumulants add up.
        peaks.append((float(stats.kurtosis(gap, fisher=True)) * (1.0 + loud) ** 2
                      ) / loud ** 2 + 3.0)
    if not weights:
        return None
    if np.average(dips, weights=weights) < RINGS:
        return _KNOCKED if np.average(peaks, weights=weights) > BURSTS else None
    # Not where the motion tells it; a step is a burst of its own, but most recordings never rest.
    untold = course is not None and (course.gap < LOUD or course.history > UNTOLD)
    return _STUCK if untold and np.median(peaks) > BURSTS else None
