# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""The Maxwell model backwards: the command that brings the stack to a wanted displacement."""

from __future__ import annotations

import math

import numpy as np

from piezo_stack_sim.errors import InputError
from piezo_stack_sim.plant.parameters import Actuator, Load


class InverseStack:
    """
    Quasi-static inverse of the stack: displacement in, voltage or charge out.

    Hysteresis stands between voltage and charge only; between charge and
    displacement the stack is linear. So nothing has to be inverted but two
    springs: the wanted displacement fixes the force, the force the inner
    voltage and that the charge,

        v_t = (k x - F_ext) / T          Eqs. 14 and 15 at rest
        q   = T x + C v_t                Eq. 11

    and the charge, led through the same Maxwell elements in the same order as
    in the stack, gives the voltage across them,

        v_in = v_t + sum v_i             Eqs. 12 and 17
        v_i  = (q - q_bi) / C_i  while |v_i| < V_i, else  V_i sgn(dq/dt)    Eq. 16

    Like the stack it remembers: ask for displacements in the order in which
    they are to be reached, starting from the relaxed state. It knows nothing of
    inertia, so it holds well below the resonance.

    Parameters
    ----------
    actuator : Actuator
        What the controller believes the stack to be.
    load : Load, optional
        What the stack works against; only its stiffness acts at rest.

    Raises
    ------
    InputError
        If the load is clamped: then no command moves it.

    """

    def __init__(self, actuator: Actuator, load: Load | None = None) -> None:
        load = load or Load()
        if load.clamped:
            raise InputError('load.clamped = true: a clamped stack reaches no displacement; '
                             'the inverse needs one that can move')
        self._k = actuator.stiffness + load.stiffness
        self._T = actuator.transformer_ratio
        self._C = actuator.linear_capacitance
        self._elastances = np.array(actuator.maxwell_stiffness)  # 1/C_i, V/C (Eq. 18)
        self._limits = np.array(actuator.maxwell_break_voltage)  # V_i, V (Eq. 19)
        self.reset()

    def reset(self) -> None:
        """Return to the relaxed state."""
        self._charge = 0.0
        self._element_voltages = np.zeros_like(self._elastances)  # v_i

    def charge(self, displacement: float, external_force: float = 0.0) -> float:
        """
        Return the charge in C that holds a displacement (m) against a force (N); no memory.

        The force counts in the direction of extension.
        """
        v_t = (self._k * displacement - external_force) / self._T  # Eqs. 14, 15
        return self._T * displacement + self._C * v_t  # Eq. 11

    def voltage(self, displacement: float, external_force: float = 0.0) -> float:
        """
        Return the voltage in V that leads to a displacement (m) from where the last call led.

        The force (N) counts in the direction of extension.
        """
        charge = self.charge(displacement, external_force)
        change = charge - self._charge
        self._charge = charge
        # Eq. 16: each element charges up to its limit and slips beyond.
        self._element_voltages = np.clip(
            self._element_voltages + self._elastances * change, -self._limits, self._limits)
        v_t = (charge - self._T * displacement) / self._C  # Eq. 11
        return v_t + math.fsum(self._element_voltages)  # Eqs. 12, 17

    def voltages(self, displacements) -> np.ndarray:
        """
        Return the voltages that lead through displacements, one after the other.

        Parameters
        ----------
        displacements : array_like, shape (n,)
            m.

        Returns
        -------
        numpy.ndarray, shape (n,)
            V.

        """
        return np.array([self.voltage(float(x)) for x in displacements])
