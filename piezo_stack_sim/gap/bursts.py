# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What the course of the displacement tells of the block, whatever the cause: knocks.

Somebody knocks on the table, and what holds the sensor rings.  No command calls for it:
it comes in bursts, which nothing does that goes with the motion, and swings through zero
in each, which no jump of a reading does.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from piezo_stack_sim.gap.back_coupling import Suspect
from scipy import signal, stats

LOUD = 0.2  # power beyond that of the noise from which a recording counts
RINGS = -0.4  # least autocorrelation of what swings through zero
BURSTS = 12.0  # kurtosis of what comes in bursts; that of noise, which counts for none of it, is 3

_KNOCKED = Suspect('environment', 'the displacement rings in bursts that no command calls for, as '
                   'of knocks on the table')


def suspect_knocks(cuts: Sequence[dict]) -> Suspect | None:
    """
    Return the environment if the displacement rings in bursts, or None.

    Parameters
    ----------
    cuts : sequence of dict
        Of each track, from :func:`~piezo_stack_sim.gap.where.block_residuals`.

    """
    weights, dips, peaks = [], [], []
    for cut in cuts:
        wrong, noise = cut.get('through', cut.get('behind', (np.empty(0), 1.0)))
        if wrong.size < 16:
            continue
        course = (wrong - wrong.mean()) / noise
        loud = float(np.mean(course ** 2)) - 1.0
        if loud < LOUD:
            continue
        likeness = signal.correlate(course, course, method='fft')[course.size - 1:]
        weights.append(loud * course.size)
        dips.append(likeness[1:course.size // 8].min() / (loud * course.size))
        # What the bursts have of it: of a sum of independent parts the cumulants add up.
        peaks.append((float(stats.kurtosis(course, fisher=True)) * (1.0 + loud) ** 2
                      ) / loud ** 2 + 3.0)
    if not weights or np.average(dips, weights=weights) > RINGS:
        return None
    return _KNOCKED if np.average(peaks, weights=weights) > BURSTS else None
