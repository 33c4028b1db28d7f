# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a device does with a command: take it, clamp it, or refuse it, and count."""

from __future__ import annotations

from dataclasses import dataclass, field
import math
from typing import Callable

# Beyond these no stack lives; they only keep absurd numbers finite.
LARGEST_CHARGE = 1.0  # C
LARGEST_FORCE = 1.0e6  # N

COMMAND_UNITS = {'voltage': 'V', 'charge': 'C'}


@dataclass
class Tally:
    """How often each thing happened, with the latest occasion of each in words."""

    counts: dict[str, int] = field(default_factory=lambda: {
        'refused_not_finite': 0, 'refused_inactive_port': 0, 'clamped': 0})
    latest: dict[str, str] = field(default_factory=dict)

    def note(self, what: str, text: str) -> None:
        """Count one more of `what`."""
        self.counts[what] += 1
        self.latest[what] = text


class News:
    """
    Passes on what is new in a tally as log lines, one for each kind of event.

    However many events there are, asked once a second it logs once a second.

    Parameters
    ----------
    tally : Tally
        Counts to watch.
    log : callable
        Takes one line of text.

    """

    def __init__(self, tally: Tally, log: Callable[[str], object]) -> None:
        self._tally = tally
        self._log = log
        self._told = dict(tally.counts)

    def tell(self) -> list[str]:
        """Log what is new; return the lines."""
        lines = []
        for what, count in self._tally.counts.items():
            fresh = count - self._told[what]
            if fresh:
                times = f' ({fresh} times)' if fresh > 1 else ''
                lines.append(f'{self._tally.latest[what]}{times}')
                self._log(lines[-1])
        self._told = dict(self._tally.counts)
        return lines


class CommandIntake:
    """
    The inputs of a device: the command of the active port, and the external force.

    Attributes
    ----------
    command : float or None
        The newest command taken (V or C), to act from the next tick; None
        holds the terminals as they are.
    force : float
        External force (N).
    tally : Tally
        What was refused and clamped.

    """

    def __init__(self, drive: str, voltage_range: tuple[float, float]) -> None:
        self.tally = Tally()
        self._limits = {'voltage': voltage_range, 'charge': (-LARGEST_CHARGE, LARGEST_CHARGE)}
        self.drive = drive
        self.clear()

    def clear(self) -> None:
        """Forget command and force, as after power-up."""
        self.command: float | None = None
        self.force = 0.0

    def switch(self, drive: str) -> None:
        """Listen to another port; the terminals stay as they are until its first command."""
        self.drive = drive
        self.command = None

    @property
    def force_is_the_input(self) -> bool:
        """Whether the external force is all that acts: leads open or shorted."""
        return self.drive not in COMMAND_UNITS

    def take_command(self, port: str, value: float) -> bool:
        """
        Take a command for a port, ``voltage`` (V) or ``charge`` (C).

        Returns
        -------
        bool
            False if it was refused: the device goes on as if it had never been sent.

        """
        if port != self.drive:
            self.tally.note('refused_inactive_port',
                            f'{port}_command refused: the drive is {self.drive}; '
                            f'set the parameter drive to {port} first')
            return False
        low, high = self._limits[port]
        if low <= value <= high:
            self.command = value
            return True
        if not math.isfinite(value):
            self.tally.note('refused_not_finite', f'{port}_command {value} refused: not finite')
            return False
        self.command = low if value < low else high
        unit = COMMAND_UNITS[port]
        self.tally.note('clamped', f'{port}_command {value:g} {unit} clamped to '
                                   f'{self.command:g} {unit}')
        return True

    def take_force(self, value: float) -> bool:
        """Take an external force (N); False if it was refused."""
        if -LARGEST_FORCE <= value <= LARGEST_FORCE:
            self.force = value
            return True
        if not math.isfinite(value):
            self.tally.note('refused_not_finite', f'external_force {value} refused: not finite')
            return False
        self.force = math.copysign(LARGEST_FORCE, value)
        self.tally.note('clamped', f'external_force {value:g} N clamped to {self.force:g} N')
        return True


class Watchdog:
    """
    Notices when commands stop coming; the device then holds the last one.

    It counts device time, which stands still in a pause, and starts with the
    first command: a device that nobody has commanded yet misses nobody.

    """

    def __init__(self, timeout: float, rate: float) -> None:
        self._rate = rate
        self.expired = False
        self._last: int | None = None
        self.set_timeout(timeout)

    def set_timeout(self, timeout: float) -> None:
        """Change the time without a command (s) that is still in order; 0 disables."""
        self._ticks = math.inf if timeout <= 0.0 else max(1, math.ceil(timeout * self._rate))
        self.timeout = timeout
        self.expired = False

    def feed(self, tick: int) -> None:
        """Note a command at a tick."""
        self._last = tick
        self.expired = False

    def clear(self) -> None:
        """Forget that there ever was a command."""
        self._last = None
        self.expired = False

    def check(self, tick: int) -> bool:
        """Return True once, when the commands have just run out."""
        if self.expired or self._last is None or tick - self._last < self._ticks:
            return False
        self.expired = True
        return True
