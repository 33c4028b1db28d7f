# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Glue, base and joints between the stack and where force and load act.

    x_read = x + compliance F_joint / (1 + stiffening |F_joint|)

The free stroke stays, the stiffness against external forces falls,
1/k' = 1/k + compliance.  A load mass then swings on the joint by itself.  Rough or
bolted faces close under load: their tangent stiffness grows, and no more than
``compliance / stiffening`` of way is left in them.  That is read where the force acts; the
swing of a load is that of the unloaded joint.

Look-alikes: a softer stack (the free response changes too), which a joint of less
than a few per cent of its compliance is, unless it stiffens.
Source: joints of 100 to 500 N/um, engineering estimate; hyperbolic closure of a
joint: Bandis, Lumsden and Barton, Int. J. Rock Mech. Min. Sci. 20 (1983) 249.
"""

import numpy as np
from piezo_stack_sim.effects.base import Effect, Parameter

RIGID = 1e-12  # m/N; 1 nm at 1000 N, and stiffer than any joint


def apply(model, compliance, stiffening):
    """Put the joint between stack and load."""
    if compliance <= RIGID:
        return
    model.series_compliance += compliance

    def closed(force):
        closing = stiffening * np.abs(force)
        return -compliance * force * closing / (1.0 + closing)

    if stiffening > 0.0:
        model.map_joint(closed)


EFFECT = Effect(
    'series_compliance', 'mechanical',
    'A soft joint sits between the stack and the point where forces act and position is read.',
    (
        Parameter('compliance', 'm/N', 0.0, 0.0, 1e-6, 5e-9, 'compliance of the joint',
                  runtime=False),
        Parameter('stiffening', '1/N', 0.0, 0.0, 1.0, 0.01,
                  'by how much its stiffness grows with the force at first, against that of no '
                  'force', magnitude=False, runtime=False, tries=(0.0, 0.02)),
    ),
    apply, channels=('charge', 'displacement'))
