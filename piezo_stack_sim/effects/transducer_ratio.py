"""
An electromechanical ratio T off by more than its uncertainty: T (1 + ratio_error).

Partial depoling, ageing, temperature (EFFECTS.md 2C T2, T5, T7).  Both
directions change (Eqs. 11, 14): x per charge, and charge per external force.
"""

from piezo_stack_sim.effects.base import Effect, Parameter


def apply(model, ratio_error):
    """Scale the ratio."""
    model.T *= 1.0 + ratio_error


EFFECT = Effect(
    'transducer_ratio', 'transducer',
    'The ratio of force to voltage, and of charge to displacement, is off.',
    (
        Parameter('ratio_error', '1', 0.0, -0.5, 0.5, 0.05, 'relative error of the ratio',
                  runtime=False),
    ),
    apply, channels=('charge', 'displacement'))
