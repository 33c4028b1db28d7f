# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Where the linear states of a device come to rest, given the others: starts without a jump."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
import math

import numpy as np

from piezo_stack_sim.errors import InputError
from piezo_stack_sim.plant import layout, ports
from piezo_stack_sim.plant.assembly import System
from scipy.optimize import brentq

STEPS = 40  # to where the other side of an equilibrium is looked for
UNSTABLE = ('the device rests nowhere under the voltages and the force before its start: a spring '
            'or a voltage of its effects yields without end')


def rest(system: System, s: np.ndarray, q: float, v: float, inputs: np.ndarray,
         free: Collection[str]) -> np.ndarray:
    """
    Let some states find the place where they no longer change.

    Parameters
    ----------
    system : System
        The device as the kernel takes it.
    s : numpy.ndarray, shape (N,)
        States; those not in ``free`` are held.
    q, v : float
        Charge (C) and terminal voltage (V).
    inputs : numpy.ndarray, shape (8,)
        Inputs of the layout.
    free : collection of str
        Names of the states to place.

    Returns
    -------
    numpy.ndarray, shape (N,)
        The states, ``free`` ones at rest.  What rests nowhere (an integral) is
        zero, what swings by itself starts as its effect says.

    """
    n = s.size
    placed = [i for i, name in enumerate(system.state_names)
              if name in free and system.initial[i] == 0.0]
    if not placed:
        return s.copy()
    s = s.copy()
    s[placed] = 0.0
    # The displacement rests where the forces balance: where the velocity does not change.
    rows = system.rates[[*placed, 1] if 0 in placed else placed]
    matrix = rows[:, placed]
    given = rows[:, :n] @ s + rows[:, n] * q + rows[:, n + 1] * v + rows[:, n + 2:] @ inputs
    # Rates span twelve decades; each equation counts the same.
    scale = np.abs(matrix).max(axis=1)
    scale[scale == 0.0] = np.inf
    s[placed] = np.linalg.lstsq(matrix / scale[:, None], -given / scale, rcond=None)[0]
    return s


def rest_of_unit_charge(system: System) -> tuple[np.ndarray, float, float]:
    """
    Return the states at rest per coulomb, and what they make of Eqs. 11 and 12.

    Returns
    -------
    states : numpy.ndarray, shape (N,)
        With a charge of 1 C and zero volts at the leads, no force.
    capacitance : float
        q / v_t (F), the free capacitance C + T^2/k of the ideal stack.
    elastance : float
        Linear voltages in series with the Maxwell capacitor, V/C.

    """
    names = system.state_names
    s = np.zeros(len(names))
    if 'charge' in names:
        s[names.index('charge')] = 1.0
    s = rest(system, s, 1.0, 0.0, np.zeros(layout.N_INPUTS),
             set(names) - {'charge', 'velocity'})
    capacitance = system.real[layout.R_C] / (1.0 - system.real[layout.R_T] * s[0])
    return s, float(capacitance), float(system.opposing[0, :-1] @ s + system.opposing[0, -1])


