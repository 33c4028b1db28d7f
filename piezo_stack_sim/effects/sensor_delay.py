# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Dead time of the position sensor.

    x_m(t) = x(t - delay)

Filters of converters and bus cycles.  Position is late against voltage and
charge, not smaller.

Look-alikes: ``sensor_lag`` (its gain falls), ``command_delay`` (voltage and
charge are late too).
Source: 20 to 40 samples of a delta-sigma converter, data sheets.
"""

from piezo_stack_sim.effects.base import Effect, Parameter


def apply(model, delay):
    """Delay the reading."""
    model.sensor_delay += delay


EFFECT = Effect(
    'sensor_delay', 'sensor',
    'The position is reported some time after it was true.',
    (
        Parameter('delay', 's', 0.0, 0.0, 0.05, 2e-4, 'time from the position to its reading'),
    ),
    apply, channels=('displacement',))
