# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A line that nobody synchronised with the recordings: one frequency, new phases each time.

Its amplitude is the same in every recording and its phase in none, so that a
simulation with one phase cannot follow it.  Frequency, amplitude and phases are
read off the residual of the displacement instead.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import math

import numpy as np

from piezo_stack_sim.gap.cores import parallel
from piezo_stack_sim.gap.measured.evidence import Evidence
from piezo_stack_sim.gap.measured.forward import spans
from scipy.signal import zoom_fft

CHANNEL = 'displacement'
HARMONICS = (1, 2)
SLOWEST = 4.0  # periods that a recording must hold to tell the amplitude
PEAKS = 4  # peaks of each spectrum that are looked at more closely
FINE = 400  # places between two lines of the longest recording's spectrum
STEADY = 0.2  # rad by which phases may differ and count as alike, and part of an amplitude
SHARP = 0.1  # of a line of the longest recording's spectrum: how exact a frequency ends
ANGLES = 2.0 * np.pi * np.arange(360) / 360.0  # phases tried where hardly a period is held


@dataclass(frozen=True)
class Line:
    """
    A line as matched to a residual.

    ``amplitudes`` (2,) of the fundamental and its second harmonic in m, ``phases``
    by recording those of both (2,) in rad at its first row.
    """

    frequency: float
    amplitudes: np.ndarray
    phases: dict[int, np.ndarray]

    @property
    def is_unsteady(self) -> bool:
        """Tell whether its phase differs from recording to recording."""
        waves = np.exp(1j * np.array(list(self.phases.values())))
        strays = np.abs(waves - waves.mean(axis=0)).max(axis=0)
        return bool((strays[self.amplitudes > STEADY * self.amplitudes.max()] > STEADY).any())

    def values(self, recording: int = 0) -> dict[str, float]:
        """Return the parameters of the effect, with the phases of one recording or the first."""
        first = next(iter(self.phases.values()), np.zeros(len(HARMONICS)))
        phases = self.phases.get(recording, first)
        return {'frequency': self.frequency,
                'displacement': float(self.amplitudes[0]), 'phase': float(phases[0]),
                'harmonic': float(self.amplitudes[1]), 'harmonic_phase': float(phases[1])}


class Tone:
    """
    The wave of one frequency in every recording of the displacement.

    Recordings that hold too few periods do not tell its amplitude: it is that of the others, and
    only the phase is theirs.
    """

    def __init__(self, evidence: Evidence, frequency: float) -> None:
        self.frequency = frequency
        self.parts = []
        for (i, channel), where in zip(evidence.keys, spans(evidence)):
            if channel != CHANNEL:
                continue
            track = evidence.tracks[i]
            time = track.recording.time - track.recording.time[0]
            angles = 2.0 * np.pi * frequency * np.outer(time, HARMONICS)
            waves = np.column_stack([track.average(wave(angle), channel) for angle in angles.T
                                     for wave in (np.sin, np.cos)])
            # Weighed as the residual is: its mean tells little.
            waves = track.unbiased(channel, waves) / track.sigma[channel]
            holds = frequency * float(time[-1]) >= SLOWEST
            self.parts.append((i, where, track.fitted, waves, holds))
        if not any(holds for *_, holds in self.parts):
            self.parts = [(*part, True) for *part, _ in self.parts]

    def match(self, residual: np.ndarray) -> tuple[Line, np.ndarray]:
        """Return the line in a residual (N,), and the residual without it."""
        left = residual.copy()
        totals, weights, found = np.zeros(len(HARMONICS)), np.zeros(len(HARMONICS)), []
        for i, where, fitted, waves, holds in self.parts:
            seen = waves[fitted]
            square = seen.T @ seen
            # Averaged over whole periods sine and cosine are one.
            square += (1e-9 * float(np.trace(square)) + 1e-300) * np.eye(len(square))
            along = seen.T @ residual[where][fitted]
            pairs = np.linalg.solve(square, along).reshape(-1, 2)
            found.append((i, where, waves, square, along, pairs, holds))
            if holds:
                # One amplitude for all: a line that is in one recording only is none.
                powers = 0.5 * np.diag(square).reshape(-1, 2).sum(axis=1)
                totals += powers * np.hypot(*pairs.T)
                weights += powers
        amplitudes = totals / np.maximum(weights, 1e-300)
        phases: dict[int, np.ndarray] = {}
        for i, where, waves, square, along, pairs, holds in found:
            angles = np.arctan2(pairs[:, 1], pairs[:, 0])
            if not holds:
                angles = _phases(square, along, amplitudes)
            left[where] -= waves @ (amplitudes * np.array([np.cos(angles), np.sin(angles)])
                                    ).T.ravel()
            phases[i] = angles
        return Line(self.frequency, amplitudes, phases), left


