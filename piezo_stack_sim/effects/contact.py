# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A one-sided stop.

    F = -stiffness d (d / 1 um)^(exponent - 1),     d = x - gap > 0

beyond the gap, nothing before it.  The stroke above the gap is cut, and the stack rings
differently there; what it still delivers goes into force and charge.  Flat on flat the force is
in proportion (exponent 1), a ball or a rounded tip meets a stop with the power 3/2 of Hertz, a
cone with the square; ``stiffness`` is that of the chord at an indentation of 1 um.

Look-alikes: ``amplifier_saturation`` (there the voltage is flat), ``parallel_stiffness``
(a stop that is met at once is a spring), ``stiffness_hardening`` (has no place where it begins).
Source: Johnson, Contact Mechanics (1985), section 4.2; 10 to 100 N/um, engineering estimate.
"""

import math

from piezo_stack_sim.effects.base import Effect, Parameter

CHORD = 1e-6  # m, the indentation for which the stiffness is given


def apply(model, gap, stiffness, exponent):
    """Put a stop in the way."""
    model.contact_gap = gap
    model.contact_stiffness = stiffness * CHORD ** (1.0 - exponent)
    model.contact_exponent = exponent


EFFECT = Effect(
    'contact', 'mechanical',
    'The moving end meets a stop and pushes against it from there on.',
    (
        Parameter('gap', 'm', math.inf, 1e-8, 1e-3, 8e-6, 'way from rest to the stop',
                  scale='log', runtime=False),
        Parameter('stiffness', 'N/m', 5e7, 1e5, 1e9, 5e7, 'of the stop, 1 um beyond the gap',
                  scale='log', magnitude=False, default=5e7, runtime=False, tries=(5e7, 1e6)),
        Parameter('exponent', '1', 1.0, 1.0, 2.0, 1.0, 'power of the indentation', magnitude=False,
                  default=1.0, runtime=False, tries=(1.5,)),
    ),
    apply, channels=('charge', 'displacement'), becomes='parallel_stiffness',
    form_like=('stiffness_hardening',))
