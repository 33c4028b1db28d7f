# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What the course of the displacement tells of the block, whatever the cause: play, a clock, heat.

Where a part has play or rubs, what is wrong with the displacement depends on which way it
last moved and how far, however fast: on the plays of a Prandtl-Ishlinskii operator.  No
reading of a sensor remembers that, however late it comes.  A reading whose clock runs fast or
slow is late by ever more.  A stack that heats itself is another for as long as it is warm.

All recordings count together: how fast they move is what tells play from a lag.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

from numba import njit
import numpy as np
from piezo_stack_sim.gap.fitting.blackbox import lagged, predict
from piezo_stack_sim.gap.lacking.back_coupling import is_behind, Suspect
from piezo_stack_sim.gap.measured.evidence import Evidence, Track

LOUD = 0.2  # power beyond that of the noise from which there is anything to tell
WIDTHS = (0.0005, 0.002, 0.01, 0.05, 0.15, 0.4)  # half widths of plays, parts of the stroke
LAGS = (3e-5, 1e-4, 3e-4, 1e-3, 1e-2, 1e-1)  # s
DELAYS = np.geomspace(1e-6, 3e-2, 40)  # s, of a constant lag
ADDS = 0.7  # part that plays, or a clock, may leave of what everything else leaves
WITHOUT = 0.3  # part of the gap that this leaves at least
LATER = 0.5  # part of the gap that a wrong clock may leave
SKEWS = np.geomspace(1e-5, 5e-3, 28)  # parts by which a clock may run fast or slow
REST = 0.5  # part that a clock may leave of what a cause leaves, and everything else
WARM = (0.03, 0.1, 0.3, 1.0, 3.0)  # s in which heat may flow off
HEARD = 0.08  # gap over the noise power from which heat may be told
STEADILY = 0.1  # and part that the motion leaves at least: one that is always late is a lag

_PLAY = Suspect('mechanical', 'what is wrong with the displacement depends on which way it last '
                'moved, however fast: something has play or rubs')
HEATED = Suspect('transducer', 'what is wrong with the displacement follows the power of the '
                 'motion that went before: the stack heats itself')
CLOCK = Suspect('sensor', 'the displacement comes late by ever more: it was read by a clock that '
                'runs at another speed')


@dataclass(frozen=True)
class Way:
    """Time (n,) in s, displacement (n,) in m, and its gap (n,) over the noise, in a recording."""

    time: np.ndarray
    moved: np.ndarray
    wrong: np.ndarray
    noise: float


@dataclass(frozen=True)
class Course:
    """
    The gap of the displacement over that of its noise, and what it may depend on.

    ``wrong`` (m,) and what it may depend on, (m, k) each, are of all recordings one after the
    other, without their means; ``plain`` is the motion itself, whichever way it came.
    """

    wrong: np.ndarray
    plain: np.ndarray
    plays: np.ndarray
    clock: np.ndarray
    heat: np.ndarray
    fitted: np.ndarray
    ways: tuple[Way, ...] = ()

    @classmethod
    def of(cls, evidence: Evidence, simulated: Sequence[dict], cuts: Sequence[dict]
           ) -> Course | None:
        """
        Return it, or None where no displacement was measured.

        Parameters
        ----------
        evidence : Evidence
            The recordings.
        simulated : sequence of dict
            Channel to (n,) array for each track, from the re-tuned device.
        cuts : sequence of dict
            Of each track, from :func:`~piezo_stack_sim.gap.measured.where.block_residuals`.

        """
        moved = [track.average(answer['displacement'])
                 for track, answer in zip(evidence.tracks, simulated)]
        stroke = max(map(np.ptp, moved), default=0.0)
        parts, ways = [], []
        for track, answer, cut, x in zip(evidence.tracks, simulated, cuts, moved):
            wrong, noise = cut.get('through', cut.get('behind', (np.empty(0), 1.0)))
            judged = track.fitted.any() and not track.fitted.all()
            if wrong.size != x.size or np.ptp(x) <= 0.0 or not judged:
                continue  # nothing moved, or nothing was withheld
            time = track.recording.period * track.factor * np.arange(x.size)
            speed = np.gradient(x, time)
            plain = [x, x ** 2, x ** 3, speed, time, track.average(track.recording.command),
                     track.average(answer['voltage']), track.average(answer['charge']),
                     *(x - np.interp(time - lag, time, x) for lag in LAGS)]
            plays = [x - play(x, width * stroke) for width in WIDTHS]
            warm = list(_warmth(track, answer['displacement']))
            heat = [*warm, *(each * x for each in warm)]
            columns = np.column_stack([wrong, *plain, *plays, speed * time, *heat])
            parts.append(((columns - columns.mean(axis=0)) / noise, track.fitted))
            ways.append(Way(time, x, wrong / noise, noise))
        if not parts:
            return None
        rows = np.concatenate([columns for columns, _ in parts])
        ends = np.cumsum([1, len(plain), len(plays), 1, len(heat)])
        motion, memory, late, warmth = np.split(rows[:, 1:], ends[1:-1] - 1, axis=1)
        return cls(rows[:, 0], motion, memory, late, warmth,
                   np.concatenate([fitted for _, fitted in parts]), tuple(ways))

    @property
    def gap(self) -> float:
        """Return the power of the gap beyond that of the noise, in units of that."""
        return float(np.mean(self.wrong[~self.fitted] ** 2)) - 1.0

    @cached_property
    def history(self) -> float:
        """Return the part of the gap that the motion and the voltage at the moment do not tell."""
        return self.left(self.plain)

    def left(self, *features: np.ndarray) -> float:
        """Return the part of the gap that is left of what features do not tell."""
        told = predict(np.hstack(features), self.wrong, self.fitted)
        return (float(np.mean((self.wrong - told)[~self.fitted] ** 2)) - 1.0) / self.gap

    def late(self, seconds: float, parts: float) -> float:
        """Return the part of the gap that is left if the motion is late, by ever more."""
        total = rows = 0.0
        for way in self.ways:
            late = np.interp(way.time - seconds - parts * way.time, way.time, way.moved)
            rest = way.wrong + (way.moved - late) / way.noise
            total += float(np.sum((rest - rest.mean()) ** 2))
            rows += rest.size
        return (total / rows - 1.0) / self.gap


