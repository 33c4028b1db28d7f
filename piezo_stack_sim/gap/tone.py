# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A line that nobody synchronised with the recordings: one frequency, new phases each time.

Its amplitude is the same in every recording and its phase in none, so that a
simulation with one phase cannot follow it.  Frequency, amplitude and phases are
read off the residual of the displacement instead.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from piezo_stack_sim.gap.evidence import Evidence
from piezo_stack_sim.gap.forward import spans

CHANNEL = 'displacement'
HARMONICS = (1, 2)
SLOWEST = 4.0  # periods that the shortest recording must hold
PEAKS = 4  # peaks of each spectrum that are looked at more closely
FINE = 24  # places between two lines of the longest recording's spectrum


@dataclass(frozen=True)
class Line:
    """
    A line as matched to a residual.

    ``amplitudes`` (2,) of the fundamental and its second harmonic in m, ``phases``
    (K,) of the fundamental in each recording, in rad at its first row.
    """

    frequency: float
    amplitudes: np.ndarray
    phases: dict[int, float]


class Tone:
    """The wave of one frequency in every recording of the displacement."""

    def __init__(self, evidence: Evidence, frequency: float) -> None:
        self.frequency = frequency
        self.parts = []
        for (i, channel), where in zip(evidence.keys, spans(evidence)):
            if channel != CHANNEL:
                continue
            track = evidence.tracks[i]
            time = track.recording.time - track.recording.time[0]
            scale = 1.0 / track.sigma[channel]
            waves = []
            for harmonic in HARMONICS:
                angle = 2.0 * np.pi * harmonic * frequency * time
                waves.append(scale * np.column_stack(
                    [track.average(np.sin(angle)), track.average(np.cos(angle))]))
            self.parts.append((i, where, track.fitted, waves))

    def match(self, residual: np.ndarray) -> tuple[Line, np.ndarray]:
        """Return the line in a residual (N,), and the residual without it."""
        left = residual.copy()
        amplitudes = np.zeros(len(HARMONICS))
        phases: dict[int, float] = {}
        for h in range(len(HARMONICS)):
            found, total, weight = [], 0.0, 0.0
            for i, where, fitted, waves in self.parts:
                seen = waves[h][fitted]
                square = seen.T @ seen
                # Averaged over whole periods sine and cosine are one.
                square += (1e-9 * float(np.trace(square)) + 1e-300) * np.eye(2)
                pair = np.linalg.solve(square, seen.T @ residual[where][fitted])
                size = float(np.hypot(*pair))
                power = 0.5 * float(np.trace(square))
                # One amplitude for all: a line that is in one recording only is none.
                total += power * size
                weight += power
                found.append((i, where, waves[h], pair, size))
            amplitudes[h] = total / weight if weight > 0.0 else 0.0
            for i, where, wave, pair, size in found:
                if size > 0.0:
                    left[where] -= wave @ (pair * (amplitudes[h] / size))
                if h == 0:
                    phases[i] = float(np.arctan2(pair[1], pair[0]))
        return Line(self.frequency, amplitudes, phases), left


def find_frequency(evidence: Evidence, residual: np.ndarray, rows: np.ndarray) -> float | None:
    """
    Return the frequency (Hz) of the line that explains most of a residual (N,), if any.

    ``rows`` are the entries that may be seen.
    """
    candidates, longest, lowest = [], 0.0, 0.0
    for (i, channel), where in zip(evidence.keys, spans(evidence)):
        if channel != CHANNEL:
            continue
        track = evidence.tracks[i]
        series = residual[where]
        dt = track.recording.period * track.factor
        longest = max(longest, dt * series.size)
        lowest = max(lowest, SLOWEST / (dt * series.size))
        power = np.abs(np.fft.rfft((series - series.mean()) * np.hanning(series.size),
                                   4 * series.size)) ** 2 / series.size
        f = np.fft.rfftfreq(4 * series.size, dt)
        for _ in range(PEAKS):
            power[f < SLOWEST / (dt * series.size)] = 0.0
            best = int(np.argmax(power))
            if power[best] <= 0.0:
                break
            candidates.append((float(f[best]), 1.0 / (dt * series.size)))
            power[max(0, best - 10):best + 11] = 0.0
    if not candidates:
        return None

    def fall(frequency):
        left = Tone(evidence, frequency).match(residual)[1][rows]
        return float(residual[rows] @ residual[rows] - left @ left)

    coarse = []
    for centre, width in candidates:
        if centre >= lowest:
            coarse.append((fall(centre), centre, width))
    if not coarse:
        return None
    _, centre, width = max(coarse)
    # From the line width of the recording it was seen in down to that of the longest.
    while width > 1.0 / (FINE * longest):
        step = width / 6.0
        tried = [(fall(centre + k * step), centre + k * step) for k in range(-5, 6)]
        centre = max(tried)[1]
        width = 1.5 * step
    return centre
