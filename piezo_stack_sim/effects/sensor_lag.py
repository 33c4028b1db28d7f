# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The bandwidth of the position sensor.

    time_constant dx_1/dt = x - x_1,      second_time_constant dx_m/dt = x_1 - x_m

A sensor head and the filter of its electronics are two poles.  The q-x loop opens in
proportion with the frequency while u, v and q agree.

Look-alikes: ``sensor_delay`` (its gain stays), ``amplifier_bandwidth`` (opens
u-v).
Source: piezosystem jena, capacitive up to 1 kHz, strain gauge 5 kHz.
"""

from piezo_stack_sim.effects.base import Effect, Parameter


def apply(model, time_constant, second_time_constant):
    """Read through a lag, and what filters its output."""
    model.read_through('sensor', 1.0 / time_constant)
    if second_time_constant > 0.0:
        model.read_through('sensor_filter', 1.0 / second_time_constant)


EFFECT = Effect(
    'sensor_lag', 'sensor',
    'The position sensor is slow: fast motion reads late and too small.',
    (
        Parameter('time_constant', 's', 0.0, 0.0, 0.1, 1.6e-4,
                  'time constant; bandwidth is 1/(2 pi time_constant)'),
        Parameter('second_time_constant', 's', 0.0, 0.0, 0.1, 2e-5,
                  'of the filter behind, 0: none', magnitude=False, tries=(0.0,)),
    ),
    apply, channels=('displacement',),
    # A filter that overshoots is faster at first than two poles, as what swings after.
    form_like=('mechanical_resonance',))
