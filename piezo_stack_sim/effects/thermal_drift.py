# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Thermal expansion of stack and frame after a change of temperature.

    x_read = x + amplitude (1 - exp(-t/time_constant)),     t since the start

The charge takes no part, and zero volts drift alike.

Look-alikes: ``creep`` (charge too), ``sensor_drift`` (never ends): repeat it at
rest, with a thermometer.
Source: PI, -3.5e-6/K poled ceramic, 12e-6/K steel: -70 and +240 nm/K on 20 mm.
"""

import numpy as np

from piezo_stack_sim.effects.base import Effect, Parameter


def apply(model, amplitude, time_constant):
    """Let the reading approach an offset."""
    model.map_reading(
        lambda reading, time: reading - amplitude * np.expm1(-time / time_constant))


EFFECT = Effect(
    'thermal_drift', 'environment',
    'The set-up warms up or cools down: the displacement drifts to another zero.',
    (
        Parameter('amplitude', 'm', 0.0, -1e-5, 1e-5, 2e-7, 'drift in the end'),
        Parameter('time_constant', 's', 300.0, 1.0, 1e5, 300.0, 'time constant of the warming',
                  scale='log', magnitude=False, default=300.0),
    ),
    apply, channels=('displacement',), before_its_time=('time_constant', 'sensor_drift'))