class Lead:
    """
    Leads a relaxed device so slowly from voltage to voltage that it is always at rest.

    Parameters
    ----------
    system : System
        The device as the kernel takes it.
    flags, p : numpy.ndarray
        Discrete state (6,) and block positions (n,), changed in place; slip goes on
        until :func:`piezo_stack_sim.plant.ports.stick`.
    force : float
        External force (N) that acts all the time.

    """

    def __init__(self, system: System, flags: np.ndarray, p: np.ndarray, force: float = 0.0
                 ) -> None:
        self.system, self.flags, self.p = system, flags, p
        self.charge = 0.0
        self.per_charge, self.capacitance, self.elastance = rest_of_unit_charge(system)
        # What is always on, as a voltage that branches start apart with.
        self.offset = float(system.opposing[0, :-1] @ system.initial)
        self.pushed = np.zeros(len(system.state_names))
        if force:
            self.pushed = self._rest_by(layout.FORCE, force)
            self.offset += float(system.opposing[0, :-1] @ self.pushed
                                 - system.real[layout.R_T] / system.real[layout.R_C]
                                 * self.pushed[0])
        ints = system.ints
        self.is_linear = not (ints[layout.I_SMOOTH] or ints[layout.I_CONTACT])
        if not self.is_linear:
            # Displacement and the states that follow it, by a force at a held charge.
            self.per_force = self._rest_by(layout.SMOOTH_F, 1.0)

    def _rest_by(self, column: int, value: float) -> np.ndarray:
        """Return where the states (N,) rest without charge by one input alone."""
        inputs = np.zeros(layout.N_INPUTS)
        inputs[column] = value
        names = self.system.state_names
        return rest(self.system, np.zeros(len(names)), 0.0, 0.0, inputs,
                    set(names) - {'charge', 'velocity'})

    def to(self, voltage: float) -> float:
        """Lead on to a voltage (V) and return the charge there (C)."""
        system = self.system
        if self.is_linear:
            self.charge = ports.move_charge(
                self.charge, self.capacitance * (voltage - self.offset), self.capacitance,
                system.real, self.flags, self.p, system.r, system.k, system.v_break,
                self.elastance)
            return self.charge
        miss = voltage - self._voltage(self.charge)
        if miss == 0.0:
            return self.charge
        # The free capacitance tells how far about; what is not linear makes it more or less.
        step, far = 0.25 * self.capacitance * miss, self.charge
        for _ in range(STEPS):
            far += step
            if (voltage - self._voltage(far)) * miss <= 0.0:
                there = _root(lambda charge: self._voltage(charge) - voltage, self.charge, far)
                self.charge = self._move(there, self.flags, self.p)
                return self.charge
            step *= 1.2
        raise InputError(UNSTABLE)

    def set_out(self, strains: Sequence[float]) -> None:
        """
        Set out at rest without voltage from how strained the elements are, not from relaxed ones.

        Parameters
        ----------
        strains : sequence of float, shape (m,)
            Voltage of each element as a part of its break voltage, -1 to 1 (Eq. 16); 0 and what
            is left out are elements that have not slipped.  Where no history leaves two neighbours
            so, since their blocks are never further apart than their break charges differ, the
            shorter one gives way.

        """
        system, p = self.system, self.p
        r, k, v_break = system.r, system.k, system.v_break
        z = np.zeros(r.size)
        z[:len(strains)] = strains[:r.size]
        z[~np.isfinite(r)] = 0.0
        slipped = z != 0.0
        sticking = k[~slipped]
        q = (self.capacitance * (sticking @ p[~slipped] - self.offset - z @ v_break)
             / (1.0 + self.capacitance * (sticking.sum() + self.elastance)))
        p[slipped] = q - z[slipped] * r[slipped]
        for i in range(r.size - 2, -1, -1):
            if math.isfinite(r[i + 1]):
                room = r[i + 1] - r[i]
                p[i] = min(max(p[i], p[i + 1] - room), p[i + 1] + room)
        self.charge = min(max(q, p[0] - r[0]), p[0] + r[0])
        self.to(0.0)

    def states(self) -> np.ndarray:
        """Return where the states rest at the charge reached, shape (N,), with zero volts."""
        states = self.charge * self.per_charge + self.pushed
        return states if self.is_linear else states + self._force(states[0]) * self.per_force

    def _move(self, charge: float, flags: np.ndarray, p: np.ndarray) -> float:
        system = self.system
        return ports.move_charge(self.charge, charge, 0.0, system.real, flags, p, system.r,
                                 system.k, system.v_break, 0.0)

    def _voltage(self, charge: float) -> float:
        """Return the voltage at rest if the charge is led on from where it is."""
        system, flags, p = self.system, self.flags.copy(), self.p.copy()
        self._move(charge, flags, p)
        slip = flags[layout.F_SLIP]
        maxwell = ports.maxwell_offset(slip, flags[layout.F_DIR], p, system.k, system.v_break)
        free = charge * self.per_charge
        states = free + self._force(free[0] + self.pushed[0]) * self.per_force
        real = system.real
        return float(self.offset + (charge - real[layout.R_T] * states[0]) / real[layout.R_C]
                     + system.opposing[0, :-1] @ states + system.opposing[0, -1] * charge
                     + maxwell + system.k[slip:].sum() * charge
                     + ports.smooth_voltage(charge, real))

    def _force(self, free: float) -> float:
        """Return the force (N) of what is not linear where the displacement would be ``free``."""
        real, softness = self.system.real, self.per_force[0]

        def force(x: float) -> float:
            stop = real[layout.R_CONTACT_K] * max(x - real[layout.R_GAP], 0.0)
            return float(ports.smooth_force(x, real)) - stop

        def miss(push: float) -> float:
            return force(free + softness * push) - push

        first = far = miss(0.0)
        if first == 0.0:
            return 0.0
        # What pushes back does so by no more than where nothing gives way, what yields by more.
        for _ in range(STEPS):
            if miss(far) * first <= 0.0:
                return _root(miss, 0.0, far)
            far *= 1.5
        raise InputError(UNSTABLE)


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    """
    Return where a function between two places of opposite sign is zero.

    Raises
    ------
    InputError
        If it leaves the finite numbers in between.

    """
    try:
        return float(brentq(function, low, high, xtol=1e-18, rtol=1e-14))
    except (ValueError, RuntimeError):
        raise InputError(UNSTABLE) from None
