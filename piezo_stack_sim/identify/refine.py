# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The joint fit: all recordings at once, by the error of their simulation.

Levenberg-Marquardt on the normal equations: there are 10^5 rows and some 25
parameters, so that a step costs little beside the simulations.  Derivatives are
differences of simulations, taken in threads (the kernel frees the interpreter).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from piezo_stack_sim.errors import InputError
from piezo_stack_sim.gap.cores import parallel
from piezo_stack_sim.identify.tracks import misfits, reweighted, weighted
from piezo_stack_sim.identify.vector import Layout

STEP = 1e-3  # of a logarithm, for the derivatives; smooths over the kinks where elements slip
LOOSE = 1.5  # standard deviation of the weak belief in the start, of a logarithm
FREE = 300.0  # the same while the weights are not yet those of the noise
LARGEST = 1.0  # change of a logarithm in one step
STEPS = (15, 10)  # at most, each round weighed by what the one before left
ENOUGH = 0.01  # fall of the cost, in units of its mean per row, below which it has arrived


@dataclass(frozen=True)
class Fit:
    """
    What a joint fit found.

    ``vector`` (p,), ``tracks`` as weighed last, ``residual`` (N,) the misfit
    over sigma, ``jacobian`` (N, p) its derivative, ``start`` (p,).
    """

    layout: Layout
    vector: np.ndarray
    tracks: list
    residual: np.ndarray
    jacobian: np.ndarray
    start: np.ndarray

    @property
    def misfits(self) -> list[dict[str, np.ndarray]]:
        """Return what the fit leaves of every channel of every track, SI units."""
        return misfits(self.layout, self.vector, self.tracks)


def refine(layout: Layout, vector, tracks, told=None, free=None) -> Fit:
    """
    Fit all recordings at once.

    Parameters
    ----------
    layout : Layout
        Which numbers are free.
    vector : ndarray, shape (p,)
        Where to start.
    tracks : list of Track
        The recordings, prepared.
    told : callable, optional
        Called with a line of progress after every step.
    free : sequence of int, optional
        Entries of the vector that may change; all if not given.

    Returns
    -------
    Fit

    """
    start = np.array(vector, dtype=float)
    vector = start.copy()
    for number, steps in enumerate(STEPS):
        if number:
            tracks = reweighted(tracks, misfits(layout, vector, tracks))
        vector = descend(layout, vector, tracks, free, steps, start, told,
                         loose=LOOSE if number else FREE)
    tracks = reweighted(tracks, misfits(layout, vector, tracks))
    residual = _residual(layout, vector, tracks)
    # Where an element is about to slip the two sides differ: intervals need their mean.
    every = range(vector.size)
    jacobian = 0.5 * (_jacobian(layout, vector, tracks, residual, every)
                      + _jacobian(layout, vector, tracks, residual, every, -STEP))
    return Fit(layout, vector, tracks, residual, jacobian, start)


def cost_of(layout: Layout, vector, tracks) -> float:
    """Return the sum of squares of the weighted misfit."""
    residual = _residual(layout, vector, tracks)
    return float(residual @ residual)


def descend(layout: Layout, vector, tracks, free=None, steps=15, start=None, told=None,
            loose=FREE):
    """
    Walk to the nearest minimum.

    Parameters
    ----------
    layout, vector, tracks
        As for `refine`.
    free : sequence of int, optional
        Entries of the vector that may change; all if not given.
    steps : int
        At most.
    start : ndarray, shape (p,), optional
        What is weakly believed; ``vector`` if not given.
    told : callable, optional
        Called with a line of progress after every step.
    loose : float
        Standard deviation of the weak belief, of a logarithm.

    Returns
    -------
    ndarray, shape (p,)

    """
    free = np.arange(vector.size) if free is None else np.asarray(free)
    start = vector if start is None else start
    damping, idle = 1e-3, 0
    residual = _residual(layout, vector, tracks)
    cost = _cost(residual, vector, start, loose)
    for step in range(steps):
        jacobian = _jacobian(layout, vector, tracks, residual, free)
        square = jacobian.T @ jacobian
        square[np.diag_indices_from(square)] += loose ** -2.0
        slope = jacobian.T @ residual + (vector - start)[free] / loose ** 2
        scale = np.sqrt(np.diag(square))
        matrix, target = square / np.outer(scale, scale), -slope / scale
        for _ in range(5):
            damped = matrix + damping * np.eye(free.size)
            change = np.zeros(vector.size)
            change[free] = np.clip(np.linalg.solve(damped, target) / scale, -LARGEST, LARGEST)
            moved = _residual(layout, vector + change, tracks)
            new = _cost(moved, vector + change, start, loose)
            if new < cost:
                break
            damping = max(damping, 1e-6) * 10.0
        else:
            break
        fall = (cost - new) / cost * residual.size
        vector, residual, cost = vector + change, moved, new
        damping = max(damping / 10.0, 1e-12)
        if told:
            told(f'step {step + 1}: rms misfit {np.sqrt(cost / residual.size):.3g} of the weight')
        idle = idle + 1 if fall < ENOUGH else 0
        if idle >= 2 or cost < 1e-12 * residual.size:
            break
    return vector


def _residual(layout, vector, tracks) -> np.ndarray:
    try:
        return weighted(tracks, misfits(layout, vector, tracks))
    except (InputError, OverflowError):
        # Numbers that no device can have: infinitely bad, but not the end of the search.
        rows = sum(values.size for track in tracks for values in track.measured.values())
        return np.full(rows, 1e6)


def _jacobian(layout, vector, tracks, residual, free, step=STEP) -> np.ndarray:
    def column(j):
        moved = vector.copy()
        moved[j] += step
        return (_residual(layout, moved, tracks) - residual) / step

    return np.column_stack(parallel(column, free))


def _cost(residual, vector, start, loose) -> float:
    return float(residual @ residual + np.sum(((vector - start) / loose) ** 2))
