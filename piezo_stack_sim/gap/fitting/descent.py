# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Bounded Gauss-Newton with a trust region, for residuals that cost a simulation each.

The derivative with respect to an effect is taken by simulation where the fit
sets out and again where it stalls, updated by Broyden's rule in between; that
with respect to the nominal parameters is taken once, for it hardly changes
within their uncertainty.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from piezo_stack_sim.gap.cores import parallel
from piezo_stack_sim.gap.fitting.lens import Lens
from scipy.optimize import lsq_linear

NUDGE = 2e-3  # relative change of a nominal parameter from which its derivative is taken
WIDE = 1e-2  # and one that looks past the kinks of single break voltages
PACE = 0.02  # change of the walk from which its derivative is taken
ENOUGH = 1e-3  # relative fall of the cost below which a fit has arrived
HARDLY = 1e-3  # change of the walk that is too little to learn from, if more was missed than told
TRIALS = 3  # step lengths that are tried before a derivative counts as stale


class Slope(NamedTuple):
    """A derivative: of all rows (N, p), of what the fit sees, and the square of that (p, p)."""

    whole: np.ndarray
    seen: np.ndarray
    square: np.ndarray

    @classmethod
    def of(cls, whole: np.ndarray, lens: Lens) -> Slope:
        """Return the slope with derivative ``whole`` (N, p), seen through a lens."""
        seen = lens(whole)
        return cls(whole, seen, seen.T @ seen)


@dataclass(frozen=True)
class Landscape:
    """
    What is to be minimised over a walk (n,) and the nominal deviations phi (p,).

    Attributes
    ----------
    residual : callable
        Takes walk and phi, returns the weighted residual (N,).
    lens : callable
        Takes a residual (N,), or changes of it (N, k), to what of it counts.
    lower, upper : ndarray, shape (n,)
        Bounds of the walk.
    room : ndarray, shape (p,)
        Bounds of the size of phi.
    prior : ndarray, shape (p,)
        Standard deviations of phi around zero.
    nudge : float
        Change of phi from which the derivative with respect to it is taken.

    """

    residual: Callable[[np.ndarray, np.ndarray], np.ndarray]
    lens: Lens
    lower: np.ndarray
    upper: np.ndarray
    room: np.ndarray
    prior: np.ndarray
    nudge: float = NUDGE

    def cost(self, residual: np.ndarray, phi: np.ndarray) -> float:
        """Return the sum of squares over what counts plus that of the prior."""
        return sum_of_squares(self.lens(residual), phi / self.prior)

    def nominal_slope(self, walk, phi, residual) -> Slope:
        """Return the derivative with respect to phi at a place."""
        return Slope.of(np.column_stack(parallel(
            lambda step: (self.residual(walk, phi + step) - residual) / self.nudge,
            self.nudge * np.eye(phi.size))), self.lens)

    def slope(self, walk, phi, residual, known=()) -> np.ndarray:
        """Return the derivative (N, n) with respect to the walk at a place, where not known."""
        columns = np.empty((residual.size, walk.size))

        def take(j):
            if j < len(known) and known[j] is not None:
                columns[:, j] = known[j]
                return
            step = PACE if self.upper[j] - walk[j] > PACE else -PACE
            moved = walk.copy()
            moved[j] += step
            columns[:, j] = (self.residual(moved, phi) - residual) / step

        parallel(take, range(walk.size))
        return columns


class End(NamedTuple):
    """Where a descent has come to, with the derivatives (N, n) and (N, p) there."""

    walk: np.ndarray
    phi: np.ndarray
    residual: np.ndarray
    cost: float
    effect: np.ndarray
    nominal: np.ndarray
    simulations: int


def sum_of_squares(*vectors: np.ndarray) -> float:
    """Return the sum of squares of all entries; infinite for a simulation that ran away."""
    with np.errstate(over='ignore'):
        return float(sum(vector @ vector for vector in vectors))


