# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Static gain and offset of the driver.

    v = (1 + gain_error) u + offset

Everything behind the driver scales, voltage included.  A charge driver has the
gain error only.

Look-alikes: ``sensor_gain`` and ``transducer_ratio`` (voltage and charge, or the
voltage, stay): measure the voltage.
Source: engineering estimate, gain 0.1 to 1 % and offset 10 to 100 mV.
"""

from piezo_stack_sim.effects.base import Effect, Parameter


def apply(model, gain_error, offset):
    """Scale and shift the command."""
    shift = offset if model.drive == 'voltage' else 0.0
    model.map_command(lambda command: (1.0 + gain_error) * command + shift)


EFFECT = Effect(
    'amplifier_gain', 'drive',
    'The driver multiplies the command by a slightly wrong number and adds an offset.',
    (
        Parameter('gain_error', '1', 0.0, -0.2, 0.2, 0.01, 'relative error of the gain'),
        Parameter('offset', 'V', 0.0, -5.0, 5.0, 0.05, 'voltage at zero command'),
    ),
    apply, channels=('voltage', 'charge', 'displacement'))
