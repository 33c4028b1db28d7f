# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The output stage of a driver that gives only so much current, as the challenge hides it.

Who writes the library of the diagnosis does not read this module.

A transistor beside each output transistor takes its drive away once the drop at an emitter
resistor, and a part of the voltage across the output transistor, open it (V-I limiting; Self
2013, Audio Power Amplifier Design, chapter on protection).  It does so exponentially, through a
capacitor at its base, and opens earlier the warmer the stage has become::

    drop = R i + TAKEN [exp((c - top)/(SLOPE limit)) - exp((-c - bottom)/(SLOPE sinks limit))]
    REACTION c' = i - c
    top = limit [1 + first (1 - across/HALF) - second w]
    third w' = |i| across/(limit HALF) - w

with what is across the conducting transistor; `bottom` likewise, sinks times as much.

"""

from numba import njit
import numpy as np

#: What is kept of it: current at the base (A), warmth, where it opens (A), and the part of its
#: way that the base goes within this step.
BASE, WARMTH, TOP, BOTTOM, SHARE = range(5)
KEPT = 5

TAKEN = 2.0  # V, at the limit
SLOPE = 0.045  # thermal voltage over that of an open base
STEEPEST = 7.0  # exponent from which on it goes straight: at more than a thousand volts
REACTION = 1.5e-5  # s
NEGATIVE, POSITIVE = -30.0, 130.0  # V, supplies
HALF = 0.5 * (POSITIVE - NEGATIVE)
LEAST = 0.2  # of the limit, however warm


@njit(cache=True)
def across(current, terminal):
    """Return the voltage across the transistor that conducts."""
    return POSITIVE - terminal if current > 0.0 else terminal - NEGATIVE


@njit(cache=True)
def begin(p, kept, terminal, h):
    """Find, in place, where the stage limits in the step that begins."""
    warm = 1.0 - p.stage_second * kept[WARMTH]
    up = warm + p.stage_first * (1.0 - across(1.0, terminal) / HALF)
    down = warm + p.stage_first * (1.0 - across(-1.0, terminal) / HALF)
    kept[TOP] = p.current_limit * max(up, LEAST)
    kept[BOTTOM] = p.current_limit * p.sink_share * max(down, LEAST)
    kept[SHARE] = 1.0 - np.exp(-h / REACTION)


@njit(cache=True)
def finish(p, kept, current, terminal, h):
    """Bring base and warmth, in place, to the end of a step with a current."""
    kept[BASE] += (current - kept[BASE]) * kept[SHARE]
    load = abs(current) * across(current, terminal) / (p.current_limit * HALF)
    kept[WARMTH] += (load - kept[WARMTH]) * (1.0 - np.exp(-h / p.stage_third))


@njit(cache=True)
def opened(exponent):
    """Return an exponential that goes on straight, and its slope."""
    slope = np.exp(min(exponent, STEEPEST))
    return slope * (1.0 + max(exponent - STEEPEST, 0.0)), slope


@njit(cache=True)
def lost(p, kept, current):
    """Return the voltage between source and load at a current, and its slope (Ohm)."""
    base = kept[BASE] + (current - kept[BASE]) * kept[SHARE]
    up = SLOPE * p.current_limit
    down = up * p.sink_share
    sourced, steep = opened((base - kept[TOP]) / up)
    sunk, steep_too = opened((-base - kept[BOTTOM]) / down)
    return (p.output_resistance * current + TAKEN * (sourced - sunk),
            p.output_resistance + TAKEN * kept[SHARE] * (steep / up + steep_too / down))


@njit(cache=True)
def most(p, kept):
    """Return the currents (A) between which the stage is, for any load: sinking, sourcing."""
    low = -kept[BOTTOM] - STEEPEST * SLOPE * p.current_limit * p.sink_share
    high = kept[TOP] + STEEPEST * SLOPE * p.current_limit
    base = kept[BASE]
    return (base + min(low - base, 0.0) / kept[SHARE],
            base + max(high - base, 0.0) / kept[SHARE])
