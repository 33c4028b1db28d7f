# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
An electromechanical ratio T off by more than its uncertainty.

    T -> T (1 + ratio_error)                      in Eq. 11 (direct effect)
    T -> T (1 + ratio_error)(1 + inequality)      in Eq. 14 (converse effect)

Partial depoling, ageing, temperature.  At large signals the two effects need not
be equal: the domains that switch under a voltage are not those under a force.

Look-alikes: ``amplifier_gain`` (moves the voltage), ``sensor_gain`` (leaves the
charge); forces at held voltage separate T from k.
Source: ageing 1 to 5 % a decade and 0.1 to 0.5 % per kelvin, inequality 5 to 20 %
at large signals, engineering estimates.
"""

from piezo_stack_sim.effects.base import Effect, Parameter


def apply(model, ratio_error, inequality):
    """Scale the ratio, in the converse direction by some more."""
    model.T *= 1.0 + ratio_error
    model.converse *= 1.0 + inequality


EFFECT = Effect(
    'transducer_ratio', 'transducer',
    'The ratio of force to voltage, and of charge to displacement, is off.',
    (
        Parameter('ratio_error', '1', 0.0, -0.5, 0.5, 0.05, 'relative error of the ratio',
                  runtime=False),
        Parameter('inequality', '1', 0.0, -0.3, 0.3, 0.0,
                  'by which the converse effect (charge to force) is stronger than the direct one',
                  runtime=False),
    ),
    apply, channels=('charge', 'displacement'))
