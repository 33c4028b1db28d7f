# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The ideal stack (Eqs. 11 to 17) as a kernel of its own, for speed.

With no more than displacement and velocity as states, a mode is one damped
oscillator about its equilibrium.  Two facts make a row cost tens of
nanoseconds: its propagator is a 2x2 matrix, and its energy never grows, which
bounds the charge for the rest of a held command while everything sticks.
Linear states that only *follow* the stack, as a slow sensor does, are moved along:
nothing that happens depends on them.  Whatever needs more than that runs in
:mod:`piezo_stack_sim.plant.kernel`; the tests hold the two against each other.
"""

import math

from piezo_stack_sim.plant.compiled import inline, jit
from piezo_stack_sim.plant.cubic import crossing, hermite, turning
from piezo_stack_sim.plant.layout import (
    A_RC, CHARGE_TOLERANCE, F_DIR, F_SLIP, FORCE, M_CHARGE, M_FURTHEST, MAX_EVENTS, U)
from piezo_stack_sim.plant.matrices import clear, product, SHORT, TERMS

# What may drive those that follow, and be read: columns of ``follow`` and ``row``.
R_X, R_W, R_Q, R_V, R_U, R_F, R_ONE = range(7)
N_READ = 7
# Constants of a mode, one row for each number of slipping elements.
C_K, C_SPRING, C_GAIN, C_DQ_DX, C_DQ_DU, C_OMEGA = range(6)
N_CONSTANTS = 6


@jit
def mode_constants(k, ratio, converse, cap, mass, stiffness, damping, voltage_driven, clamped,
                   ticks, levels, constants, propagators):
    """
    Fill in the constants and propagators of every mode.

    Parameters
    ----------
    k : numpy.ndarray, shape (n,)
        Stiffness of the Maxwell elements (V/C).
    ratio, converse, cap, mass, stiffness, damping : float
        T (Eqs. 11 and 14), C, m, k, b of Table 1.
    voltage_driven, clamped : bool
        Drive, and whether the moving end is held.
    ticks : numpy.ndarray, shape (d,)
        Tick of every segment class (s).
    levels : numpy.ndarray, shape (d,)
        The propagators are made for 1, 2, 4, ... 2**level ticks.

    constants : numpy.ndarray, shape (n+1, 6)
        Per number of slipping elements: elastance (V/C), spring (N/m), force
        per source volt (N/V) or coulomb, dq/dx (C/m), dq/du (F), natural
        frequency (rad/s).
    propagators : numpy.ndarray, shape (n+1, d, max(levels)+1, 4)
        Rows of the 2x2 matrices about the equilibrium.

    """
    n = k.size
    big_k = 0.0
    for slip in range(n, -1, -1):
        if slip < n:
            big_k += k[slip]
        scale = 1.0 / (1.0 + cap * big_k)
        constants[slip, C_K] = big_k
        if voltage_driven:
            constants[slip, C_SPRING] = stiffness + converse * ratio * big_k * scale  # Eq. 21
            constants[slip, C_GAIN] = converse * scale
            constants[slip, C_DQ_DX] = ratio * scale
            constants[slip, C_DQ_DU] = cap * scale
        else:
            constants[slip, C_SPRING] = stiffness + converse * ratio / cap  # Eq. 20
            constants[slip, C_GAIN] = converse / cap
            constants[slip, C_DQ_DU] = 1.0
        spring = constants[slip, C_SPRING]
        constants[slip, C_OMEGA] = math.sqrt(spring / mass)
        for d in range(ticks.size):
            # The propagator of one tick by its series; a tick is short against the motion.
            h = ticks[d]
            a11, a12 = 0.0, h
            a21, a22 = -spring / mass * h, -damping / mass * h
            scaling = 0
            while abs(a21 * a12) > 0.01 or abs(a22) > 0.1:
                a12 *= 0.5
                a21 *= 0.5
                a22 *= 0.5
                scaling += 1
            e11, e12, e21, e22 = 1.0, 0.0, 0.0, 1.0
            t11, t12, t21, t22 = 1.0, 0.0, 0.0, 1.0
            for order in range(1, 14):
                n11 = (t11 * a11 + t12 * a21) / order
                n12 = (t11 * a12 + t12 * a22) / order
                n21 = (t21 * a11 + t22 * a21) / order
                n22 = (t21 * a12 + t22 * a22) / order
                t11, t12, t21, t22 = n11, n12, n21, n22
                e11 += t11
                e12 += t12
                e21 += t21
                e22 += t22
            for level in range(-scaling, levels[d] + 1):
                if level >= 0:
                    propagators[slip, d, level, 0] = 1.0 if clamped else e11
                    propagators[slip, d, level, 1] = 0.0 if clamped else e12
                    propagators[slip, d, level, 2] = 0.0 if clamped else e21
                    propagators[slip, d, level, 3] = 0.0 if clamped else e22
                n11 = e11 * e11 + e12 * e21
                n12 = e11 * e12 + e12 * e22
                n21 = e21 * e11 + e22 * e21
                n22 = e21 * e12 + e22 * e22
                e11, e12, e21, e22 = n11, n12, n21, n22


@jit
def follow_propagators(follow, own, ratio, cap, mass, damping, rate_max, voltage_driven, clamped,
                       ticks, levels, constants, trails, matrices):
    """
    Fill in how states that follow are moved by as many ticks as the stack is.

    Parameters
    ----------
    follow : numpy.ndarray, shape (m, 7)
        Their derivatives by x, w, q, v, u, F and one.
    own : numpy.ndarray, shape (m, m)
        And by each other.
    ratio, cap, mass, damping, voltage_driven, clamped, ticks, levels, constants
        As in :func:`mode_constants`, which has filled in the constants.
    rate_max : float
        The fastest motion of all (rad/s).
    trails : numpy.ndarray, shape (n+1, d, max(levels)+1, m, 2+2m)
        Filled in: rows by y = x - centre, w, the m states, and their m constant rates.
    matrices : numpy.ndarray, shape (4, 2+2m, 2+2m)
        Space to work in.

    """
    m = own.shape[0]
    size = 2 + 2 * m
    rates, e, term, spare = 0, 1, 2, 3
    for slip in range(constants.shape[0]):
        dq_dx = constants[slip, C_DQ_DX]
        dv_dx = (0.0 if voltage_driven
                 else dq_dx * (1.0 / cap + constants[slip, C_K]) - ratio / cap)
        for i in range(size):
            clear(matrices[rates, i], size)
        if not clamped:
            matrices[rates, 0, 1] = 1.0
            matrices[rates, 1, 0] = -constants[slip, C_SPRING] / mass
            matrices[rates, 1, 1] = -damping / mass
        for i in range(m):
            row = matrices[rates, 2 + i]
            row[0] = follow[i, R_X] + dq_dx * follow[i, R_Q] + dv_dx * follow[i, R_V]
            row[1] = follow[i, R_W]
            row[2 + m + i] = 1.0
            for j in range(m):
                row[2 + j] = own[i, j]
        for d in range(ticks.size):
            step = ticks[d]
            scaling = 0
            while step * rate_max > SHORT:
                step *= 0.5
                scaling += 1
            for i in range(size):
                for target in (e, term):
                    clear(matrices[target, i], size)
                    matrices[target, i, i] = 1.0
            for order in range(1, TERMS + 1):
                product(matrices[term], matrices[rates], step / order, matrices[spare])
                term, spare = spare, term
                for i in range(size):
                    for j in range(size):
                        matrices[e, i, j] += matrices[term, i, j]
            for level in range(-scaling, levels[d] + 1):
                if level >= 0:
                    for i in range(m):
                        for j in range(size):
                            trails[slip, d, level, i, j] = matrices[e, 2 + i, j]
                product(matrices[e], matrices[e], 1.0, matrices[spare])
                e, spare = spare, e


@inline
def _trail(trails, slip, d, level, y, w, z, rate, moved):
    """Move states that follow by 2**level ticks, from where the stack is before."""
    m = z.size
    e = trails[slip, d, level]
    for i in range(m):
        total = e[i, 0] * y + e[i, 1] * w
        for j in range(m):
            total += e[i, 2 + j] * z[j] + e[i, 2 + m + j] * rate[j]
        moved[i] = total
    for i in range(m):
        z[i] = moved[i]


@inline
def _driven(follow, x, q, v, u, force, rate):
    """Tell the rates of states that follow while the stack rests in its equilibrium."""
    for i in range(rate.size):
        rate[i] = (follow[i, R_X] * x + follow[i, R_Q] * q + follow[i, R_V] * v
                   + follow[i, R_U] * u + follow[i, R_F] * force + follow[i, R_ONE])


@jit
def run(seg_class, seg_ticks, seg_u, seg_force, seg_state, seg_read,
        s, p, flags, inputs, memory, k, v_break, r, ratio, converse, cap, voltage_driven,
        clamped, constants, propagators, ticks, levels, short, row, charge_row, state_row,
        follow, trails, rate, moved, out_state, out_read):
    """
    Advance the ideal stack over segments of constant command and force.

    The arguments are those of :func:`piezo_stack_sim.plant.kernel.run`, with the constants of
    :func:`mode_constants` and :func:`follow_propagators`; ``row`` (7,) and ``state_row`` (m,)
    are the reading of the displacement over x, w, q, v, u, F, one and the states that follow,
    ``charge_row`` (m,) what these add to that of the charge; ``rate`` and ``moved`` (m,) are
    space to work in.  Where nothing follows these are None, and compiled away.  Returns 0, or
    1 if a state left the finite numbers.
    """
    z = s[2:]
    n = k.size
    x = s[0]
    w = s[1]
    far = memory[M_FURTHEST]
    q = memory[M_CHARGE]
    slip = flags[F_SLIP]
    direction = flags[F_DIR]
    u = inputs[U]
    force = inputs[FORCE]
    a = inputs[A_RC]
    slope_cap = cap if voltage_driven else 0.0
    failed = 0
    for segment in range(seg_class.size):
        d = seg_class[segment]
        left = seg_ticks[segment]
        if u != seg_u[segment] or force != seg_force[segment]:
            u = seg_u[segment]
            force = seg_force[segment]
            # Eqs. 11 and 12: walk q to where q + C v_rc(q) = T x + C u.
            target = ratio * x + cap * u if voltage_driven else u
            big_k = constants[slip, C_K]
            miss = target - (q + slope_cap * (a + big_k * q))
            if abs(miss) > 1e-18:
                new_direction = 1 if miss > 0.0 else -1
                if slip > 0 and new_direction != direction:
                    a = 0.0
                    for i in range(slip):
                        p[i] = q - direction * r[i]
                    for i in range(n):
                        a -= k[i] * p[i]
                    slip = 0
                direction = new_direction
                while slip < n:
                    edge = p[slip] + direction * r[slip]
                    if direction * (q - edge) < 0.0:
                        at_edge = edge + slope_cap * (a + constants[slip, C_K] * edge)
                        if direction * (target - at_edge) < 0.0:
                            break
                        q = edge
                    a += direction * v_break[slip] + k[slip] * p[slip]
                    slip += 1
                big_k = constants[slip, C_K]
                q += ((target - (q + slope_cap * (a + big_k * q)))
                      / (1.0 + slope_cap * big_k))
            if slip > 0 and voltage_driven and direction * w < 0.0:
                a = 0.0
                for i in range(slip):
                    p[i] = q - direction * r[i]
                for i in range(n):
                    a -= k[i] * p[i]
                slip = 0
            far = q
        # The oscillator of this mode about its equilibrium.
        spring = constants[slip, C_SPRING]
        free = u - a if voltage_driven else u
        centre = x if clamped else (constants[slip, C_GAIN] * free + force) / spring
        dq_dx = constants[slip, C_DQ_DX]
        q_centre = dq_dx * centre + constants[slip, C_DQ_DU] * free
        y = x - centre
        if rate is not None:
            v_centre = u if voltage_driven else (
                (q_centre - ratio * centre) / cap + a + constants[slip, C_K] * q_centre)
            _driven(follow, centre, q_centre, v_centre, u, force, rate)
        guard = 0
        while left > 0:
            if slip == 0 or not voltage_driven or (y == 0.0 and w == 0.0):
                calm = True
                if slip == 0 and voltage_driven:
                    omega = constants[0, C_OMEGA]
                    swing = dq_dx * math.sqrt(y * y + (w / omega) ** 2)
                    calm = (q_centre + swing < p[0] + r[0] + CHARGE_TOLERANCE
                            and q_centre - swing > p[0] - r[0] - CHARGE_TOLERANCE)
                if calm or guard > MAX_EVENTS:
                    # Energy never grows: nothing can happen up to the end of the segment.
                    level = levels[d]
                    while left > 0:
                        while (1 << level) > left:
                            level -= 1
                        if rate is not None:
                            _trail(trails, slip, d, level, y, w, z, rate, moved)
                        e = propagators[slip, d, level]
                        y, w = e[0] * y + e[1] * w, e[2] * y + e[3] * w
                        left -= 1 << level
                    break
            level = short[d]
            while (1 << level) > left:
                level -= 1
            count = 1 << level
            e = propagators[slip, d, level]
            y1 = e[0] * y + e[1] * w
            w1 = e[2] * y + e[3] * w
            # Where in this sub-step does the displacement turn, if it does?
            part = 2.0
            h = count * ticks[d]
            if w * w1 < 0.0:
                part = turning(y, w * h, y1, w1 * h)
            edge_at = 2.0
            if slip > 0:
                turned = direction * w1 < 0.0
                if turned and not direction * w > 0.0:
                    part = 0.0
                edge = 0.0
                over = False
                if slip < n and part > 0.0:
                    edge = (p[slip] + direction * (r[slip] + CHARGE_TOLERANCE) - q_centre) / dq_dx
                    over = direction * (y1 - edge) > 0.0
                    if turned and part < 1.0:
                        over = direction * (hermite(part, y, w * h, y1, w1 * h) - edge) > 0.0
                if over:
                    edge_at = crossing(edge, y, w * h, y1, w1 * h, min(part, 1.0))
                if not over and not turned:
                    if rate is not None:
                        _trail(trails, slip, d, level, y, w, z, rate, moved)
                    y = y1
                    w = w1
                    left -= count
                    continue
            else:
                high = (p[0] + r[0] + CHARGE_TOLERANCE - q_centre) / dq_dx
                low = (p[0] - r[0] - CHARGE_TOLERANCE - q_centre) / dq_dx
                upto = 1.0
                peak = y1
                if part < 1.0:
                    peak = hermite(part, y, w * h, y1, w1 * h)
                    upto = part
                    if not (peak > high or peak < low):
                        peak = y1
                        upto = 1.0
                if peak > high or peak < low:
                    edge_at = crossing(high if peak > high else low, y, w * h, y1, w1 * h, upto)
                else:
                    if rate is not None:
                        _trail(trails, slip, d, level, y, w, z, rate, moved)
                    y = y1
                    w = w1
                    left -= count
                    continue
            guard += 1
            done = max(1, int(math.ceil(min(part if slip > 0 else 2.0, edge_at) * count)))
            if done >= count:
                done = count
                if rate is not None:
                    _trail(trails, slip, d, level, y, w, z, rate, moved)
                y = y1
                w = w1
            else:
                bit = 0
                while (1 << bit) <= done:
                    if done & (1 << bit):
                        if rate is not None:
                            _trail(trails, slip, d, bit, y, w, z, rate, moved)
                        e = propagators[slip, d, bit]
                        y, w = e[0] * y + e[1] * w, e[2] * y + e[3] * w
                    bit += 1
            left -= done
            x = centre + y
            q = q_centre + dq_dx * y
            if slip > 0:
                if direction * w < 0.0:
                    # The charge turned: every block stays where it is, Eq. 16.
                    a = 0.0
                    for i in range(slip):
                        p[i] = q - direction * r[i]
                    for i in range(n):
                        a -= k[i] * p[i]
                    slip = 0
            elif q > p[0] + r[0]:
                direction = 1
                a += v_break[0] + k[0] * p[0]
                slip = 1
            elif q < p[0] - r[0]:
                direction = -1
                a += -v_break[0] + k[0] * p[0]
                slip = 1
            while slip > 0 and slip < n and direction * (q - p[slip]) > r[slip]:
                a += direction * v_break[slip] + k[slip] * p[slip]
                slip += 1
            spring = constants[slip, C_SPRING]
            free = u - a
            centre = (constants[slip, C_GAIN] * free + force) / spring
            dq_dx = constants[slip, C_DQ_DX]
            q_centre = dq_dx * centre + constants[slip, C_DQ_DU] * free
            y = x - centre
            if rate is not None:
                _driven(follow, centre, q_centre, u, u, force, rate)
        x = centre + y
        q = q_centre + dq_dx * y
        far = q
        if not math.isfinite(x):
            failed = 1
            break
        v_t = (q - ratio * x) / cap  # Eq. 11
        v = u if voltage_driven else v_t + a + constants[slip, C_K] * q  # Eq. 12
        reading = (row[R_X] * x + row[R_W] * w + row[R_Q] * q + row[R_V] * v + row[R_U] * u
                   + row[R_F] * force + row[R_ONE])
        shown = q
        if rate is not None:
            for i in range(z.size):
                reading += state_row[i] * z[i]
                shown += charge_row[i] * z[i]
        index = seg_state[segment]
        if index >= 0:
            out_state[index, 0] = reading
            out_state[index, 1] = w
            out_state[index, 2] = shown
            out_state[index, 3] = v
            out_state[index, 4] = converse * v_t  # Eq. 14
            out_state[index, 5] = q
        index = seg_read[segment]
        if index >= 0:
            out_read[index] = reading
    s[0] = x
    s[1] = w
    memory[M_FURTHEST] = far
    memory[M_CHARGE] = q
    flags[F_SLIP] = slip
    flags[F_DIR] = direction
    inputs[U] = u
    inputs[FORCE] = force
    inputs[A_RC] = a
    return failed
