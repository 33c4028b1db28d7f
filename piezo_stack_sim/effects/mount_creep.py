# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A viscoelastic mount: glue and polymer beside the stack yield with time.

Maxwell branches parallel to k, two per decade, driven by the displacement, with
y_i the part that branch i has forgotten:

    F = -sum_i k_i (x - y_i) + N_ref x,             dy_i/dt = (x - y_i) / tau_i
    k_i = k_c/2 (tau_i/reference_time)^-power exp(-onset/tau_i)
    tau_i = onset 10^((i - 1)/2)

Together they relax as (1 + t/onset)^-power, Williams' modified power law, of which
these are the spectrum: hardly before ``onset``, and with the logarithm of time if
power is 0.  N_ref = sum_i k_i exp(-reference_time/tau_i) is what the slower branches
hold: so long after a step the nominal curve holds.  From there one decade adds
gamma = k_c / k_s of the stroke, k_s the stiffness with leads shorted at large
signals.  The charge does not cause it and follows only as the motion draws it
(Eq. 11).

Look-alikes: ``creep`` (x/q stays, here it changes), ``thermal_drift`` (no charge).
Source: generalised Maxwell solid; Williams, Structural Analysis of Viscoelastic
Materials, AIAA J. 2 (1964); power law of polymers (Findley); 0.1 to 1 % for
epoxy joints, estimate.
"""

import math

from piezo_stack_sim.effects.base import Effect, Parameter

BRANCHES, DENSITY = 13, 2  # and how many of them a decade has: one leaves ripples of 1 %


def apply(model, gain_per_decade, power, onset, reference_time):
    """Add the branches to the force balance."""
    k_c = gain_per_decade * model.reference.stiffness / DENSITY
    for i in range(BRANCHES):
        tau = onset * 10.0 ** ((i - 1) / DENSITY)
        name = f'mount_{i}'
        model.add_state(name, {'displacement': 1.0 / tau, name: -1.0 / tau})
        k_i = k_c * (tau / reference_time) ** -power * math.exp(-onset / tau)
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
        Parameter('onset', 's', 3e-3, 2e-4, 0.05, 3e-3, 'time before which it hardly yields',
                  scale='log', magnitude=False, default=3e-3, tries=(3e-3,)),
        Parameter('reference_time', 's', 0.1, 1e-2, 10.0, 0.1,
                  'time after which the nominal curve holds', scale='log', magnitude=False,
                  default=0.1, tries=(0.1,)),
    ),
    apply, channels=('charge', 'displacement'), shown_in='hold',
    form_like=('rate_dependent_hysteresis',))
