# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Losses of the ceramic that grow with the rate: the v-q loop opens with frequency.

A resistance inside the stack, and a ladder of fast dashpot branches that makes
the capacitance fall with the logarithm of the frequency:

    v = v_t + v_rc + R dq/dt + sum_i K_d (q - g_i),     dg_i/dt = (q - g_i) / tau_i

with K_d = dispersion * (dv/dq at large signals) and tau_i = 3 us ... 3 ms.  And
break voltages that grow with a power of the current: element i of Eq. 16 breaks at

    V_i (1 + growth (|dq/dt| / 10 mA)^exponent)

where the current is what has flowed of late (it fades with 0.25 ms), taken anew
whenever the command or the force changes.  The terminal voltage follows the
command: only what lies behind it is late.

Look-alikes: ``amplifier_bandwidth`` (u-v opens, v-q does not), damping and
``sensor_lag`` (q-x opens).
Source: complex permittivity, tan delta 0.015 to 0.2 (Noliac), C -1 to -3 % a
decade (engineering estimate); rate-dependent thresholds of play operators (Al
Janaideh), a power of the velocity (Prandtl-Ishlinskii with power-law damping).
"""

from piezo_stack_sim.effects.base import Effect, Parameter

TIMES = (3e-6, 3e-5, 3e-4, 3e-3)  # s; 50 Hz to 50 kHz


def apply(model, resistance, dispersion, growth, exponent):
    """Add the resistance and the ladder behind the terminals; let break voltages grow."""
    model.internal_resistance += resistance
    model.break_growth += growth
    model.break_growth_exponent = exponent
    if dispersion == 0.0:
        return
    k_d = dispersion * model.reference.elastance
    for i, tau in enumerate(TIMES):
        name = f'dispersion_{i}'
        model.add_state(name, {'charge': 1.0 / tau, name: -1.0 / tau})
        model.add_opposing_voltage({'charge': k_d, name: -k_d})
        model.fast_rates.append(1.0 / tau)


EFFECT = Effect(
    'rate_dependent_hysteresis', 'electrical',
    'The loop between voltage and charge widens with frequency.',
    (
        Parameter('resistance', 'ohm', 0.0, 0.0, 1e4, 10.0,
                  'resistance inside the stack, behind the terminals'),
        Parameter('dispersion', '1', 0.0, 0.0, 0.1, 0.01,
                  'part of the capacitance lost in each decade of frequency above 50 Hz',
                  runtime=False),
        Parameter('growth', '1', 0.0, 0.0, 0.3, 0.01,
                  'part by which break voltages have grown at 10 mA', runtime=False),
        Parameter('exponent', '1', 0.5, 0.2, 1.0, 0.5, 'of the current in that growth',
                  magnitude=False, default=0.5, runtime=False),
    ),
    apply, channels=('charge', 'displacement'))
