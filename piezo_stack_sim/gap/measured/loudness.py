# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Recordings whose sensors were noisier than in others: another range, filter or rate.

What is noise in the quietest recording may be a small part of it in another.  An excess there is
noise only where nothing about it looks like an answer of a device: in the upper octaves it has
the spectrum of noise, every line by itself scattered as noise scatters, the same from the first
row to the last whatever was commanded, its samples are normally distributed, and no other sensor
has it: what a coarse converter does to a command looks like noise, too, but charge follows it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import math

import numpy as np
from piezo_stack_sim.gap.measured.filled import stride, wrong
from piezo_stack_sim.gap.measured.noise import ChannelNoise, QUARTER
from piezo_stack_sim.recording.recording import Recording

FEWEST = 600  # rows below which no spectrum tells so much
OCTAVES = 3  # below half the row rate, where a stack hardly answers
PIECES = 6  # bands of equal width of them
STRETCHES = 20  # of rows
MORE = 1.1  # power over that of the channel's noise from which a recording is noisier
UNLIKELY = 4.5  # standard deviations by which no band and no stretch may stand out
KURTOSIS = 0.4  # by which the fourth moment may differ from 3, that of a normal distribution
SCATTER = 0.1  # part by which the quartile of the lines may differ from that of noise
# Of a Hann window, and of third differences of white noise: rows are that many times fewer.
_WINDOWED, _DIFFERENCED = 1.95, 2.94
LAGS = 4  # rows within which one channel would answer another


def louder(recordings: Sequence[Recording], simulated: Sequence[Mapping[str, np.ndarray]],
           noise: Mapping[str, ChannelNoise]) -> list[dict[str, float]]:
    """
    Return how many times the noise of a channel each recording has, where it has clearly more.

    Parameters
    ----------
    recordings : sequence of Recording
        After preflight.
    simulated : sequence of dict
        A simulation of each, channel to (n,).
    noise : dict of str to ChannelNoise
        Of the quietest of them.

    Returns
    -------
    list of dict
        For each recording, channel to rms over that of the noise; without those that have none
        in excess, or an excess that may be something else.

    """
    out = []
    for recording, simulation in zip(recordings, simulated):
        residual = {channel: wrong(recording, channel, simulation[channel])
                    for channel in recording.measured}
        power = {channel: _level(residual[channel], recording.period, noise[channel])
                 for channel in residual if channel in noise
                 and stride(recording, channel) == 1}
        out.append({channel: math.sqrt(level) for channel, level in power.items()
                    if level > MORE and not _is_shared(channel, residual)})
    return out


def white_power(values: np.ndarray) -> float:
    """Return the power of the white noise in the upper octave of values (n,), 0 if it has more."""
    window = np.hanning(values.size)
    power = np.abs(np.fft.rfft((values - values.mean()) * window)) ** 2
    upper = power[power.size // 2:-1]
    if upper.size < FEWEST // 4 or not _is_noise(upper):
        return 0.0
    return float(upper.mean()) / float(np.sum(window ** 2))


def _level(residual: np.ndarray, period: float, noise: ChannelNoise) -> float:
    """Return the power (1) of a residual over that of a noise, 1 where it may be no noise."""
    rows = residual.size
    if rows < FEWEST or not _is_steady(np.diff(residual, 3)):
        return 1.0
    window = np.hanning(rows)
    power = np.abs(np.fft.rfft((residual - residual.mean()) * window)) ** 2
    power *= 2.0 * period / float(np.sum(window ** 2))
    f = np.fft.rfftfreq(rows, period)
    upper = slice(int(f.searchsorted(0.5 / period / 2 ** OCTAVES)), -1)
    power, like = power[upper], noise.density(f[upper], period)
    # Of its colour, or white: where the recordings differ, one colour does not fit them all.
    for lines in (power / like, power / like.mean()):
        if _is_noise(lines):
            return float(lines.mean())
    return 1.0


def _is_noise(lines: np.ndarray) -> bool:
    """Tell whether lines of a spectrum, shape (m,), scatter about one level as noise does."""
    level = float(lines.mean())
    bands = np.array([part.mean() for part in np.array_split(lines, PIECES)])
    chance = math.sqrt(_WINDOWED * PIECES / lines.size)
    quartile = float(np.quantile(lines, 0.25)) / QUARTER
    return (bool(np.all(np.abs(bands / level - 1.0) < UNLIKELY * chance))
            and abs(quartile / level - 1.0) < SCATTER)


def _is_shared(channel: str, residual: Mapping[str, np.ndarray]) -> bool:
    """Tell whether another channel, within a few rows, has what is wrong with one."""
    own = np.diff(residual[channel], 3)
    chance = UNLIKELY * math.sqrt(_DIFFERENCED / own.size)
    for name, values in residual.items():
        other = np.diff(values, 3)
        scale = math.sqrt(float(own @ own) * float(other @ other))
        if name != channel and scale > 0.0:
            both = [float(own[max(lag, 0):own.size + min(lag, 0)]
                          @ other[max(-lag, 0):own.size - max(lag, 0)])
                    for lag in range(1 - LAGS, LAGS)]
            if max(map(abs, both)) > chance * scale:
                return True
    return False


def _is_steady(series: np.ndarray) -> bool:
    """Tell whether a series is normally distributed, and as loud in the end as at first."""
    power = series ** 2
    mean = float(power.mean())
    if mean == 0.0 or abs(float(np.mean(power ** 2)) / mean ** 2 - 3.0) > KURTOSIS:
        return False
    stretches = np.array([part.mean() for part in np.array_split(power, STRETCHES)])
    chance = math.sqrt(2.0 * _DIFFERENCED * STRETCHES / series.size)
    return bool(np.all(np.abs(stretches / mean - 1.0) < UNLIKELY * chance))
