# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Recordings made ready for comparison: thinned, weighted by their noise, split in two.

Every row keeps its place in time, because hysteresis remembers; what is
withheld from a fit are stretches of rows, alternating along each recording.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
import math

import numpy as np

from piezo_stack_sim.gap.measured.filled import refilled, scarcity, stride
from piezo_stack_sim.gap.measured.loudness import louder
from piezo_stack_sim.gap.measured.noise import ChannelNoise, estimate_noise
from piezo_stack_sim.plant import Device
from piezo_stack_sim.recording.finding import Finding, found, NOTE
from piezo_stack_sim.recording.recording import Recording

CHANNELS = ('voltage', 'charge', 'displacement')
ROWS = 7500  # a recording is averaged down to at most about this many rows
RESTING_ROWS = 3000  # one whose command mostly rests, to this many
STRETCHES = 20  # alternating stretches that are fitted and withheld
TOLD = 1.2  # times the noise of others from which that of a recording is worth a word
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
    louder : dict of str to float
        How many times the noise of a channel this recording has, where that is not 1.
    told : dict of str to ndarray, shape (m,)
        Part of the rows behind an averaged one that was measured, of channels where some were not.

    """

    recording: Recording
    factor: int
    measured: dict[str, np.ndarray]
    sigma: dict[str, float]
    zero: dict[str, float]
    fitted: np.ndarray
    louder: Mapping[str, float] = field(default_factory=dict)
    told: Mapping[str, np.ndarray] = field(default_factory=dict)

    @property
    def channels(self) -> tuple[str, ...]:
        """Return the measured channels, in a fixed order."""
        return tuple(self.measured)

    def average(self, values: np.ndarray, channel: str = '') -> np.ndarray:
        """Average (n,) values over neighbouring rows, of a channel those measured, to (m,)."""
        plain = average(values, self.factor)
        part = self.told.get(channel)
        if part is None:
            return plain
        rows = average(values * self.recording.told(channel), self.factor)
        return np.where(part > 0.0, rows / np.maximum(part, 1e-9), plain)

    def misfit(self, channel: str, simulated: np.ndarray) -> np.ndarray:
        """Return averaged errors (m,), SI units, of a simulation (n,); 0 where nobody measured."""
        wrong = self.measured[channel] - self.average(simulated, channel)
        part = self.told.get(channel)
        return wrong if part is None else np.where(part > 0.0, wrong, 0.0)

    def weighted(self, channel: str, simulated: np.ndarray) -> np.ndarray:
        """
        Return measured less simulated over the noise, (m,), white for a noisy zero as well.

        The sum of squares is that of noise whose mean is known to ``zero`` only:
        no fit needs to know of the sensor's zero, and an offset that no single
        row's noise can make still counts.
        """
        return self.unbiased(channel, self.misfit(channel, simulated)) / self.sigma[channel]

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
    """All tracks of a set, the noise of each channel, and the device as its file has it."""

    tracks: tuple[Track, ...]
    noise: dict[str, ChannelNoise]
    device: Device | None = None

    @property
    def channels(self) -> tuple[str, ...]:
        """Return the channels that at least one recording measured."""
        return tuple(c for c in CHANNELS if any(c in track.measured for track in self.tracks))

    def noise_rms(self, channel: str) -> float:
        """Return the standard deviation of the noise of a row, over those of all recordings."""
        tracks = [track for track in self.tracks if channel in track.zero]
        return float(np.sqrt(np.average([track.zero[channel] ** 2 for track in tracks],
                                        weights=[len(track.recording) for track in tracks])))

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
    noise, times = _noise_of([track.recording for track in evidence.tracks], simulated)
    now = [_deviations(noise, track.recording, track.factor, each)
           for track, each in zip(evidence.tracks, times)]
    better = {channel: noise[channel] for track, sigma in zip(evidence.tracks, now)
              for channel in sigma if sigma[channel] < QUIETER * track.sigma[channel]}
    if not better:
        return evidence
    return replace(evidence, noise=evidence.noise | better, tracks=tuple(
        replace(track,
                sigma=track.sigma | _deviations(better, track.recording, track.factor, each),
                zero=track.zero | _deviations(better, track.recording, 1, each),
                louder={**track.louder, **{channel: each.get(channel, 1.0) for channel in better}})
        for track, each in zip(evidence.tracks, times)))


def noisier(evidence: Evidence) -> list[Finding]:
    """Return what to tell of recordings that are noisier than others of the same channel."""
    several = {channel for channel in evidence.channels
               if sum(channel in track.measured for track in evidence.tracks) > 1}
    return [found(track.recording, None, NOTE,
                  f'{channel} is {times:.2g} times as noisy as in the quietest recording',
                  'it is weighed by its own noise: another range, filter or rate of the sensor?')
            for track in evidence.tracks for channel, times in sorted(track.louder.items())
            if times > TOLD and channel in several]


def of_any_colour(evidence: Evidence, simulated) -> Evidence:
    """
    Return the evidence with noise of which any colour is believed that the spectra tell.

    Where many rows are averaged a colour counts that is hardly seen from row to row.

    Parameters
    ----------
    evidence : Evidence
        As prepared.
    simulated : sequence of dict
        Channel to (n,) array for each track, from the best model without any effect.

    """
    noise = estimate_noise([track.recording for track in evidence.tracks], simulated, 1.0,
                           [track.louder for track in evidence.tracks])
    tracks = []
    for track in evidence.tracks:
        now = _deviations(noise, track.recording, track.factor, track.louder)
        tracks.append(replace(track, sigma={
            channel: max(sigma, now.get(channel, 0.0)) for channel, sigma in track.sigma.items()}))
    return replace(evidence, tracks=tuple(tracks))


def _noise_of(recordings, simulated) -> tuple[dict[str, ChannelNoise], list[dict[str, float]]]:
    """Return the noise of every channel, and how many times that each recording has."""
    noise = estimate_noise(recordings, simulated)
    times = louder(recordings, simulated, noise)
    if any(times):
        # What differs in loudness had looked like colour.
        noise = estimate_noise(recordings, simulated, louder=times)
        times = louder(recordings, simulated, noise)
    return noise, times


def _deviations(noise: dict[str, ChannelNoise], recording: Recording, factor: int,
                times: Mapping[str, float]) -> dict[str, float]:
    """Return the deviation of an average over ``factor`` rows, of every channel it measured."""
    def one(c):
        every = stride(recording, c)
        of_it = noise[c].deviation(every * recording.period, len(recording) // every,
                                   max(factor // every, 1)) * scarcity(recording, c, factor)
        return math.hypot(recording.unsure.get(c, 0.0), times.get(c, 1.0) * of_it)

    return {c: one(c) for c in CHANNELS if c in recording.measured and c in noise}


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
    # A product takes a tenth of the time of `mean` over so few.
    return np.asarray(values)[:m * factor].reshape(m, factor) @ np.full(factor, 1.0 / factor)


def _averaging(recording: Recording) -> int:
    """
    Return over how many rows to average: a command that mostly rests bears more.

    As many, at least, as pass until the slowest sensor is read again.
    """
    factor = max(1, int(round(len(recording) / ROWS)))
    moving = np.mean((np.diff(recording.command) != 0.0)
                     | (np.diff(recording.external_force) != 0.0)) if len(recording) > 1 else 1.0
    if moving <= 0.2:
        factor = max(factor, int(round(len(recording) / RESTING_ROWS)))
    every = max((stride(recording, channel) for channel in recording.filled), default=1)
    return every * max(1, round(factor / every))


def prepare(recordings, simulated, device: Device | None = None) -> Evidence:
    """
    Prepare recordings against a first simulation of them.

    Parameters
    ----------
    recordings : sequence of Recording
        After preflight.
    simulated : sequence of dict
        Channel to (n,) array for each recording, from the parameter file as given.
    device : Device, optional
        What they are recordings of: it tells what moves with the charge.

    Returns
    -------
    Evidence

    """
    recordings = [refilled(*pair) for pair in zip(recordings, simulated)]
    noise, louder_by = _noise_of(recordings, simulated)
    tracks = []
    for recording, times in zip(recordings, louder_by):
        factor = _averaging(recording)
        measured = [c for c in CHANNELS if c in recording.measured]
        told = {c: average(recording.told(c).astype(float), factor) for c in recording.filled}
        m = len(recording) // factor
        stretch = np.arange(m) * STRETCHES // max(m, 1)
        track = Track(recording, factor, {}, _deviations(noise, recording, factor, times),
                      _deviations(noise, recording, 1, times), stretch % 2 == 0, times, told)
        tracks.append(replace(track, measured={
            c: track.average(recording.measured[c], c) for c in measured}))
    return Evidence(tuple(tracks), noise, device)
