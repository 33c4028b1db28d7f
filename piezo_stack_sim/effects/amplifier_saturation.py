# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The rails of the driver.

    v = clip(u, lower, upper)

Flat tops at the same voltage, whatever came before.

Look-alikes: ``contact`` (the voltage goes on), ``asymmetric_hysteresis``.
Source: data sheets; PI E-500 -20 to 120 V, Thorlabs MDT693 0 to 75, 100 or 150 V.
"""

import math

from piezo_stack_sim.effects.base import Effect, Parameter


def apply(model, lower, upper):
    """Clip the command of a voltage driver."""
    if model.drive == 'voltage':
        model.map_command(lambda command: command.clip(lower, upper))


EFFECT = Effect(
    'amplifier_saturation', 'drive',
    'The driver clips voltages beyond its rails.',
    (
        Parameter('lower', 'V', -math.inf, -1000.0, 50.0, 0.0, 'lowest voltage'),
        Parameter('upper', 'V', math.inf, 1.0, 2000.0, 75.0, 'highest voltage', scale='log'),
    ),
    apply, channels=('voltage', 'charge', 'displacement'),
    # A soft knee stops short near the top, as what is behind it might.
    form_like=('contact', 'stiffness_hardening', 'asymmetric_hysteresis'))
