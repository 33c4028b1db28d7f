# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The noise of each channel, estimated from the data alone.

Noise does not know what is commanded: in every band of frequency it is the same
in all recordings, so the quietest of them bounds it.  Where inputs repeat, the
difference of the answers one period apart holds noise only, because the
device's own answer cancels.  To the lower edge of all these spectra a noise is
fitted that is white from row to row, plus one part that falls with 1/f and one
of first order with a corner.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
import math

import numpy as np

from piezo_stack_sim.errors import InputError
from piezo_stack_sim.gap.measured.filled import SELDOM, series
from piezo_stack_sim.recording.recording import Recording

# Variance of the third difference of white noise of unit variance.
_THIRD_DIFFERENCE = 20.0
_MAD = 0.67448975  # median |z| of a standard normal z
QUARTER = -math.log(0.75)  # lower quartile of a periodogram line over its mean
BANDS_PER_DECADE = 8
LINES = 6  # lines of a periodogram below which a band says too little
EDGE = 0.25  # part of the bands that may lie below the noise
SCATTER = 1.65  # distance of that edge in ln power, for a band of one line
CORNERS = (50.0, 2e4)  # Hz; slower than that it would be drift, faster white
FEWEST = 50  # rows of a recording that tells noise
COLOURED = 1.15  # rms beyond the white part from which colour is believed


@dataclass(frozen=True)
class ChannelNoise:
    """
    Noise of one channel, in units of the channel.

    ``white`` is the standard deviation from row to row, ``pink`` the power per
    unit of ln f, ``red`` the power of the part of first order with its
    ``corner`` (Hz).
    """

    white: float
    pink: float = 0.0
    red: float = 0.0
    corner: float = 1000.0

    def deviation(self, period: float, rows: int, factor: int = 1) -> float:
        """
        Return the standard deviation of an average over ``factor`` rows.

        ``period`` (s) is the distance of rows, ``rows`` how many there are: what
        is slower than the recording is an offset, not noise.
        """
        variance = self.white ** 2 / factor
        if self.pink:
            f = np.geomspace(1.0 / (period * rows), 0.5 / period, 400)
            passed = np.sinc(f * period * factor) ** 2
            variance += float(np.sum(0.5 * (passed[1:] + passed[:-1]) * np.diff(np.log(f)))
                              ) * self.pink
        if self.red:
            lag = np.arange(1, factor)
            alike = np.exp(-2.0 * math.pi * self.corner * period * lag)
            variance += self.red / factor * (1.0 + 2.0 * float(
                np.sum((1.0 - lag / factor) * alike)))
        return math.sqrt(variance)

    def density(self, f: np.ndarray, period: float | np.ndarray) -> np.ndarray:
        """Return the one-sided power spectral density, unit^2/Hz, at frequencies f (Hz)."""
        return _density_at(f, period)(self.white, self.pink, self.red, self.corner)


def _density_at(f: np.ndarray, period: float | np.ndarray
                ) -> Callable[[float, float, float, float], np.ndarray]:
    """Return what gives the density of the four numbers of a noise at frequencies f (Hz)."""
    turn = 2.0 * np.cos(2.0 * math.pi * f * period)
    decay = -2.0 * math.pi * period
    twice = 2.0 * period

    def density(white: float, pink: float, red: float, corner: float) -> np.ndarray:
        # Sampled without a filter, all power beyond half the row rate folds back.
        alike = np.exp(decay * corner)
        square = alike * alike
        first_order = red * (1.0 - square) / (1.0 - alike * turn + square)
        return twice * (white ** 2 + first_order) + pink / f

    return density


