# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The equations of the stack (paper Eqs. 11-19) and of what a real one adds, as compiled functions.

The charge is the one unknown of the electrical mesh: the root of a monotone function, found anew
at every step of the integrator. Mechanical forces are functions of the trial displacement.

"""

from numba import njit
import numpy as np

from piezo_stack_sim.challenge.guide import drag
from piezo_stack_sim.challenge.stage import BASE, lost, most


@njit(cache=True)
def mesh_voltage(p, z, q, dq, slow, x, h, heat, rate_scale):
    """
    Return the voltage that the mesh needs for a charge step `dq`, and its slope (Eqs. 11-18).

    `slow` is the part of `dq` that creeps past the Maxwell elements; ``h = 0`` is a jump.

    """
    rising = rate_scale * (1.0 + p.branch_difference)
    falling = -rate_scale * (1.0 - p.branch_difference)
    charge = q + dq
    coupling = p.T * (1.0 + p.direct_error) * (1.0 + heat)
    voltage = (charge - coupling * x) / p.C
    voltage += p.sense_elastance * charge
    slope = 1.0 / p.C + p.sense_elastance
    if p.electrostriction != 0.0:
        # The reaction of the coupling energy -(q^2 - q q_c) x/2 electrostriction. Table 2 was
        # identified on the free stack and so holds it already, there: x = free q.
        free = p.T / (p.T * p.T + p.k * p.C)
        voltage -= p.electrostriction * (charge - 0.5 * p.chord_charge) * x
        voltage += p.electrostriction * free * (1.5 * charge - p.chord_charge) * charge
        slope += p.electrostriction * (free * (3.0 * charge - p.chord_charge) - x)
    for i in range(z.size):
        stretched = z[i] + p.K[i] * (dq - slow)
        if stretched > p.V[i] * rising:
            voltage += p.V[i] * rising
        elif stretched < p.V[i] * falling:
            voltage += p.V[i] * falling
        else:
            voltage += stretched
            slope += p.K[i]
    if p.bow_stiffness != 0.0:
        growth = np.exp(charge / p.bow_charge)
        voltage += p.bow_stiffness * (p.bow_charge * (growth - 1.0) - charge)
        slope += p.bow_stiffness * (growth - 1.0)
    if h > 0.0 and not p.current_limit < np.inf:
        drop, rise = output_drop(p, dq, h)
        voltage += drop
        slope += rise
    return voltage, slope


@njit(cache=True)
def output_drop(p, dq, h):
    """
    Return the voltage lost in the amplifier's output for a charge step, and its slope.

    It grows only with the logarithm of the current beyond the quiescent one.

    """
    current = dq / h
    if p.crossover_voltage > 0.0:
        # Neither transistor conducts until the output is so far off: a class B stage.
        load = np.tanh(current / p.crossover_current)
        return (p.crossover_voltage * load,
                p.crossover_voltage / p.crossover_current / h * (1.0 - load * load))
    if p.quiescent_current < np.inf:
        load = current / p.quiescent_current
        return (p.output_resistance * p.quiescent_current * np.arcsinh(load),
                p.output_resistance / h / np.sqrt(1.0 + load * load))
    return p.output_resistance * current, p.output_resistance / h


@njit(cache=True)
def charge_step(p, z, stage, q, slow, x, h, heat, rate_scale, source):
    """Return the charge step with which the mesh takes the source voltage: Newton, bracketed."""
    low, high = -1e-2, 1e-2
    dq = 0.0
    limited = h > 0.0 and p.current_limit < np.inf
    if limited:
        low, high = most(p, stage)
        low, high, dq = low * h, high * h, stage[BASE] * h
    for _ in range(100):
        voltage, slope = mesh_voltage(p, z, q, dq, slow, x, h, heat, rate_scale)
        if limited:
            drop, rise = lost(p, stage, dq / h)
            voltage += drop
            slope += rise / h
        error = voltage - source
        if error > 0.0:
            high = dq
        else:
            low = dq
        if abs(error) < 1e-9 or high - low < 1e-19:
            break
        guess = dq - error / slope
        if not low < guess < high:
            guess = 0.5 * (low + high)
        dq = guess
    return dq


@njit(cache=True)
def slip(p, z, dq, slow, rate_scale):
    """Move the Maxwell elements by a charge step, in place (Eq. 16)."""
    rising = rate_scale * (1.0 + p.branch_difference)
    falling = -rate_scale * (1.0 - p.branch_difference)
    for i in range(z.size):
        z[i] = min(max(z[i] + p.K[i] * (dq - slow), p.V[i] * falling), p.V[i] * rising)


@njit(cache=True)
def mechanical_force(p, q, x, rubbing, relaxed, heat, force):
    """Return the force on the moving end (Eqs. 14, 15), without viscosity and payload."""
    direct = p.T * (1.0 + p.direct_error) * (1.0 + heat)
    off = p.converse_error * (1.0 - force / p.depoling_force)
    converse = p.T * (1.0 + off) * (1.0 + heat)
    total = converse * (q - direct * x) / p.C
    total += 0.5 * p.electrostriction * q * (q - p.chord_charge)
    total += force - p.k * x
    if p.spring_stiffness != 0.0:
        total -= p.spring_stiffness * x * (1.0 + abs(x) / p.spring_length)
    if p.hardening_force != 0.0:
        ratio = abs(x) / p.hardening_reference
        total -= np.sign(x) * p.hardening_force * ratio ** p.hardening_power
    total -= rubbing
    if p.hertz_stiffness > 0.0:
        # Asperities touch first: about the mean gap the indentation begins softly.
        deep = (x - p.hertz_gap) / p.hertz_roughness
        if deep > -40.0:
            indented = deep if deep > 40.0 else np.log1p(np.exp(deep))
            total -= p.hertz_stiffness * (p.hertz_roughness * indented) ** 1.5
    total -= p.mount_stiffness * x - relaxed
    if p.yielding_stiffness > 0.0:
        total += p.yielding_stiffness * p.yielding_width * np.log1p(
            np.exp((x - p.yielding_place) / p.yielding_width))
    if p.detent_force != 0.0:
        total -= p.detent_force * np.sin(2.0 * np.pi * x / p.detent_pitch)
    return total


@njit(cache=True)
def equilibrium(p, z, stage, q, x, guided, slow, relaxed, h, heat, rate_scale, source, force):
    """Return the steps of displacement and charge to where all forces balance: secant method."""
    stiff = p.k + p.T * p.T / p.C + p.spring_stiffness + p.mount_stiffness + p.b / h
    rubs = p.guide_first[0] > 0.0
    if rubs:
        stiff += p.guide_second.sum()
    dx = dq = 0.0
    last_dx = last_net = 0.0
    for attempt in range(50):
        dq = charge_step(p, z, stage, q, slow, x + dx, h, heat, rate_scale, source)
        rubbing = 0.0
        if rubs:
            rubbing = drag(p.guide_first, p.guide_second, p.guide_third, guided, dx, h)
        net = mechanical_force(p, q + dq, x + dx, rubbing, relaxed, heat, force)
        net -= p.b * dx / h
        slope = stiff
        if attempt > 0 and dx != last_dx:
            slope = (last_net - net) / (dx - last_dx)
            if not slope > 0.01 * stiff:
                slope = stiff
        last_dx, last_net = dx, net
        move = net / slope
        if abs(move) < 1e-15:
            break
        dx += move
    return dx, dq
