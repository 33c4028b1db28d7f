# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A viscoelastic mount: glue and polymer beside the stack yield with time.

Maxwell branches parallel to k, one per decade, driven by the displacement, with
y_i the part that branch i has forgotten:

    F = -sum_i k_c (x - y_i) + k_c N_ref x,     dy_i/dt = (x - y_i) / tau_i

N_ref = sum_i exp(-0.1 s/tau_i) counts the slower branches: 0.1 s after a step the
nominal curve holds.  One decade adds gamma = k_c / k_s of the stroke, k_s the
stiffness with leads shorted at large signals.  The charge does not cause it and
follows only as the motion draws it (Eq. 11).

Look-alikes: ``creep`` (x/q stays, here it changes), ``thermal_drift`` (no charge).
Source: generalised Maxwell solid; 0.1 to 1 % for epoxy joints, estimate.
"""

import math

from piezo_stack_sim.effects.base import Effect, Parameter

TIMES = (0.01, 0.1, 1.0, 10.0, 100.0)  # s
REFERENCE_TIME = 0.1  # s


def apply(model, gain_per_decade):
    """Add the branches to the force balance."""
    k_c = gain_per_decade * model.reference.stiffness
    for i, tau in enumerate(TIMES):
        name = f'mount_{i}'
        model.add_state(name, {'displacement': 1.0 / tau, name: -1.0 / tau})
        slow = math.exp(-REFERENCE_TIME / tau)
        model.add_force({'displacement': -k_c * (1.0 - slow), name: k_c})


EFFECT = Effect(
    'mount_creep', 'mechanical',
    'The mount yields with the logarithm of time: displacement creeps more than charge.',
    (
        Parameter('gain_per_decade', '1', 0.0, -0.005, 0.08, 0.01,
                  'part of the stroke that each decade of time adds'),
    ),
    apply, channels=('charge', 'displacement'), shown_in='hold')
