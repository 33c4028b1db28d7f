# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Smooth ports: a voltage over the charge, a force over the displacement.

Polynomials, and a stop that pushes back with a power of the indentation.

Within a sub-step each follows a parabola in time, which the motion, exact for
such an input, must meet at the end and in the middle.
"""


from piezo_stack_sim.plant.compiled import inline, jit
from piezo_stack_sim.plant.cubic import hermite
from piezo_stack_sim.plant.lanes import LANES, sums
from piezo_stack_sim.plant.layout import (
    N_INPUTS, N_RAMPS, R_T, R_TOL, R_V2, R_V3, SMOOTH_F, SMOOTH_V, W_Q, W_Q1)
from piezo_stack_sim.plant.ports import smooth_force, smooth_force_slope, smooth_voltage


@jit
def charge_gain(weight, q, real):
    """
    Return by what the rate of charge grows because the smooth voltage follows the charge.

    ``weight`` (F) is the charge that a smooth volt moves at once: zero behind a resistance.
    """
    return 1.0 / max(0.05, 1.0 - weight * q * (2.0 * real[R_V2] + 3.0 * real[R_V3] * q))


@inline
def _meet(tables, at, z, held, n, rows, bend, length, real, end):
    """
    Find the ports' voltage and force at the end of a sub-step, and that ``end``.

    ``held`` is the end with the ports held; ``bend`` says by how much each is
    above its chord in the middle.  Returns both ports at the end.
    """
    used = n + N_INPUTS
    v0 = z[n + SMOOTH_V]
    f0 = z[n + SMOOTH_F]
    slope = 1.0 / length
    z[used] = 4.0 * bend[0] * slope
    z[used + 1] = 4.0 * bend[1] * slope
    z[used + 2] = -8.0 * bend[0] * slope * slope
    z[used + 3] = -8.0 * bend[1] * slope * slope
    # Charge and displacement at the end are linear in what the ports do.
    q = held[n + W_Q]
    x = held[0]
    for c in range(used, used + N_RAMPS):
        q += tables[at, c, n + W_Q] * z[c]
        x += tables[at, c, 0] * z[c]
    q_v = tables[at, used, n + W_Q] * slope
    q_f = tables[at, used + 1, n + W_Q] * slope
    x_v = tables[at, used, 0] * slope
    x_f = tables[at, used + 1, 0] * slope
    dv = 0.0
    df = 0.0
    for _ in range(6):
        q1 = q + q_v * dv + q_f * df
        x1 = x + x_v * dv + x_f * df
        miss_v = smooth_voltage(q1, real) - v0 - dv
        miss_f = smooth_force(x1, real) - f0 - df
        if abs(miss_v) + abs(miss_f) / real[R_T] < 1e-7 * real[R_TOL]:
            break
        grow_v = q1 * (2.0 * real[R_V2] + 3.0 * real[R_V3] * q1)
        grow_f = smooth_force_slope(x1, real)
        # Newton with the 2x2 Jacobian.
        a = 1.0 - grow_v * q_v
        b = -grow_v * q_f
        c = -grow_f * x_v
        d = 1.0 - grow_f * x_f
        scale = 1.0 / (a * d - b * c)
        dv += (d * miss_v - b * miss_f) * scale
        df += (a * miss_f - c * miss_v) * scale
    z[used] += dv * slope
    z[used + 1] += df * slope
    stride = tables.shape[2]
    start = (at * tables.shape[1] + used) * stride
    ramps = z[used:]
    for i in range(0, rows, LANES):
        sums(tables, start + i, stride, ramps, N_RAMPS, end, i)
    for i in range(rows):
        end[i] += held[i]
    return v0 + dv, f0 + df


@inline
def smooth_step(tables, at, z, held, n, rows, length, weight, real, now, bend, end):
    """
    Let the smooth ports follow a parabola over a sub-step.

    ``held`` is where it would end with the ports held, ``now`` has charge and rate
    at its start, ``weight`` is that of :func:`charge_gain`.  What the ports do is
    left in the last columns of ``z``.  Returns by how much (V) a port strays from its
    parabola at a quarter, and both ports at the end.
    """
    v0 = z[n + SMOOTH_V]
    f0 = z[n + SMOOTH_F]
    bend[0] = 0.0
    bend[1] = 0.0
    q0 = now[W_Q]
    d0 = now[W_Q1] * length
    x0 = z[0]
    w0 = z[1] * length
    error = 0.0
    v1 = v0
    f1 = f0
    for turn in range(2):
        v1, f1 = _meet(tables, at, z, held, n, rows, bend, length, real, end)
        q1 = end[n + W_Q]
        end[n + W_Q1] *= charge_gain(weight, q1, real)
        if turn == 1:
            break
        d1 = end[n + W_Q1] * length
        w1 = end[1] * length
        for part in range(2):
            theta = 0.5 - 0.25 * part
            voltage = (smooth_voltage(hermite(theta, q0, d0, q1, d1), real)
                       - v0 - theta * (v1 - v0))
            force = smooth_force(hermite(theta, x0, w0, end[0], w1), real) - f0 - theta * (f1 - f0)
            if part == 0:
                bend[0] = voltage
                bend[1] = force
            else:
                error = (abs(voltage - 0.75 * bend[0])
                         + abs(force - 0.75 * bend[1]) / real[R_T])
        if error > real[R_TOL] or abs(bend[0]) + abs(bend[1]) / real[R_T] < 0.05 * real[R_TOL]:
            break
    return error, v1, f1


@jit
def follow(z, n, length):
    """Move the smooth inputs of an extended state for ``length`` seconds."""
    for port in range(2):
        value = n + SMOOTH_V + port
        slope = n + N_INPUTS + port
        z[value] += length * (z[slope] + 0.5 * length * z[slope + 2])
        z[slope] += length * z[slope + 2]
