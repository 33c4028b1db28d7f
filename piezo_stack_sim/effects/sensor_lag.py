# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The bandwidth of the position sensor.

    (quality_factor time_constant)^2 x_m'' + time_constant x_m' + x_m = x

The general low pass of second order by its slow part: a ramp comes late by
``time_constant``, whatever the ``quality_factor``.  With 0 it has one pole, up to 0.5 two
real ones (a sensor head and the filter behind), then a pair that rings (0.577 Bessel, 0.707
Butterworth).  The q-x loop opens in proportion with the frequency while u, v and q agree.

Look-alikes: ``sensor_delay`` (its gain stays), ``amplifier_bandwidth`` (opens
u-v), ``mechanical_resonance`` (the reading is late below its peak by much less).
Source: piezosystem jena, capacitive up to 1 kHz, strain gauge 5 kHz.
"""

import cmath

from piezo_stack_sim.effects.base import Effect, Parameter


def apply(model, time_constant, quality_factor):
    """Read through a low pass."""
    if quality_factor < 1e-9:  # the square of less may be nothing to divide by
        model.read_through('sensor', 1.0 / time_constant)
        return
    # (Q T)^2 s^2 + T s + 1 = 0, by what does not cancel for small Q.
    root = cmath.sqrt(1.0 - 4.0 * quality_factor ** 2)
    slow = 2.0 / (time_constant * (1.0 + root))
    fast = (1.0 + root) / (2.0 * quality_factor ** 2 * time_constant)
    if root.imag:
        model.read_through_pair('sensor', slow)
        return
    model.read_through('sensor', slow.real)
    model.read_through('sensor_filter', fast.real)


EFFECT = Effect(
    'sensor_lag', 'sensor',
    'The position sensor is slow: fast motion reads late and too small.',
    (
        Parameter('time_constant', 's', 0.0, 0.0, 0.1, 1.6e-4,
                  'by which a ramp reads late; bandwidth of one pole is 1/(2 pi time_constant)'),
        Parameter('quality_factor', '1', 0.0, 0.0, 1.0, 0.0,
                  'of two poles, 0: one', magnitude=False, tries=(0.0, 0.6)),
    ),
    apply, channels=('displacement',),
    # A filter of higher order swings, too.
    form_like=('mechanical_resonance',))
