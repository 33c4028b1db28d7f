# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A mode of the structure between the stack and the point that is read.

    y'' = omega^2 (x - y) - 2 damping_ratio omega y',    x_read = x + participation (y - x)

The general second-order correction of a reading: unchanged for slow motion, with
a peak of participation/(2 damping_ratio) at ``frequency``.  What swings is light
against the stack: charge and voltage stay.

Look-alikes: ``added_mass`` (moves the stack's own frequency, and the charge).
Source: modal superposition; stages 0.2 to 5 kHz with Q of 10 to 50, estimate.
"""

import math

from piezo_stack_sim.effects.base import Effect, Parameter


def apply(model, participation, frequency, damping_ratio):
    """Let part of the reading swing."""
    omega = 2.0 * math.pi * frequency
    motion = dict(model.reading_terms)
    model.add_state('mode_position', {'mode_velocity': 1.0})
    model.add_state('mode_velocity', {
        **{source: gain * omega ** 2 for source, gain in motion.items()},
        'mode_position': -omega ** 2, 'mode_velocity': -2.0 * damping_ratio * omega})
    model.add_reading({source: -participation * gain for source, gain in motion.items()})
    model.add_reading({'mode_position': participation})
    # It follows the stack and never acts on it: exact in every step, however long.
    model.fast_rates.append(omega)


def answer(participation, frequency, damping_ratio):
    """Return the transfer function from the displacement to what is added to the reading."""
    omega = 2.0 * math.pi * frequency
    loss = 2.0 * damping_ratio * omega
    return (-participation, -participation * loss, 0.0), (1.0, loss, omega ** 2)


EFFECT = Effect(
    'mechanical_resonance', 'mechanical',
    'The structure swings at a frequency of its own between the stack and the sensor.',
    (
        Parameter('participation', '1', 0.0, -1.0, 1.0, 0.3, 'part of the reading that swings'),
        Parameter('frequency', 'Hz', 2500.0, 50.0, 5e4, 2500.0, 'natural frequency',
                  scale='log', magnitude=False, default=2500.0),
        Parameter('damping_ratio', '1', 0.03, 0.002, 0.3, 0.03, 'damping ratio, Q = 1/(2 zeta)',
                  scale='log', magnitude=False, default=0.03),
    ),
    apply, channels=('displacement',), answer=answer)
