# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Displacement is not quite proportional to charge (electrostriction).

    x = T v_t / k + curvature * 4 s (s_b - s) x_full,     s = q/q_full

The term vanishes at s = 0 and at s_b = ``balanced_at``, the charge whose chord
has the slope of the straight line.  With s_b = 1 ``curvature`` is the departure
at half the charge, as a fraction of the full stroke.  It is what a charge drive
leaves of the loop.

Look-alikes: ``sensor_nonlinearity``: bowed over position, also under forces.
Source: self-sensing studies, at most 4.65 % departure of x over q.
"""

from piezo_stack_sim.effects.base import Effect, Parameter


def apply(model, curvature, balanced_at):
    """Bow the displacement over the charge."""
    full, scale = model.reference.charge, 4.0 * curvature * model.reference.stroke

    def bow(charge):
        s = charge / full
        return scale * s * (balanced_at - s)

    model.map_charge(bow)


EFFECT = Effect(
    'transducer_nonlinearity', 'transducer',
    'The displacement over the charge is bowed instead of straight.',
    (
        Parameter('curvature', '1', 0.0, -0.1, 0.1, 0.03,
                  'departure from proportional at half the charge, part of the full stroke'),
        Parameter('balanced_at', '1', 1.0, -1.0, 2.0, 1.0,
                  'charge up to which x over q is right on the whole, part of the full charge',
                  magnitude=False),
    ),
    apply, channels=('displacement',),
    # What bows the displacement pushes back on the voltage, too.
    form_like=('asymmetric_hysteresis', 'stiffness_hardening'))
