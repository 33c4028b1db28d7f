# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Dry friction of a guide: an elasto-slip element on the displacement.

    F = -clip(F_prev + sigma dx, +-coulomb_force),     sigma = coulomb_force/presliding

The same operator as Eqs. 3 and 4, in displacement.  Position lags the charge at
every reversal, whatever the speed.

Look-alikes: the stack's own hysteresis (opens v-q, friction opens q-x).
Source: Dahl 1968; cross-roller guides 1 to 20 N, flexures next to none.
"""

from piezo_stack_sim.effects.base import Effect, Parameter


def apply(model, coulomb_force, presliding):
    """Add the element between the moving end and ground."""
    model.friction_force += coulomb_force
    model.friction_stiffness = model.friction_force / presliding


EFFECT = Effect(
    'friction', 'mechanical',
    'A guide rubs: the position sticks at each reversal, whatever the speed.',
    (
        Parameter('coulomb_force', 'N', 0.0, 0.0, 50.0, 5.0, 'force while sliding',
                  runtime=False),
        Parameter('presliding', 'm', 5e-8, 1e-9, 2e-6, 5e-8,
                  'displacement before it slides', scale='log', magnitude=False, default=5e-8,
                  runtime=False, tries=(5e-8, 5e-9)),
    ),
    apply, channels=('charge', 'displacement'),
    # Real friction depends on the speed.
    form_like=('rate_dependent_hysteresis',))
