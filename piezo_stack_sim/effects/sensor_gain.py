# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A position sensor with a wrong scale.

    x_m = (1 + gain_error) x

Look-alikes: ``transducer_ratio`` and ``parallel_stiffness`` move the charge too,
``amplifier_gain`` the voltage.
Source: PI and piezosystem jena: capacitive 0.05 to 0.1 %, strain gauge 0.1 to
0.5 %; laser 0.1 to 1 %; a wrong calibration any number.
"""

from piezo_stack_sim.effects.base import Effect, Parameter


def apply(model, gain_error):
    """Scale the reading."""
    model.map_reading(lambda reading, time: (1.0 + gain_error) * reading)


EFFECT = Effect(
    'sensor_gain', 'sensor',
    'The position sensor multiplies by a slightly wrong number.',
    (
        Parameter('gain_error', '1', 0.0, -0.5, 0.5, 0.02, 'relative error of the scale'),
    ),
    apply, channels=('displacement',))
