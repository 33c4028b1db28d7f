# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Playing to a device that keeps its own time: a steady clock here, stamps from there."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable
import time

import numpy as np
from piezo_stack_sim.errors import InputError
from piezo_stack_sim.node.excite_link import Heard, Link
from piezo_stack_sim.node.excite_lockstep import Sink
from piezo_stack_sim.node.schedule import day_ahead, SECOND

BLOCK = 100  # rows handed on at once
_SAME_CLOCK = 0.05  # s; stamps this close to the clock of the day here are taken from it
# A command is sent this part of a period after a tick, early enough for a slow way.
_PHASE = 0.3
_OBSERVED = 30  # ticks from which rate and clock of the device are learnt


class WallPlayer:
    """
    Plays commands at a rate, and finds out from stamps which one each sample belongs to.

    Parameters
    ----------
    link : Link
        A device that runs by itself.
    rate : float, optional
        Commands a second (Hz); the device's own rate if not given.

    Attributes
    ----------
    rate : float
        Commands a second (Hz).
    present : dict of str to float
        The newest sample by channel (SI).
    sent : tuple of (float, float) or None
        The newest command (V or C) and force (N).

    """

    def __init__(self, link: Link, rate: float | None = None) -> None:
        self._link = link
        self.rate = rate or 0.0
        self._period = 0.0  # s between two ticks of the device
        self._offset = 0.0  # s from a stamp to the steady clock here
        self._force = 0.0
        self.present: dict[str, float] = {}
        self.sent: tuple[float, float] | None = None
        self._ticks: list[Heard] = []  # not yet made into rows
        self._last: Heard | None = None  # the newest that was
        self._leads: dict[str, bool] = {}  # channels that are sent before their tick
        self._times: list[float] = []  # when the commands of this play were sent
        self._start: float | None = None

    def prepare(self) -> None:
        """Listen for a while: the rate of the device, its clock, where it stands."""
        link = self._link
        ticks = link.heard['tick']
        link.wait(lambda: len(ticks) >= _OBSERVED,
                  f'{link.device} sends no samples; if it is paused, call '
                  f'{link.device}/pause with false')
        stamps = np.array([tick.stamp for tick in ticks])
        steps = np.diff(stamps)
        usual = float(np.median(steps))
        if usual <= 0.0:
            raise InputError(f'{link.device}: its stamps stand still or go backwards')
        # Jitter averages out over all of them; a lost sample makes a step of two periods.
        self._period = float(np.sum(steps) / max(np.sum(np.rint(steps / usual)), 1.0))
        # The message that came fastest tells best how far the two clocks are apart.
        self._offset = float(min(tick.arrived - tick.stamp for tick in ticks))
        here = (link.epoch * SECOND - day_ahead()) / SECOND
        if 0.0 <= self._offset - here < _SAME_CLOCK:
            self._offset = here  # the clock of this host; the rest was the message's way
        # Stamps jitter; a command need not come with a tick, so that a round rate will do.
        self.rate = self.rate or link.rate or float(f'{1.0 / self._period:.3g}')
        for name, heard in link.heard.items():
            self._leads[name] = self._is_before(heard, stamps.size)
        self._observe()
        self._forget()

    def _is_before(self, heard, count: int) -> bool:
        """Tell whether the values of a topic come closely before a tick, or closely after it."""
        ticks = np.array([tick.arrived for tick in self._link.heard['tick']])
        gaps = [np.min(ticks[ticks > h.arrived] - h.arrived, initial=self._period)
                for h in list(heard)[:count]]
        return not gaps or float(np.median(gaps)) < 0.5 * self._period

    def _forget(self) -> None:
        for heard in self._link.heard.values():
            heard.clear()

    def _observe(self) -> None:
        for channel in self._link.channels:
            heard = self._link.heard[self._link.source(channel)]
            if heard:
                self.present[channel] = heard[-1].value

    def reset(self, command: float) -> None:
        """Relax a virtual device and let it rest for some ticks."""
        self._link.call('reset')
        end = time.monotonic() + max(0.1, 5.0 * self._period)
        self._link.wait(lambda: time.monotonic() > end, '')
        self._observe()

    def play(self, commands: np.ndarray, forces: np.ndarray, sink: Sink | None,
             stopped: Callable[[], bool]) -> int:
        """
        Play commands at the rate, as `LockstepPlayer.play` does tick by tick.

        A command that is late is never made up for by two at once, which would
        exceed a slew limit: the rest comes later, and the recording tells when.

        Returns
        -------
        int
            How many commands were played.

        """
        link, period = self._link, 1.0 / self.rate
        self._forget()
        self._ticks, self._times, self._start, self._last = [], [], None, None
        heard, rows = time.monotonic(), []
        deadline = self._first_deadline()
        for k in range(len(commands)):
            while (now := time.monotonic()) < deadline:
                link.spin(min(deadline - now, 0.05))
            if stopped():
                break
            force = float(forces[k])
            link.send(float(commands[k]), force if force != self._force else None)
            self._force = force
            self.sent = float(commands[k]), force
            self._times.append(now)
            deadline += period if now - deadline < 0.5 * period else period + now - deadline
            if link.heard['tick']:
                heard = now
            elif now - heard > link.patience:
                raise InputError(f'{link.device} stopped sending samples')
            rows += self._rows(commands, forces)
            if sink is not None and len(rows) >= BLOCK:
                sink(rows)
                rows = []
        # The last command holds for its period; its samples, and two more that close the last.
        end = time.monotonic() + period + max(3.0 * self._period, 0.05)
        link.wait(lambda: time.monotonic() > end, '')
        rows += self._rows(commands, forces)
        if sink is not None and rows:
            sink(rows)
        return len(self._times)

    def _first_deadline(self) -> float:
        """Return a time well between two ticks, where no command races with a tick."""
        now = time.monotonic() + 2.0 / self.rate
        newest = self._link.heard['tick'][-1].stamp if self._link.heard['tick'] else 0.0
        phase = (now - newest - self._offset) / self._period
        return now + (_PHASE - phase) % 1.0 * self._period

    def _rows(self, commands: np.ndarray, forces: np.ndarray) -> list[tuple[float, ...]]:
        """Return the rows of all ticks whose neighbours have arrived too."""
        link = self._link
        queue = link.heard['tick']
        while queue:
            self._ticks.append(queue.popleft())
        rows = []
        while len(self._ticks) > 2:
            tick, after = self._ticks[0], self._ticks[1]
            before, self._last = self._last, self._ticks.pop(0)
            moment = tick.stamp + self._offset
            sample = {name: tick.value if link.source(name) == 'tick'
                      else self._nearest(name, tick, before, after) for name in link.channels}
            self.present.update({n: v for n, v in sample.items() if v == v})
            k = bisect_right(self._times, moment) - 1
            if k < 0 or moment > self._times[-1] + 1.0 / self.rate:
                continue
            if self._start is None:
                self._start = tick.stamp
            rows.append((tick.stamp - self._start, float(commands[k]), float(forces[k]),
                         *sample.values()))
        return rows

    def _nearest(self, channel: str, tick: Heard, before: Heard | None, after: Heard) -> float:
        """Take the value that was sent with a tick; NaN if it was lost."""
        heard = self._link.heard[channel]
        # What one device sends arrives in order: values stand before their tick, or after it.
        first, last = ((before.number if before else -1, tick.number) if self._leads[channel]
                       else (tick.number, after.number))
        found = float('nan')
        while heard and heard[0].number < last:
            value = heard.popleft()
            if value.number > first:
                found = value.value
        return found
