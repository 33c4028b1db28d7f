# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Where the linear states of a device come to rest, given the others: starts without a jump."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from piezo_stack_sim.plant import layout
from piezo_stack_sim.plant.assembly import System


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
