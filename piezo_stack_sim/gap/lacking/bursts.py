# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What the course of the displacement tells of the block, whatever the cause: bursts and jumps.

Somebody knocks on the table, and what holds the sensor rings.  No command calls for it:
it comes in bursts, which nothing does that goes with the motion, and swings through zero
in each, which no reading does that jumps or sticks.  What rings whenever the command changes
is no knock: a linear answer to the inputs tells it.  A reading that jumps between two levels, at
times of its own, stays at each: a drift or a vibration leaves a fifth and more of itself beside
any two levels.  One that sticks stays where it was while the stack moves on, and what is wrong
with it may swing as the motion does.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from piezo_stack_sim.gap.cores import parallel
from piezo_stack_sim.gap.fitting.blackbox import answers_to, predict
from piezo_stack_sim.gap.lacking.back_coupling import is_led, Suspect
from piezo_stack_sim.gap.lacking.course import Course, LOUD, STEADILY, suspect_play
from piezo_stack_sim.gap.measured.evidence import Track
from scipy import signal, stats

RINGS = -0.4  # least autocorrelation of what swings through zero
BURSTS = 12.0  # kurtosis of what comes in bursts; that of noise, which counts for none of it, is 3
UNTOLD = 0.8  # part of the gap that the motion must leave, if something else is to blame
ALIKE = 0.2  # autocorrelation, from row to row, of a reading that sticks
JUMP = 12.0  # nats that a jump from level to level must bring: one in a hundred thousand rows
FEW = 20  # rows in bursts from which it is told whether a reading sticks
TURNS = 6  # times that levels and jumps are asked in turn
LEVELS = 0.13  # part of the gap that two levels may leave
FAR, MOVES = 2.0, 6.0  # rms of a gap beyond which a burst is, and noise that a motion is beyond
STAYS, MOSTLY = 0.3, 0.8  # part of a motion that a reading does at most that sticks, and how often
RINGING = 300  # averaged rows after a change of an input that may ring because of it
CALLED = 0.5  # part of a gap that is called for if its inputs tell as much

_KNOCKED = Suspect('environment', 'the displacement rings in bursts that no command calls for, as '
                   'of knocks on the table')
_STUCK = Suspect('sensor', 'the displacement is wrong in short bursts that nothing calls for: its '
                 'readings jump or stick')
_NOISY = Suspect('sensor', 'the displacement is noisier at some times than at others, and differs '
                 'from row to row as noise does')
_JUMPS = Suspect('sensor', 'the displacement is wrong by one of two levels, between which its '
                 'reading jumps at times of its own')


def suspect_bursts(tracks: Sequence[Track], cuts: Sequence[dict], course: Course | None
                   ) -> Suspect | None:
    """
    Return the environment if the displacement rings in bursts, the sensor if it jumps, or None.

    The sensor, too, if it is noisier at times.  None if that is what a change of an input makes,
    or a charge that is wrong.

    Parameters
    ----------
    tracks : sequence of Track
        The recordings.
    cuts : sequence of dict
        Of each track, from :func:`~piezo_stack_sim.gap.measured.where.block_residuals`.
    course : Course or None
        Of the displacement, of all tracks.

    """
    if is_led(cuts):
        return None
    weights, dips, peaks, nexts, asked = [], [], [], [], []
    stays: list[bool] = []
    for track, cut in zip(tracks, cuts):
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
        nexts.append(likeness[1] / (loud * gap.size))
        # What the bursts have of it: of a sum of independent parts the cumulants add up.
        peaks.append((float(stats.kurtosis(gap, fisher=True)) * (1.0 + loud) ** 2
                      ) / loud ** 2 + 3.0)
        asked.append((track, gap))
        stays += _stays(track, wrong, noise).tolist()
    if not weights:
        return None
    if np.average(dips, weights=weights) < RINGS:
        if np.average(peaks, weights=weights) < BURSTS:
            return None
        if len(stays) > FEW and np.mean(stays) > MOSTLY:
            return _STUCK
        whole, left = np.sum(parallel(lambda pair: _uncalled(*pair), asked), axis=0)
        return _KNOCKED if left > (1.0 - CALLED) * whole else None
    # Not where the motion tells it; a step is a burst of its own, but most recordings never rest.
    untold = course is not None and (course.gap < LOUD or course.history > UNTOLD)
    if not untold or np.median(peaks) < BURSTS:
        return None
    return _STUCK if np.average(nexts, weights=weights) > ALIKE else _NOISY


