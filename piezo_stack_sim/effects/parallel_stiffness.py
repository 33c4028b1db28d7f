"""
A preload spring or flexure that the stack must stretch: k + stiffness (Eq. 15).

Stroke falls to k_s/(k_s + stiffness) (EFFECTS.md 2D M4: -9 % for 5 N/um).
"""

from piezo_stack_sim.effects.base import Effect, Parameter


def apply(model, stiffness):
    """Add a spring to ground."""
    model.k += stiffness


EFFECT = Effect(
    'parallel_stiffness', 'mechanical',
    'A spring beside the stack takes part of its stroke.',
    (
        Parameter('stiffness', 'N/m', 0.0, 0.0, 1e9, 5e6, 'stiffness of the spring'),
    ),
    apply, channels=('charge', 'displacement'))
