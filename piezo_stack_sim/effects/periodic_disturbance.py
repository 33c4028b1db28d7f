# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Mains hum, floor vibration, a pump: a line at a fixed frequency, perhaps with its second harmonic.

    x_read = x + displacement sin(2 pi frequency t + phase)
               + harmonic sin(4 pi frequency t + harmonic_phase)
    F      = F_ext + force sin(2 pi frequency t + phase),     t since the start

Not caused by the command, so that it shows at rest as well.

Look-alikes: ``mechanical_resonance`` (rings only when driven).
Source: 1 to 50 nm of hum on a position sensor, engineering estimate.
"""

import math

import numpy as np

from piezo_stack_sim.effects.base import Effect, Parameter


def apply(model, displacement, force, frequency, phase, harmonic, harmonic_phase):
    """Add the line to the reading, and to the force as a swinging pair of states."""
    omega = 2.0 * math.pi * frequency
    if displacement != 0.0 or harmonic != 0.0:
        model.map_reading(lambda reading, time: (
            reading + displacement * np.sin(omega * time + phase)
            + harmonic * np.sin(2.0 * omega * time + harmonic_phase)))
    if force != 0.0:
        model.add_state('disturbance_sine', {'disturbance_cosine': omega}, math.sin(phase))
        model.add_state('disturbance_cosine', {'disturbance_sine': -omega}, math.cos(phase))
        model.add_force({'disturbance_sine': force})
        model.slow_rates.append(omega)


EFFECT = Effect(
    'periodic_disturbance', 'environment',
    'Hum or vibration shakes the reading, or the stack, at one frequency.',
    (
        Parameter('displacement', 'm', 0.0, 0.0, 1e-5, 2e-8, 'amplitude as it is read'),
        Parameter('force', 'N', 0.0, 0.0, 1e3, 0.0, 'amplitude of the force on the moving end',
                  runtime=False),
        Parameter('frequency', 'Hz', 50.0, 0.01, 1e4, 50.0, 'frequency of the line', scale='log',
                  magnitude=False, default=50.0, runtime=False),
        Parameter('phase', 'rad', 0.0, -math.pi, math.pi, 0.0, 'phase at the start',
                  magnitude=False, default=0.0, runtime=False),
        Parameter('harmonic', 'm', 0.0, 0.0, 1e-5, 0.0,
                  'amplitude of the second harmonic as it is read', runtime=False),
        Parameter('harmonic_phase', 'rad', 0.0, -math.pi, math.pi, 0.0,
                  'phase of the second harmonic at the start', magnitude=False, default=0.0,
                  runtime=False),
    ),
    apply, channels=('displacement',), each_time='phase')