def suspect_jumps(cuts: Sequence[dict], course: Course | None) -> Suspect | None:
    """
    Return the sensor if the displacement is wrong by one of two levels, or None.

    Parameters
    ----------
    cuts : sequence of dict
        Of each track, from :func:`~piezo_stack_sim.gap.measured.where.block_residuals`.
    course : Course or None
        Of the displacement, of all tracks.

    """
    # A gain makes two levels of two commands, and play of two directions: not where those tell it.
    if (course is None or course.gap < LOUD or course.history < STEADILY
            or suspect_play(course) is not None):
        return None
    loud = left = 0.0
    for cut in cuts:
        wrong, noise = cut.get('through', cut.get('behind', (np.empty(0), 1.0)))
        if wrong.size < 16:
            continue
        gap = (wrong - wrong.mean()) / noise
        loud += max(float(gap @ gap) - gap.size, 0.0)
        rest = gap - _two_levels(gap)
        left += max(float(rest @ rest) - gap.size, 0.0)
    return _JUMPS if left < min(LEVELS, 0.5 * course.history) * loud else None


def _stays(track: Track, wrong: np.ndarray, noise: float) -> np.ndarray:
    """Return where a reading hardly moves, of the rows in bursts of a gap (m) that should."""
    read = track.average(track.recording.measured['displacement'], 'displacement')
    gap = np.abs(wrong - wrong.mean())
    far = gap > FAR * np.sqrt(np.mean(gap ** 2))
    does, should = np.abs(np.diff(read)), np.abs(np.diff(read - wrong))
    rows = far[1:] & far[:-1] & (should > MOVES * noise)
    return does[rows] < STAYS * should[rows]


def _uncalled(track: Track, gap: np.ndarray) -> np.ndarray:
    """
    Return the power of a gap (m,) on withheld rows, and what a linear answer to the inputs leaves.

    Both beyond that of the noise, which is one.
    """
    recording = track.recording
    changes = [np.diff(each, prepend=each[0]) for each in map(
        track.average, (recording.command, recording.external_force)) if np.ptp(each) > 0.0]
    rows = min(RINGING, gap.size // 8)
    told = np.zeros(gap.size)
    if changes:
        told = predict(np.hstack([answers_to(change, rows) for change in changes]), gap,
                       track.fitted)
    return np.array([max(float(np.sum(each[~track.fitted] ** 2 - 1.0)), 0.0)
                     for each in (gap, gap - told)])


def _two_levels(gap: np.ndarray) -> np.ndarray:
    """Return what two levels, and jumps between them, make of a gap (n,) with noise of one."""
    low, high = np.quantile(gap, [0.1, 0.9])
    for _ in range(TURNS):
        at_high = _path(0.5 * ((gap - low) ** 2 - (gap - high) ** 2))
        if at_high.all() or not at_high.any():
            break
        low, high = float(gap[~at_high].mean()), float(gap[at_high].mean())
    return np.where(at_high, high, low)


def _path(nats: np.ndarray) -> np.ndarray:
    """Return where the high of two levels is the likelier (n,), jumps considered (Viterbi)."""
    lead, leads = 0.0, []
    for more in nats.tolist():
        lead = min(max(lead, -JUMP), JUMP) + more
        leads.append(lead)
    high, path = lead > 0.0, []
    for lead in reversed(leads):
        # Whichever level comes after, who leads by more than a jump costs was there before.
        if abs(lead) > JUMP or not path:
            high = lead > 0.0
        path.append(high)
    return np.array(path[::-1])
