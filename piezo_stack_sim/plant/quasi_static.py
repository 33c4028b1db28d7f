# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The device led so slowly that inertia and damping play no part: exact, and without a time step.

Between two points of a path everything moves one way, so the charge is the inversion of a
monotone piecewise-linear function (Eqs. 11 to 17 at rest).  No kernel, no compiler: this is also
an independent check of the plant.

"""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np

from piezo_stack_sim.errors import InputError
from piezo_stack_sim.plant.parameters import Device


@dataclass(frozen=True)
class Rest:
    """Where a quasi-static path ended: the charge (C) and each element's voltage (V)."""

    charge: float
    element_voltage: tuple[float, ...]


@dataclass(frozen=True)
class Path:
    """
    A quasi-static path: arrays of shape (n,), SI units.

    ``force`` is the transduced force T v_t of Eq. 14, which is what a wall feels when the device
    is clamped.  ``dissipated`` (J) is what the Maxwell elements have turned into heat up to each
    point, ``out_of_range`` whether the last element, which should not, has slipped.

    """

    voltage: np.ndarray
    external_force: np.ndarray
    charge: np.ndarray
    displacement: np.ndarray
    force: np.ndarray
    dissipated: np.ndarray
    out_of_range: bool
    end: Rest


def relaxed(device: Device) -> Rest:
    """Return the relaxed state: no charge, no element strained."""
    return Rest(0.0, (0.0,) * len(device.actuator.maxwell_stiffness))


def lead(device: Device, values, external_force=0.0, drive: str = 'voltage',
         start: Rest | None = None) -> Path:
    """
    Lead a device quasi-statically from point to point.

    Parameters
    ----------
    device : Device
        Its actuator and load; effects play no part.
    values : array_like, shape (n,)
        Terminal voltage (V) for ``drive='voltage'``, charge (C) for ``'charge'``. Between two
        points it changes in proportion with the force, from the start to the first point too.
    external_force : array_like, shape (n,) or scalar
        N, positive in the direction of extension.
    drive : str
        ``voltage`` or ``charge``. Leads shorted is a voltage of zero, leads open a charge that
        stays.
    start : Rest, optional
        Where to start; relaxed if not given.

    Returns
    -------
    Path

    Raises
    ------
    InputError
        If the drive is unknown.

    """
    if drive not in ('voltage', 'charge'):
        raise InputError(f'drive {drive!r}: expected voltage or charge')
    values, forces = np.broadcast_arrays(np.atleast_1d(np.asarray(values, dtype=float)),
                                         np.asarray(external_force, dtype=float))
    actuator, load = device.actuator, device.load
    T = actuator.transformer_ratio
    C = actuator.linear_capacitance
    k = actuator.stiffness + load.stiffness
    # At rest Eqs. 11 and 15 give q = free v_t + pushed F: a capacitance and a charge per force.
    free, pushed = (C, 0.0) if load.clamped else (C + T * T / k, T / k)
    stiffness = np.array(actuator.maxwell_stiffness)
    limit = np.array(actuator.maxwell_break_voltage)

    start = start or relaxed(device)
    q, z = start.charge, np.array(start.element_voltage)
    charge = np.empty(values.size)
    v_rc = np.empty(values.size)
    dissipated = np.empty(values.size)
    heat, out_of_range = 0.0, False
    for row, (value, force) in enumerate(zip(values.tolist(), forces.tolist())):
        if drive == 'charge':
            dq = value - q
        else:
            missing = value - z.sum() - (q - pushed * force) / free
            dq = charge_step(missing, z, stiffness, limit, 1.0 / free)
        strained = z + stiffness * dq
        z = np.clip(strained, -limit, limit)  # Eq. 16
        over = np.abs(strained - z)
        slipped = over > 0.0
        if slipped.any():
            # A slipping element holds V_i while (strained - z)/k_i of charge passes it.
            heat += float((over[slipped] / stiffness[slipped] * limit[slipped]).sum())
            out_of_range = out_of_range or bool(slipped[-1])
        q += dq
        charge[row], v_rc[row], dissipated[row] = q, z.sum(), heat
    v_t = (charge - pushed * forces) / free
    x = np.zeros(values.size) if load.clamped else (T * v_t + forces) / k  # Eq. 15 at rest
    return Path(v_t + v_rc, np.array(forces), charge, x, T * v_t, dissipated, out_of_range,
                Rest(q, tuple(z.tolist())))


def charge_step(voltage: float, element_voltage, stiffness, limit, elastance: float) -> float:
    """
    Return the charge that raises the voltage of a Maxwell capacitor and one in series with it.

    Parameters
    ----------
    voltage : float
        Change of the voltage over both (V).
    element_voltage, stiffness, limit : ndarray, shape (n,)
        v_i (V), k_i = 1/C_i (V/C) and V_i (V) of the elements, Eqs. 16 to 19.
    elastance : float
        1/C of the capacitor in series (V/C).

    Returns
    -------
    float
        Change of the charge (C).

    """
    sign = math.copysign(1.0, voltage)
    left = abs(voltage)
    room = (limit - sign * element_voltage) / stiffness  # charge until each element slips
    slope = float(stiffness.sum()) + elastance
    done = 0.0
    for i in np.argsort(room, kind='stable'):
        step = (float(room[i]) - done) * slope
        if left <= step:
            break
        left -= step
        done = float(room[i])
        slope -= float(stiffness[i])
    return sign * (done + left / slope)


def cycle(device: Device, low: float, high: float, points: int = 401) -> Path:
    """
    Return one closed, settled voltage cycle: low to high and back.

    Parameters
    ----------
    device : Device
        The device.
    low, high : float
        V.
    points : int
        Points of each branch.

    Returns
    -------
    Path
        ``2 points - 1`` rows, ``low`` first and last; ``dissipated`` counts from the first.

    """
    # The operator remembers its last turning points only: after low - high - low it repeats.
    settled = lead(device, [low, high, low])
    branch = np.linspace(low, high, points)
    path = lead(device, np.concatenate([branch, branch[-2::-1]]), start=settled.end)
    if not settled.out_of_range:
        return path
    return Path(path.voltage, path.external_force, path.charge, path.displacement, path.force,
                path.dissipated, True, path.end)


def force_cycle(device: Device, low: float, high: float, voltage: float = 0.0,
                points: int = 401) -> Path:
    """
    Return one settled cycle of the external force at a held voltage: high to low and back.

    Parameters
    ----------
    device : Device
        The device.
    low, high : float
        N, positive in the direction of extension: the device is squeezed by a negative force.
    voltage : float
        Held voltage (V); zero is leads shorted.
    points : int
        Points of each branch.

    Returns
    -------
    Path
        ``2 points - 1`` rows, ``high`` first and last.

    """
    settled = lead(device, [voltage, voltage, voltage, voltage], [0.0, high, low, high])
    branch = np.linspace(high, low, points)
    forces = np.concatenate([branch, branch[-2::-1]])
    return lead(device, np.full(forces.size, voltage), forces, start=settled.end)
