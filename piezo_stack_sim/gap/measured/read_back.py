# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Commands and forces that were measured: their noise is the recorder's, not the device's.

Where a command was read back by a converter, or a force by a load cell, the recording has noise
that the device never got, and a simulation played with it moves where the device did not.  Noise
is told by its third differences, which those of a smooth input are not like, or by its spectrum
above that of the motion.  It is taken off where the inputs are smooth, or where they consist of
few lines of a spectrum, whatever leaves less of the gap, and what is left of it counts as noise
of what is simulated; and not at all where the device shows that it got it.
"""

from __future__ import annotations

from collections.abc import Sequence
import math

import numpy as np
from piezo_stack_sim.gap.cores import parallel
from piezo_stack_sim.gap.measured.forward import simulate_channels
from piezo_stack_sim.gap.measured.loudness import white_power
from piezo_stack_sim.gap.measured.noise import white_level
from piezo_stack_sim.plant import Device
from piezo_stack_sim.recording.finding import Finding, found, REPAIRED
from piezo_stack_sim.recording.recording import Recording
from scipy import ndimage, signal

INPUTS = ('command', 'external_force')
FEWEST = 200  # rows that tell noise
# Of third differences of white noise: autocorrelation from row to row, and how far the largest
# fifth of them is out, over their median; and by how much these may differ.
ALIKE, FIFTH = -0.75, 1.9
ALIKE_BY, FIFTH_BY = 0.1, 0.25
CLIP = 6.0  # times their median from which a difference is an edge of the input
LEAST = 1e-6  # part of the range of an input below which it has the errors of numbers
HALF_WIDTHS = (1, 2, 3, 5, 8, 13, 21, 34, 55, 89)  # rows, over which an input may be smooth
# Standard deviations within which estimates over wider windows must agree: around a row, and on
# one side of it.  At a turn, which the hysteresis remembers, all hangs on these.
SURE = (2.0, 3.0)
LINES, OVER = 9, 1.5  # over which the power of lines is averaged, and what of noise they may have
CLEARLY = 0.9  # part of the error that a recording without that noise may leave


def without_noise(recordings: Sequence[Recording], device: Device,
                  simulated: Sequence[dict[str, np.ndarray]]
                  ) -> tuple[tuple[Recording, ...], list[Finding]]:
    """
    Return recordings without the noise of what read their inputs, and what was taken off.

    Parameters
    ----------
    recordings : sequence of Recording
        After preflight.
    device : Device
        The simulation.
    simulated : sequence of dict
        Channel to (n,) array for each of them.

    """
    answers = parallel(lambda pair: _quiet(device, *pair), zip(recordings, simulated))
    findings = [finding for _, said in answers for finding in said]
    return tuple(each for each, _ in answers), findings


def noise_in(values: np.ndarray) -> float:
    """Return the standard deviation of the white noise in an input, shape (n,); 0 for none."""
    if values.size < FEWEST:
        return 0.0
    level = white_level(values)
    if level <= LEAST * float(np.ptp(values)):
        return 0.0
    third = np.diff(values, 3)
    size = np.abs(third)
    median = float(np.median(size))
    third = np.clip(third, -CLIP * median, CLIP * median)
    alike = float(third[1:] @ third[:-1]) / float(third @ third)
    fifth = float(np.quantile(size, 0.8)) / median
    if abs(alike - ALIKE) < ALIKE_BY and abs(fifth - FIFTH) < FIFTH_BY:
        return level
    # Fast motion hides it from row to row, but not above its own frequencies.
    power = white_power(values)
    return math.sqrt(power) if power > (LEAST * float(np.ptp(values))) ** 2 else 0.0


def smoothed(values: np.ndarray, noise: float) -> np.ndarray:
    """
    Return an input (n,) averaged as far around each row as it is smooth.

    By parabolas around a row, and lines before and after it, over windows that grow as long as
    what they tell agrees (the intersection of confidence intervals of Goldenshluger and
    Nemirovski, 1997).
    """
    total, weight = np.zeros(values.size), np.zeros(values.size)
    for side in (-1, 0, 1):
        best, spread = values.copy(), np.full(values.size, noise)
        sure = SURE[abs(side)]
        low, high = values - sure * noise, values + sure * noise
        grows = np.ones(values.size, dtype=bool)
        for half in HALF_WIDTHS:
            if 2 * half + 1 > values.size:
                break
            rows = 2 * half + 1
            kernel = signal.savgol_coeffs(rows, 1 if side else 2, pos=half * (1 + side),
                                          use='dot')
            told = ndimage.correlate1d(values, kernel, mode='nearest', origin=side * half)
            wide = noise * float(np.sqrt(kernel @ kernel))
            low = np.maximum(low, told - sure * wide)
            high = np.minimum(high, told + sure * wide)
            grows &= low <= high
            if wide < noise:
                best, spread = np.where(grows, told, best), np.where(grows, wide, spread)
        total += best / spread ** 2
        weight += 1.0 / spread ** 2
    return total / weight


def by_lines(values: np.ndarray, noise: float) -> np.ndarray:
    """Return an input (n,) of which each line counts by what stands out of its noise (Wiener)."""
    n = values.size
    ramp = np.linspace(values[0], values[-1], n)
    # Turned about its ends it goes on without a jump.
    whole = np.concatenate([values - ramp, -(values - ramp)[::-1]])
    spectrum = np.fft.rfft(whole)
    power = ndimage.uniform_filter1d(np.abs(spectrum) ** 2, LINES) / (2.0 * n * noise ** 2)
    gain = np.clip(1.0 - OVER / np.maximum(power, OVER), 0.0, 1.0)
    return ramp + np.fft.irfft(gain * spectrum, 2 * n)[:n]


WAYS = (smoothed, by_lines)


def _quiet(device: Device, recording: Recording, simulated: dict[str, np.ndarray]
           ) -> tuple[Recording, list[Finding]]:
    """Return a recording without the noise of its inputs, if that leaves clearly less wrong."""
    findings = []
    error = _error(recording, simulated)
    for name in INPUTS:
        values = getattr(recording, name)
        noise = noise_in(values)
        if not noise:
            continue
        tried = [recording.replace(**{name: way(values, noise)}) for way in WAYS]
        errors = [_error(each, simulate_channels(device, each)) for each in tried]
        least = min(errors)
        if least < CLEARLY * error:
            best = errors.index(least)
            recording, error = tried[best], least
            again = WAYS[best](getattr(recording, name) + noise * _fresh(len(recording)), noise)
            recording = _unsure(recording, recording.replace(**{name: again}), device)
            unit = 'N' if name == 'external_force' else 'V' if recording.drive == 'voltage' else (
                'C')
            shown = recording.command_name or name if name == 'command' else name
            findings.append(found(
                recording, None, REPAIRED, f'{shown} has {noise:.2g} {unit} of noise, which the '
                'device did not get', 'it was measured: what is smooth in it is taken instead'))
    return recording, findings


def _fresh(rows: int) -> np.ndarray:
    """Return white noise, always the same."""
    return np.random.default_rng(rows).standard_normal(rows)


def _unsure(recording: Recording, again: Recording, device: Device) -> Recording:
    """Return a recording with what its simulation is unsure by, from another draw of its noise."""
    one, other = (simulate_channels(device, each) for each in (recording, again))
    return recording.replace(unsure={
        channel: float(np.hypot(recording.unsure.get(channel, 0.0),
                                np.std(other[channel] - one[channel])))
        for channel in recording.measured})


def _error(recording: Recording, simulated: dict[str, np.ndarray]) -> float:
    """Return the power of what is wrong with all channels, from row to row in their noise."""
    total = 0.0
    for channel, values in recording.measured.items():
        wrong = values - simulated[channel]
        total += float(np.var(wrong)) / max(
            float(np.median(np.diff(values, 3) ** 2)), 1e-14 * float(np.ptp(values)) ** 2, 1e-300)
    return total
