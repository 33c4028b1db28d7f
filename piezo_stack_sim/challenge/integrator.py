# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Small fixed steps through the equations of the stack: no events, no modes, no closed forms.

Motion is velocity Verlet with an implicit damper. In long holds, once nothing moves any more,
coarse steps of the static equilibrium take over.

"""

from numba import njit
import numpy as np

from piezo_stack_sim.challenge.guide import MEMBERS, rub
from piezo_stack_sim.challenge.memory import CAPACITY, logarithmic_growth, remember
from piezo_stack_sim.challenge.mount import relax, yields_to
from piezo_stack_sim.challenge.physics import (
    charge_step, equilibrium, force_per_charge, mechanical_force, mesh_voltage, output_drop,
    resisted_step, slip,
)
from piezo_stack_sim.challenge.stage import begin, finish, KEPT, lost

#: Layout of the state vector; those of stage and guide follow, then the Maxwell voltages.
(Q, X, SPEED, TERMINAL, HEAT, CURRENT, RELAY, RELAY_GOAL, LAGGED, RING, RING_RATE, BODY,
 BODY_SPEED, RING_STEP, RING_PART, RING_COSINE, STAGE) = range(17)
GUIDE = STAGE + KEPT
STATES = GUIDE + MEMBERS + 1

#: Motion slower than this (m/s) is a hold: at 20 kHz it is an amplitude of 0.01 nm.
AT_REST = 1e-6
#: So long (s) must everything have been slower before coarse steps begin; longer with a
#: payload, whose speed is small for a while at every reversal.
SETTLING = 4e-4
SETTLING_WITH_BODY = 3e-3
#: A change of the source below this (V) does not end a hold: a drift, not a command.
DRIFT = 2e-3
#: Interval at which slow memories are brought up to date (s).
MEMORY_INTERVAL = 2e-5
#: So often is a jump of the charge found again with the current that it has brought.
JUMP_ROUNDS = 3
#: So often is the step halved that follows a jump of the source, if charge must follow it.
PARTS = 4
#: Share of the piezoelectric stiffness T^2/C that is left where the stiff elements stick.
STUCK = 0.8


@njit(cache=True)
def amplify(p, state, source, h):
    """Advance the amplifier's own dynamics: a lag, then an output filter that may ring."""
    before = state[LAGGED]
    state[LAGGED] = source + (before - source) * (
        np.exp(-h / p.amplifier_lag) if p.amplifier_lag > 0.0 else 0.0)
    if p.ringing_frequency > 0.0:
        if h <= 0.0:
            return
        # Exactly, for an input that keeps its mean: without a lag it is constant.
        omega = 2.0 * np.pi * p.ringing_frequency
        loss = p.ringing_damping * omega
        if not abs(h - state[RING_STEP]) < 1e-9 * h:
            # Most steps are as long as the one before.
            swing = omega * np.sqrt(1.0 - p.ringing_damping ** 2)
            state[RING_STEP], faded = h, np.exp(-loss * h)
            state[RING_PART] = faded * np.sin(swing * h) / swing
            state[RING_COSINE] = faded * np.cos(swing * h)
        goal = 0.5 * (before + state[LAGGED])
        off, rate = state[RING] - goal, state[RING_RATE]
        part, cosine = state[RING_PART], state[RING_COSINE]
        state[RING] = goal + off * cosine + (rate + loss * off) * part
        state[RING_RATE] = rate * cosine - (loss * rate + omega * omega * off) * part
    else:
        state[RING] = state[LAGGED]


@njit(cache=True)
def pull_of_body(p, state, x):
    """Return the force of the payload on the moving end, less what its damper takes."""
    return held_by_joint(p, state[BODY] - x) + p.body_damping * state[BODY_SPEED]


@njit(cache=True)
def held_by_joint(p, stretch):
    """Return the force of the payload's joint: part of what holds it slips when stretched."""
    slips = p.body_slips / (1.0 + abs(stretch) / p.body_slip)
    return p.body_stiffness * stretch * (1.0 - p.body_slips + slips)


@njit(cache=True)
def move_body(p, state, h):
    """Advance the payload by one semi-implicit step."""
    push = (held_by_joint(p, state[X] - state[BODY])
            + p.body_damping * (state[SPEED] - state[BODY_SPEED]))
    state[BODY_SPEED] += h * push / p.body_mass
    state[BODY] += h * state[BODY_SPEED]


