# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Which swings a stack made before a recording.

Which of its elements start strained depends on them, and how the outputs change
with a swing turns a corner wherever one more of them slips: no derivative leads
far.  They are searched by simplex instead, and whatever else is free follows
linearly (variable projection): one simulation a place.
"""

from __future__ import annotations

from collections.abc import Callable
import itertools

import numpy as np
from piezo_stack_sim.gap.fitting.fit import free_parameters
from scipy.optimize import minimize

FIRST = (1.0, 1.15, 1.35)  # of the first swing alone: with later ones it may have been larger
BACK, FORTH = (-0.1, -0.2), (0.3, 0.65)  # of the first: later ones, each smaller than before
REACH = 0.15  # of the first: the first step of the simplex
EVALUATIONS = 25, 110  # simulations for the first alone, and for all
STARTS = 2  # places from which all are searched
FALLEN = 0.8  # part of the cost to which the first must bring it before more are tried
FINE = 1e-3  # change of the numbers, against the first step, and of the cost: arrived


def find_swings(cost: Callable[[np.ndarray], float], start: np.ndarray, bounds: np.ndarray,
                worth: tuple[float, float] = (0.0, np.inf)) -> tuple[np.ndarray, float]:
    """
    Return the swings (n,) with the lowest cost near a start, and that cost.

    The first is moved alone, then all: where it is wrong the others mean nothing.

    Parameters
    ----------
    cost : callable
        Takes swings (n,), returns a positive number.
    start : ndarray, shape (n,)
        Where to set out; the first is not zero.
    bounds : ndarray, shape (n, 2)
        The least and the greatest value of each.
    worth : (float, float), optional
        Costs with the first alone between which it is worth while to move the others.

    """
    def lead(swings, moved, most):
        def there(part):
            return np.clip(np.concatenate([part, swings[moved:]]), *bounds.T)

        size = REACH * abs(swings[0])
        corners = np.vstack([swings[:moved], swings[:moved] + size * np.eye(moved)])
        found = minimize(lambda part: np.log(cost(there(part))), corners[0],
                         method='Nelder-Mead', options={
                             'maxfev': most, 'initial_simplex': corners,
                             'xatol': FINE * size, 'fatol': FINE})
        return float(np.exp(found.fun)), there(found.x)

    def lowest(found):
        return min(found, key=lambda pair: pair[0])

    best = lead(start, 1, EVALUATIONS[0])
    if start.size > 1 and worth[0] < best[0] < worth[1]:
        parts = itertools.product(FIRST, *itertools.islice(
            itertools.cycle((BACK, FORTH)), start.size - 1))
        places = [np.clip(best[1][0] * np.array(part), *bounds.T) for part in parts]
        places = [place for _, place in sorted(
            ((cost(place), place) for place in places), key=lambda pair: pair[0])]
        best = lowest([best, *(lead(place, start.size, EVALUATIONS[1])
                               for place in places[:STARTS])])
    return best[1], best[0]


def find_history(name: str, place: dict[str, float], cost: Callable[[dict[str, float]], float],
                 worth: tuple[float, float]) -> tuple[dict[str, float], float]:
    """
    Return the numbers of an effect with the lowest cost near a place, and that cost.

    Parameters
    ----------
    name : str
        An effect that is a history of swings.
    place : dict
        Its parameters (SI) to start from.
    cost : callable
        Takes such parameters.
    worth : (float, float)
        Costs with the first alone between which it is worth while to move the others.

    """
    free = free_parameters(name, place)
    names = [f.parameter.name for f in free]
    numbers, lowest = find_swings(
        lambda numbers: cost({**place, **dict(zip(names, numbers.tolist()))}),
        np.array([place[n] for n in names]),
        np.array([(f.parameter.lower, f.parameter.upper) for f in free]), worth)
    return {**place, **dict(zip(names, numbers.tolist()))}, lowest
