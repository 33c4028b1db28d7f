# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A capacitor in series with the stack that nobody mentioned, such as one that senses its charge.

It takes a part of the voltage, in proportion to the charge.  A capacitor C_s is the same in every
channel as a spring of T^2/(C_s + C) beside a stack whose ratio and capacitance are smaller by
the factor 1 + C/C_s (Eqs. 11 and 14 of the paper).  So the two are told apart by how much of the
nominal parameters must be re-tuned, and these are fitted anew beside either.
"""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np
from piezo_stack_sim.gap.cores import parallel
from piezo_stack_sim.gap.fitting.descent import descend, Landscape
from piezo_stack_sim.gap.fitting.fit import Fit, Fitter
from piezo_stack_sim.gap.lacking.back_coupling import Suspect
from piezo_stack_sim.gap.measured.forward import residuals
from piezo_stack_sim.gap.quantities import quantity
from piezo_stack_sim.plant import Device

SPRING = 'parallel_stiffness'  # of all the library has, that which looks like it
SIZES = np.geomspace(1e-3, 0.5, 7)  # of the elastance 1/C of the stack
OFTENER = 3.0  # times as often as such a capacitor there is a spring
ROUGHLY = 5.0  # nats by which two fits differ for elements that are about to slip
ROUNDS, STEPS = 3, 8  # in which the derivatives are taken anew, and steps of each


@dataclass(frozen=True)
class InSeries:
    """
    A capacitor where it leaves least, and what it must explain.

    ``farads`` is how large it is, ``better`` by how many nats it explains the recordings better,
    what it takes to re-tune the parameters included.
    """

    farads: float
    better: float

    @property
    def chance(self) -> float:
        """Return the probability that there is none, if it is this or what the library has."""
        return OFTENER / (OFTENER + math.exp(min(self.better / ROUGHLY, 100.0)))

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
    Fit a capacitor in series with the stack, and the nominal parameters beside it.

    Parameters
    ----------
    fitter : Fitter
        Of the set.
    known : Fit
        What the library has for it.

    Returns
    -------
    InSeries

    """
    evidence, nuisance = fitter.evidence, fitter.nuisance

    def left(walk, phi):
        return residuals(_with(fitter.device_with({}, phi), float(np.exp(walk[0]))), evidence)

    landscape = Landscape(left, fitter.lens, np.log(SIZES[:1]), np.log(SIZES[-1:]),
                          nuisance.bound, nuisance.prior)
    # Not from where the parameters have gone to do without a capacitor.
    phi = np.zeros(nuisance.bound.size)
    costs = parallel(lambda size: landscape.cost(left(np.log([size]), phi), phi), SIZES)
    walk = np.log(SIZES[[int(np.argmin(costs))]])
    for _ in range(ROUNDS):
        # Beside the capacitor the parameters do something else than without it.
        end = descend(landscape, walk, phi, None, STEPS)
        walk, phi = end.walk, end.phi
    for _ in range(ROUNDS - 1):
        known = fitter.fit(known.effects, known.phi, anew=True)
    return InSeries(fitter.device.actuator.linear_capacitance / float(np.exp(walk[0])),
                    0.5 * (known.cost - end.cost))


def _with(device: Device, part: float) -> Device:
    """Return a device in series with a capacitor, of an elastance that is a part of its 1/C."""
    actuator, volts = device.actuator, device.actuator.maxwell_break_voltage
    *elastances, last = actuator.maxwell_stiffness
    more = part / actuator.linear_capacitance
    # It is one more element, which never slips: if the last one never does, the two are one.
    if math.isinf(volts[-1]):
        elastances.append(last + more)
    else:
        elastances += last, more
        volts = *volts, math.inf
    return device.replace(actuator=actuator.replace(
        maxwell_stiffness=tuple(elastances), maxwell_break_voltage=volts))
