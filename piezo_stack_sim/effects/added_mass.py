# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Mass that moves with the stack and was forgotten.

    (m + mass) x'' + ...,  Eq. 15

Lowers the natural frequency by sqrt(m/(m + mass)); slow motion stays.

Look-alikes: ``series_compliance``, a softer stack: a known mass added on purpose
tells them apart.
Source: Eq. 15; stages weigh 10 g to 1 kg.
"""

from piezo_stack_sim.effects.base import Effect, Parameter


def apply(model, mass):
    """Add to the moving mass."""
    model.m += mass


EFFECT = Effect(
    'added_mass', 'mechanical',
    'More mass moves than the model knows: slower ringing, more overshoot.',
    (
        Parameter('mass', 'kg', 0.0, 0.0, 10.0, 0.05, 'additional moving mass',
                  # It moves a resonance, and a resonance is found only from close by.
                  tries=tuple(5e-4 * 1.23 ** i for i in range(40))),
    ),
    apply, channels=('charge', 'displacement'),
    # A payload on a joint comes late.
    form_like=('command_delay', 'amplifier_bandwidth', 'sensor_lag', 'sensor_delay',
               'rate_dependent_hysteresis'))
