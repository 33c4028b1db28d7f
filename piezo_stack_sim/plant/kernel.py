# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The compiled heart of the plant: exact motion between slip events.

Between two slip events the whole device is one linear system out of a small,
known family, a *mode* (:mod:`piezo_stack_sim.plant.modes`).  A segment is a few
small matrix products; an event inside it is found from charge and displacement
and their rates at the ends of a sub-step (:mod:`piezo_stack_sim.plant.events`)
and met on a grid of *ticks* (about 60 ns).  A sub-step is short against the
fastest swing, or longer where nothing hidden can happen
(:mod:`piezo_stack_sim.plant.calm`).

:mod:`piezo_stack_sim.plant.layout` names the columns of all arrays.
"""

import math

from piezo_stack_sim.plant.calm import calm_time
from piezo_stack_sim.plant.compiled import inline, jit
from piezo_stack_sim.plant.events import first_event
from piezo_stack_sim.plant.lanes import LANES, sums
from piezo_stack_sim.plant.layout import (
    CHARGE_TOLERANCE, F_DIR, F_FRIC, F_FRIC_DIR, F_SLIP, FORCE, I_CONTACT, I_FRICTION, I_GROWING,
    I_INPUTS, I_LIMITER, I_RELAXING, I_SMOOTH, M_BEGAN, M_CHARGE, M_FURTHEST, M_GROWTH, M_JUMP,
    M_SINCE, M_SLIDE, MAX_EVENTS, N_INPUTS, N_OUTPUTS, N_RAMPS, N_WATCHED, R_QUICKEST, R_TOL,
    SMOOTH_F, SMOOTH_V, U, W_OUT, W_Q, W_Q1, W_Q2, W_WANT, WORK_BEND, WORK_END, WORK_HELD,
    WORK_NOW, WORK_THEN, WORK_Z, WORK_Z1)
from piezo_stack_sim.plant.modes import build_mode, mode_index
from piezo_stack_sim.plant.ports import (
    grow, grown, offsets, settle, smooth_force, smooth_voltage, switch)
from piezo_stack_sim.plant.smooth import charge_gain, follow, smooth_step

AFRESH = -1  # trust no more than short sub-steps, for the motion has changed


@inline
def _look(watch, mode, z, used, first, last, out):
    """Compute watched values of an extended state, from ``first`` in lanes past ``last``."""
    start = mode * (watch.shape[1] * watch.shape[2])
    for o in range(first, last, LANES):
        sums(watch, start + o, watch.shape[2], z, used, out, o)


@inline
def _move(tables, at, z, used, rows, out):
    """Move a state by one propagator; rows behind the states are watched values."""
    start = at * (tables.shape[1] * tables.shape[2])
    for i in range(0, rows, LANES):
        sums(tables, start + i, tables.shape[2], z, used, out, i)


@jit
def _advance(tables, at, ticks, tick, z, n, used, smooth, end):
    """Move by any number of ticks in the same mode, smooth ports along their parabolas."""
    level = 0
    while ticks > 0:
        if ticks & 1:
            _move(tables, at + level, z, used, n, end)
            if smooth:
                follow(z, n, tick * (1 << level))
            for i in range(n):
                z[i] = end[i]
        ticks >>= 1
        level += 1


@jit
def run(seg_class, seg_ticks, seg_u, seg_force, seg_state, seg_read,
        state, p, flags, ports, x_block, k, v_break, r, limits,
        real, ip, rates, opposing, reading, cls_tick, levels, short, built,
        tables, watch, omegas, dampings, matrices, work, out_state, out_read):
    """
    Advance the device over segments of constant command and force.

    ``seg_state[i]`` / ``seg_read[i]`` name the row of ``out_state`` /
    ``out_read`` (n, 6) that is sampled at the end of segment i, or -1.
    ``limits`` (2, n) is where break charges and voltages that grow with the current are kept.
    ``built`` marks the modes whose propagators ``tables`` exist; ``matrices`` and
    ``work`` are space to work in, see :mod:`piezo_stack_sim.plant.layout`.
    Returns 0, or 1 if a state left the finite numbers.
    """
    n = k.size
    n_in = ip[I_INPUTS]
    n_states = state.size
    end = work[WORK_END]  # of a sub-step
    held = work[WORK_HELD]
    used = n_states + n_in
    # Extended states: states, inputs, what the smooth inputs do within a sub-step.
    z = work[WORK_Z]
    z1 = work[WORK_Z1]
    for c in range(z.size):
        z[c] = 0.0
        z1[c] = 0.0
    s = z[:n_states]
    inputs = z[n_states:n_states + N_INPUTS]
    for c in range(n_states):
        z[c] = state[c]
    for c in range(N_INPUTS):
        z[n_states + c] = ports[c]
    i_smooth = n_states + SMOOTH_V
    bend = work[WORK_BEND]
    now = work[WORK_NOW]
    then = work[WORK_THEN]
    smooth = ip[I_SMOOTH] != 0
    columns = used + (N_RAMPS if smooth else 0)
    exact = n_states == 2 and not smooth
    relaxing = ip[I_RELAXING] != 0
    limited = ip[I_LIMITER] != 0
    displaced = ip[I_FRICTION] != 0 or ip[I_CONTACT] != 0
    growing = ip[I_GROWING] != 0
    r_slow = r
    v_slow = v_break
    if growing:
        grown(x_block[M_GROWTH], r_slow, v_slow, limits)
        r = limits[0]
        v_break = limits[1]
    n_look = (W_WANT if limited else W_Q1) + 1
    rows = n_states + n_look
    known = False  # `calm` holds for the present state
    calm = 0.0
    v1 = 0.0
    f1 = 0.0
    failed = 0
    n_classes = cls_tick.size
    n_levels = tables.shape[0] // (built.size * n_classes)
    for segment in range(seg_class.size):
        d = seg_class[segment]
        tick = cls_tick[d]
        left = seg_ticks[segment]
        unsettled = 0  # how often ports may still switch at this instant
        kind = 0
        fresh = True  # watch anew: the same bits however the rows are cut into calls
        trust = levels[d]  # the longest sub-step, in levels
        begun = False
        if inputs[U] != seg_u[segment] or inputs[FORCE] != seg_force[segment]:
            if growing and left > 0:
                grow(flags, p, r_slow, v_slow, limits, real, x_block)
            before = x_block[M_CHARGE]
            inputs[U] = seg_u[segment]
            inputs[FORCE] = seg_force[segment]
            settle(s, inputs, flags, p, r, k, v_break, real, ip, opposing, x_block)
            offsets(inputs, flags, p, k, v_break, real, ip, x_block)
            x_block[M_FURTHEST] = x_block[M_CHARGE]
            if growing and left > 0:
                x_block[M_JUMP] = abs(x_block[M_CHARGE] - before)
                x_block[M_BEGAN] = x_block[M_CHARGE]
                x_block[M_SINCE] = 0.0
            unsettled = 4
            kind = 1  # a rate of charge that now points back ends the slip at once
            if relaxing:
                # What relaxes after a jump is met by steps that grow with the time since then.
                while trust > 0 and tick * (1 << trust) * real[R_QUICKEST] > 1.0:
                    trust -= 1
                begun = True
            elif not exact:
                trust = AFRESH
        mode = mode_index(flags)
        level = levels[d]
        habit = level  # what the smooth ports allow
        met = 0  # events: a guard
        wait = 0
        while True:
            if not built[mode]:
                build_mode(mode, real, ip, k, rates, opposing, reading, cls_tick, levels,
                           short, tables, watch, omegas, dampings, matrices, work)
                built[mode] = True
            if fresh:
                _look(watch, mode, z, used, W_Q, n_look, now)
                if smooth:
                    now[W_Q1] *= charge_gain(watch[mode, i_smooth, W_Q], now[W_Q], real)
                for c in range(n_states, used):
                    z1[c] = z[c]
                fresh = False
                known = False
            if unsettled > 0:
                unsettled -= 1
                if switch(now, s, inputs, flags, p, r, k, v_break, real, ip, x_block, kind):
                    mode = mode_index(flags)
                    fresh = True
                else:
                    unsettled = 0
                continue
            if left <= 0:
                break
            safe = short[mode, d]
            at = (mode * n_classes + d) * n_levels  # of the propagator of one tick
            if trust == AFRESH or (begun and trust > safe):
                trust = safe
            begun = False
            level = min(level, trust)
            while (1 << level) > left:
                level -= 1
            if level > safe and wait > 0:
                wait -= 1
                level = safe
                while (1 << level) > left:
                    level -= 1
            if level > safe:
                if not known:
                    _look(watch, mode, z, used, W_Q2, W_OUT, now)
                    calm = calm_time(now, s[0], s[1], omegas[mode], dampings[mode], exact,
                                     flags, p, r, real, ip, x_block)
                    known = True
                if (calm >= tick * left and flags[F_SLIP] == 0 and flags[F_FRIC] == 0
                        and not smooth and not limited and (exact or not displaced)
                        and (1 << trust) > left // 2):
                    # Nothing can happen up to the end of the segment.
                    for i in range(n_states):
                        held[i] = z[i]
                    _advance(tables, at, left, tick, z, n_states, used, smooth, end)
                    _look(watch, mode, z, used, W_Q, n_look, then)
                    if exact or abs(then[W_Q] - p[0]) <= r[0] + CHARGE_TOLERANCE:
                        for o in range(n_look):
                            now[o] = then[o]
                        known = False
                        unsettled = 1 if exact else 0
                        kind = 0
                        left = 0
                        continue
                    for i in range(n_states):
                        z[i] = held[i]
                    calm = 0.0  # the bound was wrong
                while level > safe and tick * (1 << level) > calm:
                    level -= 1
                if level == safe:
                    wait = 1  # to ask costs as much as a step
            count = 1 << level
            length = tick * count
            _move(tables, at + level, z, used, rows, held if smooth else end)
            if smooth:
                error, v1, f1 = smooth_step(tables, at + level, z, held, n_states, rows, length,
                                            watch[mode, i_smooth, W_Q], real, now, bend, end)
                if error > real[R_TOL] and level > 0:
                    level -= 1
                    continue
            for o in range(n_look):
                then[o] = end[n_states + o]
            reliable = level <= safe
            known = False
            if not reliable and (flags[F_SLIP] > 0 or flags[F_FRIC] != 0):
                # What slips at the start must still slip at the end for all between to be clear.
                for i in range(n_states):
                    z1[i] = end[i]
                if smooth:
                    z1[i_smooth] = v1
                    z1[i_smooth + 1] = f1
                _look(watch, mode, z1, used, W_Q2, W_OUT, then)
                calm = calm_time(then, end[0], end[1], omegas[mode], dampings[mode], exact, flags,
                                 p, r, real, ip, x_block)
                if calm < length:
                    level = max(safe, level - 2)
                    continue
                known = True
            part, kind = first_event(now, then, s, end, length, flags, p, r, real, ip, x_block, n,
                                     reliable, level > 0, displaced, limited)
            if part < 0.0:
                level -= 1  # too close to an edge to tell on which side
                continue
            if part <= 1.0 and met < MAX_EVENTS:
                if reliable:
                    # An event: meet it on its tick.
                    met += 1
                    ticks = min(count, max(1, int(math.ceil(part * count))))
                    _advance(tables, at, ticks, tick, z, n_states, columns, smooth, end)
                    left -= ticks
                    unsettled = 4
                    fresh = True
                    trust = levels[d] if exact else AFRESH
                    level = min(levels[d], habit)
                    if smooth:
                        inputs[SMOOTH_F] = smooth_force(s[0], real)
                        _look(watch, mode, z, used, W_Q, n_look, now)
                        inputs[SMOOTH_V] = smooth_voltage(now[W_Q], real)
                else:
                    known = False
                    level = max(safe, level - 3)  # too long to trust the cubic
                continue
            left -= count
            for i in range(n_states):
                z[i] = end[i]
            for i in range(n_look):
                now[i] = then[i]
            if smooth:
                z[i_smooth] = v1
                z[i_smooth + 1] = f1
                habit = level + 1
            if flags[F_SLIP] > 0 and flags[F_DIR] * (now[W_Q] - x_block[M_FURTHEST]) > 0.0:
                x_block[M_FURTHEST] = now[W_Q]
            if flags[F_FRIC] != 0 and flags[F_FRIC_DIR] * (s[0] - x_block[M_SLIDE]) > 0.0:
                x_block[M_SLIDE] = s[0]
            trust = min(trust + 1, levels[d])
            level = trust if reliable and not smooth else min(level + 1, trust)
        x_block[M_CHARGE] = now[W_Q]
        x_block[M_SINCE] += tick * seg_ticks[segment]
        if not math.isfinite(x_block[M_CHARGE]) or not math.isfinite(s[0]):
            failed = 1
            break
        row = seg_state[segment]
        read = seg_read[segment]
        if row >= 0 or read >= 0:
            _look(watch, mode, z, used, W_OUT, N_WATCHED, now)
            if row >= 0:
                for o in range(N_OUTPUTS):
                    out_state[row, o] = now[W_OUT + o]
            if read >= 0:
                out_read[read] = now[W_OUT]
    for c in range(n_states):
        state[c] = z[c]
    for c in range(N_INPUTS):
        ports[c] = z[n_states + c]
    return failed
