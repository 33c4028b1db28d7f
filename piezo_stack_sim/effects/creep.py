# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Slow polarisation of the ceramic: charge and displacement creep together.

Kelvin-Voigt branches, one per decade of time up to 1000 s.  The charge that has passed the
Maxwell elements at once, q_m, is followed by a part that passes none of them:

    q = q_m + sum_i gamma_i (g_i - N_i q_m),      dg_i/dt = (q_m - g_i) / tau_i
    gamma_i = gamma (tau_i/reference_time)^-power,      tau_i = onset 10^i

N_i = 1 - exp(-reference_time/tau_i): so long after a step the stack is where the
nominal curve says.  Each decade adds gamma = ``gain_per_decade`` of the stroke.

Look-alikes: ``thermal_drift``, ``sensor_drift`` (no charge), ``mount_creep``
(less charge), ``leakage`` (charge alone).
Source: Croft, Shed and Devasia 2001, Kuhnen 2003; 1 to 2 % a decade: PI.
"""

import math

from piezo_stack_sim.effects.base import Effect, Parameter

DECADES = 7
LONGEST = 1e3  # s; what is slower is lost in rounding at the rate of a node


def apply(model, gain_per_decade, reference_time, onset, power):
    """Add one branch per decade of time."""
    for i in range(DECADES):
        tau = onset * 10.0 ** i
        # One branch the fewer, a decade later: it goes little by little.
        part = min(1.0 - math.log10(tau / LONGEST), 1.0)
        if part <= 0.0:
            break
        tau = min(tau, LONGEST)
        name = f'creep_{i}'
        model.add_state(name, {'charge': 1.0 / tau, name: -1.0 / tau})
        quick = 1.0 - math.exp(-reference_time / tau)
        gain = part * gain_per_decade * (tau / reference_time) ** -power
        model.add_charge({'charge': -gain * quick, name: gain})


EFFECT = Effect(
    'creep', 'electrical',
    'Charge and displacement go on growing with the logarithm of time after a change.',
    (
        Parameter('gain_per_decade', '1', 0.0, -0.005, 0.08, 0.015,
                  'part of the stroke that each decade of time adds', runtime=False),
        Parameter('reference_time', 's', 0.1, 1e-3, 10.0, 0.1,
                  'time after which the nominal curve holds', scale='log', magnitude=False,
                  default=0.1, runtime=False, tries=(0.1,)),
        Parameter('onset', 's', 1e-3, 1e-3, 0.1, 1e-3, 'shortest time in which it creeps',
                  scale='log', magnitude=False, runtime=False, tries=(1e-3, 1e-2)),
        Parameter('power', '1', 0.0, -0.2, 0.3, 0.0, 'of time with which it slows; 0: logarithm',
                  magnitude=False, runtime=False),
    ),
    apply, channels=('charge', 'displacement'), shown_in='hold')
