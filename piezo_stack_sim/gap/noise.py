"""
The noise of each channel, estimated from the data alone.

Differences of neighbouring rows tell the white part.  Where a command repeats,
the difference of the answers one period apart tells the whole of it, slow parts
included, because the device's own answer cancels.
"""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np

# Variance of the third difference of white noise of unit variance.
_THIRD_DIFFERENCE = 20.0
COLOURED = 1.25  # repeats that differ by less than this are as good as white
LONGEST = 4.0  # the most that correlation may take from the weight of an average
LOUDEST = 2.0  # repeats that differ by more than this over the white part hold a gap, not noise
_MAD = 0.67448975  # median |z| of a standard normal z


@dataclass(frozen=True)
class ChannelNoise:
    """
    Noise of one channel.

    ``rms`` is its standard deviation; ``correlation`` by how much the variance
    of a long average exceeds that of white noise (1 for white).
    """

    rms: float
    correlation: float

    def averaged(self, rows: int) -> float:
        """Return the standard deviation to weigh an average over ``rows`` rows with."""
        return self.rms * math.sqrt(self.correlation / rows)


def estimate_noise(recordings, simulated) -> dict[str, ChannelNoise]:
    """
    Estimate the noise of every measured channel.

    Parameters
    ----------
    recordings : sequence of Recording
        After preflight.
    simulated : sequence of dict
        A simulation of each, channel to (n,); subtracting it removes most of
        what is not noise.

    Returns
    -------
    dict of str to ChannelNoise

    """
    white, repeats = {}, {}
    for recording, simulation in zip(recordings, simulated):
        period = repetition(recording.command) if recording.drive in ('voltage', 'charge') else 0
        if period and np.ptp(recording.external_force) > 0.0:
            period = 0
        for channel, measured in recording.measured.items():
            residual = measured - simulation[channel]
            if residual.size < 50:
                continue
            third = np.diff(residual, 3)
            white.setdefault(channel, []).append(
                np.median(np.abs(third)) / _MAD / math.sqrt(_THIRD_DIFFERENCE))
            # A gap of its own at high frequency would pass for noise.
            if period and white[channel][-1] < 1.2 * min(white[channel]):
                repeats.setdefault(channel, []).append(
                    _from_repeats(residual, period, recording.command))
    result = {}
    for channel, levels in white.items():
        level = float(np.median(np.sort(levels)[:max(1, (len(levels) + 1) // 2)]))
        resolution = _resolution(recordings, channel)
        level = max(level, resolution / math.sqrt(12.0), np.finfo(float).tiny)
        level = max(level, 1e-7 * _span(recordings, channel))
        rms, correlation = level, 1.0
        if channel in repeats:
            seen = min(repeats[channel])
            if COLOURED * level < seen[0] < LOUDEST * level:
                rms, correlation = seen[0], min(seen[1], LONGEST)
        result[channel] = ChannelNoise(rms, correlation)
    return result


def repetition(command: np.ndarray) -> int:
    """Return the period (rows) in which the end of a command repeats, or 0."""
    n = command.size
    if n < 200 or np.ptp(command) == 0.0:
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
    return 0


def _from_repeats(residual, period, command) -> tuple[float, float]:
    n = residual.size
    start = n
    while start - 1 - period >= 0 and abs(command[start - 1] - command[start - 1 - period]) < (
            1e-4 * np.ptp(command)):
        start -= 1
    difference = (residual[start:] - residual[start - period:n - period]) / math.sqrt(2.0)
    if difference.size < 100:
        return math.inf, 1.0
    # What is linear in time is drift of the device, not noise.
    line = np.polyfit(np.linspace(-1.0, 1.0, difference.size), difference, 1)
    difference = difference - np.polyval(line, np.linspace(-1.0, 1.0, difference.size))
    rms = float(difference.std())
    return rms, integrated_correlation(difference)


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


def _resolution(recordings, channel) -> float:
    """Return the step of the converter, 0 if values are not on a coarse grid."""
    for recording in recordings:
        if channel in recording.measured:
            levels = np.unique(recording.measured[channel])
            steps = np.diff(levels)
            if levels.size > 10 and levels.size < 0.2 * len(recording):
                return float(steps.min())
    return 0.0


def _span(recordings, channel) -> float:
    return max((float(np.ptp(r.measured[channel])) for r in recordings if channel in r.measured),
               default=0.0)
