# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A position sensor whose error is a function of position alone.

    x_m = x + x_full (4 quadratic s (1 - s) + 2.598 cubic s (1 - s^2)
                      + 16 quartic s (1 - s) (1 - 2 s)^2),     s = x/x_full

All terms vanish at both ends of the stroke and reach 1 between, as a catalogue
states linearity.  Beyond the ends, where a force pushes or a voltage below zero
pulls, the error goes straight on: there a polynomial would run away.
Controllers linearise a sensor by a polynomial of the fourth order; what is
wrong with it has that order, too.

Look-alikes: ``transducer_nonlinearity`` (a function of charge),
``asymmetric_hysteresis`` (bows the charge too).
Source: piezosystem jena and PI, 0.05 to 1 % of the range.
"""

import math

import numpy as np

from piezo_stack_sim.effects.base import Effect, Parameter

WAVE = 1.5 * math.sqrt(3.0)  # s (1 - s^2) reaches 1/WAVE


def apply(model, quadratic, cubic, quartic):
    """Bow the reading over the position."""
    full = model.reference.stroke
    at_zero = 4.0 * quadratic + WAVE * cubic + 16.0 * quartic
    at_full = -4.0 * quadratic - 2.0 * WAVE * cubic - 16.0 * quartic

    def bow(reading, time):
        s = reading / full
        within = np.clip(s, 0.0, 1.0)
        error = within * (1.0 - within) * (
            4.0 * quadratic + WAVE * cubic * (1.0 + within)
            + 16.0 * quartic * (1.0 - 2.0 * within) ** 2)
        beyond = s - within
        slope = np.where(s < 0.0, at_zero, at_full)
        return reading + full * (error + slope * beyond)

    model.map_reading(bow)


EFFECT = Effect(
    'sensor_nonlinearity', 'sensor',
    'The scale of the position sensor varies along the stroke.',
    (
        Parameter('quadratic', '1', 0.0, -0.1, 0.1, 0.01,
                  'departure from the straight line in the middle, part of the full stroke'),
        Parameter('cubic', '1', 0.0, -0.1, 0.1, 0.0,
                  'S-shaped departure, equal for both signs, part of the full stroke'),
        Parameter('quartic', '1', 0.0, -0.1, 0.1, 0.0,
                  'M-shaped departure, largest at 15 % and 85 %, part of the full stroke'),
    ),
    apply, channels=('displacement',))
