# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The structure between the stack and the point that is read, as the challenge hides it.

Who writes the library of the diagnosis does not read this module.

Two modes stand on one joint that is pressed together: its faces are rough, so that force grows
with the square of the approach (Back, Burdekin and Cowley 1973, Review of the research on fixed
and sliding joints), and so do they open under tension.  What is lost in it grows with how far
the faces are closed (Hunt and Crossley 1975, Coefficient of restitution interpreted as damping
in vibroimpact).  With modal masses in inverse proportion to the squares of the frequencies::

    d_i'' = -x'' - w_i^2 [d_i + SHARE g(d)] - 2 zeta w_i [(1 - LOSS) d_i' + c(d) d' w_i/w_1]
    d = d_1 + d_2,  u = 1 + d/approach at least 0
    g(d) = approach (u^2 - 1)/2 - d,  c(d) = LOSS u

Energy 1/2 sum M_i (d_i'^2 + w_i^2 d_i^2) + M_1 w_1^2 SHARE G(d), convex for SHARE < 1/2, never
grows while the base stands still.

"""

from numba import njit
import numpy as np

SHARE = 0.45  # of the stiffness of each mode that is the joint's
LOSS = 0.7  # of the damping, at the approach at rest
TURN = 0.025  # rad of the faster mode in one step
FORGET = 2500  # steps between two readings: in a long hold there is nothing to follow


@njit(cache=True)
def pressed(stretch, approach):
    """Return what the joint's force (as a way) is off the straight line, and how closed it is."""
    closed = max(1.0 + stretch / approach, 0.0)
    return 0.5 * approach * (closed * closed - 1.0) - stretch, closed


@njit(cache=True)
def sway(time, signal, frequencies, damping, approach, parts):
    """
    Return what the structure adds to a signal (m) that moves its base; small steps.

    Parameters
    ----------
    time, signal : (n,) array
        In s and m; straight in between.
    frequencies, parts : tuple of 2 float
        Of small motion, in Hz, and what is read of each deflection.
    damping : float
        Ratio, of small motion.
    approach : float
        Of the faces at rest, in m.

    """
    out = np.zeros_like(signal)
    slow, fast = 2.0 * np.pi * frequencies[0], 2.0 * np.pi * frequencies[1]
    first = second = signal[0]
    first_rate = second_rate = 0.0
    own = 2.0 * damping * (1.0 - LOSS)
    joint = 2.0 * damping * LOSS / slow
    for i in range(1, signal.size):
        passed = time[i] - time[i - 1]
        steps = 1 + int(passed * fast / TURN)
        if steps > FORGET:
            first = second = signal[i]
            first_rate = second_rate = 0.0
            continue
        h = passed / steps
        base_rate = (signal[i] - signal[i - 1]) / passed
        base = signal[i - 1]
        for _ in range(steps):
            one, two = first - base, second - base
            one_rate, two_rate = first_rate - base_rate, second_rate - base_rate
            off, closed = pressed(one + two, approach)
            shared = SHARE * off + joint * closed * (one_rate + two_rate)
            first_rate -= h * slow * (slow * (one + shared) + own * one_rate)
            second_rate -= h * fast * (fast * (two + shared) + own * two_rate)
            first += h * first_rate
            second += h * second_rate
            base += h * base_rate
        out[i] = parts[0] * (first - signal[i]) + parts[1] * (second - signal[i])
    return out
