# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A position sensor whose zero wanders.

    x_m = x + rate t,     t since the start

Seen with the stack at rest or disconnected too.

Look-alikes: ``thermal_drift`` (comes to an end), ``creep`` (charge too).
Source: strain gauges 50 to 500 nm/h, engineering estimate.
"""

from piezo_stack_sim.effects.base import Effect, Parameter


def apply(model, rate):
    """Let the zero of the reading run away."""
    model.map_reading(lambda reading, time: reading + rate * time)


EFFECT = Effect(
    'sensor_drift', 'sensor',
    'The zero of the position sensor drifts steadily.',
    (
        Parameter('rate', 'm/s', 0.0, -1e-6, 1e-6, 1e-10, 'drift of the zero'),
    ),
    apply, channels=('displacement',))
