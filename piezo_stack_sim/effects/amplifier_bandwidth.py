# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A driver that is not infinitely fast: its own pole, and its output resistance.

    time_constant du'/dt = u - u',        output_resistance dq/dt = u' - v

The resistance forms a pole with the stack, 1/(2 pi R C), that moves with the
amplitude because C does.  It acts where the driver controls the voltage.

Look-alikes: ``rate_dependent_hysteresis`` (the measured voltage is on time),
``amplifier_current_limit`` (small signals are on time).
Source: Fleming and Leang, Design, Modeling and Control of Nanopositioning
Systems, 2014; 5 to 100 ohm and 1 to 60 kHz in data sheets of stack drivers.
"""

from piezo_stack_sim.effects.base import Effect, Parameter


def apply(model, output_resistance, time_constant):
    """Put the lag and the resistance between command and terminals."""
    if model.drive != 'voltage':
        return
    if time_constant > 0.0:
        model.drive_through('driver', 1.0 / time_constant)
    model.output_resistance += output_resistance


EFFECT = Effect(
    'amplifier_bandwidth', 'drive',
    'The voltage follows the command with a lag, from the driver itself and its resistance.',
    (
        Parameter('output_resistance', 'ohm', 0.0, 0.0, 1e4, 20.0,
                  'resistance between driver and stack'),
        Parameter('time_constant', 's', 0.0, 0.0, 0.05, 2e-5,
                  'time constant of the driver without load'),
    ),
    apply, channels=('voltage', 'charge', 'displacement'),
    # The resistance of an output stage changes with its current, and so bends its line.
    form_like=('amplifier_current_limit', 'amplifier_gain'),
    told_by={'amplifier_current_limit': ('output_resistance',)})
