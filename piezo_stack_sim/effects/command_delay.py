# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Dead time between the command and the driver.

    v(t) = u(t - delay)

Converters, buffers and buses take one to two sample periods.  The gain stays,
the phase grows in proportion with the frequency.

Look-alikes: ``amplifier_bandwidth`` (its gain falls), ``sensor_delay`` (there
only the displacement is late, here voltage and charge too).
Source: 1.5 sample periods of a sampled loop, Franklin, Powell and Workman 1998.
"""

from piezo_stack_sim.effects.base import Effect, Parameter


def apply(model, delay):
    """Delay the command."""
    model.command_delay += delay


EFFECT = Effect(
    'command_delay', 'drive',
    'The command reaches the driver some time after it was given.',
    (
        Parameter('delay', 's', 0.0, 0.0, 0.05, 1.5e-4, 'time from command to driver'),
    ),
    apply, channels=('voltage', 'charge', 'displacement'))
