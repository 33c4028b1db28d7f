# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a figure of the paper is here: a drawing, and the numbers that prove what it shows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from piezo_stack_sim.plant import Device, simulate
from piezo_stack_sim.plant.analysis import voltage_row


@dataclass(frozen=True)
class Number:
    """A number computed with the figure: SI units, and what it proves."""

    name: str
    value: float
    unit: str
    proves: str
    digits: int = 4


@dataclass(frozen=True)
class Figure:
    """
    One figure of the paper.

    ``says`` is what the paper says of it, ``note`` what a reader of ours should know besides;
    ``draw`` takes a `Setting` and returns a matplotlib figure and its list of `Number`.
    """

    name: str
    title: str
    says: str
    draw: Callable[[Setting], tuple[Any, list[Number]]]
    note: str = ''


@dataclass(frozen=True)
class Setting:
    """The device of all figures, and how far it is driven: the paper's 90 V if it can take it."""

    device: Device
    peaks: tuple[float, ...]  # V, ascending
    squeeze: float  # N

    @classmethod
    def of(cls, device: Device) -> Setting:
        """Return the paper's voltages and force, or less where the actuator takes less."""
        peak = min(90.0, device.actuator.voltage_range[1])
        squeeze = min(200.0, 0.5 * voltage_row(device, peak).blocked_force)
        return cls(device, (peak / 3.0, 2.0 * peak / 3.0, peak), squeeze)


@dataclass(frozen=True)
class Run:
    """A simulated test: times (s), what was commanded (V or N) and the `Response`."""

    time: np.ndarray
    command: np.ndarray
    response: Any

    @property
    def held(self) -> np.ndarray:
        """Return what acted when each row was sampled: the command of the row before."""
        return np.concatenate([self.command[:1], self.command[:-1]])

    def cycle(self, rows: int) -> slice:
        """Return the rows of the last cycle of so many rows, its first row repeated at the end."""
        return slice(self.time.size - rows - 1, self.time.size)


def triangle(setting: Setting, peak: float, frequency: float = 100.0, cycles: int = 3,
             rows: int = 1000) -> Run:
    """Play a triangle from zero from the relaxed state, with so many rows a cycle."""
    phase = np.arange(cycles * rows + 1) / rows
    command = peak * (1.0 - np.abs(phase % 1.0 * 2.0 - 1.0))
    time = phase / frequency
    return Run(time, command, simulate(setting.device, time, command, drive='voltage'))


def squeeze(setting: Setting, drive: str, frequency: float = 10.0, cycles: int = 3,
            rows: int = 2000) -> Run:
    """Squeeze by a raised cosine from the relaxed state, leads ``open`` or ``shorted``."""
    phase = np.arange(cycles * rows + 1) / rows
    force = -0.5 * setting.squeeze * (1.0 - np.cos(2.0 * np.pi * phase))
    time = phase / frequency
    still = np.zeros(time.size)
    return Run(time, force, simulate(setting.device, time, still, force, drive=drive))


def width_at_equal(x, y) -> float:
    """
    Return the largest vertical distance of the two branches of a closed loop.

    Parameters
    ----------
    x, y : array_like, shape (n,)
        One cycle; ``x`` rises to its largest value and falls again.

    Returns
    -------
    float
        In the unit of ``y``.

    """
    x, y = np.asarray(x), np.asarray(y)
    top = int(np.argmax(x))
    up_x, up_y = x[:top + 1], y[:top + 1]
    down_x, down_y = x[top:][::-1], y[top:][::-1]
    inner = np.linspace(max(up_x[0], down_x[0]), x[top], 2001)
    return float(np.abs(np.interp(inner, up_x, up_y) - np.interp(inner, down_x, down_y)).max())
