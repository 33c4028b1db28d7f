# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The cubic through both ends of a sub-step, and what happens on it.

Everywhere ``theta`` runs from 0 to 1 over the sub-step and ``d0``, ``d1`` are
the slopes at its ends times its length, in the unit of ``y``.
"""

import math

from piezo_stack_sim.plant.compiled import jit


@jit
def hermite(theta, y0, d0, y1, d1):
    """Return the cubic at ``theta``."""
    t2 = theta * theta
    t3 = t2 * theta
    return ((2.0 * t3 - 3.0 * t2 + 1.0) * y0 + (t3 - 2.0 * t2 + theta) * d0
            + (3.0 * t2 - 2.0 * t3) * y1 + (t3 - t2) * d1)


@jit
def turning(y0, d0, y1, d1):
    """Return where in (0, 1) the cubic turns, or 2 if it does not."""
    a = 6.0 * (y0 - y1) + 3.0 * (d0 + d1)
    b = 6.0 * (y1 - y0) - 4.0 * d0 - 2.0 * d1
    c = d0
    best = 2.0
    if abs(a) < 1e-12 * (abs(b) + abs(c)):
        if b != 0.0:
            root = -c / b
            if 0.0 < root < 1.0:
                best = root
        return best
    disc = b * b - 4.0 * a * c
    if disc < 0.0:
        return best
    disc = math.sqrt(disc)
    half = -0.5 * (b + (disc if b >= 0.0 else -disc))
    root = half / a
    if 0.0 < root < 1.0:
        best = root
    if half != 0.0:
        root = c / half
        if 0.0 < root < 1.0 and root < best:
            best = root
    return best


@jit
def crossing(level, y0, d0, y1, d1, upper):
    """Return where the cubic first reaches ``level`` in (0, upper]."""
    low = 0.0
    high = upper
    rising = hermite(upper, y0, d0, y1, d1) > level
    for _ in range(14):
        middle = 0.5 * (low + high)
        if (hermite(middle, y0, d0, y1, d1) > level) == rising:
            high = middle
        else:
            low = middle
    return high
