# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A guide or flexure whose stiffness changes along the stroke.

    F = -k_s x_full (quadratic s^2 / 2 + cubic s^3 / 3),     s = x/x_full

so that the stiffness changes by (quadratic + cubic) k_s at the full stroke;
k_s is the stiffness of the stack with leads shorted at large signals.

Look-alikes: ``asymmetric_hysteresis`` (the q-x line stays straight).
Source: flexures 0.01 to 0.2, engineering estimate.
"""

from piezo_stack_sim.effects.base import Effect, Parameter


def apply(model, quadratic, cubic):
    """Add a polynomial spring to ground."""
    k_s, stroke = model.reference.stiffness, model.reference.stroke
    k2, k3 = model.smooth_force
    model.smooth_force = (k2 + quadratic * k_s / (2.0 * stroke),
                          k3 + cubic * k_s / (3.0 * stroke ** 2))


EFFECT = Effect(
    'stiffness_hardening', 'mechanical',
    'The stiffness changes with the position: more resistance towards the end of the stroke.',
    (
        Parameter('quadratic', '1', 0.0, -0.3, 1.0, 0.0,
                  'relative change of stiffness at full stroke, odd in position'),
        Parameter('cubic', '1', 0.0, -0.2, 1.0, 0.1,
                  'relative change of stiffness at full stroke, even in position'),
    ),
    apply, channels=('charge', 'displacement'), form_like=('contact',))
