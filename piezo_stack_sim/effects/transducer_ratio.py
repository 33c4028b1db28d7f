# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
An electromechanical ratio T off by more than its uncertainty.

    F_t = T (1 + ratio_error (1 + inequality)) v_t                 the converse effect, Eq. 14
    q   = T (1 + ratio_error (1 - inequality)) x + C v_t           the direct effect, Eq. 11

Partial depoling, ageing, temperature.  Driven hard, the direct and the converse effect may be off
by unequal amounts.  Without forces from outside the difference is the same as a reading of the
displacement that is off by half of it; a force moves the end by as much less.  Unequal ones are
no law of energy, but the secants of two large loops.

Look-alikes: ``amplifier_gain`` (moves the voltage), ``sensor_gain`` (leaves the
charge); forces at held voltage separate T from k.
Source: ageing 1 to 5 % a decade and 0.1 to 0.5 % per kelvin, unequal by 5 to 20 % at a large
signal, engineering estimates.
"""

from piezo_stack_sim.effects.base import Effect, Parameter


def apply(model, ratio_error, inequality):
    """Scale the ratio, in both directions."""
    direct = 1.0 + ratio_error * (1.0 - inequality)
    model.T *= direct
    model.converse_share *= (1.0 + ratio_error * (1.0 + inequality)) / direct


EFFECT = Effect(
    'transducer_ratio', 'transducer',
    'The ratio of force to voltage, and of charge to displacement, is off.',
    (
        Parameter('ratio_error', '1', 0.0, -0.5, 0.5, 0.05, 'relative error of the ratio',
                  runtime=False),
        Parameter('inequality', '1', 0.0, -0.3, 0.3, 0.0,
                  'part by which the error of the converse effect is larger, that of the direct '
                  'effect smaller', magnitude=False, runtime=False),
    ),
    apply, channels=('charge', 'displacement'),
    # Real ratios depend on the load, too.
    form_like=('series_compliance',))
