# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Effects that neither the library of the diagnosis has nor any of its rules was made for.

What the diagnosis is taught of an effect that it lacks (``foreign.py``) from the devices of one
batch helps on the next, and says nothing about what nobody thought of. These are kept for asking
that: nothing is to be learned from them.

"""

from piezo_stack_sim.challenge.hidden import log, of_stroke, of_top, register, whole

UNFORESEEN: dict = {}

ALL = 'voltage charge displacement'
BOTH = 'charge displacement'


@register(UNFORESEEN, 'drive', 'a class B output that must cross over', ALL,
          voltage=log(0.02, 1.0), current=log(1e-4, 1e-3))
def crossover(unit, voltage, current):
    return unit.change(stack={'crossover_voltage': voltage, 'crossover_current': current})


@register(UNFORESEEN, 'electrical', 'discharges past the ceramic, at random, when the voltage is '
          'high', 'charge', needs=('charge',), charge=log(1e-8, 5e-7), above=of_top(0.5, 0.8),
          rate=log(3.0, 60.0), seed=whole(1 << 30))
def discharges(unit, charge, above, rate, seed):
    return unit.change(sensing={'discharge': charge, 'discharge_above': above,
                                'discharge_rate': rate, 'seed': seed})


@register(UNFORESEEN, 'mechanical', 'a disc spring that yields beyond a place', BOTH,
          stiffness=log(2e4, 2e6), place=of_stroke(0.3, 0.7), width=of_stroke(0.03, 0.1))
def yielding_spring(unit, stiffness, place, width):
    return unit.change(stack={'yielding_stiffness': stiffness, 'yielding_place': place,
                              'yielding_width': width})


@register(UNFORESEEN, 'environment', 'a machine nearby that runs up', 'displacement',
          size=log(2e-9, 2e-7), low=log(8.0, 40.0), high=log(60.0, 400.0))
def run_up(unit, size, low, high):
    return unit.change(sensing={'run_up': size, 'run_up_from': low, 'run_up_to': high})


@register(UNFORESEEN, 'sensor', 'a displacement that is read in coarse steps', 'displacement',
          step=log(5e-9, 4e-7))
def coarse_reading(unit, step):
    return unit.change(sensing={'reading_step': step})


@register(UNFORESEEN, 'sensor', 'a reading that ends, softly, before the stroke does',
          'displacement', level=of_stroke(0.6, 0.97), knee=of_stroke(0.003, 0.03))
def clipped_reading(unit, level, knee):
    return unit.change(sensing={'clipping': level, 'clipping_knee': knee})
