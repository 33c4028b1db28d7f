# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Playing to a device in lockstep: every command brings the next tick, exactly repeatable."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress

import numpy as np
from piezo_stack_sim.errors import InputError
from piezo_stack_sim.node.excite_link import Link

# Commands on their way at once. A topic keeps their order, and the device's depth is greater.
WINDOW = 64
BLOCK = 200  # rows handed on at once

Sink = Callable[[list[tuple[float, ...]]], None]


def never() -> bool:
    """Tell that nobody wants to stop."""
    return False


class LockstepPlayer:
    """
    Plays commands tick by tick.

    Parameters
    ----------
    link : Link
        A device in lockstep.

    Attributes
    ----------
    rate : float
        Ticks a second of device time (Hz).
    present : dict of str to float
        The newest sample by channel (SI).
    sent : tuple of (float, float) or None
        The newest command (V or C) and force (N).

    """

    def __init__(self, link: Link) -> None:
        self._link = link
        self.rate: float = link.rate or 1000.0
        self._stamp: float | None = None  # of the newest tick; None when it is not known
        self._force = 0.0
        self.present: dict[str, float] = {}
        self.sent: tuple[float, float] | None = None

    def prepare(self) -> None:
        """Step the device until every topic is connected, and no message is on its way."""
        link = self._link
        link.call('pause', data=True)
        try:
            self._connect()
        except BaseException:
            with suppress(InputError):  # the first fault is the one to tell
                link.call('pause', data=False)
            raise
        self._take()
        link.call('pause', data=False)
        self._drain()

    def _connect(self) -> None:
        link = self._link
        clean = 0
        for _ in range(50):
            link.drain(0.02)
            link.call('step')
            try:
                link.wait(lambda: all(link.heard.values()), 'silent', 0.3)
            except InputError:
                clean = 0
                continue
            clean += all(len(heard) == 1 for heard in link.heard.values())
            if clean > 1:
                return
        raise InputError(f'{link.device}: its topics do not connect')

    def reset(self, command: float) -> None:
        """Relax the device; one tick at a command (V or C) gives the first sample."""
        self._stamp = None
        self._link.call('reset')
        self._drain()
        self._stamp = 0.0
        self.play(np.array([command]), np.zeros(1), None, never)

    def _drain(self) -> None:
        """Forget what has arrived: where it does not end, somebody else steps the device."""
        if not self._link.drain():
            raise self._foreign()

    def _take(self) -> None:
        """Take the sample of one tick from the queues."""
        link = self._link
        tick = {name: heard.popleft() for name, heard in link.heard.items()}
        self._stamp = tick['tick'].stamp
        self.present = {name: tick[link.source(name)].value for name in link.channels}

    def play(self, commands: np.ndarray, forces: np.ndarray, sink: Sink | None,
             stopped: Callable[[], bool]) -> int:
        """
        Play commands; each row is sampled just before its command takes effect.

        Parameters
        ----------
        commands, forces : ndarray, shape (n,)
            V or C; N.
        sink : callable, optional
            Takes rows (time in s, command, force, then the link's channels).
        stopped : callable
            Asked before each command.

        Returns
        -------
        int
            How many commands were played.

        Raises
        ------
        InputError
            If the device stops answering, or somebody else steps it.

        """
        link, heard = self._link, list(self._link.heard.values())
        # Force and command travel on two topics: what both bring waits for its answer.
        window = 1 if np.any(forces != self._force) else WINDOW
        steps_by_force = link.drive in ('open', 'shorted')
        sent, got, rows = 0, 0, []
        while got < len(commands):
            while sent < len(commands) and sent - got < window and not stopped():
                force = float(forces[sent])
                changed = steps_by_force or force != self._force
                link.send(float(commands[sent]), force if changed else None)
                self._force = force
                self.sent = float(commands[sent]), force
                sent += 1
            if sent == got:
                break
            link.wait(lambda: all(heard), f'{link.device} stopped answering')
            rows.append((got / self.rate, float(commands[got]), float(forces[got]),
                         *self.present.values()))
            before = self._stamp
            self._take()
            got += 1
            skipped = before is not None and self._stamp is not None and (
                abs((self._stamp - before) * self.rate - 1.0) > 0.01)
            if skipped or any(len(each) > sent - got for each in heard):
                raise self._foreign()
            if sink is not None and (len(rows) >= BLOCK or got == len(commands)):
                sink(rows)
                rows = []
        if sink is not None:
            if rows:
                sink(rows)
            # A tick that somebody else brought took the place of one that is still to come.
            if not link.settle(lambda: any(heard)):
                raise self._foreign()
        return got

    def _foreign(self) -> InputError:
        return InputError(f'{self._link.device}: ticks that were not commanded here, the '
                          'recording is wrong; stop whatever else commands or steps it')
