# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Deadlines on the steady clock: no drift, no time lost, however late a tick comes."""

from __future__ import annotations

import time

NEVER = 2**63 - 1  # ns; later than any deadline
SECOND = 1_000_000_000  # ns
TOGETHER = 20_000  # ns within which two clocks are read at once
READINGS = 10  # of both clocks, at most
PUNCTUAL = 500_000  # ns; a tick within half a millisecond of its deadline is on time


def day_ahead() -> int:
    """Return how far the clock of the day is ahead of the steady one, in ns."""
    for _ in range(READINGS):
        before = time.monotonic_ns()
        day = time.time_ns()
        # Who is put aside in between, as happens on a busy machine, would tear the two apart.
        if time.monotonic_ns() - before < TOGETHER:
            break
    return day - before


class Schedule:
    """
    Absolute deadlines at a fixed rate.

    Deadline n is ``origin + n / rate``, computed anew from n, so that errors
    never add up. What the clock of the day or ``/clock`` do has no influence.

    Parameters
    ----------
    rate : float
        Deadlines per second (Hz).

    Attributes
    ----------
    deadline : int
        The next deadline (ns on ``time.monotonic_ns``), `NEVER` while stopped.
    ticks, late, tardy : int
        Deadlines met so far; those met a whole period or more too late; those
        met later than `PUNCTUAL`.
    worst : int
        Greatest lateness (ns) since `worst` was last set to zero.
    trace : list of int, optional
        Where the benchmark wants the lateness (ns) of each tick noted.

    """

    trace: list[int] | None = None

    def __init__(self, rate: float) -> None:
        self._period = SECOND / rate
        self._origin = 0
        self._n = 0
        self.deadline = NEVER
        self.ticks = self.late = self.tardy = self.worst = 0

    def start(self, origin: int | None = None) -> None:
        """Begin: the first deadline lies one period after `origin` (ns), by default now."""
        self._origin = time.monotonic_ns() if origin is None else origin
        self._n = 1
        self.deadline = self._origin + round(self._period)

    def stop(self) -> None:
        """Have no deadlines until the next start; the time between is not caught up."""
        self.deadline = NEVER

    def backlog(self, now: int) -> int:
        """Return how many deadlines have passed at `now` (ns), the next one included."""
        return max(0, int((now - self._origin) / self._period) - self._n + 1)

    def advance(self, now: int, count: int = 1) -> None:
        """Note that `count` deadlines were met at `now` (ns); move on to the one after."""
        lateness = now - self.deadline
        if self.trace is not None:
            self.trace.append(lateness)
        self._n += count
        self.deadline = self._origin + round(self._n * self._period)
        self.ticks += count
        if lateness > self.worst:
            self.worst = lateness
        # The first of a backlog is the latest one; each next one is a period less late.
        if lateness > PUNCTUAL:
            self.tardy += min(count, int((lateness - PUNCTUAL) / self._period) + 1)
        if lateness >= self._period:
            self.late += min(count, int(lateness / self._period))
