# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
For how long nothing hidden can happen: sub-steps longer than the fast motion.

A value is split into ringing about a centre and a slow part, by its first
three derivatives.  The amplitude sqrt((y - centre)^2 + (y'/omega)^2) of a damped
oscillator never grows; that bounds where the value can go.
"""

import math


from piezo_stack_sim.plant.compiled import jit
from piezo_stack_sim.plant.layout import (
    CHARGE_TOLERANCE, DISPLACEMENT_TOLERANCE, F_CONTACT, F_DIR, F_FRIC, F_FRIC_DIR, F_LIMIT,
    F_SLIP, I_CONTACT, I_FRICTION, I_LIMITER, M_FRICTION, R_FRICTION_F, R_FRICTION_K, R_GAP,
    R_KNEE, R_KNEE_SINK, REST, W_Q, W_Q1, W_Q2, W_Q3, W_WANT, W_X2, W_X3)

MARGIN = 0.5  # of the amplitude, where the split into ringing and slow part is not strict
EVER = 1e30  # s


@jit
def _within(y, d1, d2, d3, omega, damping, low, high, exact):
    """
    Return for how long (s) y stays within (low, high) for sure.

    With two states (``exact``) the bound is strict; else it gets a margin.
    """
    inverse = 1.0 / omega
    slow = 0.0 if exact else d1 + (d3 + 2.0 * damping * d2) * inverse * inverse
    fast = d1 - slow
    offset = -(d2 + 2.0 * damping * fast) * inverse * inverse  # of y from its centre
    radius = math.sqrt(offset * offset + fast * fast * inverse * inverse)
    reach = radius if exact else (1.0 + MARGIN) * radius
    above = high - (y - offset + reach)
    below = (y - offset - reach) - low
    if not (above > 0.0 and below > 0.0):
        return 0.0
    if slow > 0.0:
        return above / slow
    if slow < 0.0:
        return below / -slow
    return EVER


@jit
def _goes_on(d1, d2, d3, omega, damping, direction, small, exact):
    """
    Return for how long (s) a slip goes on in its direction, or rests.

    What rings by less than a thousandth of ``small`` (C or m) is rounding: it would
    hide that nothing moves any more.
    """
    inverse = 1.0 / omega
    ring = (abs(d2) + abs(d3) * inverse) * inverse
    if ring < 1e-3 * small * omega:
        return EVER if direction * d1 >= 0.0 else small / abs(d1)
    if not exact:
        # Monotone: the slow part outruns the ringing.
        slow = d1 + (d3 + 2.0 * damping * d2) * inverse * inverse
        fast = d1 - slow
        if direction * slow > 2.0 * (abs(fast) + abs(d2 + 2.0 * damping * fast) * inverse):
            return EVER
    return max(0.0, (small - ring * inverse) / (abs(d1) + ring))


@jit
def calm_time(now, x, w, omega, damping, exact, flags, p, r, real, ip, x_block):
    """Return for how long (s) there can be no event that a longer sub-step would hide."""
    if ip[I_LIMITER] != 0 and (flags[F_LIMIT] != 0
                               or abs(now[W_WANT]) > 0.5 * min(real[R_KNEE], real[R_KNEE_SINK])):
        return 0.0  # ringing may lead it across the limit and back
    if flags[F_SLIP] > 0:
        calm = _goes_on(now[W_Q1], now[W_Q2], now[W_Q3], omega, damping, flags[F_DIR], REST,
                        exact)
    else:
        calm = _within(now[W_Q], now[W_Q1], now[W_Q2], now[W_Q3], omega, damping,
                       p[0] - r[0] - CHARGE_TOLERANCE, p[0] + r[0] + CHARGE_TOLERANCE, exact)
    for port in range(2):
        if calm <= 0.0 or ip[I_CONTACT if port else I_FRICTION] == 0:
            continue
        low = -1.0
        high = real[R_GAP] + DISPLACEMENT_TOLERANCE
        if port == 0:
            if flags[F_FRIC] != 0:
                calm = min(calm, _goes_on(w, now[W_X2], now[W_X3], omega, damping,
                                          flags[F_FRIC_DIR], 0.1 * REST, exact))
                continue
            reach = real[R_FRICTION_F] / real[R_FRICTION_K] + DISPLACEMENT_TOLERANCE
            low = x_block[M_FRICTION] - reach
            high = x_block[M_FRICTION] + reach
        elif flags[F_CONTACT] != 0:
            low = real[R_GAP] - DISPLACEMENT_TOLERANCE
            high = 1.0
        calm = min(calm, _within(x, w, now[W_X2], now[W_X3], omega, damping, low, high, exact))
    return calm
