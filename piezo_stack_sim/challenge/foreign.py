# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Effects that the library of the diagnosis does not have: the right answer is UNKNOWN, there."""

from piezo_stack_sim.challenge.hidden import (
    either_sign, log, of_top, register, whole,
)

FOREIGN: dict = {}

ALL = 'voltage charge displacement'
BOTH = 'charge displacement'


@register(FOREIGN, 'drive', 'missing bits: the command in coarse steps', ALL,
          resolution=log(0.05, 0.8))
def command_resolution(unit, resolution):
    return unit.change(drive={'resolution': resolution})


@register(FOREIGN, 'drive', 'an output filter that rings', ALL, frequency=log(3e3, 1.2e4),
          damping=log(0.03, 0.2))
def amplifier_ringing(unit, frequency, damping):
    return unit.change(stack={'ringing_frequency': frequency, 'ringing_damping': damping})


@register(FOREIGN, 'drive', 'an offset that warms up', ALL, recordings=('steps',),
          offset=either_sign(1e-2, 1.0), time_constant=log(2.0, 10.0))
def amplifier_warm_up(unit, offset, time_constant):
    return unit.change(drive={'warm_up': offset, 'warm_up_time': time_constant})


@register(FOREIGN, 'electrical', 'a domain wall that jumps at one voltage, back at another', BOTH,
          charge=log(5e-8, 4e-6), jump=of_top(0.5, 0.85), back=of_top(0.1, 0.35))
def polarisation_relay(unit, charge, jump, back):
    return unit.change(stack={'relay_charge': charge, 'relay_on': jump, 'relay_off': back})


@register(FOREIGN, 'electrical', 'a sense capacitor in series that nobody mentioned', BOTH,
          lookalikes=('parallel_stiffness',), capacitance=log(2.5e-5, 2e-3))
def sense_capacitor(unit, capacitance):
    return unit.change(stack={'sense_elastance': 1.0 / capacitance})


@register(FOREIGN, 'transducer', 'a ratio that grows as the stack heats itself', BOTH,
          growth=log(2e-4, 5e-3), current=log(2e-3, 6e-3), time_constant=log(0.05, 0.6))
def self_heating(unit, growth, current, time_constant):
    return unit.change(stack={'heating_gain': growth, 'heating_current': current,
                              'heating_time': time_constant})


@register(FOREIGN, 'mechanical', 'a force that alternates along the way, as of a roller cage',
          BOTH, force=log(0.05, 15.0), pitch=log(8e-7, 3e-6))
def detent(unit, force, pitch):
    return unit.change(stack={'detent_force': force, 'detent_pitch': pitch})


@register(FOREIGN, 'mechanical', 'play between the stack and the point that is measured',
          'displacement', lookalikes=('friction',), width=log(2e-9, 3e-7))
def backlash(unit, width):
    return unit.change(sensing={'play': width})


@register(FOREIGN, 'environment', 'knocks: short bursts at random times', 'displacement',
          size=log(3e-9, 3e-7), rate=log(3.0, 20.0), seed=whole(1 << 30))
def knocks(unit, size, rate, seed):
    return unit.change(sensing={'knocks': size, 'knock_rate': rate, 'seed': seed})


@register(FOREIGN, 'sensor', 'the terminal voltage leaks into the displacement reading',
          'displacement', leak=either_sign(5e-11, 5e-9))
def crosstalk(unit, leak):
    return unit.change(sensing={'crosstalk': leak})


@register(FOREIGN, 'sensor', 'two levels between which the reading jumps at random',
          'displacement', size=log(2e-9, 2e-7), rate=log(1.0, 20.0), seed=whole(1 << 30))
def telegraph(unit, size, rate, seed):
    return unit.change(sensing={'telegraph': size, 'telegraph_rate': rate, 'seed': seed})


@register(FOREIGN, 'sensor', 'readings that stick for milliseconds', 'displacement',
          share=log(5e-3, 0.1), length=log(1e-3, 1e-2), seed=whole(1 << 30))
def dropouts(unit, share, length, seed):
    return unit.change(sensing={'dropouts': share, 'dropout_length': length, 'seed': seed})


@register(FOREIGN, 'sensor', 'displacement recorded by a clock that runs fast or slow',
          'displacement', error=either_sign(2e-5, 3e-3))
def clock_skew(unit, error):
    return unit.change(sensing={'clock_error': error})


@register(FOREIGN, 'sensor', 'a charge amplifier that forgets (high pass)', 'charge',
          needs=('charge',), time_constant=log(1.0, 3e3))
def charge_droop(unit, time_constant):
    return unit.change(sensing={'droop_time': time_constant})
