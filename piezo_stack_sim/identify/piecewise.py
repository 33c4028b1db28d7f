# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A rising curve by straight pieces, and the Maxwell elements that the pieces stand for.

The paper fits pieces by eye.  Here their ends are placed best for a given
number, first on the points of a thinned curve by dynamic programming, then
anywhere: given the ends, the element stiffnesses follow linearly (Eqs. 6 to 10).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares, nnls

FEWEST = 2  # points in a piece
MOST = 12  # elements tried when their number is not given
EXACT = 1e-6  # of the largest voltage: an error that no element mends
BETTER = 0.93  # an element more must bring the held-out error below this share


@dataclass(frozen=True)
class Pieces:
    """
    A concave curve of straight pieces from the origin.

    ``stiffness`` (n,) V/C are k_i of Eq. 8, the last one with the linear part of
    the stack in it; ``break_charge`` (n-1,) C the ends of all pieces but the last,
    Eq. 9; ``error`` (V) is the rms misfit.
    """

    stiffness: np.ndarray
    break_charge: np.ndarray
    error: float

    def voltage(self, charge) -> np.ndarray:
        """Return the curve (V) at charges (C)."""
        return _basis(np.asarray(charge), self.break_charge) @ self.stiffness


def fit_pieces(charge, voltage, weight, n: int) -> Pieces:
    """
    Fit a rising curve by the best n straight pieces.

    Parameters
    ----------
    charge, voltage, weight : ndarray, shape (m,)
        C, V and weight of each point; charges increase.
    n : int
        Pieces, that is elements.

    Returns
    -------
    Pieces

    """
    ends = _best_ends(charge, voltage, weight, n)
    root = np.sqrt(weight)

    def solve(walk):
        ends = np.sort(np.exp(walk))
        stiffness, _ = nnls(_basis(charge, ends) * root[:, None], voltage * root)
        return ends, stiffness

    def misfit(walk):
        ends, stiffness = solve(walk)
        return (_basis(charge, ends) @ stiffness - voltage) * root

    least, most = charge[charge > 0.0][0], charge[-1]
    walk = np.log(np.clip(ends, least * (1.0 + 1e-9), most * (1.0 - 1e-9)))
    if walk.size:
        low, high = np.log(least), np.log(most)
        walk = least_squares(misfit, walk, bounds=(low, high), xtol=1e-10, ftol=1e-12,
                             max_nfev=60).x
    ends, stiffness = solve(walk)
    return Pieces(stiffness, ends, float(np.sqrt(np.sum(misfit(walk) ** 2) / weight.sum())))


def choose_pieces(charge, voltage, weight, most: int = MOST) -> Pieces:
    """Fit a curve by as many pieces as points that were held out justify."""
    seen = np.arange(charge.size) % 2 == 0
    errors = []
    for n in range(1, most + 1):
        if seen.sum() < 3 * n + 3:
            break
        pieces = fit_pieces(charge[seen], voltage[seen], weight[seen], n)
        miss = pieces.voltage(charge[~seen]) - voltage[~seen]
        errors.append(float(np.sqrt(np.average(miss ** 2, weights=weight[~seen]))))
    best = 0
    for n in range(1, len(errors)):
        if errors[best] < EXACT * voltage[-1]:
            break
        if errors[n] < BETTER ** (n - best) * errors[best]:
            best = n
    return fit_pieces(charge, voltage, weight, best + 1)


def _basis(charge, ends) -> np.ndarray:
    """Return what an element of stiffness one carries, (m, n): min(q, end), the last without."""
    return np.minimum(charge[:, None], np.append(ends, np.inf)[None, :])


def _best_ends(charge, voltage, weight, n) -> np.ndarray:
    """Return the ends (n-1,) of the best n separate lines, by dynamic programming."""
    q, v = charge / charge[-1], voltage / voltage[-1]
    m = q.size
    sums = [np.concatenate([[0.0], np.cumsum(weight * each)])
            for each in (np.ones(m), q, v, q * q, q * v, v * v)]
    # cost[i, j]: what a line through the points i to j - 1 leaves.
    w, sq, sv, sqq, sqv, svv = [s[None, :] - s[:, None] for s in sums]
    with np.errstate(divide='ignore', invalid='ignore'):
        cqq, cqv, cvv = sqq - sq * sq / w, sqv - sq * sv / w, svv - sv * sv / w
        cost = cvv - np.where(cqq > 0.0, cqv * cqv / cqq, 0.0)
        slope = cqv / cqq
        level = (sv - slope * sq) / w
    points = np.arange(m + 1)[None, :] - np.arange(m + 1)[:, None]
    cost = np.where(points >= FEWEST, np.maximum(cost, 0.0), np.inf)
    total, back = cost[0], []
    for _ in range(n - 1):
        table = total[:, None] + cost
        back.append(np.argmin(table, axis=0))
        total = table[back[-1], np.arange(m + 1)]
    cuts = [m]
    for choice in back[::-1]:
        cuts.append(int(choice[cuts[-1]]))
    cuts = [0, *cuts[:0:-1], m]
    ends = []
    for a, b, c in zip(cuts, cuts[1:], cuts[2:]):
        inside = (q[b - 1], q[min(b, m - 1)])
        turn = slope[a, b] - slope[b, c]
        where = (level[b, c] - level[a, b]) / turn if turn else np.nan
        margin = inside[1] - inside[0]
        good = inside[0] - margin <= where <= inside[1] + margin
        ends.append((where if good else 0.5 * sum(inside)) * charge[-1])
    return np.array(ends)
