# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The regular sampling behind a column of times.

A sampler with a clock of its own leaves one of three kinds of times behind. Stamps of the sampler
are *regular*, up to rounding, with whole periods missing where rows were lost. Times at which a
message arrived are *jittered*: each is the regular time plus a delay of its own, so that they stay
near the grid however long it lasts. Times of a sampler without a clock are *irregular*: every
interval is on its own and the distance from any grid grows like a random walk; such times are
right and must be kept.
"""

from dataclasses import dataclass

import numpy as np

# Stamps may deviate by this part of a period from a grid to count as its own.
_ROUNDING = 0.05
_WINDOW = 50
_LONG_GAP = 10
# Periods; more are no sampling, and too many to count in a float.
_LONGEST = 1e12
# Residual power over that of a random walk with the same intervals; arrival jitter has 6/n of it.
_BOUNDED = 0.05


@dataclass(frozen=True, eq=False)
class Grid:
    """
    A regular grid and where on it each row lies.

    Attributes
    ----------
    kind : str
        'regular' or 'jittered'.
    period, origin : float
        Seconds.
    index : ndarray of int64, shape (n,)
        Strictly increasing; a jump of more than one means lost rows.
    jitter : float
        Standard deviation of the times about the grid, s.

    """

    kind: str
    period: float
    origin: float
    index: np.ndarray
    jitter: float

    @property
    def times(self):
        """Return the grid's time of each row, s."""
        return self.origin + self.period * self.index


def find_grid(time):
    """
    Find the regular grid behind times.

    Parameters
    ----------
    time : ndarray, shape (n,)
        Finite, not decreasing, s.

    Returns
    -------
    Grid or None
        None when there is none: the times are irregular, or too few to tell.

    """
    step = np.diff(time)
    if step.size < 2 or not np.any(step > 0.0):
        return None
    return _regular(time, step) or _jittered(time, step)


def _regular(time, step):
    period = float(np.median(step))
    if period <= 0.0 or time[-1] - time[0] > _LONGEST * period:
        return None
    single = np.abs(step - period) < 0.5 * period
    if not single.any():
        return None
    period = float(np.mean(step[single]))
    count = np.maximum(np.rint(step / period), 1.0)
    # After a long gap the sampler may have started anew, at any phase.
    off = np.abs(step - count * period)[count <= _LONG_GAP]
    if off.size and off.max() > _ROUNDING * period:
        return None
    index = np.concatenate(([0], np.cumsum(count).astype(np.int64)))
    residual = time - (time[0] + period * index)
    inner = residual[:1 + int(np.argmax(count > _LONG_GAP))] if count.max() > _LONG_GAP \
        else residual
    if np.abs(inner).max() > 0.5 * period:
        return None
    return Grid('regular', period, float(time[0]), index, float(np.std(inner)))


def _lowest(values, window):
    """Return the minimum of each run of `window` values, shape (n - window + 1,)."""
    return np.lib.stride_tricks.sliding_window_view(values, window).min(axis=1)


def _lost(time, step, period, window):
    """
    Return how many rows are missing before each row but the first.

    A delay that recovers leaves the lower envelope of the times where it was; a lost row lifts it
    for good by one period, over a short window as over a long one.

    """
    lost = np.zeros(step.size, dtype=np.int64)
    # Times with too few digits stand still and jump: nothing can be said about single rows.
    if np.mean(step <= 0.0) > 0.2:
        return lost
    short = max(window // 5, 2)
    candidates = np.flatnonzero(step > 1.5 * period) + 1
    # The envelopes need a window of rows on each side.
    candidates = candidates[(candidates >= window) & (candidates <= time.size - window)]
    for _ in range(8):
        residual = time - period * np.arange(time.size)
        residual[1:] -= period * np.cumsum(lost)
        lift = np.full(candidates.size, np.inf)
        for width in (short, window):
            envelope = _lowest(residual, width)
            lift = np.minimum(lift, envelope[candidates] - envelope[candidates - width])
        found = candidates[lift > 0.6 * period]
        if not found.size:
            break
        # Rows just after a loss seem lifted too: only the widest step of a neighbourhood counts.
        size = np.rint(lift[lift > 0.6 * period] / period).astype(np.int64)
        order = np.argsort(-step[found - 1], kind='stable')
        taken = np.zeros(time.size, dtype=bool)
        for each in order:
            if not taken[found[each]]:
                lost[found[each] - 1] += size[each]
                taken[max(found[each] - window, 0):found[each] + window] = True
    return lost


def _line(index, time):
    """Return origin and period of a line through the times, not drawn up by late arrivals."""
    keep = np.ones(time.size, dtype=bool)
    for _ in range(4):
        period, origin = np.polyfit(index[keep], time[keep], 1)
        residual = time - origin - period * index
        middle = np.median(residual)
        spread = 1.5 * np.median(np.abs(residual - middle))
        keep = np.abs(residual - middle) <= 3.0 * max(spread, 1e-9 * period)
    return float(origin), float(period), residual


def _jittered(time, step):
    window = min(_WINDOW, time.size // 4)
    if window < 5:
        return None
    period = float(np.median(time[window:] - time[:-window])) / window
    if period <= 0.0 or time[-1] - time[0] > _LONGEST * period:
        return None
    index = np.concatenate(([0], np.cumsum(1 + _lost(time, step, period, window))))
    origin, period, residual = _line(index, time)
    walk = np.var(step - period * np.diff(index)) * time.size / 6.0
    if period <= 0.0 or np.var(residual) > _BOUNDED * walk:
        return None
    return Grid('jittered', period, origin, index, float(np.std(residual)))
