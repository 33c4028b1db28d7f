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

from piezo_stack_sim.gap.cores import parallel
from piezo_stack_sim.gap.measured.evidence import Evidence, Track
from piezo_stack_sim.gap.measured.forward import spans

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
    def corrected(part):
        (i, _), where = part
        track = evidence.tracks[i]
        features = _features(track, simulated[i])
        return residual[where] - predict(features, residual[where], track.fitted)

    return np.concatenate(parallel(corrected, zip(evidence.keys, spans(evidence))))


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
        left[where] = residual[where] - predict(wave[:, None], residual[where], track.fitted)
    return left


def predict(features: np.ndarray, target: np.ndarray, fitted: np.ndarray) -> np.ndarray:
    """
    Return what a ridge regression on the fitted rows predicts of all.

    Parameters
    ----------
    features : ndarray, shape (m, k)
        In any units; they are standardised here.
    target : ndarray, shape (m,)
        What to predict.
    fitted : ndarray of bool, shape (m,)
        The rows that are seen.

    Returns
    -------
    ndarray, shape (m,)

    """
    features = _standardised(features)
    seen = features[fitted]
    square = seen.T @ seen
    square[np.diag_indices_from(square)] += RIDGE * seen.shape[0]
    return features @ np.linalg.solve(square, seen.T @ target[fitted])


def _features(track: Track, simulated: dict) -> np.ndarray:
    """Return features of what was asked and simulated, shape (m, k)."""
    recording = track.recording
    dt = recording.period * track.factor
    time = track.average(recording.time - recording.time[0])
    raw = {'u': track.average(recording.command), 'f': track.average(recording.external_force),
           'q': track.average(simulated['charge']), 'x': track.average(simulated['displacement'])}
    columns = [time, np.log1p(time / dt / 10.0)]
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
                columns.append(v - lagged(v, decay))
    return np.column_stack(columns)


def _standardised(features: np.ndarray) -> np.ndarray:
    """Return features (m, k) without their means and in units of their spread, and a constant."""
    features = features - features.mean(axis=0)
    spread = features.std(axis=0)
    keep = spread > 1e-12 * np.abs(features).max(axis=0, initial=1e-300)
    return np.column_stack([np.ones(len(features)), features[:, keep] / spread[keep]])


def answers_to(change: np.ndarray, rows: int) -> np.ndarray:
    """Return a change (n,) as it was up to so many rows ago, (n, rows)."""
    return np.column_stack([np.concatenate([np.zeros(late), change[:change.size - late]])
                            for late in range(rows)])


def lagged(values: np.ndarray, rows: float) -> np.ndarray:
    """Return values (n,) behind a pole with a time constant in rows."""
    from scipy.signal import lfilter
    a = np.exp(-1.0 / rows)
    return lfilter([1.0 - a], [1.0, -a], values, zi=[a * values[0]])[0]