@njit(cache=True)
def slow_states(p, state, dq, h):
    """Advance what follows the current slowly: filtered current and the heat it leaves."""
    rate, kept = abs(dq) / h, np.exp(-h / p.rate_memory)
    more, some = state[CURRENT] - rate, (1.0 - kept) * p.rate_memory / h
    state[CURRENT] = rate + more * kept
    # The mean of its square, exactly: what jumped into it is soon gone again.
    square = rate * rate + more * some * (2.0 * rate + 0.5 * more * (1.0 + kept))
    power = square / p.heating_current ** 2
    state[HEAT] += (power - state[HEAT]) * (1.0 - np.exp(-h / p.heating_time))


@njit(cache=True)
def stretched(p, current):
    """Return the factor of the break voltages at a filtered current."""
    if p.rate_gain == 0.0:
        return 1.0
    return 1.0 + p.rate_gain * np.log(1.0 + current / p.rate_reference)


@njit(cache=True)
def relay_charge(p, state, h):
    """Return the charge that the domain wall moves in this step."""
    if state[TERMINAL] > p.relay_on:
        state[RELAY_GOAL] = 1.0
    elif state[TERMINAL] < p.relay_off:
        state[RELAY_GOAL] = 0.0
    moved = (state[RELAY_GOAL] - state[RELAY]) * (1.0 - np.exp(-h / p.relay_time))
    state[RELAY] += moved
    return p.relay_charge * moved


@njit(cache=True)
def at_rest(state, source):
    """Tell whether nothing moves any more that the small steps are for."""
    return (abs(state[RING] - source) < 1e-5 and abs(state[SPEED]) < AT_REST
            and abs(state[BODY_SPEED]) < AT_REST)


@njit(cache=True)
def jump(p, z, stage, state, x, heat):
    """Move the charge that flows at once when the source has jumped; return it (C)."""
    source = state[RING]
    scale = stretched(p, state[CURRENT])
    if p.crossover_voltage > 0.0:
        # However large the current, the output keeps back so much, and less if that suffices.
        off = source - mesh_voltage(p, z, state[Q], 0.0, 0.0, x, 0.0, heat, scale)[0]
        if abs(off) <= p.crossover_voltage:
            return 0.0
        source -= p.crossover_voltage if off > 0.0 else -p.crossover_voltage
    dq = charge_step(p, z, stage, state[Q], 0.0, x, 0.0, heat, scale, source)
    if p.rate_gain != 0.0:
        # What the current has become meanwhile counts, however quick the jump.
        for _ in range(JUMP_ROUNDS):
            scale = stretched(p, state[CURRENT] + abs(dq) / p.rate_memory)
            dq = charge_step(p, z, stage, state[Q], 0.0, x, 0.0, heat, scale, source)
    slip(p, z, dq, 0.0, scale)
    state[Q] += dq
    state[CURRENT] += abs(dq) / p.rate_memory
    return dq


@njit(cache=True)
def charge_through_output(p, z, stage, state, slow, dx, h, heat, scale, source, jumped, rate):
    """
    Advance amplifier and charge by one step of the motion; elements and stage in place.

    Where the source has just jumped, in steps that begin small. Return the charge that has
    flowed (C), how much of it the force has felt in the mean (C), and the last current (A).

    """
    q, flowed, felt, done = state[Q], 0.0, 0.0, 0.0
    parts = PARTS if jumped else 0
    for part in range(parts + 1):
        piece = 0.5 ** min(parts - part + 1, parts) if parts else 1.0
        done += piece
        before = state[RING]
        amplify(p, state, source, piece * h)
        lag = 0.0
        if p.amplifier_lag > 0.0 and p.ringing_frequency == 0.0:
            lag = piece * h / p.amplifier_lag
        if p.current_limit < np.inf:
            begin(p, stage, state[TERMINAL], piece * h)
        dq, voltage, early = resisted_step(
            p, z, stage, q + flowed, piece * slow, state[X] + done * dx, piece * h, heat, scale,
            state[TERMINAL], before, state[RING], lag, rate)
        slip(p, z, dq, piece * slow, scale)
        rate = dq / (piece * h)
        felt += piece * (flowed + early)
        flowed += dq
        state[TERMINAL] = voltage
        if p.current_limit < np.inf:
            finish(p, stage, rate, voltage, piece * h)
    return flowed, felt, rate


