# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Rates with their uncertainty, and how honest stated probabilities are."""

import math

import numpy as np

Z = 1.959964  # two-sided 95 %
DRAWS = 2000  # of answers as true as their probabilities say


def wilson(hits, of):
    """
    Return a rate with its Wilson score interval (95 %).

    Parameters
    ----------
    hits, of : int
        Successes, and how many there were.

    Returns
    -------
    dict
        hits, of, rate, low, high; rate and interval are None for an empty sample.

    """
    if of == 0:
        return {'hits': 0, 'of': 0, 'rate': None, 'low': None, 'high': None}
    p = hits / of
    centre = p + Z * Z / (2 * of)
    spread = Z * math.sqrt(p * (1 - p) / of + Z * Z / (4 * of * of))
    scale = 1 + Z * Z / of
    return {'hits': int(hits), 'of': int(of), 'rate': p,
            'low': max(0.0, (centre - spread) / scale),
            'high': min(1.0, (centre + spread) / scale)}


def rate(outcomes):
    """Return the Wilson rate of an iterable of truth values; None does not count."""
    counted = [bool(outcome) for outcome in outcomes if outcome is not None]
    return wilson(sum(counted), len(counted))


def calibration(probabilities, outcomes, bins=10):
    """
    Return how stated probabilities compare with what came true.

    Parameters
    ----------
    probabilities : (n,) sequence of float
        What each answer claimed.
    outcomes : (n,) sequence of bool
        Whether each answer was right.
    bins : int
        Equal-width bins of the expected calibration error.

    Returns
    -------
    dict
        n, ece, brier, bins with their mean probability, rate and count; and ``ece_by_chance``, the
        mean and the 95 % quantile of the error that probabilities without any error would show
        in as few answers.

    """
    p = np.asarray(probabilities, dtype=float)
    hit = np.asarray(outcomes, dtype=float)
    if p.size == 0:
        return {'n': 0, 'ece': None, 'brier': None, 'bins': [],
                'ece_by_chance': {'mean': None, 'p95': None}}
    which = np.minimum((p * bins).astype(int), bins - 1)
    member = np.equal.outer(which, np.arange(bins)).astype(float)
    came_true = np.random.default_rng(0).random((DRAWS, p.size)) < p
    by_chance = np.abs((came_true - p) @ member).sum(axis=1) / p.size
    rows, ece = [], 0.0
    for b in range(bins):
        inside = which == b
        if inside.any():
            stated, came = float(p[inside].mean()), float(hit[inside].mean())
            ece += inside.mean() * abs(stated - came)
            rows.append({'stated': stated, 'true': came, 'count': int(inside.sum())})
    return {'n': int(p.size), 'ece': float(ece), 'brier': float(np.mean((p - hit) ** 2)),
            'bins': rows, 'ece_by_chance': {'mean': float(by_chance.mean()),
                                            'p95': float(np.quantile(by_chance, 0.95))}}


def summary(values):
    """Return count, median, mean, 5 and 95 % quantile of an iterable; None is left out."""
    kept = np.array([value for value in values if value is not None], dtype=float)
    if kept.size == 0:
        return {'n': 0, 'median': None, 'mean': None, 'q05': None, 'q95': None}
    return {'n': int(kept.size), 'median': float(np.median(kept)), 'mean': float(kept.mean()),
            'q05': float(np.quantile(kept, 0.05)), 'q95': float(np.quantile(kept, 0.95))}
