# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What a sensor is shown besides the linear part: what follows charge and force at once.

A bow over the charge and a joint that closes are no linear states.  Row by row they are put
through the lags of the sensor as what moves evenly between two rows (exact for that), and
through what of its delay is shorter than a row.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
import math

import numpy as np


class Shown:
    """
    What is shown besides the linear part (m), and what the lags remember of it.

    Attributes
    ----------
    trail : ndarray, shape (2 + lags,)
        What there is now (m), what each lag remembers of it, and what is shown of it now.

    """

    def __init__(self, functions: Iterable[Callable], lags: Iterable[float]) -> None:
        self.functions = tuple(functions)
        self.lags = tuple(lags)  # 1/s
        self.trail = np.zeros(2 + len(self.lags))

    def __bool__(self) -> bool:
        return bool(self.functions)

    def at(self, out: np.ndarray) -> np.ndarray:
        """Return what there is (m), shape (n,), at outputs of the kernel (n, outputs)."""
        return sum((function(out) for function in self.functions), np.zeros(len(out)))

    def rest(self, out: np.ndarray, period: float) -> None:
        """Let the lags rest at outputs (outputs,) of the kernel."""
        value = float(self.at(out[None, :])[0])
        self.trail[:] = value
        for i, lag in enumerate(self.lags):
            follows, _, then = _weights(lag, period)
            self.trail[1 + i] = value * (then + follows)

    def now(self, out: np.ndarray) -> float:
        """Return what the sensor shows of it (m) at outputs (outputs,) of the kernel."""
        return float(self.trail[-1] if self.lags else self.at(out[None, :])[0])

    def follow(self, out: np.ndarray, period: float, late: float = 0.0) -> np.ndarray:
        """
        Return what is shown (m), shape (n,), at rows a period (s) apart, and remember.

        ``late`` is by how much less than a period a row shows what was before it (s).
        """
        from scipy.signal import lfilter
        trail, values = self.trail, self.at(out)
        last, before = values[-1], trail[-1]
        for i, lag in enumerate(self.lags):
            follows, now, then = _weights(lag, period)
            values, trail[1 + i:2 + i] = lfilter([now, then], [1.0, -follows], values,
                                                 zi=trail[1 + i:2 + i])
        trail[0], trail[-1] = last, values[-1]
        if late:
            earlier = np.concatenate([[before], values[:-1]])
            values = values + late / period * (earlier - values)
        return values

    def follow_irregular(self, out: np.ndarray, time: np.ndarray, delay: float, period: float
                         ) -> np.ndarray:
        """Do the same at the rows ``time[1:]`` (s), all of it ``delay`` (s) late."""
        values = np.concatenate([self.trail[:1], self.at(out)])
        last = values[-1]
        for i, lag in enumerate(self.lags):
            followed = [float(values[0])]
            for gap, one, other in zip(np.diff(time).tolist(), values[:-1].tolist(),
                                       values[1:].tolist()):
                follows, now, then = _weights(lag, gap)
                followed.append(follows * followed[-1] + now * other + then * one)
            follows, now, then = _weights(lag, period)
            self.trail[1 + i] = then * last + follows * followed[-1]
            values, last = np.array(followed), followed[-1]
        self.trail[0], self.trail[-1] = self.at(out[-1:])[0], values[-1]
        return np.interp(time[1:] - delay, time, values)


def _weights(lag: float, period: float) -> tuple[float, float, float]:
    """Return what a lag (rate constant, 1/s) takes of itself, of now and of a row ago."""
    follows = math.exp(-lag * period)
    part = -math.expm1(-lag * period) / (lag * period)
    return follows, 1.0 - part, part - follows
