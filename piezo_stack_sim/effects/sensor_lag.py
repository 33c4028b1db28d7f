# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The bandwidth of the position sensor.

    (1 + (1 - second) time_constant s) (1 + second time_constant s) x_m = x

with s the derivative by time: one pole, or two of which the second is quicker.
The q-x loop opens in proportion with the frequency while u, v and q agree.

Look-alikes: ``sensor_delay`` (its gain stays), ``amplifier_bandwidth`` (opens
u-v).
Source: n poles; piezosystem jena, capacitive up to 1 kHz, strain gauge 5 kHz.
"""

from piezo_stack_sim.effects.base import Effect, Parameter

INSTANT = 1e-9  # s; a quicker pole is none


def apply(model, time_constant, second):
    """Read through one lag of first order, or two in a row."""
    if second > 0.0:
        model.read_through('sensor_filter', 1.0 / max(second * time_constant, INSTANT))
    model.read_through('sensor', 1.0 / ((1.0 - second) * time_constant))


EFFECT = Effect(
    'sensor_lag', 'sensor',
    'The position sensor is slow: fast motion reads late and too small.',
    (
        Parameter('time_constant', 's', 0.0, 0.0, 0.1, 1.6e-4,
                  'sum of the time constants; of a single pole the bandwidth is '
                  '1/(2 pi time_constant)'),
        Parameter('second', '1', 0.0, 0.0, 0.5, 0.2, 'share of a second pole in that',
                  magnitude=False, runtime=False),
    ),
    apply, channels=('displacement',))
