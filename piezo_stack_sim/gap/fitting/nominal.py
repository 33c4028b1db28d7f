# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What the diagnosis may re-tune without calling it an effect.

The numbers of the parameter file are known to ``relative_uncertainty``; within
it they are nuisance: a deviation has a normal prior of half that width and is
never allowed beyond it, so that what lies outside is left to an effect.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from piezo_stack_sim.plant import Device

TABLE_1 = ('mass', 'stiffness', 'damping', 'linear_capacitance', 'transformer_ratio')

SURE = 1e-6  # smallest standard deviation of a number
ANY_SCALE = 0.5  # relative deviation of a scale of which nothing is known


class Nuisance:
    """
    The relative deviations phi of the nominal parameters, shape (p,).

    First those of Table 1, then the stiffness and the break voltage of every
    Maxwell element of Table 2, and last, if ``scale_free``, the scale of the
    displacement, of which nothing is known.  A load's mass moves with the stack's:
    only their sum shows.
    """

    def __init__(self, device: Device, scale_free: bool = False) -> None:
        self.device = device
        actuator = device.actuator
        uncertainty = actuator.relative_uncertainty
        n = len(actuator.maxwell_stiffness)
        self.names = [*TABLE_1, *(f'maxwell_stiffness[{i}]' for i in range(n)),
                      *(f'maxwell_break_voltage[{i}]' for i in range(n))]
        # The elements were fitted jointly to one curve: single deviations are smaller.
        self.bound = np.concatenate([np.full(5, uncertainty), np.full(2 * n, 0.5 * uncertainty)])
        if scale_free:
            self.names.append('displacement_scale')
            self.bound = np.append(self.bound, ANY_SCALE)
        self.scale_free = scale_free
        # A file that is sure of its numbers leaves nothing to re-tune.
        self.prior = np.maximum(0.5 * self.bound, SURE)
        self.n = n

    def apply(self, device: Device, phi: np.ndarray) -> Device:
        """Return the device with its nominal parameters changed by the factors 1 + phi."""
        if not np.any(phi):
            return device
        actuator = device.actuator
        changes = {name: getattr(actuator, name) * (1.0 + phi[i])
                   for i, name in enumerate(TABLE_1)}
        n = self.n
        changes['maxwell_stiffness'] = tuple(
            np.array(actuator.maxwell_stiffness) * (1.0 + phi[5:5 + n]))
        changes['maxwell_break_voltage'] = tuple(
            np.array(actuator.maxwell_break_voltage) * (1.0 + phi[5 + n:5 + 2 * n]))
        if self.scale_free:
            known = device.effects.get('sensor_gain', {}).get('gain_error', 0.0)
            device = device.with_effects(
                {'sensor_gain': {'gain_error': (1.0 + known) * (1.0 + float(phi[-1])) - 1.0}})
        load = replace(device.load, mass=device.load.mass * (1.0 + float(phi[0])))
        return device.replace(actuator=actuator.replace(**changes), load=load)
