# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What counts of a channel some rows of which nobody measured.

A sensor that is read less often than the command, or a message that was lost, leaves rows that
preflight fills in by straight lines.  Those are no measurement: of a device that moves fast they
are wrong by far more than the noise, and they hold none of it.  What is wrong with a simulation is
looked for in the rows that were measured; between them, where a value is needed at all, it is
wrong by the line between these.
"""

from __future__ import annotations

from collections.abc import Mapping
import math

import numpy as np

from piezo_stack_sim.recording.recording import Recording

SELDOM = 0.6  # part of the rows that were measured, up to which the sensor is a slower one


def stride(recording: Recording, channel: str) -> int:
    """Return every how many rows a channel was measured: 1 where only some of them are lost."""
    told = recording.told(channel)
    if told is None:
        return 1
    part = float(np.mean(told))
    return max(int(round(1.0 / part)), 1) if 0.0 < part < SELDOM else 1


def wrong(recording: Recording, channel: str, simulated: np.ndarray) -> np.ndarray:
    """Return measured less simulated (n,), in SI units; in rows that were filled in, by a line."""
    error = recording.measured[channel] - simulated
    told = recording.told(channel)
    if told is None:
        return error
    rows = np.flatnonzero(told)
    return np.interp(np.arange(error.size), rows, error[rows])


def series(recording: Recording, channel: str, simulated: np.ndarray
           ) -> tuple[np.ndarray, float]:
    """
    Return what is wrong with a channel in the rows that were measured, (k,), and their period (s).

    Rows that were lost are left out: filled in they would hold less of the noise.
    """
    error = recording.measured[channel] - simulated
    told = recording.told(channel)
    every = stride(recording, channel)
    return error if told is None else error[told], every * recording.period


def scarcity(recording: Recording, channel: str, factor: int) -> float:
    """
    Return how many times the noise an average over ``factor`` rows has for those that were lost.

    In its standard deviation, over all averages; each is over the rows that were measured.
    """
    told = recording.told(channel)
    if told is None or factor == 1 or stride(recording, channel) > 1:
        return 1.0
    m = told.size // factor
    part = told[:m * factor].reshape(m, factor).mean(axis=1)
    return math.sqrt(float(np.mean(1.0 / part[part > 0.0]))) if part.any() else 1.0


def refilled(recording: Recording, simulated: Mapping[str, np.ndarray]) -> Recording:
    """
    Return a recording with the rows that nobody measured filled in by what a simulation tells.

    Parameters
    ----------
    recording : Recording
        After preflight.
    simulated : dict
        Channel to (n,) array, SI units.

    """
    if not recording.filled:
        return recording
    return recording.replace(measured={
        channel: simulated[channel] + wrong(recording, channel, simulated[channel])
        if channel in recording.filled else values
        for channel, values in recording.measured.items()})