def descend(landscape: Landscape, walk: np.ndarray, phi: np.ndarray, nominal: Slope | None,
            steps: int, known: Sequence[np.ndarray | None] = ()) -> End:
    """
    Walk downhill.

    Parameters
    ----------
    landscape : Landscape
        What is to be minimised.
    walk, phi : ndarray
        Where to start.
    nominal : Slope or None
        Derivative with respect to phi; None takes it where the descent starts.
    steps : int
        The most Gauss-Newton steps.
    known : sequence of (N,) arrays or None
        Derivatives with respect to the walk that are near enough to set out with.

    Returns
    -------
    End

    """
    residual = landscape.residual(walk, phi)
    cost = landscape.cost(residual, phi)
    used, damping, n = 1, 1e-3, walk.size
    if nominal is None:
        nominal = landscape.nominal_slope(walk, phi, residual)
        used += phi.size
    precision = np.concatenate([np.zeros(n), landscape.prior ** -2.0])
    effect = np.full((residual.size, n), np.nan)  # not known, if there are no steps
    stale, fresh, held = True, False, False
    for _ in range(steps):
        if stale:
            effect = landscape.slope(walk, phi, residual, known)
            borrowed = sum(column is not None for column in known)
            used += n - borrowed
            stale, fresh, known = False, not borrowed, ()
        square, slope = _quadratic(landscape, effect, nominal, residual)
        slope += precision * np.concatenate([walk, phi])
        fallen = False
        for _ in range(TRIALS):
            reach = 0.0 if held else 1.0
            change = _bounded_step(
                square, precision, slope, damping,
                np.concatenate([reach * (landscape.lower - walk), -landscape.room - phi]),
                np.concatenate([reach * (landscape.upper - walk), landscape.room - phi]))
            new_walk, new_phi = walk + change[:n], phi + change[n:]
            new_residual = landscape.residual(new_walk, new_phi)
            used += 1
            new_cost = landscape.cost(new_residual, new_phi)
            fallen = new_cost < cost
            if fallen:
                break
            damping = max(damping, 1e-3) * 100.0
        if not fallen:
            if held or not n:
                break
            # On a corner no derivative leads on, but the nominal parameters may still follow.
            held, stale, damping = fresh, not fresh, 1e-3
            continue
        if n and np.any(change[:n]):
            # Broyden: what the step taught about the derivative costs no simulation.
            told = effect @ change[:n]
            missed = new_residual - residual - told - nominal.whole @ change[n:]
            # Unless the walk hardly moved: that is what the nominal parameters did.
            if np.abs(change[:n]).max() > HARDLY or missed @ missed < told @ told:
                effect += np.outer(missed, change[:n] / (change[:n] @ change[:n]))
        progress = (cost - new_cost) / max(cost, 1.0)
        walk, phi, residual, cost = new_walk, new_phi, new_residual, new_cost
        damping = max(damping / 30.0, 1e-6)
        if progress < ENOUGH:
            if fresh or held or not n:
                break
            stale = True
        fresh = False
    return End(walk, phi, residual, cost, effect, nominal.whole, used)


def _quadratic(landscape: Landscape, effect: np.ndarray, nominal: Slope, residual: np.ndarray
               ) -> tuple[np.ndarray, np.ndarray]:
    """Return the square of the derivative and its product with the residual."""
    seen, now = landscape.lens(effect), landscape.lens(residual)
    cross = seen.T @ nominal.seen
    square = np.block([[seen.T @ seen, cross], [cross.T, nominal.square]])
    return square, np.concatenate([seen.T @ now, nominal.seen.T @ now])


def _bounded_step(square, precision, slope, damping, low, high) -> np.ndarray:
    """Minimise the local quadratic within bounds (active sets of scipy)."""
    scale = np.sqrt(np.maximum(np.diag(square) + precision, 1e-12))
    matrix = (square + np.diag(precision)) / np.outer(scale, scale)
    matrix[np.diag_indices_from(matrix)] += damping + 1e-9
    root = np.linalg.cholesky(matrix)
    target = -np.linalg.solve(root, slope / scale)
    low, high = np.minimum(low * scale, -1e-12), np.maximum(high * scale, 1e-12)
    step = np.linalg.solve(root.T, target)
    if np.any(step < low) or np.any(step > high):
        # Not by 'trf': where no step leads further than rounding its search never ends.
        step = lsq_linear(root.T, target, bounds=(low, high), method='bvls').x
    return np.clip(step, low, high) / scale
