# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
An electromechanical ratio T off by more than its uncertainty.

    T -> T (1 + ratio_error),  in both directions: Eqs. 11 and 14

Partial depoling, ageing, temperature.  Driven hard, the direct and the converse effect may be off
by unequal amounts: the same as a reading of the displacement that is off by half the difference,
besides, another stiffness against forces, k + T_converse T_direct/C, and as much more mass.

Look-alikes: ``amplifier_gain`` (moves the voltage), ``sensor_gain`` (leaves the
charge); forces at held voltage separate T from k.
Source: ageing 1 to 5 % a decade and 0.1 to 0.5 % per kelvin, engineering estimate.
"""

from piezo_stack_sim.effects.base import Effect, Parameter


def apply(model, ratio_error):
    """Scale the ratio."""
    model.T *= 1.0 + ratio_error


EFFECT = Effect(
    'transducer_ratio', 'transducer',
    'The ratio of force to voltage, and of charge to displacement, is off.',
    (
        Parameter('ratio_error', '1', 0.0, -0.5, 0.5, 0.05, 'relative error of the ratio',
                  runtime=False),
    ),
    apply, channels=('charge', 'displacement'),
    form_like=('sensor_gain', 'series_compliance', 'parallel_stiffness', 'added_mass'),
    form_mended_by=('sensor_gain',))