def estimate_noise(recordings, simulated, coloured: float = COLOURED,
                   louder: Sequence[Mapping[str, float]] | None = None
                   ) -> dict[str, ChannelNoise]:
    """
    Estimate the noise of every measured channel.

    Parameters
    ----------
    recordings : sequence of Recording
        After preflight.
    simulated : sequence of dict
        A simulation of each, channel to (n,); subtracting it removes most of
        what is not noise.
    coloured : float, optional
        Rms, against that of the white part, from which colour is believed.
    louder : sequence of dict, optional
        Channel to how many times (rms) as noisy as others each recording is known to be.

    Returns
    -------
    dict of str to ChannelNoise
        Of recordings that are not.

    Raises
    ------
    InputError
        If a channel is in no recording that is long enough.

    """
    spectra: dict[str, list] = {}
    floors: dict[str, list[float]] = {}
    for recording, simulation, times in zip(
            recordings, simulated, louder or [{}] * len(recordings)):
        lag = repetition(recording.command, recording.external_force)
        for channel in recording.measured:
            residual, period = series(recording, channel, simulation[channel])
            residual = residual / times.get(channel, 1.0)
            if residual.size < FEWEST:
                continue
            floors.setdefault(channel, []).append(white_level(residual))
            bands = spectra.setdefault(channel, [])
            bands += _bands(residual, period)
            if residual.size < SELDOM * len(recording):
                continue  # the inputs repeat by rows of their own
            error = recording.measured[channel] - simulation[channel]
            for difference in _differences(error / times.get(channel, 1.0), recording, lag,
                                           recording.told(channel)):
                bands += _bands(difference, period)
    for recording in recordings:
        for channel in recording.measured.keys() - spectra.keys():
            raise InputError(f'{recording.source or recording.name}: {len(recording)} rows of '
                             f'{channel}: expected {FEWEST} or more in one recording at least, to '
                             'tell noise from a gap; record longer, or leave the channel out')
    return {channel: _fitted(np.array(bands).reshape(-1, 4), min(floors[channel]),
                             _least(recordings, channel), coloured)
            for channel, bands in spectra.items()}


def white_level(series: np.ndarray) -> float:
    """Return the standard deviation of what is white in a series (n,), by third differences."""
    third = np.diff(series, 3)
    return float(np.median(np.abs(third)) / _MAD / math.sqrt(_THIRD_DIFFERENCE))


