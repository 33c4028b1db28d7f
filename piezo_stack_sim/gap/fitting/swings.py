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
from dataclasses import dataclass
import itertools

import numpy as np
from piezo_stack_sim.gap.cores import parallel
from piezo_stack_sim.gap.fitting.fit import free_parameters
from scipy.optimize import minimize

FIRST = (1.0, 1.15, 1.35)  # of the first swing alone: with later ones it may have been larger
BACK, FORTH = (-0.1, -0.2), (0.3, 0.65)  # of the first: later ones, each smaller than before
REACH = 0.15  # of the first: the first step of the simplex
EVALUATIONS = 25, 110  # simulations for the first alone, and for all
STARTS = 2  # places from which all are searched
FALLEN = 0.8  # part of the cost to which the first must bring it before more are tried
FINE = 1e-3  # change of the numbers, against the first step, and of the cost: arrived
SAME = 2e-3  # part by which the costs of two places differ that are one


@dataclass(frozen=True)
class Led:
    """Where a search has come to: the parameters of the effect (SI), and the cost there."""

    place: dict[str, float]
    cost: float


class History:
    """
    The search for the numbers of an effect that is a history of swings.

    Parameters
    ----------
    name : str
        The effect.
    place : dict
        Its parameters (SI) to start from; the first swing is not zero.
    cost : callable
        Takes such parameters, returns a positive number.

    """

    def __init__(self, name: str, place: dict[str, float],
                 cost: Callable[[dict[str, float]], float]) -> None:
        self._place, self._given = place, cost
        free = free_parameters(name, place)
        self._names = [f.parameter.name for f in free]
        self._bounds = np.array([(f.parameter.lower, f.parameter.upper) for f in free])

    def first(self) -> Led:
        """Return where the first alone costs least: where it is wrong the others mean nothing."""
        return self._led(np.array([self._place[name] for name in self._names]), 1, EVALUATIONS[0])

    def others(self, first: Led) -> Led:
        """Return where all of them cost least, near where the first alone does."""
        swings = np.array([first.place[name] for name in self._names])
        if swings.size < 2:
            return first
        parts = itertools.product(FIRST, *itertools.islice(
            itertools.cycle((BACK, FORTH)), swings.size - 1))
        places = [np.clip(swings[0] * np.array(part), *self._bounds.T) for part in parts]
        best = np.argsort(parallel(self._cost, places), kind='stable')[:STARTS]
        return min([first, *parallel(
            lambda i: self._led(places[i], swings.size, EVALUATIONS[1]), best)],
            key=lambda led: led.cost)

    def _at(self, swings: np.ndarray) -> dict[str, float]:
        return {**self._place, **dict(zip(self._names, swings.tolist()))}

    def _cost(self, swings: np.ndarray) -> float:
        return self._given(self._at(swings))

    def _led(self, swings: np.ndarray, moved: int, most: int) -> Led:
        """Move so many of the swings by simplex."""
        def there(part):
            return np.clip(np.concatenate([part, swings[moved:]]), *self._bounds.T)

        size = REACH * abs(swings[0])
        corners = np.vstack([swings[:moved], swings[:moved] + size * np.eye(moved)])
        found = minimize(lambda part: np.log(self._cost(there(part))), corners[0],
                         method='Nelder-Mead', options={
                             'maxfev': most, 'initial_simplex': corners,
                             'xatol': FINE * size, 'fatol': FINE})
        return Led(self._at(there(found.x)), float(np.exp(found.fun)))


def apart(found: list[Led]) -> list[Led]:
    """Return what is led to places of other costs, the best first: of those that met, one."""
    kept: list[Led] = []
    for led in sorted(found, key=lambda led: led.cost):
        if not kept or led.cost > (1.0 + SAME) * kept[-1].cost:
            kept.append(led)
    return kept
