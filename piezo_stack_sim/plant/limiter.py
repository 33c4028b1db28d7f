# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
How a driver limits its current: not at all, beyond a knee more and more, altogether.

Told by what its resistance alone would let flow, which is continuous whatever it does.
"""

import math

from piezo_stack_sim.plant.compiled import inline, jit
from piezo_stack_sim.plant.layout import (
    BENT_DOWN, BENT_UP, FREE, R_CEILING, R_FLOOR, R_KNEE, R_KNEE_SINK, SOURCED, SUNK)

SLACK = 1e-9  # part of an edge by which it must be passed to count: rounding is no event


@inline
def limit_edges(state, real):
    """Return between which currents (A) the driver goes on as it does."""
    low = -real[R_KNEE_SINK]
    high = real[R_KNEE]
    if state == SOURCED:
        low = real[R_CEILING]
        high = math.inf
    elif state == SUNK:
        low = -math.inf
        high = -real[R_FLOOR]
    elif state == BENT_UP:
        low = real[R_KNEE]
        high = real[R_CEILING]
    elif state == BENT_DOWN:
        low = -real[R_FLOOR]
        high = -real[R_KNEE_SINK]
    return low - SLACK * abs(low), high + SLACK * abs(high)


@jit
def event_limit(want0, want1, state, real):
    """Return the part of a sub-step after which the driver changes how it limits, or 2."""
    low, high = limit_edges(state, real)
    if want1 > high:
        edge = high
    elif want1 < low:
        edge = low
    else:
        return 2.0
    part = 1.0
    if want1 != want0:
        part = (edge - want0) / (want1 - want0)
    return min(1.0, max(0.02, part))


@inline
def limit_at(want, state, real):
    """Return how the driver limits a current (A) that its resistance would let flow."""
    low, high = limit_edges(state, real)
    if low <= want <= high:
        return state
    if want > real[R_CEILING]:
        return SOURCED
    if want > real[R_KNEE]:
        return BENT_UP
    if want < -real[R_FLOOR]:
        return SUNK
    if want < -real[R_KNEE_SINK]:
        return BENT_DOWN
    return FREE
