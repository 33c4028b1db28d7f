# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Ports with memory: which Maxwell elements slip, friction, stops, the amplifier's limit.

Here the discrete state of the device changes; between two changes the motion
is linear, but for the polynomial (*smooth*) ports.
"""

import math


from piezo_stack_sim.plant.compiled import inline, jit
from piezo_stack_sim.plant.layout import (
    A_CONTACT, A_FRICTION, A_RC, CHARGE_TOLERANCE, DISPLACEMENT_TOLERANCE, F_CONTACT, F_DIR,
    F_FRIC, F_FRIC_DIR, F_LIMIT, F_SLIP, GROWTH_CURRENT, GROWTH_MEMORY, GROWTH_STEP, I_CONTACT,
    I_DRIVE, I_FRICTION, I_LIMITER, I_QSTATE, I_SMOOTH, I_SOURCE, M_BEGAN, M_CHARGE, M_CURRENT,
    M_FRICTION, M_FURTHEST, M_GROWTH, M_JUMP, M_SINCE, M_SLIDE, R_C, R_CONTACT_H, R_CONTACT_K,
    R_CONTACT_POWER, R_EXPONENT, R_FRICTION_F, R_FRICTION_K, R_GAP, R_GROWTH, R_K2, R_K3, R_SHARE,
    R_T, R_V2, R_V3, SMOOTH_F, SMOOTH_V, U, VOLTAGE, W_Q, W_Q1, W_WANT)
from piezo_stack_sim.plant.limiter import limit_at


@jit
def maxwell_offset(slip, direction, p, k, v_break):
    """Return the part of v_rc that does not depend on q in this mode (V)."""
    a = 0.0
    for i in range(k.size):
        if i < slip:
            a += direction * v_break[i]  # Eq. 16, slipping
        else:
            a -= k[i] * p[i]  # Eq. 16, sticking
    return a


@jit
def smooth_voltage(q, real):
    return q * q * (real[R_V2] + real[R_V3] * q)


@jit
def smooth_force(x, real):
    force = -x * x * (real[R_K2] + real[R_K3] * x)
    over = x - real[R_GAP]
    if real[R_CONTACT_H] > 0.0 and over > 0.0:
        force -= real[R_CONTACT_H] * over ** real[R_CONTACT_POWER]
    return force


@jit
def smooth_force_slope(x, real):
    slope = -x * (2.0 * real[R_K2] + 3.0 * real[R_K3] * x)
    over = x - real[R_GAP]
    if real[R_CONTACT_H] > 0.0 and over > 0.0:
        slope -= real[R_CONTACT_POWER] * real[R_CONTACT_H] * over ** (real[R_CONTACT_POWER] - 1.0)
    return slope


@jit
def stick(flags, p, r, q):
    """Stop all slip at charge ``q``: the blocks stay where they are (Eq. 16)."""
    for i in range(flags[F_SLIP]):
        p[i] = q - flags[F_DIR] * r[i]
    flags[F_SLIP] = 0


@jit
def grown(growth, r, v_break, limits):
    """Set ``limits`` (2, n) to the charges and voltages at which elements break by now."""
    for i in range(r.size):
        limits[0, i] = r[i] * (1.0 + growth)
        limits[1, i] = v_break[i] * (1.0 + growth)


@jit
def grow(flags, p, r, v_break, limits, real, x_block):
    """
    Let the break voltages follow the current of late.

    An element that holds more than it still can gives way: its block follows.
    """
    remember(x_block)
    growth = real[R_GROWTH] * (x_block[M_CURRENT] / GROWTH_CURRENT) ** real[R_EXPONENT]
    if abs(growth - x_block[M_GROWTH]) <= GROWTH_STEP:
        return
    q = x_block[M_CHARGE]
    if growth > x_block[M_GROWTH]:
        stick(flags, p, limits[0], q)
    x_block[M_GROWTH] = growth
    grown(growth, r, v_break, limits)
    for i in range(flags[F_SLIP], r.size):
        p[i] = min(max(p[i], q - limits[0, i]), q + limits[0, i])


@jit
def remember(x_block):
    """Let the current of late follow what has flowed since the command last changed."""
    length = x_block[M_SINCE]
    if length <= 0.0:
        return
    fading = math.exp(-length / GROWTH_MEMORY)
    current = abs(x_block[M_CHARGE] - x_block[M_BEGAN]) / length
    x_block[M_CURRENT] = ((x_block[M_CURRENT] + x_block[M_JUMP] / GROWTH_MEMORY) * fading
                          + current * (1.0 - fading))


@jit
def move_charge(q0, target, slope_cap, real, flags, p, r, k, v_break, opposing_q):
    """
    Move the charge at once until q + C v_rc(q) reaches ``target`` (Eqs. 11, 12).

    A monotone piecewise-linear (with a smooth part: piecewise cubic) function
    is inverted by walking its breaks.  With ``slope_cap`` zero the target is
    the charge itself.  Returns the new charge; ``flags`` and ``p`` follow.
    """
    n = k.size
    q = q0
    slip = flags[F_SLIP]
    a = maxwell_offset(slip, flags[F_DIR], p, k, v_break)
    stiff = opposing_q
    for i in range(slip, n):
        stiff += k[i]
    value = q + slope_cap * (a + stiff * q + smooth_voltage(q, real))
    miss = target - value
    if abs(miss) <= 1e-18:
        return q
    direction = 1 if miss > 0.0 else -1
    if slip > 0 and flags[F_DIR] != direction:
        stick(flags, p, r, q)
        slip = 0
        a = maxwell_offset(0, direction, p, k, v_break)
        stiff = opposing_q
        for i in range(n):
            stiff += k[i]
    flags[F_DIR] = direction
    while slip < n:
        edge = p[slip] + direction * r[slip]
        if not math.isfinite(edge):
            break  # an element that never slips
        if direction * (q - edge) < 0.0:
            at_edge = edge + slope_cap * (a + stiff * edge + smooth_voltage(edge, real))
            if direction * (target - at_edge) < 0.0:
                break
            q = edge
        a += direction * v_break[slip] + k[slip] * p[slip]
        stiff -= k[slip]
        slip += 1
    flags[F_SLIP] = slip
    for _ in range(8):
        value = q + slope_cap * (a + stiff * q + smooth_voltage(q, real))
        slope = 1.0 + slope_cap * (stiff + q * (2.0 * real[R_V2] + 3.0 * q * real[R_V3]))
        change = (target - value) / max(slope, 0.05)
        q += change
        if abs(change) < 1e-19 + 1e-15 * abs(q) or (real[R_V2] == 0.0 and real[R_V3] == 0.0):
            break
    return q


@jit
def settle(s, inputs, flags, p, r, k, v_break, real, ip, opposing, x_block):
    """
    Bring the algebraic part in line after the inputs jumped.

    With an ideal voltage source the charge jumps, with charge drive it is
    given; with a source resistance only the rate of charge jumps.
    """
    n_states = s.size
    if ip[I_SMOOTH] != 0:
        inputs[SMOOTH_F] = smooth_force(s[0], real)
    source = s[ip[I_SOURCE]] if ip[I_SOURCE] >= 0 else inputs[U]
    iq = ip[I_QSTATE]
    q = x_block[M_CHARGE]
    if iq >= 0:
        q = s[iq]
    else:
        row = 0 if ip[I_DRIVE] == VOLTAGE else 1
        target = source if row == 0 else source / real[R_SHARE]
        for c in range(n_states):
            target -= opposing[row, c] * s[c]
        slope_cap = 0.0
        elastance = 0.0
        if row == 0:
            slope_cap = real[R_C]
            elastance = opposing[0, n_states]
            target = real[R_T] * s[0] + slope_cap * target
        q = move_charge(q, target, slope_cap, real, flags, p, r, k, v_break, elastance)
    x_block[M_CHARGE] = q
    if ip[I_SMOOTH] != 0:
        inputs[SMOOTH_V] = smooth_voltage(q, real)


@inline
def offsets(inputs, flags, p, k, v_break, real, ip, x_block):
    """Offsets of the piecewise-linear ports in the present mode."""
    inputs[A_RC] = maxwell_offset(flags[F_SLIP], flags[F_DIR], p, k, v_break)
    if ip[I_FRICTION] != 0:
        if flags[F_FRIC] == 0:
            inputs[A_FRICTION] = real[R_FRICTION_K] * x_block[M_FRICTION]
        else:
            inputs[A_FRICTION] = -flags[F_FRIC_DIR] * real[R_FRICTION_F]
    if ip[I_CONTACT] != 0:
        inputs[A_CONTACT] = real[R_CONTACT_K] * real[R_GAP] if flags[F_CONTACT] else 0.0


@inline
def switch(now, s, inputs, flags, p, r, k, v_break, real, ip, x_block, turned):
    """
    Switch every port whose condition is met at this instant.

    ``turned`` says that the event search met a reversal: 1 of the charge, 2 of
    the displacement.

    Returns True if the mode changed.  ``x_block`` holds the position of the
    friction block, the furthest charge since slip began and the present charge.
    """
    n = k.size
    changed = False
    q = now[W_Q]
    x_block[M_CHARGE] = q
    rate = now[W_Q1]
    if flags[F_SLIP] > 0:
        direction = flags[F_DIR]
        if direction * (q - x_block[M_FURTHEST]) > 0.0:
            x_block[M_FURTHEST] = q
        if direction * rate < 0.0 and (
                turned == 1 or direction * (x_block[M_FURTHEST] - q) > CHARGE_TOLERANCE):
            stick(flags, p, r, q)
            changed = True
    if flags[F_SLIP] == 0:
        if q > p[0] + r[0] + CHARGE_TOLERANCE:
            flags[F_DIR] = 1
            flags[F_SLIP] = 1
            x_block[M_FURTHEST] = q
            changed = True
        elif q < p[0] - r[0] - CHARGE_TOLERANCE:
            flags[F_DIR] = -1
            flags[F_SLIP] = 1
            x_block[M_FURTHEST] = q
            changed = True
    if flags[F_SLIP] > 0:
        direction = flags[F_DIR]
        while (flags[F_SLIP] < n
               and direction * (q - p[flags[F_SLIP]]) > r[flags[F_SLIP]] + CHARGE_TOLERANCE):
            flags[F_SLIP] += 1
            changed = True

    if ip[I_FRICTION] != 0:
        x = s[0]
        reach = real[R_FRICTION_F] / real[R_FRICTION_K]
        if flags[F_FRIC] != 0:
            if flags[F_FRIC_DIR] * (x - x_block[M_SLIDE]) > 0.0:
                x_block[M_SLIDE] = x
            if flags[F_FRIC_DIR] * s[1] < 0.0 and (
                    turned == 2
                    or flags[F_FRIC_DIR] * (x_block[M_SLIDE] - x) > DISPLACEMENT_TOLERANCE):
                x_block[M_FRICTION] = x - flags[F_FRIC_DIR] * reach
                flags[F_FRIC] = 0
                changed = True
        elif abs(x - x_block[M_FRICTION]) > reach + DISPLACEMENT_TOLERANCE:
            flags[F_FRIC] = 1
            flags[F_FRIC_DIR] = 1 if x > x_block[M_FRICTION] else -1
            x_block[M_SLIDE] = x
            changed = True
    if ip[I_CONTACT] != 0:
        touch = flags[F_CONTACT]
        if touch == 0 and s[0] > real[R_GAP] + DISPLACEMENT_TOLERANCE:
            flags[F_CONTACT] = 1
            changed = True
        elif touch == 1 and s[0] < real[R_GAP] - DISPLACEMENT_TOLERANCE:
            flags[F_CONTACT] = 0
            changed = True
    if ip[I_LIMITER] != 0:
        state = limit_at(now[W_WANT], flags[F_LIMIT], real)
        if state != flags[F_LIMIT]:
            flags[F_LIMIT] = state
            changed = True
    if changed:
        offsets(inputs, flags, p, k, v_break, real, ip, x_block)
    return changed