def repetition(command: np.ndarray, force: np.ndarray | None = None) -> int:
    """Return the period (rows) in which the end of the inputs repeats, or 0."""
    if np.ptp(command) < 1e-9 or (force is not None and np.ptp(force) > 0.0 and _rests(command)):
        if force is None or np.ptp(force) == 0.0:
            return 0
        return repetition(force)
    n = command.size
    if n < 200:
        return 0
    tail = command[n // 5:]
    tail = tail - tail.mean()
    spectrum = np.fft.rfft(tail, 2 * tail.size)
    correlation = np.fft.irfft(np.abs(spectrum) ** 2)[:tail.size]
    lags = np.arange(tail.size)
    correlation = correlation / np.maximum(tail.size - lags, 1)
    usable = tail.size // 2 + 1
    start = np.argmax(correlation[:usable] < 0.5 * correlation[0])
    if start == 0:
        return 0
    for period in start + np.argsort(-correlation[start:usable])[:3]:
        if np.abs(tail[period:] - tail[:-period]).max() < 1e-4 * np.ptp(command):
            return int(period)
    # A programme may repeat each of several amplitudes: its last cycles tell the period.
    half = command[n - n // 3:]
    if half.size < n:
        return repetition(half)
    return 0


def integrated_correlation(series: np.ndarray, longest: int | None = None) -> float:
    """
    Return 1 + 2 sum of the autocorrelation of a series, cut where it first vanishes.

    It is the factor by which rows are fewer than they seem (Sokal's window).
    """
    series = series - series.mean()
    n = series.size
    if n < 8 or not np.any(series):
        return 1.0
    spectrum = np.fft.rfft(series, 2 * n)
    correlation = np.fft.irfft(np.abs(spectrum) ** 2)[:n]
    correlation = correlation / correlation[0]
    total = 1.0
    for lag in range(1, min(n - 1, longest or n // 4)):
        total += 2.0 * correlation[lag]
        if lag >= 5.0 * total:
            break
    return float(max(total, 1.0))


def _rests(command: np.ndarray) -> bool:
    """Tell whether a command stays put in the last four fifths."""
    tail = command[command.size // 5:]
    return bool(np.ptp(tail) <= 1e-6 * max(float(np.ptp(command)), 1e-12))


def _differences(residual: np.ndarray, recording: Recording, lag: int,
                 told: np.ndarray | None) -> list[np.ndarray]:
    """Return residuals less those one period before, over sqrt 2, where all inputs repeat."""
    if not lag:
        return []
    same = np.ones(residual.size - lag, dtype=bool)
    for given in (recording.command, recording.external_force):
        same &= np.abs(given[lag:] - given[:-lag]) <= 1e-4 * max(float(np.ptp(given)), 1e-12)
    edges = np.flatnonzero(np.diff(np.concatenate(([False], same, [False])).astype(np.int8)))
    out = []
    for first, last in edges.reshape(-1, 2):
        if last - first >= max(100, lag // 2):
            piece = (residual[first + lag:last + lag] - residual[first:last]) / math.sqrt(2.0)
            # What is linear in time is drift of the device, not noise.
            place = np.linspace(-1.0, 1.0, piece.size)
            if told is not None:
                both = told[first + lag:last + lag] & told[first:last]
                place, piece = place[both], piece[both]
            out.append(piece - np.polyval(np.polyfit(place, piece, 1), place))
    return out


def _bands(series: np.ndarray, period: float) -> list[tuple[float, ...]]:
    """Return (frequency, density, row period, lines) by band: the lower quartile of each."""
    n = series.size
    window = np.hanning(n)
    power = np.abs(np.fft.rfft((series - series.mean()) * window)) ** 2
    power *= 2.0 * period / float(np.sum(window ** 2))
    f = np.fft.rfftfreq(n, period)
    band = np.floor(BANDS_PER_DECADE * np.log10(np.maximum(f, 1e-9))).astype(int)
    first = int(np.searchsorted(f, 2.0 / (n * period)))
    edges = np.flatnonzero(np.diff(band[first:])) + first + 1
    out: list[tuple[float, ...]] = []
    for low, high in zip(np.append(first, edges), np.append(edges, f.size)):
        if high - low >= LINES:
            level = float(np.quantile(power[low:high], 0.25)) / QUARTER
            out.append((float(np.exp(np.mean(np.log(f[low:high])))), level, period,
                        float(high - low)))
    return out


def _fitted(bands: np.ndarray, floor: float, least: float, coloured: float) -> ChannelNoise:
    """Fit white, 1/f and first-order noise to the lower edge of spectra by band."""
    from scipy.optimize import minimize
    usable = bands[bands[:, 1] > 0.0] if bands.size else bands
    if usable.shape[0] < 4:
        return ChannelNoise(max(floor, least))
    f, level, period, lines = usable.T
    weight = np.sqrt(np.minimum(lines, 400.0))
    weight /= weight.sum()
    # The edge of bands that hold nothing but noise lies below it by their scatter.
    edge = np.log(level) + SCATTER / np.sqrt(lines)
    start = max(floor, least)
    density = _density_at(f, period)

    def loss(log):
        # Called ten thousand times a set: of few operations on purpose.
        over = edge - np.log(density(*np.exp(log).tolist()))
        far = np.maximum(limits[0] - log, 0.0) + np.maximum(log - limits[1], 0.0)
        return EDGE * float(weight @ over) - float(
            weight @ np.minimum(over, 0.0)) + 0.1 * float(far.sum())

    limits = (np.log([least, 1e-8 * start ** 2, 1e-8 * start ** 2, CORNERS[0]]),
              np.log([30.0 * start, 30.0 * start ** 2, 900.0 * start ** 2, CORNERS[1]]))
    tried = []
    for part in ((1.0, 1e-6, 1e-6, 500.0), (0.8, 0.05, 1e-6, 500.0), (0.3, 1e-6, 4.0, 300.0),
                 (0.3, 1e-6, 2.0, 1500.0)):
        first = np.log([max(part[0] * start, least), part[1] * start ** 2, part[2] * start ** 2,
                        part[3]])
        tried.append(minimize(loss, first, method='Nelder-Mead',
                              options={'maxiter': 600, 'xatol': 0.01, 'fatol': 1e-5}))
    # The plainer noise unless colour tells clearly.
    best = tried[0]
    for found in tried[1:]:
        if found.fun < best.fun - 0.01:
            best = found
    noise = ChannelNoise(*np.exp(np.clip(best.x, *limits)))
    total = noise.white ** 2 + noise.red + 8.0 * noise.pink
    if total < (coloured * noise.white) ** 2 or best.fun > loss(np.log(
            [noise.white, 1e-8 * start ** 2, 1e-8 * start ** 2, 1000.0])) - 0.01:
        return ChannelNoise(max(noise.white, least))
    return noise


def _least(recordings, channel: str) -> float:
    """Return the least noise a channel can have: its converter's step, or rounding."""
    span, step = 0.0, 0.0
    for recording in recordings:
        if channel in recording.measured:
            values = recording.measured[channel]
            told = recording.told(channel)
            values = values if told is None else values[told]
            span = max(span, float(np.ptp(values)))
            levels = np.unique(values)
            if not step and 10 < levels.size < 0.2 * values.size:
                step = float(np.diff(levels).min())
    return max(step / math.sqrt(12.0), 1e-7 * span, np.finfo(float).tiny)
