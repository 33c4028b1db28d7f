# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A capacitor in series with the stack that nobody mentioned, such as one that senses its charge.

It takes a part of the voltage, in proportion to the charge.  A capacitor C_s is the same in every
channel as a spring of T^2/(C_s + C) beside a stack whose ratio and capacitance are smaller by
the factor 1 + C/C_s (Eqs. 11 and 14 of the paper): no recording tells the two apart, only what is
known beforehand.  That is how far the nominal parameters may be from the file, and which springs
and capacitors there are: one that leaves as little as another but is far softer than any preload
spring is hardly a spring.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
import math
from typing import NamedTuple

import numpy as np
from piezo_stack_sim.effects.registry import EFFECTS
from piezo_stack_sim.gap.cores import parallel
from piezo_stack_sim.gap.fitting.descent import sum_of_squares, WIDE
from piezo_stack_sim.gap.fitting.fit import Fit, Fitter
from piezo_stack_sim.gap.lacking.back_coupling import Suspect
from piezo_stack_sim.gap.quantities import quantity
from scipy.integrate import trapezoid
from scipy.optimize import lsq_linear

SPRING, SIZE = 'parallel_stiffness', 'stiffness'  # what looks like it of all the library has
# Times as often as such a capacitor there is a spring, where nothing is left and where something
# is: a flexure grows stiffer the further it is bent, and a capacitor that senses is straight.
OFTENER = (1.5, 9.0)
# In F and N/m: the size that is as often exceeded as not, and the factor within which nine of ten
# are.  Sawyer-Tower capacitors take about a hundredth of the voltage; preload springs and
# flexures are from 1 to 25 N/um.
CAPACITOR, CAPACITORS = 1e-4, 3.0
SPRINGS = 5.0
NINE_OF_TEN = 1.645  # standard deviations
ROUNDS = 3  # in which the derivatives are taken anew
STIFF, LARGE = np.geomspace(2e5, 2e7, 9), np.geomspace(1e-5, 4e-4, 9)  # N/m and F, to set out
CLEARLY, PIECES = 3.0, 50.0  # standard deviations, and parts of a set that err by themselves
COARSELY, FINELY = 60, 40  # sizes that are tried, and as many about the best of these
BEYOND = 4.0  # standard deviations in which sizes are tried


@dataclass(frozen=True)
class InSeries:
    """
    A capacitor where it leaves least, and how likely it is.

    ``farads`` is how large it is, ``better`` by how many nats it is likelier than the spring that
    leaves as much, before either is known to be more frequent, ``straight`` whether both leave
    no more than noise, ``residual`` (N,) what it leaves, over the noise, and ``cost`` what that
    costs.
    """

    farads: float
    better: float
    straight: bool
    residual: np.ndarray
    cost: float

    @property
    def chance(self) -> float:
        """Return the probability that there is none, if it is this or what the library has."""
        spring = OFTENER[not self.straight]
        return spring / (spring + math.exp(min(self.better, 100.0)))

    @property
    def words(self) -> str:
        """Return what it is, in words."""
        return f'a capacitor of about {quantity(self.farads, "F", 2)} in series with the stack'

    @property
    def suspect(self) -> Suspect:
        """Return what it is, as something that the library lacks."""
        return Suspect('electrical', f'all is wrong as if there were {self.words}')


def capacitor_in_series(fitter: Fitter, known: Fit) -> InSeries:
    """
    Weigh a capacitor in series with the stack against the spring that looks like it.

    Parameters
    ----------
    fitter : Fitter
        Of the set.
    known : Fit
        What the library has for it, with a spring.

    Returns
    -------
    InSeries

    """
    actuator, nuisance = fitter.device.actuator, fitter.nuisance
    k, C, T = actuator.stiffness, actuator.linear_capacitance, actuator.transformer_ratio
    stiffness, capacitance, ratio = map(nuisance.names.index, (
        'stiffness', 'linear_capacitance', 'transformer_ratio'))

    def spring(newtons: float) -> np.ndarray:
        shift = np.zeros(nuisance.bound.size)
        shift[stiffness] = newtons / k
        return shift

    def capacitor(farads: float) -> np.ndarray:
        shift = spring(T ** 2 / (farads + C))
        shift[[capacitance, ratio]] = -C / (farads + C)
        return shift

    def residual(away: np.ndarray, newtons: float) -> np.ndarray:
        return fitter.residual_of({**known.effects, SPRING: {SIZE: newtons}},
                                  away - spring(newtons), known)

    def stiffer(away: np.ndarray) -> float:
        return k * float(away[stiffness])

    # Not from where the parameters have gone to do without a capacitor.
    starts = [*map(spring, STIFF), *map(capacitor, LARGE)]
    costs = parallel(lambda away: sum_of_squares(fitter.lens(residual(away, stiffer(away)))),
                     starts)
    away = starts[int(np.argmin(costs))]
    newtons = stiffer(away)
    for turn in range(ROUNDS):
        bowl = _Bowl.around(fitter, away, partial(residual, newtons=newtons))
        if turn == ROUNDS - 1:
            bowl = bowl.doubted()  # before, it would lead to what is usual and not to what fits
        springs = _Weighed.of(bowl, spring, EFFECTS[SPRING].typical()[SIZE], SPRINGS)
        capacitors = _Weighed.of(bowl, capacitor, CAPACITOR, CAPACITORS)
        likelier = max(springs, capacitors, key=lambda one: one.evidence)
        newtons, away = stiffer(likelier.shift), likelier.shift + likelier.phi
    away = capacitors.shift + capacitors.phi
    left = residual(away, stiffer(away))
    return InSeries(capacitors.size, capacitors.evidence - springs.evidence,
                    bowl.missed < PIECES, left, fitter.cost(left, capacitors.phi))


