# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Recordings made ready for comparison: thinned, weighted by their noise, split in two.

Every row keeps its place in time, because hysteresis remembers; what is
withheld from a fit are stretches of rows, alternating along each recording.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from piezo_stack_sim.gap.noise import ChannelNoise, estimate_noise
from piezo_stack_sim.recording.recording import Recording

CHANNELS = ('voltage', 'charge', 'displacement')
ROWS = 7500  # a recording is averaged down to at most about this many rows
RESTING_ROWS = 3000  # one whose command mostly rests, to this many
STRETCHES = 20  # alternating stretches that are fitted and withheld


@dataclass(frozen=True)
class Track:
    """
    One recording as the comparison sees it.

    Attributes
    ----------
    recording : Recording
        All rows, SI units.
    factor : int
        Neighbouring rows that are averaged into one.
    measured : dict of str to ndarray, shape (m,)
        Averaged measurements.
    sigma : dict of str to float
        Standard deviation of the noise of an averaged value.
    zero : dict of str to float
        Standard deviation with which the zero of the sensor is known: it was
        read off a single row.
    fitted : ndarray of bool, shape (m,)
        The rows that a fit may see; the others are withheld from it.

    """

    recording: Recording
    factor: int
    measured: dict[str, np.ndarray]
    sigma: dict[str, float]
    zero: dict[str, float]
    fitted: np.ndarray

    @property
    def channels(self) -> tuple[str, ...]:
        """Return the measured channels, in a fixed order."""
        return tuple(self.measured)

    def average(self, values: np.ndarray) -> np.ndarray:
        """Average (n,) values over neighbouring rows to (m,)."""
        return average(values, self.factor)

    def weighted(self, channel: str, simulated: np.ndarray) -> np.ndarray:
        """
        Return measured less simulated over the noise, (m,), white for a noisy zero as well.

        The sum of squares is that of noise whose mean is known to ``zero`` only:
        no fit needs to know of the sensor's zero, and an offset that no single
        row's noise can make still counts.
        """
        wrong = self.measured[channel] - self.average(simulated)
        return self.unbiased(channel, wrong) / self.sigma[channel]

    def unbiased(self, channel: str, wrong: np.ndarray) -> np.ndarray:
        """Return averaged errors (m,), SI units, with the mean weighed by how it is known."""
        known = 1.0 + wrong.size * (self.zero[channel] / self.sigma[channel]) ** 2
        return wrong - (1.0 - 1.0 / np.sqrt(known)) * wrong.mean()


@dataclass(frozen=True)
class Evidence:
    """All tracks of a set and the noise of each channel."""

    tracks: tuple[Track, ...]
    noise: dict[str, ChannelNoise]

    @property
    def channels(self) -> tuple[str, ...]:
        """Return the channels that at least one recording measured."""
        return tuple(c for c in CHANNELS if any(c in track.measured for track in self.tracks))

    def noise_rms(self, channel: str) -> float:
        """Return the standard deviation of the noise of a single row, over all recordings."""
        return float(np.sqrt(np.mean([track.zero[channel] ** 2 for track in self.tracks
                                      if channel in track.zero])))

    @property
    def keys(self) -> list[tuple[int, str]]:
        """Every (track, channel) there is, in the order of a residual vector."""
        return [(i, c) for i, track in enumerate(self.tracks) for c in track.channels]


def average(values: np.ndarray, factor: int) -> np.ndarray:
    """Average (n,) values over ``factor`` neighbouring rows; a rest is left out."""
    if factor == 1:
        return np.asarray(values)
    m = len(values) // factor
    return np.asarray(values)[:m * factor].reshape(m, factor).mean(axis=1)


def informative(recording: Recording) -> tuple[str, ...]:
    """
    Return the measured channels that can tell something.

    Under charge drive the charge is the command, leads shorted fix the
    voltage, leads open the charge; they are compared all the same, since a
    drive or a leak may differ.
    """
    return tuple(c for c in CHANNELS if c in recording.measured)


def _averaging(recording: Recording) -> int:
    """Return over how many rows to average: a command that mostly rests bears more."""
    factor = max(1, int(round(len(recording) / ROWS)))
    moving = np.mean((np.diff(recording.command) != 0.0)
                     | (np.diff(recording.external_force) != 0.0)) if len(recording) > 1 else 1.0
    return factor if moving > 0.2 else max(factor, int(round(len(recording) / RESTING_ROWS)))


def prepare(recordings, simulated) -> Evidence:
    """
    Prepare recordings against a first simulation of them.

    Parameters
    ----------
    recordings : sequence of Recording
        After preflight.
    simulated : sequence of dict
        Channel to (n,) array for each recording, from the parameter file as given.

    Returns
    -------
    Evidence

    """
    noise = estimate_noise(recordings, simulated)
    tracks = []
    for recording in recordings:
        factor = _averaging(recording)
        measured, sigma, zero = {}, {}, {}
        for channel in informative(recording):
            measured[channel] = average(recording.measured[channel], factor)
            sigma[channel] = noise[channel].deviation(recording.period, len(recording), factor)
            zero[channel] = noise[channel].deviation(recording.period, len(recording))
        m = len(recording) // factor
        stretch = np.arange(m) * STRETCHES // max(m, 1)
        tracks.append(Track(recording, factor, measured, sigma, zero, stretch % 2 == 0))
    return Evidence(tuple(tracks), noise)
