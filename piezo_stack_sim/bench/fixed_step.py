# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A plain loop with a fixed time step: the trapezoidal rule and Newton's method, compiled.

It shares no code with the plant. With a step of a microsecond it is what one would write first;
with a step of tens of nanoseconds it is the reference that every accuracy is measured against.

"""

from __future__ import annotations

import numba
import numpy as np

from piezo_stack_sim.plant.parameters import Device


def run(device: Device, time, command, external_force=None, step: float = 1e-6
        ) -> dict[str, np.ndarray]:
    """
    Compute a voltage-driven, unclamped device step by step.

    Parameters
    ----------
    device : Device
        Its actuator and load; effects are left out.
    time, command, external_force : array_like, shape (n,)
        s, V and N; held from row to row.
    step : float
        Largest time step (s); each row takes the least whole number of steps.

    Returns
    -------
    dict of ndarray, shape (n,)
        ``displacement`` (m) and ``charge`` (C), sampled just before each row's command.

    """
    actuator, load = device.actuator, device.load
    force = np.zeros(len(time)) if external_force is None else external_force
    # Copies: a read-only array is another type, and would be compiled for anew.
    time, command, force = (np.array(each, dtype=float) for each in (time, command, force))
    x, q = _loop(
        time, command, force, step,
        actuator.mass + load.mass, actuator.damping + load.damping,
        actuator.stiffness + load.stiffness, actuator.linear_capacitance,
        actuator.transformer_ratio, np.array(actuator.maxwell_stiffness),
        np.array(actuator.maxwell_break_voltage))
    return {'displacement': x, 'charge': q}


@numba.njit(cache=True)
def _charge(q, z, k, limit, a, b, u):
    """Return the charge at which the elements' voltages and a q + b add up to u (Newton)."""
    new = q
    for _ in range(50):
        voltage = a * new + b - u
        slope = a
        for i in range(k.size):
            strained = z[i] + k[i] * (new - q)
            if strained > limit[i]:
                voltage += limit[i]
            elif strained < -limit[i]:
                voltage -= limit[i]
            else:
                voltage += strained
                slope += k[i]
        change = voltage / slope
        new -= change
        if abs(change) < 1e-16:
            break
    return new


@numba.njit(cache=True)
def _strain(z, k, limit, dq):
    for i in range(k.size):
        z[i] = min(max(z[i] + k[i] * dq, -limit[i]), limit[i])


@numba.njit(cache=True)
def _loop(time, command, force, step, m, b, stiffness, C, T, k, limit):
    n = time.size
    xs, qs = np.zeros(n), np.zeros(n)
    z = np.zeros(k.size)
    x, v, q = 0.0, 0.0, 0.0
    total = stiffness + T * T / C
    for row in range(n - 1):
        duration = time[row + 1] - time[row]
        count = max(int(np.ceil(duration / step - 1e-6)), 1)
        h = duration / count
        u, F = command[row], force[row]
        # The command jumps, and the charge with it; the mass stands still meanwhile.
        jumped = _charge(q, z, k, limit, 1.0 / C, -T * x / C, u)
        _strain(z, k, limit, jumped - q)
        q = jumped
        # Trapezoidal rule on Eq. 15 with Eq. 14: velocity w and place y at the end of a step are
        # affine in the charge at its end.
        inverse = 1.0 / (m + 0.5 * h * b + 0.25 * h * h * total)
        for _ in range(count):
            pull = -b * v - total * x + T / C * q + 2.0 * F
            w0 = (m * v + 0.5 * h * (pull - total * (x + 0.5 * h * v))) * inverse
            w1 = 0.5 * h * T / C * inverse
            y0, y1 = x + 0.5 * h * (v + w0), 0.5 * h * w1
            new = _charge(q, z, k, limit, (1.0 - T * y1) / C, -T * y0 / C, u)
            _strain(z, k, limit, new - q)
            x, v, q = y0 + y1 * new, w0 + w1 * new, new
        xs[row + 1], qs[row + 1] = x, q
    return xs, qs