@njit(cache=True)
def save(out, row, now, state, force):
    """Write one row of the trace."""
    out[0, row] = now
    out[1, row] = state[TERMINAL]
    out[2, row] = state[Q]
    out[3, row] = state[X]
    out[4, row] = force
    out[5, row] = state[SPEED]


@njit(cache=True)
def run(p, shares, times, state, starts, sources, forces, step, coarse, keep, hold_only,
        resolution):
    """
    Integrate over segments of constant source voltage and force.

    Parameters
    ----------
    p : Stack
        Parameters of the device, in the order of this module.
    shares, times : (m,) array
        Branches of the mount: see its module. Not in `p`, which each function gets.
    state : (STATES + n,) array
        Changed in place to the state at the end; see the layout above.
    starts : (s + 1,) array
        Times of the segment boundaries in s.
    sources, forces : (s,) array
        Open-circuit voltage of the amplifier (V) and external force (N).
    step, coarse, keep : float
        Small step, step during holds, and spacing of what is returned, in s.
    hold_only : bool
        Take coarse steps only: quasi-static.
    resolution : float
        How finely slow memories keep what happened: as a fraction of its age.

    Returns
    -------
    (6, r) array
        Time, terminal voltage, charge, displacement, force, speed; left limits at segment
        boundaries.

    """
    z, guided, stage = state[STATES:], state[GUIDE:STATES], state[STAGE:GUIDE]
    rubs, rubbing = p.guide_first[0] > 0.0, guided[:MEMBERS].sum()
    out = np.empty((6, 8192))
    save(out, 0, starts[0], state, 0.0)
    rows = 1
    creep_ends, creep_means = np.empty(CAPACITY), np.empty(CAPACITY)
    creep_count = 0
    creep_rate = relaxation_rate = crept = 0.0
    q_begun, begun = state[Q], starts[0]
    # What happened before the recording is long past.
    yielded = np.full(shares.size, state[X])
    relaxed = p.mount_stiffness * state[X]
    q_sum = x_sum = 0.0
    memory_from = memory_due = begun
    creeping = p.creep_per_decade != 0.0
    relaxing = p.mount_stiffness > 0.0
    warming = p.rate_gain != 0.0 or p.heating_gain != 0.0
    viscosity = p.b + p.body_damping
    stiff = STUCK * p.T * p.T / p.C + p.k
    limited = p.current_limit < np.inf
    # What a resistance, or a limit, lets follow the source in its own time.
    resisted = limited or (p.output_resistance > 0.0 and p.crossover_voltage == 0.0)
    rate = 0.0
    calm = hold_only
    still = unsaved = acceleration = last = 0.0
    settling = SETTLING_WITH_BODY if p.body_mass > 0.0 else SETTLING

    for j in range(sources.size):
        source, force = sources[j], forces[j]
        now, end = starts[j], starts[j + 1]
        if j == 0 or abs(source - sources[j - 1]) > DRIFT or force != forces[j - 1]:
            calm = hold_only
            still = 0.0
        fresh = True
        while now < end:
            calm = calm or still >= settling
            remaining = end - now
            h = remaining / np.ceil(remaining / (coarse if calm else step) - 1e-6)

            # Slow memories move on straight lines between their updates, to where they would
            # be if nothing moved until then.
            if (creeping or relaxing) and now + h > memory_due + 1e-12:
                interval = max(h, MEMORY_INTERVAL)
                memory_due, lasted = now + interval, now - memory_from
                if creeping:
                    if lasted > 0.0:
                        creep_count = remember(creep_ends, creep_means, creep_count, begun, now,
                                               q_sum / lasted, p.creep_onset, resolution)
                    creep_rate = (p.creep_per_decade * logarithmic_growth(
                        creep_ends, creep_means, creep_count, begun, state[Q] - q_begun - crept,
                        memory_due, p.creep_onset) - crept) / interval
                if relaxing:
                    if lasted > 0.0:
                        relax(shares, times, p.mount_third, yielded, x_sum / lasted, lasted)
                    relaxation_rate = (p.mount_stiffness * yields_to(
                        shares, times, p.mount_third, yielded, state[X], interval)
                        - relaxed) / interval
                memory_from, q_sum, x_sum = now, 0.0, 0.0

            heat = p.heating_gain * state[HEAT]
            x = state[X]
            if calm:
                state[LAGGED], state[RING], state[RING_RATE] = source, source, 0.0
            elif fresh:
                # The source has just jumped: without resistance the charge jumps with it.
                amplify(p, state, source, 0.0)
                if p.output_resistance == 0.0:
                    jump(p, z, stage, state, x, heat)
                pull = (mechanical_force(p, state[Q], x, rubbing, relaxed, heat, force)
                        + pull_of_body(p, state, x))
                inertia = p.m + stiff * h * h / 12.0
                acceleration = (pull - viscosity * state[SPEED]) / inertia
            jumped, fresh = fresh, False
            rate_scale = 1.0
            if p.rate_gain != 0.0:
                # At the end of the step, by the current of the last one.
                rate_scale = stretched(p, last + (state[CURRENT] - last)
                                       * np.exp(-h / p.rate_memory))
            following = resisted and not calm
            if not calm and not resisted:
                amplify(p, state, source, h)
            slow = creep_rate * h + (relay_charge(p, state, h) if p.relay_charge != 0.0 else 0.0)
            relaxed += relaxation_rate * h
            crept += creep_rate * h
            if limited and calm:
                begin(p, stage, state[TERMINAL], h)

            if calm:
                dx, dq = equilibrium(p, z, stage, state[Q], x, guided, slow, relaxed, h, heat,
                                     rate_scale, source, force)
                speed = dx / h
                if rubs:
                    rubbing = rub(p.guide_first, p.guide_second, p.guide_third, guided, dx, h)
                if p.body_mass > 0.0:
                    state[BODY], state[BODY_SPEED] = x + dx, speed
            else:
                dx = h * (state[SPEED] + 0.5 * h * acceleration)
                if following:
                    dq, felt, rate = charge_through_output(
                        p, z, stage, state, slow, dx, h, heat, rate_scale, source, jumped, rate)
                else:
                    dq = charge_step(p, z, stage, state[Q], slow, x + dx, h, heat, rate_scale,
                                     state[RING])
                if rubs:
                    rubbing = rub(p.guide_first, p.guide_second, p.guide_third, guided, dx, h)
                if p.body_mass > 0.0:
                    move_body(p, state, h)
                pull = (mechanical_force(p, state[Q] + dq, x + dx, rubbing, relaxed, heat, force)
                        + pull_of_body(p, state, x + dx))
                # Verlet shortens the period; so much more mass gives it back (Fox and Goodwin).
                inertia = p.m + stiff * h * h / 12.0
                speed = ((state[SPEED] + 0.5 * h * (acceleration + pull / inertia))
                         / (1.0 + 0.5 * h * viscosity / inertia))
                if following:
                    # Most of the charge has come early in the step: so has its push.
                    speed += (felt - 0.5 * dq) * h / inertia * force_per_charge(
                        p, state[Q] + 0.5 * dq, heat, force)
                acceleration = (pull - viscosity * speed) / inertia
            if not following:
                slip(p, z, dq, slow, rate_scale)
            q_sum += h * (state[Q] + 0.5 * dq - q_begun - crept + 0.5 * creep_rate * h)
            x_sum += h * (x + 0.5 * dx)
            state[Q] += dq
            state[X], state[SPEED] = x + dx, speed
            if not following:
                rate = dq / h
                state[TERMINAL] = state[RING] - (
                    lost(p, stage, rate) if limited else output_drop(p, dq, h))[0]
                if limited:
                    finish(p, stage, rate, state[TERMINAL], h)
            if warming:
                slow_states(p, state, dq, h)
                last = abs(dq) / h

            now = end if remaining - h < 0.5 * h else now + h
            still = still + h if at_rest(state, source) else 0.0
            unsaved += h
            if unsaved >= keep - 1e-12 or now == end:
                unsaved = 0.0
                if rows == out.shape[1]:
                    larger = np.empty((6, 2 * rows))
                    larger[:, :rows] = out
                    out = larger
                save(out, rows, now, state, force)
                rows += 1
    return out[:, :rows].copy()
