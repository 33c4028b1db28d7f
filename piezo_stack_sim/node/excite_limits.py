# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a test may do to a device: limits of voltage, slew and current, and ramps within them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
import math

import numpy as np
from piezo_stack_sim.errors import InputError
from piezo_stack_sim.recording.playable import require_finite
from piezo_stack_sim.recording.recording import Recording

RAMP_TIME = 0.5  # s for the whole voltage range, when no slew limit is given
_ROUNDING = 1.0 + 1e-9


@dataclass(frozen=True)
class Limits:
    """
    Limits of a test on a device driven by voltage; None is no limit.

    Attributes
    ----------
    voltage : (float, float), optional
        Lowest and highest command (V).
    slew : float, optional
        Greatest change of the command in a second (V/s).
    current : float, optional
        Greatest current (A).
    capacitance : float or callable, optional
        Charge that a volt moves at most (F), turns the current into a slew; or a function that
        returns it for the highest voltage (V) that is reached.

    """

    voltage: tuple[float, float] | None = None
    slew: float | None = None
    current: float | None = None
    capacitance: float | Callable[[float], float] | None = None

    def __post_init__(self) -> None:
        """Refuse limits that make no sense."""
        if self.voltage and not all(map(math.isfinite, self.voltage)):
            raise InputError(f'--voltage-limits {self.voltage[0]:g} {self.voltage[1]:g}: expected '
                             'finite numbers; leave it out where there is no limit')
        if self.voltage and not self.voltage[0] < self.voltage[1]:
            raise InputError(f'--voltage-limits {self.voltage[0]:g} {self.voltage[1]:g}: expected '
                             'the lower one first')
        for name in ('slew', 'current', 'capacitance'):
            value = getattr(self, name)
            if isinstance(value, (int, float)) and not 0.0 < value < float('inf'):
                raise InputError(f'--{name} {value:g}: expected a positive number')
        if self.current is not None and self.capacitance is None:
            raise InputError('--current: add --params YAML or --capacitance F, which tell what '
                             'current a change of voltage takes')

    @property
    def safe(self) -> float:
        """Return where a device is left (V): zero, or the allowed one nearest to it."""
        return min(max(0.0, self.voltage[0]), self.voltage[1]) if self.voltage else 0.0

    def fastest(self, peak: float) -> float | None:
        """Return the slew (V/s) that slew and current limits allow together up to a peak (V)."""
        slews = [] if self.slew is None else [self.slew]
        if self.current is not None:
            slews.append(self.current / self._farads(peak))
        return min(slews, default=None)

    def _farads(self, peak: float) -> float:
        if callable(self.capacitance):
            return self.capacitance(peak)
        return float(self.capacitance or 0.0)

    def enforce(self, recording: Recording, clip: bool) -> tuple[Recording, list[str]]:
        """
        Return a programme that keeps the limits, and what was clipped, in words.

        Parameters
        ----------
        recording : Recording
            Evenly sampled commands (V).
        clip : bool
            Whether to clip what exceeds the limits instead of refusing it.

        Raises
        ------
        InputError
            When the programme exceeds a limit and is not to be clipped, or has a command or a
            force that is no finite number, clipped or not.

        """
        require_finite(recording)  # NaN exceeds no limit, whatever a driver makes of it
        command, remarks = np.array(recording.command), []
        period = recording.period
        if self.voltage:
            low, high = float(command.min()), float(command.max())
            if low < self.voltage[0] or high > self.voltage[1]:
                remarks.append(f'{recording.name}: {low:g} to {high:g} V exceeds the limits '
                               f'{self.voltage[0]:g} to {self.voltage[1]:g} V')
                command = np.clip(command, *self.voltage)
        peak = float(np.abs(command).max())
        fastest = self.fastest(peak)
        if fastest is not None:
            # A command changes in steps; what counts is its change from row to row.
            slew = float(np.abs(np.diff(command)).max()) / period
            if slew > fastest * _ROUNDING:
                why = (f'the slew limit {fastest:g} V/s' if fastest == self.slew else
                       f'{fastest:g} V/s, the current limit {self.current:g} A at '
                       f'{self._farads(peak):.3g} F')
                remarks.append(f'{recording.name}: {slew:g} V/s exceeds {why}')
                command = _follow(command, fastest * period)
        if remarks and not clip:
            raise InputError(f'{remarks[0]}: choose a gentler programme, other limits, or --clip')
        return (recording.replace(command=command) if remarks else recording), remarks

    def ramp(self, begin: float, end: float, rate: float, time: float = RAMP_TIME) -> np.ndarray:
        """
        Return the commands (V) that lead from one voltage to another, the last one included.

        Parameters
        ----------
        begin, end : float
            V; nothing when they are equal.
        rate : float
            Commands a second (Hz).
        time : float
            Duration when no slew is limited, s.

        """
        distance = abs(end - begin)
        if distance == 0.0:
            return np.empty(0)
        fastest = self.fastest(max(abs(begin), abs(end)))
        duration = time if fastest is None else max(time, distance / fastest)
        count = max(1, int(np.ceil(duration * rate / _ROUNDING)))
        return begin + (end - begin) * np.arange(1, count + 1) / count


def _follow(command: np.ndarray, step: float) -> np.ndarray:
    """Return the command as followed by a source that changes by at most `step` a row."""
    followed = np.empty_like(command)
    value = followed[0] = command[0]
    for k in range(1, command.size):
        value += min(max(command[k] - value, -step), step)
        followed[k] = value
    return followed
