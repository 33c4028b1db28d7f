# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Modes: which ports stick, slip or touch makes one linear system out of a small family.

Per mode and per duration of a segment the propagators for h, h/2, h/4, ... are
made once, when the mode is first met.
"""

import math

from piezo_stack_sim.plant.compiled import jit
from piezo_stack_sim.plant.layout import (
    A_RC, BENT_UP, F_CONTACT, F_FRIC, F_LIMIT, F_SLIP, FREE, I_CLAMPED, I_DRIVE, I_FRICTION,
    I_INPUTS, I_QSTATE, I_RELAXING, I_SMOOTH, I_SOURCE, N_AHEAD, N_INPUTS, N_LIMITS, N_OUTPUTS,
    ONE, R_C, R_CONTACT_K, R_CONVERSE, R_FRICTION_K, R_INTERNAL, R_KNEE, R_KNEE_SINK, R_LIMIT,
    R_MASS, R_OMEGA_EXTRA, R_OMEGA_FAST, R_RATE_MAX, R_RESISTANCE, R_RISE, R_SHARE, R_SINK,
    R_STIFFNESS, R_T, SMOOTH_V, SOURCED, SUNK, U,
    VOLTAGE, W_OUT, W_Q, W_Q1, W_Q2, W_Q3, W_WANT, W_X2, W_X3, WORK_FLOW, WORK_Q, WORK_SOURCE,
    WORK_V, WORK_WANT)
from piezo_stack_sim.plant.matrices import clear, product, SHORT, TERMS


@jit
def mode_index(flags):
    """Return the number of the mode in which the device is."""
    index = flags[F_SLIP]
    index = index * 2 + (1 if flags[F_FRIC] != 0 else 0)
    index = index * 2 + flags[F_CONTACT]
    return index * N_LIMITS + flags[F_LIMIT]


@jit
def _derive(matrix, n_states, used, watch, source, target):
    """Let the watched value ``target`` be the derivative of ``source``, inputs held."""
    for c in range(used):
        total = 0.0
        for i in range(n_states):
            total += watch[i, source] * matrix[i, c]
        watch[c, target] = total


@jit
def _keep(e, n_states, used, watch, table):
    """Store a propagator, and behind the states the watched values at its end."""
    for c in range(e.shape[1]):
        for i in range(n_states):
            table[c, i] = e[i, c]
        for o in range(N_AHEAD):
            total = 0.0
            for i in range(used):
                total += watch[i, o] * e[i, c]
            table[c, n_states + o] = total


@jit
def build_mode(mode, real, ip, k, rates, opposing, reading, cls_tick, levels,
               short, tables, watch, omegas, dampings, matrices, work):
    """
    Resolve the algebra of one mode and make its propagators.

    ``rates`` (N, N+2+8) are the derivatives of the states over extended
    signals, ``opposing`` (2, N+1) the voltage in series with the Maxwell
    capacitor and the charge lost under charge drive, both over states and q,
    ``reading`` (5, N+2+8) the outputs.
    Fills ``tables[mode]`` and ``watch[mode]``, the natural frequency ``omegas`` (rad/s) and
    decay rate ``dampings`` (1/s) of the moving end, and ``short``, per class the greatest
    level in which the fastest swing of this mode turns by at most 1.3 rad.  ``matrices``
    (4, M, M) and ``work`` are space to work in.
    """
    n_states = rates.shape[0]
    n = k.size
    width = n_states + N_INPUTS
    limit = mode % N_LIMITS
    contact = (mode // N_LIMITS) % 2
    friction = (mode // (2 * N_LIMITS)) % 2
    slip = mode // (4 * N_LIMITS)
    stiff_rc = 0.0
    for i in range(slip, n):
        stiff_rc += k[i]
    big_k = stiff_rc + opposing[0, n_states]
    ratio = real[R_T]
    cap = real[R_C]

    source = work[WORK_SOURCE]
    clear(source, width)
    if ip[I_SOURCE] >= 0:
        source[ip[I_SOURCE]] = 1.0
    else:
        source[n_states + U] = 1.0

    q_row = work[WORK_Q]
    clear(q_row, width)
    iq = ip[I_QSTATE]
    if iq >= 0:
        q_row[iq] = 1.0
    elif ip[I_DRIVE] == VOLTAGE:
        # Eqs. 11 and 12 solved for q with v_rc = a + K q.
        scale = 1.0 / (1.0 + cap * big_k)
        for c in range(width):
            q_row[c] = cap * source[c]
        for c in range(n_states):
            q_row[c] -= cap * opposing[0, c]
        q_row[0] += ratio
        q_row[n_states + A_RC] -= cap
        q_row[n_states + SMOOTH_V] -= cap
        for c in range(width):
            q_row[c] *= scale
    else:
        for c in range(width):
            q_row[c] = source[c] / real[R_SHARE]
        for c in range(n_states):
            q_row[c] -= opposing[1, c]

    # v_t = (q - T x) / C, Eq. 11;  v_rc of Eq. 13 with all that is in series.
    v_row = work[WORK_V]
    for c in range(width):
        v_row[c] = q_row[c] * (1.0 / cap + big_k)
    v_row[0] -= ratio / cap
    for c in range(n_states):
        v_row[c] += opposing[0, c]
    v_row[n_states + A_RC] += 1.0
    v_row[n_states + SMOOTH_V] += 1.0

    # Rate of q wanted by the source resistance, before any limit, and what flows of it.
    want = work[WORK_WANT]
    flow = work[WORK_FLOW]
    clear(want, width)
    clear(flow, width)
    if iq >= 0:
        total = real[R_RESISTANCE] + real[R_INTERNAL]
        for c in range(width):
            want[c] = (source[c] - v_row[c]) / total
        if limit == SOURCED:
            flow[n_states + ONE] = real[R_LIMIT]
        elif limit == SUNK:
            flow[n_states + ONE] = -real[R_SINK]
        else:
            slope = 1.0 if limit == FREE else 1.0 / real[R_RISE]
            for c in range(width):
                flow[c] = slope * want[c]
            knee = real[R_KNEE] if limit == BENT_UP else -real[R_KNEE_SINK]
            flow[n_states + ONE] += (1.0 - slope) * knee
        for c in range(width):
            v_row[c] += real[R_INTERNAL] * flow[c]
    elif ip[I_DRIVE] == VOLTAGE:
        for c in range(width):
            v_row[c] = source[c]

    # Inputs that are not worked with have no columns; the smooth ones may change in a sub-step.
    used = n_states + ip[I_INPUTS]
    size = matrices.shape[1]
    augmented = matrices[0]
    for i in range(size):
        clear(augmented[i], size)
    for i in range(n_states):
        for c in range(used):
            rate = rates[i, c if c < n_states else c + 2]
            augmented[i, c] = (rate + rates[i, n_states] * q_row[c]
                               + rates[i, n_states + 1] * v_row[c])
    if iq >= 0:
        for c in range(used):
            augmented[iq, c] = flow[c]
    if ip[I_CLAMPED] == 0:
        if ip[I_FRICTION] != 0 and friction == 0:
            augmented[1, 0] -= real[R_FRICTION_K] / real[R_MASS]
        if contact == 1:
            augmented[1, 0] -= real[R_CONTACT_K] / real[R_MASS]
    if ip[I_SMOOTH] != 0:
        for port in range(2):
            augmented[n_states + SMOOTH_V + port, used + port] = 1.0
            augmented[used + port, used + 2 + port] = 1.0

    for c in range(width):
        watch[mode, c, W_Q] = q_row[c]
        watch[mode, c, W_WANT] = want[c]
    _derive(augmented, n_states, used, watch[mode], W_Q, W_Q1)
    for o in range(N_OUTPUTS):
        for c in range(n_states):
            watch[mode, c, W_OUT + o] = reading[o, c]
        for c in range(N_INPUTS):
            watch[mode, n_states + c, W_OUT + o] = reading[o, n_states + 2 + c]
        for c in range(width):
            watch[mode, c, W_OUT + o] += (reading[o, n_states] * q_row[c]
                                          + reading[o, n_states + 1] * v_row[c])

    # With the charge held the end is stiffer than with the leads shorted, Eqs. 20 and 21.
    held = real[R_CONVERSE] * ratio / cap
    freed = real[R_CONVERSE] * ratio * big_k / (1.0 + cap * big_k)
    stiffness = max(-augmented[1, 0] * real[R_MASS], 0.0)
    if iq >= 0:
        lag = (real[R_RESISTANCE] + real[R_INTERNAL]) / (big_k + 1.0 / cap)
        if limit != FREE:
            lag *= real[R_RISE]
        follows = limit != SOURCED and limit != SUNK
        if follows and lag * math.sqrt(stiffness / real[R_MASS]) < 0.2:
            stiffness += freed - held
    fastest = math.sqrt(max(stiffness, real[R_STIFFNESS], 1.0) / real[R_MASS])
    fastest = max(fastest, real[R_OMEGA_FAST])
    spring = real[R_STIFFNESS]
    spring += freed if iq >= 0 or ip[I_DRIVE] == VOLTAGE else held
    if friction == 0:
        spring += real[R_FRICTION_K] * ip[I_FRICTION]
    if contact == 1:
        spring += real[R_CONTACT_K]
    omega = math.sqrt(max(spring, 1.0) / real[R_MASS])
    if real[R_OMEGA_EXTRA] > 0.0:
        omega = min(omega, real[R_OMEGA_EXTRA])
    omegas[mode] = omega
    dampings[mode] = -0.5 * augmented[1, 1]

    n_levels = tables.shape[0] // (omegas.size * cls_tick.size)
    for d in range(cls_tick.size):
        # The propagator of one tick by Taylor series, scaled until it converges fast.
        scaling = 0
        step = cls_tick[d]
        while step * real[R_RATE_MAX] > SHORT:
            step *= 0.5
            scaling += 1
        e, term, spare = 1, 2, 3  # matrices
        for i in range(size):
            for target in (e, term):
                clear(matrices[target, i], size)
                matrices[target, i, i] = 1.0
        at = (mode * cls_tick.size + d) * n_levels
        for turn in range(TERMS + scaling + levels[d] + 1):
            level = turn - TERMS - scaling
            if level >= 0:
                _keep(matrices[e], n_states, used, watch[mode], tables[at + level])
            # One call for all products: it is the larger part of what has to be compiled.
            series = turn < TERMS
            product(matrices[term if series else e], matrices[0 if series else e],
                    step / (turn + 1) if series else 1.0, matrices[spare])
            if series:
                term, spare = spare, term
                for i in range(size):
                    for c in range(size):
                        matrices[e, i, c] += matrices[term, i, c]
            else:
                e, spare = spare, e
        level = 0
        while level < levels[d] and fastest * cls_tick[d] * (2 << level) <= 1.3:
            level += 1
        short[mode, d] = level

    # Higher derivatives, to tell what still swings from what creeps.
    change = augmented
    if ip[I_RELAXING] != 0:
        # What relaxes fast would hide both: differences over a quarter radian instead.
        level = max(0, short[mode, 0] - 2)
        length = cls_tick[0] * (1 << level)
        at = mode * cls_tick.size * n_levels
        for i in range(n_states):
            for c in range(size):
                same = 1.0 if c == i else 0.0
                change[i, c] = (tables[at + level, c, i] - same) / length
    watch[mode, 1, W_X3] = 1.0  # the velocity, for a moment
    for source, target in ((W_X3, W_X2), (W_X2, W_X3), (W_Q1, W_Q2), (W_Q2, W_Q3)):
        _derive(change, n_states, used, watch[mode], source, target)
