# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What a sensor is shown besides the linear part: what follows charge and force at once.

A bow over the charge and a joint that closes are no linear states.  Row by row they are put
through the lags of the sensor, and through what of its delay is shorter than a row.  Between two
rows they are taken to move as what drives them does: at once with the force, which is held, and
with the charge as the driver lets it follow (exact for that).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

INSTANT = 1e-9  # s


class Course:
    """
    One displacement (m) that follows the outputs of the kernel at once, behind the lags.

    Parameters
    ----------
    function : callable
        Takes outputs (n, outputs), returns displacements (n,).
    settling : float
        Time constant (s) with which it moves after each row begins.
    lags : sequence of float or complex
        Rate constants (1/s) of the sensor; a complex one stands for itself and its conjugate.

    Attributes
    ----------
    trail : ndarray, shape (1 + lags,)
        What there is now (m), and what comes out of each lag: all that these remember.

    """

    def __init__(self, function: Callable, settling: float, lags: Sequence[complex]) -> None:
        self.function = function
        self.settling = max(settling, INSTANT)
        self.lags: tuple[complex, ...] = tuple(each for lag in lags for each in (
            (lag, lag.conjugate()) if isinstance(lag, complex) else (lag,)))
        self.trail = np.zeros(1 + len(self.lags), complex if any(
            isinstance(lag, complex) for lag in self.lags) else float)

    def rest(self, out: np.ndarray) -> None:
        """Let the lags rest at outputs (outputs,) of the kernel."""
        self.trail[:] = self.function(out[None, :])[0]

    def now(self, out: np.ndarray) -> float:
        """Return what the sensor shows of it (m) at outputs (outputs,) of the kernel."""
        return float(self.trail[-1].real if self.lags else self.function(out[None, :])[0])

    def follow(self, out: np.ndarray, period: float, late: float) -> np.ndarray:
        """Do what :meth:`Shown.follow` does."""
        from scipy.signal import lfilter
        trail, values = self.trail, self.function(out)
        before = np.concatenate([trail[:1], values[:-1]])
        trail[0] = values[-1]
        shown = before + self._moved(period - late, period) * (values - before)
        for i, lag in enumerate(self.lags):
            follows, now, then = self._weights(lag, period)
            # Of what went in and came out: its weights may be new since.  The product is the
            # filter's own, to the bit: a call may end anywhere.
            passed, _ = lfilter([1.0], [1.0, -follows], now * values + then * before,
                                zi=[follows.item() * trail[1 + i].item()])
            last = np.concatenate([trail[1 + i:2 + i], passed[:-1]])
            trail[1 + i] = passed[-1]
            follows, now, then = self._weights(lag, period - late)
            shown = follows * last + now * shown + then * before
            values, before = passed, last
        return (shown if late else values).real

    def follow_irregular(self, out: np.ndarray, time: np.ndarray, delay: float) -> np.ndarray:
        """Do what :meth:`Shown.follow_irregular` does."""
        gaps, times = np.diff(time), np.maximum(time[1:] - delay, time[0])
        row = np.clip(np.searchsorted(time, times, side='right') - 1, 0, gaps.size - 1)
        since = times - time[row]
        values = np.concatenate([self.trail[:1], self.function(out)])
        self.trail[0] = values[-1]
        shown = values[row] + self._moved(since, gaps[row]) * (values[row + 1] - values[row])
        for i, lag in enumerate(self.lags):
            passed = [self.trail[1 + i].item()]
            weights = np.column_stack(self._weights(lag, gaps)).tolist()
            for (follows, now, then), one, other in zip(
                    weights, values[:-1].tolist(), values[1:].tolist()):
                passed.append(follows * passed[-1] + now * other + then * one)
            self.trail[1 + i] = passed[-1]
            follows, now, then = self._weights(lag, np.maximum(since, INSTANT))
            shown = follows * np.array(passed)[row] + now * shown + then * values[row]
            values = np.array(passed)
        return shown.real

    def _moved(self, since, period):
        """Return which part of its way in a row of a period (s) it has made some time (s) in."""
        return np.expm1(-since / self.settling) / np.expm1(-period / self.settling)

    def _weights(self, lag: complex, period):
        """Return what a lag (1/s) takes in a period (s) of itself, of now and of a row ago."""
        follows, left = np.exp(-lag * period), np.exp(-period / self.settling)
        fast = lag * self.settling
        if abs(fast - 1.0) < 1e-6:
            fast = 1.0 + 1e-6
        behind = (left - follows) * fast / (fast - 1.0)
        now = (1.0 - follows - behind) / (1.0 - left)
        return follows, now, 1.0 - follows - now


class Shown:
    """
    All that is shown besides the linear part (m), and what the lags remember of it.

    Parameters
    ----------
    courses : sequence of Course
        Its parts.

    """

    def __init__(self, courses: Sequence[Course]) -> None:
        self.courses = tuple(courses)

    def __bool__(self) -> bool:
        return bool(self.courses)

    @property
    def trail(self) -> list[float]:
        """Return what is remembered, as plain numbers."""
        return [value for course in self.courses for value in course.trail.view(float).tolist()]

    def restore(self, trail: Sequence[float]) -> None:
        """Remember what :attr:`trail` told."""
        numbers = iter(trail)
        for course in self.courses:
            plain = course.trail.view(float)
            plain[:] = [next(numbers) for _ in plain]

    def rest(self, out: np.ndarray) -> None:
        """Let the lags rest at outputs (outputs,) of the kernel."""
        for course in self.courses:
            course.rest(out)

    def now(self, out: np.ndarray) -> float:
        """Return what the sensor shows of it (m) at outputs (outputs,) of the kernel."""
        return sum(course.now(out) for course in self.courses)

    def follow(self, out: np.ndarray, period: float, late: float = 0.0) -> np.ndarray:
        """
        Return what is shown (m), shape (n,), at rows a period (s) apart, and remember.

        ``late`` is by how much less than a period a row shows what was before it (s).
        """
        return sum((course.follow(out, period, late) for course in self.courses),
                   np.zeros(len(out)))

    def follow_irregular(self, out: np.ndarray, time: np.ndarray, delay: float) -> np.ndarray:
        """Do the same at the rows ``time[1:]`` (s), all of it ``delay`` (s) late."""
        return sum((course.follow_irregular(out, time, delay) for course in self.courses),
                   np.zeros(len(out)))
