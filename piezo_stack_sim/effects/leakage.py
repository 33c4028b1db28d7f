"""
Charge that passes through the insulation: dq_leak/dt = v / R.

The driver delivers it, so a charge meter on the leads counts it, though the
stack does not hold it.  With charge given or the leads open the stack loses it
(time constant R C), EFFECTS.md 2A E3: catalogue insulation 10 to 50 megohm at
least, dry ceramic a gigohm.
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
