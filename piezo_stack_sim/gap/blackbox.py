# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The ceiling and the placebo: what any effect could explain, and what none should.

The ceiling is a flexible linear correction of the residual from a few dozen
features of command, force, simulated answer and time, learned on the fitted
rows.  The placebo is one such feature with no physics in it, a slow random
wave that no device has.
"""

from __future__ import annotations

import numpy as np

from piezo_stack_sim.gap.evidence import Evidence, Track
from piezo_stack_sim.gap.forward import spans

RIDGE = 1e-3
SEED = 20261121
DRAWS = 7


def flexible_correction(evidence: Evidence, simulated: list[dict], residual: np.ndarray
                        ) -> np.ndarray:
    """
    Return the residual (N,) that is left after a flexible correction per track and channel.

    Parameters
    ----------
    evidence : Evidence
        The recordings.
    simulated : list of dict
        Simulated channels of each, (n,).
    residual : ndarray, shape (N,)
        Weighted residual to explain.

    """
    left = residual.copy()
    for (i, channel), where in zip(evidence.keys, spans(evidence)):
        track = evidence.tracks[i]
        features = _features(track, simulated[i])
        left[where] = residual[where] - _predict(features, residual[where], track.fitted)
    return left


def placebo_corrections(evidence: Evidence, residual: np.ndarray) -> list[np.ndarray]:
    """
    Return the residuals (N,) after fitting slow random waves, one a recording, to one.

    Several draws, for a single wave may resemble a programme of a few levels by
    luck: the middle one counts.
    """
    random = np.random.default_rng(SEED)
    return [_one_placebo(evidence, residual, random) for _ in range(DRAWS)]


def _one_placebo(evidence: Evidence, residual: np.ndarray, random) -> np.ndarray:
    left = residual.copy()
    for (i, _), where in zip(evidence.keys, spans(evidence)):
        track = evidence.tracks[i]
        m = track.fitted.size
        wave = np.cumsum(random.standard_normal(m))
        wave = (wave - wave.mean()) / max(wave.std(), 1e-12)
        left[where] = residual[where] - _predict(wave[:, None], residual[where], track.fitted)
    return left


def _predict(features, target, fitted) -> np.ndarray:
    seen = features[fitted]
    square = seen.T @ seen
    square[np.diag_indices_from(square)] += RIDGE * seen.shape[0]
    return features @ np.linalg.solve(square, seen.T @ target[fitted])


def _features(track: Track, simulated: dict) -> np.ndarray:
    """Return standardised features, shape (m, k)."""
    recording = track.recording
    dt = recording.period * track.factor
    time = track.average(recording.time - recording.time[0])
    raw = {'u': track.average(recording.command), 'f': track.average(recording.external_force),
           'q': track.average(simulated['charge']), 'x': track.average(simulated['displacement'])}
    columns = [np.ones_like(time), time, np.log1p(time / dt / 10.0)]
    for name, values in raw.items():
        span = np.ptp(values)
        if span <= 0.0:
            continue
        v = (values - values.min()) / span * 2.0 - 1.0
        rate = np.gradient(v)
        size = np.abs(rate).max() or 1.0
        columns += [v, v ** 2, v ** 3, rate / size, np.sign(rate) * (np.abs(rate) > 1e-3 * size)]
        if name in ('q', 'x'):
            columns += [v ** 4, np.gradient(rate) / (np.abs(np.gradient(rate)).max() or 1.0),
                        v * rate / size, np.abs(v)]
            for decay in (3, 30, 300, 3000):
                columns.append(v - _lagged(v, decay))
    matrix = np.column_stack(columns)
    matrix[:, 1:] -= matrix[:, 1:].mean(axis=0)
    scale = matrix.std(axis=0)
    scale[0] = 1.0
    keep = scale > 1e-12
    return matrix[:, keep] / scale[keep]


def _lagged(values, rows) -> np.ndarray:
    from scipy.signal import lfilter
    a = np.exp(-1.0 / rows)
    return lfilter([1.0 - a], [1.0, -a], values, zi=[a * values[0]])[0]