def suspect_clock(course: Course | None) -> Suspect | None:
    """Return the sensor if the displacement is late by ever more, or None."""
    if course is None or course.gap < LOUD:
        return None
    late = (course.history > STEADILY and course.left(course.clock) < LATER
            and course.left(course.plain, course.clock) < ADDS * course.history)
    return CLOCK if late or skewed(course) < LATER else speaks_for_clock(course)


def skewed(course: Course | None) -> float:
    """
    Return the part of the gap that a clock leaves which runs fast or slow.

    1 if that is no less than half of what a constant lag leaves.
    """
    if course is None or course.gap < LOUD:
        return 1.0
    clock = min(course.late(0.0, sign * skew) for skew in SKEWS for sign in (1.0, -1.0))
    lag = min(course.late(sign * lag, 0.0) for lag in DELAYS for sign in (1.0, -1.0))
    return clock if clock < REST * lag else 1.0


def speaks_for_clock(course: Course | None) -> Suspect | None:
    """Return the sensor if what a cause leaves of the motion is late by ever more, or None."""
    if course is None or course.gap < LOUD or course.history < WITHOUT:
        return None
    return CLOCK if course.left(course.plain, course.clock) < REST * course.history else None


def suspect_heat(course: Course | None, cuts: Sequence[dict]) -> Suspect | None:
    """
    Return the transducer if the displacement is wrong as the stack heats itself, or None.

    A driver that sags under current does the same to a displacement: what comes before the
    transducer must be known to be right.
    """
    if not is_behind(cuts) or course is None or course.gap < HEARD or course.history < WITHOUT:
        return None
    left = course.left(course.plain, course.heat)
    return HEATED if left < ADDS * min(course.history, 1.0) else None


def suspect_play(course: Course | None) -> Suspect | None:
    """Return the mechanics if the displacement is wrong by which way it last moved, or None."""
    if course is None or course.gap < LOUD:
        return None
    played = (course.history > WITHOUT
              and course.left(course.plain, course.plays) < ADDS * course.history)
    return _PLAY if played else None


def is_plain(course: Course | None) -> bool:
    """Tell whether the motion or the voltage at the moment tell what is wrong, and no history."""
    return course is not None and course.gap > LOUD and course.history < WITHOUT


def _warmth(track: Track, displacement: np.ndarray) -> Iterator[np.ndarray]:
    """Yield how warm (m,) a motion (n,) keeps the stack, one for each time in which heat flows."""
    recording = track.recording
    power = track.average(np.gradient(displacement, recording.period) ** 2)
    for time in WARM:
        yield lagged(power, time / (recording.period * track.factor))


def play(x: np.ndarray, half: float) -> np.ndarray:
    """Return what a play of a half width (m) makes of displacements (n,)."""
    out = np.empty(len(x))
    _follow(np.ascontiguousarray(x, dtype=float), half, out)
    return out


@njit(cache=True, nogil=True)
def _follow(x, half, out):
    follower = x[0]
    for i in range(x.size):
        follower = min(max(follower, x[i] - half), x[i] + half)
        out[i] = follower
