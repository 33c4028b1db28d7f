# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Slow polarisation of the ceramic: charge and displacement creep together.

Maxwell dashpot branches in series with the Maxwell capacitor's voltage, one per
decade of time, with g_i the part of the charge that branch i has forgotten:

    v_creep = sum_i K_c (q - g_i) - K_c N_ref q,     dg_i/dt = (q - g_i) / tau_i

N_ref = sum_i exp(-reference_time/tau_i) counts the slower branches: so long
after a step the stack is where the nominal curve says.  One decade adds
gamma = K_c / (dv/dq), with dv/dq the elastance of the stack at large signals.

Look-alikes: ``thermal_drift``, ``sensor_drift`` (no charge), ``mount_creep``
(less charge), ``leakage`` (charge alone).
Source: Croft, Shed and Devasia 2001, Kuhnen 2003; 1 to 2 % a decade: PI.
"""

import math

from piezo_stack_sim.effects.base import Effect, Parameter

SHORTEST = 1e-3  # s; six decades
LONGEST = 1e3  # s


def apply(model, gain_per_decade, reference_time):
    """Add one branch per decade of time."""
    k_c = gain_per_decade * model.reference.elastance
    for i in range(round(math.log10(LONGEST / SHORTEST)) + 1):
        tau = SHORTEST * 10.0 ** i
        name = f'creep_{i}'
        model.add_state(name, {'charge': 1.0 / tau, name: -1.0 / tau})
        slow = math.exp(-reference_time / tau)
        model.add_opposing_voltage({'charge': k_c * (1.0 - slow), name: -k_c})


EFFECT = Effect(
    'creep', 'electrical',
    'Charge and displacement go on growing with the logarithm of time after a change.',
    (
        Parameter('gain_per_decade', '1', 0.0, -0.005, 0.08, 0.015,
                  'part of the stroke that each decade of time adds', runtime=False),
        Parameter('reference_time', 's', 0.1, 1e-3, 10.0, 0.1,
                  'time after which the nominal curve holds', scale='log', magnitude=False,
                  default=0.1, runtime=False, tries=(0.1,)),
    ),
    apply, channels=('charge', 'displacement'), shown_in='hold')
