# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A one-sided stop.

    F = -stiffness (x - gap)  beyond the gap, nothing before it

The stroke above the gap is cut, and the stack rings differently there; what it
still delivers goes into force and charge.

Look-alikes: ``amplifier_saturation`` (there the voltage is flat), ``parallel_stiffness``
(a stop that is met at once is a spring).
Source: penalty contact; its stiffness, 10 to 100 N/um, is an engineering estimate.
"""

import math

from piezo_stack_sim.effects.base import Effect, Parameter


def apply(model, gap, stiffness):
    """Put a stop in the way."""
    model.contact_gap = gap
    model.contact_stiffness = stiffness


EFFECT = Effect(
    'contact', 'mechanical',
    'The moving end meets a stop and pushes against it from there on.',
    (
        Parameter('gap', 'm', math.inf, 1e-8, 1e-3, 8e-6, 'way from rest to the stop',
                  scale='log', runtime=False),
        Parameter('stiffness', 'N/m', 5e7, 1e5, 1e9, 5e7, 'stiffness of the stop', scale='log',
                  magnitude=False, default=5e7, runtime=False, tries=(5e7, 1e6)),
    ),
    apply, channels=('charge', 'displacement'), becomes='parallel_stiffness')
