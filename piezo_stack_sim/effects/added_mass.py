"""
Mass that moves with the stack and was forgotten: m + mass (Eq. 15).

Lowers the natural frequency by sqrt(m/(m + mass)) (EFFECTS.md 2D M2: 50 g on
this stack gives 4 to 5 kHz); nothing changes for slow motion.
"""

from piezo_stack_sim.effects.base import Effect, Parameter


def apply(model, mass):
    """Add to the moving mass."""
    model.m += mass


EFFECT = Effect(
    'added_mass', 'mechanical',
    'More mass moves than the model knows: slower ringing, more overshoot.',
    (
        Parameter('mass', 'kg', 0.0, 0.0, 10.0, 0.05, 'additional moving mass'),
    ),
    apply, channels=('charge', 'displacement'))
