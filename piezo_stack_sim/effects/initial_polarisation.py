# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A stack that was not relaxed when the recording began.

It had been led slowly to a voltage, perhaps back and forth once more, and to zero (or
to the voltage at which the recording begins), and the sensors were zeroed there: the
blocks of Eq. 16 start where that left them, or where they have crept back to in the meantime.
The first cycle differs, later ones close on it.

Look-alikes: ``creep`` and drifts (they go on after the first full cycle).
Source: recomputed from Tables 1 and 2, 2.2 um remain after 90 V.
"""

from piezo_stack_sim.effects.base import Effect, Parameter

ELEMENTS = 10  # of Table 2


def apply(model, peak_voltage, turn_voltage, return_voltage, **strains):
    """Start from the remanence of earlier voltages, at most those of the full range."""
    full = model.reference.voltage
    model.previous_voltages = tuple(max(-full, min(volt, full))
                                    for volt in (peak_voltage, turn_voltage, return_voltage))
    model.strains = tuple(strains[f'strain_{i + 1}'] for i in range(ELEMENTS))


EFFECT = Effect(
    'initial_polarisation', 'electrical',
    'The stack was used before: it starts with remanent polarisation, the sensors zeroed there.',
    (
        Parameter('peak_voltage', 'V', 0.0, -200.0, 200.0, 90.0,
                  'voltage it had been led to before and back; beyond the range the range counts',
                  runtime=False, tries=(-15.0, -5.0, *(1.4 ** i for i in range(15)))),
        Parameter('turn_voltage', 'V', 0.0, -200.0, 200.0, 0.0,
                  'voltage at which it turned once more on the way back to zero', runtime=False,
                  tries=(0.0,)),
        Parameter('return_voltage', 'V', 0.0, -200.0, 200.0, 0.0,
                  'voltage to which it returned after that before it came to zero',
                  runtime=False, tries=(0.0,)),
        *(Parameter(f'strain_{i + 1}', '1', 0.0, -1.0, 1.0, 0.0,
                    'voltage of the element of that number as a part of its break voltage, if '
                    'known; then the voltages above do not count, and 0 is one that never slipped',
                    runtime=False, late=True)
          for i in range(ELEMENTS)),
    ),
    apply, channels=('charge', 'displacement'), swings=True)
