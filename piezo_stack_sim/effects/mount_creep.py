# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A viscoelastic mount: glue and polymer beside the stack yield with time.

Maxwell branches parallel to k, one per decade, driven by the displacement, with
y_i the part that branch i has forgotten:

    F = -sum_i k_i (x - y_i) + N_ref x,             dy_i/dt = (x - y_i) / tau_i
    k_i = k_c (tau_i/reference_time)^-power,        tau_i = onset 10^i

N_ref = sum_i k_i exp(-reference_time/tau_i) is what the slower branches hold: so
long after a step the nominal curve holds.  From there one decade adds
gamma = k_c / k_s of the stroke, k_s the stiffness with leads shorted at large
signals; the later ones add less if it yields with a power of time and not with
its logarithm.  The charge does not cause it and follows only as the motion draws
it (Eq. 11).

Look-alikes: ``creep`` (x/q stays, here it changes), ``thermal_drift`` (no charge).
Source: generalised Maxwell solid, power law of polymers (Findley); 0.1 to 1 % for
epoxy joints, estimate.
"""

import math

from piezo_stack_sim.effects.base import Effect, Parameter

DECADES = 5


def apply(model, gain_per_decade, power, onset, reference_time):
    """Add the branches to the force balance."""
    k_c = gain_per_decade * model.reference.stiffness
    for i in range(DECADES):
        tau = onset * 10.0 ** i
        name = f'mount_{i}'
        model.add_state(name, {'displacement': 1.0 / tau, name: -1.0 / tau})
        k_i = k_c * (tau / reference_time) ** -power
        slow = math.exp(-reference_time / tau)
        model.add_force({'displacement': -k_i * (1.0 - slow), name: k_i})


EFFECT = Effect(
    'mount_creep', 'mechanical',
    'The mount yields with the logarithm of time: displacement creeps more than charge.',
    (
        Parameter('gain_per_decade', '1', 0.0, -0.005, 0.3, 0.01,
                  'part of the stroke that a decade of time adds'),
        Parameter('power', '1', 0.0, -0.1, 0.3, 0.05, 'of time with which it yields; 0: logarithm',
                  magnitude=False, default=0.0, tries=(0.0,)),
        Parameter('onset', 's', 0.01, 1e-3, 0.1, 0.01, 'shortest time in which it yields',
                  scale='log', magnitude=False, default=0.01, tries=(0.01,)),
        Parameter('reference_time', 's', 0.1, 1e-2, 10.0, 0.1,
                  'time after which the nominal curve holds', scale='log', magnitude=False,
                  default=0.1, tries=(0.1,)),
    ),
    apply, channels=('charge', 'displacement'), shown_in='hold',
    form_like=('rate_dependent_hysteresis',))
