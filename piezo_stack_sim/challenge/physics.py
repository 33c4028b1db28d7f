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
def share_left(way):
    """Return the part of its change that what decays by exp(-way) has made in the mean."""
    if way < 1e-3:
        return 0.5 + way / 12.0
    return 1.0 / (1.0 - np.exp(-way)) - 1.0 / way


@njit(cache=True)
def share_lagging(way, lag):
    """Return the same of an input that nears its end by exp(-lag), as the charge sees it."""
    if lag < 1e-3 or way < 1e-3:
        return share_left(max(way, lag))
    if abs(lag - way) < 1e-4 * way:
        lag = way * (1.0 + 1e-4)
    early, late = np.exp(-lag), np.exp(-way)
    return (1.0 - (early - late) / ((1.0 - lag / way) * (1.0 - late))) / (1.0 - early)


@njit(cache=True)
def share_bent(off, way):
    """Return the same where current grows with sinh of what is off, over its own unit."""
    if abs(off) < 0.03 or way < 1e-3:
        return share_left(way)
    left = 2.0 * np.arctanh(min(np.tanh(0.5 * abs(off)), 1.0 - 1e-15) * np.exp(-way))
    gone = abs(off) - left
    if gone < 1e-9:
        return 0.5
    return (abs(off) - np.arcsinh(gone / way)) / gone


@njit(cache=True)
def resisted_step(p, z, stage, q, slow, x, h, heat, rate_scale, start, before, source, lag, rate):
    """
    Return charge step (C), mesh voltage at its end (V), and what has flowed in the mean (C).

    The charge decays towards the source through the output resistance, in a time that may be
    less than the step: each voltage is weighed as that exponential weighs it, which is exact as
    long as the mesh is linear (exponential fitting, Liniger and Willoughby 1970).

    Parameters
    ----------
    p, z, stage, q, slow, heat, rate_scale : ndarray or float
        What the step starts with, as the integrator holds it.
    x : float
        Displacement at the end, in m.
    h : float
        Step, in s.
    start, before, source : float
        Voltage of the mesh at the beginning, and of the source there and at the end, in V.
    lag : float
        Step over the time constant with which the source nears its end; 0 if it goes straight.
    rate : float
        Current to begin the search with, in A.

    """
    still, slope = mesh_voltage(p, z, q, 0.0, slow, x, 0.0, heat, rate_scale)
    limited = p.current_limit < np.inf
    low, high, dq = -1e-2, 1e-2, rate * h
    if limited:
        low, high = most(p, stage)
        low, high = low * h, high * h
        dq = min(max(dq, low), high)
    voltage, moved, felt, early = still, 0.5, 0.5, 0.0
    for _ in range(100):
        voltage, slope = mesh_voltage(p, z, q, dq, slow, x, 0.0, heat, rate_scale)
        secant = (voltage - still) / dq if abs(dq) > 1e-16 else slope
        if limited:
            drop, rise = lost(p, stage, dq / h)
            own = p.output_resistance / rise
            way = h * secant / p.output_resistance
            # What limits takes its voltage at once, and the current hardly changes then.
            share = 1.0 - own * (1.0 - share_left(way))
            felt, way = share_left(own * way), own * way
            rise /= h
        else:
            drop, rise = output_drop(p, dq, h)
            way = h * secant / p.output_resistance
            share = share_left(way)
            if p.quiescent_current < np.inf:
                full = before - start + moved * (source - before) - share * (still - start)
                share = share_bent(full / (p.output_resistance * p.quiescent_current), way)
            felt = share
        moved = share_lagging(way, lag) if lag > 0.0 else share
        # What the source and the motion do throughout the step comes in its middle.
        middle = share_left(lag) if lag > 0.0 else 0.5
        early = ((middle - moved) * (source - before) + (felt - 0.5) * (still - start)) / secant
        error = drop + start + share * (voltage - start) - before - moved * (source - before)
        if error > 0.0:
            high = dq
        else:
            low = dq
        if abs(error) < 1e-8 or high - low < 1e-19:
            break
        guess = dq - error / (rise + share * slope)
        if not low < guess < high:
            guess = 0.5 * (low + high)
        dq = guess
    return dq, voltage, felt * dq + early


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
def force_per_charge(p, q, heat, force):
    """Return the slope of `mechanical_force` with the charge, in N/C."""
    off = p.converse_error * (1.0 - force / p.depoling_force)
    return (p.T * (1.0 + off) * (1.0 + heat) / p.C
            + p.electrostriction * (q - 0.5 * p.chord_charge))


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