def _phases(square: np.ndarray, along: np.ndarray, amplitudes: np.ndarray) -> np.ndarray:
    """
    Return the phases (rad) of waves of known amplitudes, each without those before it.

    ``square`` (2n, 2n) and ``along`` (2n,) are of the normal equations of n waves.
    """
    unit = np.array([np.cos(ANGLES), np.sin(ANGLES)])
    angles, rest = np.zeros(len(amplitudes)), along.copy()
    for h, amplitude in enumerate(amplitudes):
        own = slice(2 * h, 2 * h + 2)
        cost = (amplitude * np.einsum('ij,ik,kj->j', unit, square[own, own], unit)
                - 2.0 * rest[own] @ unit)
        best = int(np.argmin(cost))
        before, here, after = cost[best - 1], cost[best], cost[(best + 1) % ANGLES.size]
        bow = before - 2.0 * here + after
        angles[h] = ANGLES[best] + (
            ANGLES[1] * 0.5 * (before - after) / bow if bow > 0.0 else 0.0)
        rest -= square[:, own] @ (amplitude * np.array([np.cos(angles[h]), np.sin(angles[h])]))
    return angles


def find_frequency(evidence: Evidence, residual: np.ndarray, rows: np.ndarray) -> float | None:
    """
    Return the frequency (Hz) of the line that explains most of a residual (N,), if any.

    Half of the recordings hold enough of its periods.  ``rows`` are the entries that may be seen.
    """
    candidates, longest, slowest = [], 0.0, []
    for (i, channel), where in zip(evidence.keys, spans(evidence)):
        if channel != CHANNEL:
            continue
        track = evidence.tracks[i]
        series = residual[where]
        dt = track.recording.period * track.factor
        longest = max(longest, dt * series.size)
        slowest.append(SLOWEST / (dt * series.size))
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

    seen = residual[rows]
    power = seen @ seen

    def fall(frequency):
        left = Tone(evidence, frequency).match(residual)[1][rows]
        return float(power - left @ left)

    coarse = [(centre, width) for centre, width in candidates if centre >= np.median(slowest)]
    if not coarse:
        return None
    _, centre, width = max((gain, *line) for gain, line in zip(
        parallel(fall, [centre for centre, _ in coarse]), coarse))
    # From the line width of the recording it was seen in down to that of the longest.
    while width > 1.0 / (FINE * longest):
        step = width / 6.0
        tried = [centre + k * step for k in range(-5, 6)]
        centre = max(zip(parallel(fall, tried), tried))[1]
        width = 1.5 * step
    return centre


def in_step(line: Line, evidence: Evidence, simulated: Sequence[Mapping[str, np.ndarray]]
            ) -> Line:
    """
    Return a line as the single rows tell it, where averaged ones hide it.

    A long recording is averaged over what may be whole periods of it: that tells neither its
    phase there nor how exactly the frequency must be known to stay in step.  Rows that are
    withheld from a fit have no say here either.

    Parameters
    ----------
    line : Line
        As matched to averaged rows.
    evidence : Evidence
        The recordings.
    simulated : sequence of mapping of str to ndarray, shape (n,)
        What each recording shows without the line (m).

    """
    found = {}
    for i, (track, channels) in enumerate(zip(evidence.tracks, simulated)):
        if CHANNEL in track.channels:
            seen = np.repeat(track.fitted, track.factor)
            wrong = (track.recording.measured[CHANNEL] - channels[CHANNEL])[:seen.size]
            time = track.recording.time[:seen.size] - track.recording.time[0]
            found[i] = time, wrong - wrong[seen].mean(), seen
    frequency = _sharpened(line.frequency, list(found.values()))
    pairs, weights = {}, {}
    for i, (time, wrong, seen) in found.items():
        angles = 2.0 * np.pi * frequency * np.outer(time[seen], HARMONICS)
        waves = np.column_stack([np.sin(angles), np.cos(angles), np.ones(len(angles))])
        sines, cosines = np.linalg.lstsq(waves, wrong[seen], rcond=None)[0][:-1].reshape(2, -1)
        pairs[i] = np.hypot(sines, cosines), np.arctan2(cosines, sines)
        weights[i] = len(angles) / np.var(wrong) if frequency * time[-1] >= SLOWEST else 0.0
    if not any(weights.values()):
        return line
    amplitudes = np.average([sizes for sizes, _ in pairs.values()], axis=0,
                            weights=list(weights.values()))
    return Line(frequency, amplitudes, {i: angles for i, (_, angles) in pairs.items()})


def _sharpened(frequency: float, found: list[tuple[np.ndarray, np.ndarray, np.ndarray]]) -> float:
    """Return where near a frequency (Hz) time, residual and what may be seen of it peak."""
    lengths = [float(time[-1]) for time, *_ in found]
    low = max(frequency - 2.0 / min(lengths), 0.0)
    high = frequency + 2.0 / min(lengths)
    count = math.ceil((high - low) * max(lengths) / SHARP)
    power = np.zeros(count)
    for time, wrong, seen in found:
        power += np.abs(zoom_fft(np.where(seen, wrong, 0.0), [low, high], count,
                                 fs=(time.size - 1) / time[-1])) ** 2 / (
            time.size * np.var(wrong))
    tried = np.linspace(low, high, count, endpoint=False)
    best = int(np.argmax(power))
    # Hardly more than where it was seen first is chance.
    before = power[np.argmin(np.abs(tried - frequency))]
    return float(tried[best]) if power[best] > 1.02 * before else frequency