class _Bowl(NamedTuple):
    """
    The sum of squares of a set about a device, of second order in what it is like.

    ``centre`` (p,) is where it was taken: how far that is from the file, a spring counted to its
    stiffness, ``missed`` what it is there above the noise, ``square`` (p, p) and ``slope`` (p,)
    its derivatives there.
    """

    centre: np.ndarray
    missed: float
    square: np.ndarray
    slope: np.ndarray
    bound: np.ndarray
    prior: np.ndarray

    @classmethod
    def around(cls, fitter: Fitter, centre: np.ndarray,
               residual: Callable[[np.ndarray], np.ndarray]) -> _Bowl:
        """Return that about a device so far from the file (p,)."""
        here = residual(centre)
        seen = fitter.lens(here).astype(float)
        slopes = fitter.lens(np.column_stack(parallel(
            lambda step: (residual(centre + step) - here) / WIDE,
            WIDE * np.eye(centre.size)))).astype(float)
        noise = seen.size + CLEARLY * math.sqrt(2.0 * seen.size)
        return cls(centre, max(float(seen @ seen) - noise, 0.0), slopes.T @ slopes,
                   slopes.T @ seen, fitter.nuisance.bound, fitter.nuisance.prior)

    def doubted(self) -> _Bowl:
        """
        Return what may be concluded from it, if what it misses is an error of its form.

        The nominal parameters then go to their bounds to imitate what the form lacks, and that is
        wrong alike for the whole of a piece.
        """
        trust = 1.0 / (1.0 + self.missed / PIECES)
        return self._replace(square=trust * self.square, slope=trust * self.slope)

    def least(self, shift: np.ndarray) -> tuple[float, np.ndarray]:
        """Return the least cost, and the nominal deviations (p,), of a device so far away."""
        away, precision = shift - self.centre, np.diag(self.prior ** -2.0)
        root = np.linalg.cholesky(self.square + precision)
        phi = lsq_linear(root.T, -np.linalg.solve(root, self.square @ away + self.slope),
                         (-self.bound - 1e-12, self.bound + 1e-12), method='bvls').x
        change = away + phi
        return float(change @ self.square @ change + 2.0 * self.slope @ change
                     + phi @ precision @ phi), phi


class _Weighed(NamedTuple):
    """The likeliest size of what a device may have, with the nats that speak for any size."""

    size: float
    shift: np.ndarray
    phi: np.ndarray
    evidence: float

    @classmethod
    def of(cls, bowl: _Bowl, shift: Callable[[float], np.ndarray], usual: float, within: float
           ) -> _Weighed:
        width = math.log(within) / NINE_OF_TEN
        sizes = np.linspace(-BEYOND, BEYOND, COARSELY)

        def nats(size):
            # Normal in the logarithm of the size.
            cost, _ = bowl.least(shift(usual * math.exp(width * size)))
            return -0.5 * (cost + size ** 2 + math.log(2.0 * math.pi))

        found = np.array([nats(size) for size in sizes])
        best, apart = sizes[int(np.argmax(found))], sizes[1] - sizes[0]
        finer = best + apart * np.linspace(-1.0, 1.0, FINELY)
        sizes = np.append(sizes, finer)
        found = np.append(found, [nats(size) for size in finer])
        order = np.argsort(sizes)
        sizes, found = sizes[order], found[order]
        most = int(np.argmax(found))
        size = usual * math.exp(width * float(sizes[most]))
        return cls(size, shift(size), bowl.least(shift(size))[1], float(
            found[most] + np.log(trapezoid(np.exp(found - found[most]), sizes))))
