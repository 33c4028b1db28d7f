# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Modes of the structure between the stack and the point that is read.

    y_i'' = omega_i^2 (x - y_i) - 2 damping_ratio_i omega_i y_i',
    x_read = x + sum_i participation_i (y_i - x)

The general second-order correction of a reading: unchanged for slow motion, with
a peak of participation/(2 damping_ratio) at ``frequency``.  What swings is light
against the stack: charge and voltage stay.  A stage seldom has one mode only: the
``second`` one is there where its participation is not 0.

Look-alikes: ``added_mass`` (moves the stack's own frequency, and the charge).
Source: modal superposition; stages 0.2 to 5 kHz with Q of 10 to 50, estimate.
"""

import math

from piezo_stack_sim.effects.base import Effect, Parameter


def apply(model, participation, frequency, damping_ratio, second_participation, second_frequency,
          second_damping_ratio):
    """Let part of the reading swing."""
    motion = dict(model.reading_terms)
    swings = [('mode', participation, frequency, damping_ratio)]
    if second_participation != 0.0:
        swings.append(('second_mode', second_participation, second_frequency,
                       second_damping_ratio))
    for name, part, natural, ratio in swings:
        omega = 2.0 * math.pi * natural
        position, velocity = f'{name}_position', f'{name}_velocity'
        model.add_state(position, {velocity: 1.0})
        model.add_state(velocity, {
            **{source: gain * omega ** 2 for source, gain in motion.items()},
            position: -omega ** 2, velocity: -2.0 * ratio * omega})
        model.add_reading({source: -part * gain for source, gain in motion.items()})
        model.add_reading({position: part})
        # It follows the stack and never acts on it: exact in every step, however long.
        model.fast_rates.append(omega)


def answer(participation, frequency, damping_ratio):
    """Return the transfer function of one mode, from the displacement to what is added to it."""
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
        Parameter('second_participation', '1', 0.0, -1.0, 1.0, 0.0,
                  'part of the reading that swings in a second mode, 0: none', late=True),
        Parameter('second_frequency', 'Hz', 5000.0, 50.0, 5e4, 5000.0, 'its natural frequency',
                  scale='log', magnitude=False, late=True),
        Parameter('second_damping_ratio', '1', 0.03, 0.002, 0.3, 0.03, 'its damping ratio',
                  scale='log', magnitude=False, late=True),
    ),
    apply, channels=('displacement',), answer=answer)
