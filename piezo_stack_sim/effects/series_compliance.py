# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Glue, base and joints between the stack and where force and load act.

    x_read = x + compliance F_joint

The free stroke stays, the stiffness against external forces falls,
1/k' = 1/k + compliance.  A load mass then swings on the joint by itself.

Look-alikes: a softer stack (the free response changes too).
Source: joints of 100 to 500 N/um, engineering estimate.
"""

from piezo_stack_sim.effects.base import Effect, Parameter

RIGID = 1e-12  # m/N; 1 nm at 1000 N, and stiffer than any joint


def apply(model, compliance):
    """Put the joint between stack and load."""
    if compliance > RIGID:
        model.series_compliance += compliance


EFFECT = Effect(
    'series_compliance', 'mechanical',
    'A soft joint sits between the stack and the point where forces act and position is read.',
    (
        Parameter('compliance', 'm/N', 0.0, 0.0, 1e-6, 5e-9, 'compliance of the joint',
                  runtime=False),
    ),
    apply, channels=('charge', 'displacement'))
