# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Mass that moves with the stack and was forgotten.

    (m + mass) x'' + ...,  Eq. 15

Lowers the natural frequency by sqrt(m/(m + mass)); slow motion stays.  A payload is held by
something: on a joint it swings against the stack by itself, free of everything else with
``joint_frequency``, and is felt more, then less than a rigid one the faster it moves; from
200 kHz on it counts as rigid:

    mass y'' = F_joint,   (m + ...) x'' = ... - F_joint,
    F_joint = k_j (x - y) + c_j (x' - y'),   k_j = mu (2 pi joint_frequency)^2,
    c_j = 2 LOSS mu (2 pi joint_frequency),  mu = m mass/(m + mass)

Look-alikes: ``series_compliance``, a softer stack: a known mass added on purpose
tells them apart.
Source: Eq. 15; stages weigh 10 g to 1 kg; two masses on a spring, damping ratio of glued and
bolted joints 1 to 5 %, estimate.
"""

import math

from piezo_stack_sim.effects.base import Effect, Parameter

LOSS = 0.03  # damping ratio of the joint
STIFF = 2e5  # Hz; so fast a joint does not yield


def apply(model, mass, joint_frequency):
    """Add to the moving mass, at once or through a joint."""
    if mass <= 0.0 or joint_frequency >= STIFF:
        model.m += mass
        return
    reduced = model.m * mass / (model.m + mass)
    omega = 2.0 * math.pi * joint_frequency
    stiffness, damping = reduced * omega ** 2, 2.0 * LOSS * reduced * omega
    force = {'displacement': stiffness, 'velocity': damping,
             'payload_displacement': -stiffness, 'payload_velocity': -damping}
    model.add_state('payload_displacement', {'payload_velocity': 1.0})
    model.add_state('payload_velocity', {source: gain / mass for source, gain in force.items()})
    model.add_force({source: -gain for source, gain in force.items()})
    model.slow_rates.append(omega)


EFFECT = Effect(
    'added_mass', 'mechanical',
    'More mass moves than the model knows: slower ringing, more overshoot.',
    (
        Parameter('mass', 'kg', 0.0, 0.0, 10.0, 0.05, 'additional moving mass',
                  # It moves a resonance, and a resonance is found only from close by.
                  tries=tuple(5e-4 * 1.23 ** i for i in range(40))),
        Parameter('joint_frequency', 'Hz', math.inf, 1e4, STIFF, STIFF,
                  'at which it swings against the stack, both free; inf: rigid', scale='log',
                  magnitude=False, default=math.inf, runtime=False, tries=(6e4,)),
    ),
    apply, channels=('charge', 'displacement'),
    # A payload on a joint comes late.
    form_like=('command_delay', 'amplifier_bandwidth', 'sensor_lag', 'sensor_delay',
               'rate_dependent_hysteresis'))
