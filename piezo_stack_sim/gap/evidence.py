# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Recordings made ready for comparison: thinned, weighted by their noise, split in two.

Every row keeps its place in time, because hysteresis remembers; what is
withheld from a fit are stretches of rows, alternating along each recording.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
import math

import numpy as np

from piezo_stack_sim.gap.noise import ChannelNoise, estimate_noise
from piezo_stack_sim.recording.recording import Recording

CHANNELS = ('voltage', 'charge', 'displacement')
ROWS = 7500  # a recording is averaged down to at most about this many rows
RESTING_ROWS = 3000  # one whose command mostly rests, to this many
STRETCHES = 20  # alternating stretches that are fitted and withheld
QUIETER = 0.87  # part of the noise below which a new estimate of it is taken for better


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
        return wrong - (1.0 - 1.0 / self._blur(channel, len(wrong))) * wrong.mean(axis=0)

    def errors(self, channel: str, weighted: np.ndarray) -> np.ndarray:
        """Return the averaged errors, SI units, that were weighted to (m,) or (m, k)."""
        seen = weighted * self.sigma[channel]
        return seen + (self._blur(channel, len(seen)) - 1.0) * seen.mean(axis=0)

    def _blur(self, channel: str, rows: int) -> float:
        """Return how much less is known of the mean of many rows than their noise would tell."""
        return math.sqrt(1.0 + rows * (self.zero[channel] / self.sigma[channel]) ** 2)


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


def quieter(evidence: Evidence, simulated) -> Evidence:
    """
    Return the evidence with the noise that a better simulation leaves, where that is clearly less.

    A fit of a few numbers to thousands of rows cannot imitate noise, so that what it leaves
    bounds the noise from above.

    Parameters
    ----------
    evidence : Evidence
        As prepared against an earlier simulation.
    simulated : sequence of dict
        Channel to (n,) array for each track, from the better one.

    Returns
    -------
    Evidence
        The same object if no channel's noise is clearly less.

    """
    noise = estimate_noise([track.recording for track in evidence.tracks], simulated)
    better = {}
    for channel, found in noise.items():
        tracks = [t for t in evidence.tracks if channel in t.sigma]
        if any(_deviation(found, t, t.factor) < QUIETER * t.sigma[channel] for t in tracks):
            better[channel] = found
    if not better:
        return evidence
    weighed = tuple(replace(
        track,
        sigma=track.sigma | {c: _deviation(better[c], track, track.factor)
                             for c in track.sigma if c in better},
        zero=track.zero | {c: _deviation(better[c], track) for c in track.zero if c in better})
        for track in evidence.tracks)
    return Evidence(weighed, evidence.noise | better)


def _deviation(noise: ChannelNoise, track: Track, factor: int = 1) -> float:
    return noise.deviation(track.recording.period, len(track.recording), factor)


def reweigh(old: Evidence, new: Evidence) -> Callable[[np.ndarray], np.ndarray]:
    """
    Return what turns residuals weighted by one noise into those weighted by another.

    Parameters
    ----------
    old, new : Evidence
        Of the same recordings, with other noise.

    Returns
    -------
    callable
        Takes residuals (N,) or changes of them (N, k) and returns the same shape.

    """
    def turn(weighted: np.ndarray) -> np.ndarray:
        parts, start = [], 0
        for i, channel in old.keys:
            end = start + old.tracks[i].measured[channel].size
            errors = old.tracks[i].errors(channel, weighted[start:end])
            track = new.tracks[i]
            parts.append(track.unbiased(channel, errors) / track.sigma[channel])
            start = end
        return np.concatenate(parts).astype(weighted.dtype)

    return turn


def average(values: np.ndarray, factor: int) -> np.ndarray:
    """Average (n,) values over ``factor`` neighbouring rows; a rest is left out."""
    if factor == 1:
        return np.asarray(values)
    m = len(values) // factor
    return np.asarray(values)[:m * factor].reshape(m, factor).mean(axis=1)


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
        for channel in (c for c in CHANNELS if c in recording.measured):
            measured[channel] = average(recording.measured[channel], factor)
            sigma[channel] = noise[channel].deviation(recording.period, len(recording), factor)
            zero[channel] = noise[channel].deviation(recording.period, len(recording))
        m = len(recording) // factor
        stretch = np.arange(m) * STRETCHES // max(m, 1)
        tracks.append(Track(recording, factor, measured, sigma, zero, stretch % 2 == 0))
    return Evidence(tuple(tracks), noise)
