# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The rails of the driver.

    v = clip(u, lower, upper),      or softly      v = upper - knee ln(1 + exp((upper - u)/knee))

and likewise at the lower rail.  Flat tops at the same voltage, whatever came before; an output
stage has less to give already ``knee`` before its rail.

Look-alikes: ``contact`` (the voltage goes on), ``asymmetric_hysteresis``.
Source: data sheets; PI E-500 -20 to 120 V, Thorlabs MDT693 0 to 75, 100 or 150 V.  How wide
the knee is, is an engineering estimate.
"""

import math

import numpy as np
from piezo_stack_sim.effects.base import Effect, Parameter

SHARP = 1e-3  # V; a knee so narrow is none


def apply(model, lower, upper, knee):
    """Clip the command of a voltage driver."""
    if model.drive != 'voltage':
        return
    if knee < SHARP:
        model.map_command(lambda command: command.clip(lower, upper))
        return

    def clipped(command):
        if math.isfinite(upper):
            command = upper - knee * np.logaddexp(0.0, (upper - command) / knee)
        if math.isfinite(lower):
            command = lower + knee * np.logaddexp(0.0, (command - lower) / knee)
        return command

    model.map_command(clipped)


EFFECT = Effect(
    'amplifier_saturation', 'drive',
    'The driver clips voltages beyond its rails.',
    (
        Parameter('lower', 'V', -math.inf, -1000.0, 50.0, 0.0, 'lowest voltage'),
        Parameter('upper', 'V', math.inf, 1.0, 2000.0, 75.0, 'highest voltage', scale='log'),
        Parameter('knee', 'V', 0.0, 0.0, 10.0, 0.5, 'width in which the rails are met',
                  magnitude=False, tries=(0.5,)),
    ),
    apply, channels=('voltage', 'charge', 'displacement'),
    # A knee of another shape bends the line of the driver below its rail.
    form_like=('amplifier_gain',))
