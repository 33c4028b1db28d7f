# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Static gain and offset of the driver, and how far it is from straight.

    v = (1 + gain_error) u + offset + 4 curvature s (1 - s) V_full,     s = u/V_full

The last term vanishes at both ends of the range and is ``curvature`` of it between, as data
sheets state linearity.  Everything behind the driver follows, voltage included.  A charge driver
has the gain error only.

Look-alikes: ``sensor_gain`` and ``transducer_ratio`` (voltage and charge, or the
voltage, stay): measure the voltage.  The curvature: ``asymmetric_hysteresis``.
Source: engineering estimate, gain 0.1 to 1 %, offset 10 to 100 mV, linearity 0.01 to 0.1 %.
"""

from piezo_stack_sim.effects.base import Effect, Parameter


def apply(model, gain_error, offset, curvature):
    """Scale, shift and bow the command."""
    if model.drive != 'voltage':
        model.map_command(lambda command: (1.0 + gain_error) * command)
        return
    full = model.reference.voltage
    slope = 1.0 + gain_error + 4.0 * curvature
    model.map_command(lambda command: (
        offset + command * (slope - 4.0 * curvature * command / full)))


EFFECT = Effect(
    'amplifier_gain', 'drive',
    'The driver multiplies the command by a slightly wrong number and adds an offset.',
    (
        Parameter('gain_error', '1', 0.0, -0.2, 0.2, 0.01, 'relative error of the gain'),
        Parameter('offset', 'V', 0.0, -5.0, 5.0, 0.05, 'voltage at zero command'),
        Parameter('curvature', '1', 0.0, -0.05, 0.05, 0.0,
                  'departure from a straight line, of the range'),
    ),
    apply, channels=('voltage', 'charge', 'displacement'))
