# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""The controllers of the closed-loop examples: a constant gain, and PI on the displacement."""

from __future__ import annotations

from piezo_stack_sim.examples.experiment import Controller


def constant_gain(gain: float) -> Controller:
    """
    Return an open-loop controller that takes the stack for linear.

    Parameters
    ----------
    gain : float
        Displacement per command (m/V or m/C).

    """
    def control(wanted: float, wanted_next: float, measured: float) -> float:
        return wanted_next / gain
    return control


class ProportionalIntegral:
    """
    PI control of the displacement.

    At a kilohertz the stack, which resonates above 20 kHz, is a gain and a
    delay. With a delay of one sample an integral that makes up for half of the
    error in each sample is fast and well damped; a longer one asks for less.

    Parameters
    ----------
    gain : float
        Displacement per command (m/V or m/C).
    delay : int
        Samples until a command shows.
    limits : tuple of float
        Lowest and highest command (V or C): the integral stops there instead
        of winding up.

    """

    PROPORTIONAL, INTEGRAL = 0.1, 0.5  # of the error, in each sample

    def __init__(self, gain: float, delay: int, limits: tuple[float, float]) -> None:
        self._kp = self.PROPORTIONAL / gain / delay ** 2
        self._ki = self.INTEGRAL / gain / delay ** 2
        self._limits = limits
        self._integral = 0.0

    def __call__(self, wanted: float, wanted_next: float, measured: float) -> float:
        """Return the command that answers a sample."""
        error = wanted - measured
        self._integral = self._limited(self._integral + self._ki * error)
        return self._limited(self._integral + self._kp * error)

    def _limited(self, command: float) -> float:
        low, high = self._limits
        return min(max(command, low), high)
