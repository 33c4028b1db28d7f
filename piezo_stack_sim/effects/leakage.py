# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Charge that passes through the insulation.

    dq_leak/dt = v / resistance

The driver delivers it, so a charge meter on the leads counts it, though the
stack does not hold it.  With charge given or the leads open the stack loses it,
with a time constant of resistance times capacitance.

Look-alikes: ``creep`` (displacement creeps too); the drift of a charge amplifier
(does not follow the voltage).
Source: TOKIN catalogue, at least 10 to 50 megohm; dry ceramic reaches a gigohm.
"""

import math

from piezo_stack_sim.effects.base import Effect, Parameter


def apply(model, resistance):
    """Count the leaked charge in the reading, and take it from a given charge."""
    model.add_state('leaked', {'voltage': 1.0 / resistance})
    model.add_charge_reading({'leaked': 1.0})
    model.lose_charge({'leaked': 1.0})


EFFECT = Effect(
    'leakage', 'electrical',
    'Charge flows through the insulation: the measured charge drifts, open leads lose it.',
    (
        Parameter('resistance', 'ohm', math.inf, 1e4, 1e13, 1e8, 'insulation resistance',
                  scale='log'),
    ),
    apply, channels=('charge',))
