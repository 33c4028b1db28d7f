# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The effects that the library of the diagnosis has, each in another functional form than there.

Magnitudes run from about the noise floor to large; sources of the forms are named in the effects'
pages of the documentation.

"""

import numpy as np

from piezo_stack_sim.challenge.guide import guide_of
from piezo_stack_sim.challenge.hidden import (
    either_sign, log, of_stroke, of_top, register, uniform, whole,
)
from piezo_stack_sim.challenge.mount import kept_after, mount_of

KNOWN: dict = {}

ALL = 'voltage charge displacement'
BOTH = 'charge displacement'


# -- drive -----------------------------------------------------------------------------------

@register(KNOWN, 'drive', 'the driver samples the command with a clock of its own, then waits',
          ALL, delay=log(2e-6, 3e-4), share=uniform(0.1, 0.5), phase=uniform(0.0, 1.0))
def command_delay(unit, delay, share, phase):
    period = min(share * delay, 6e-5)
    return unit.change(drive={'clock_period': period, 'clock_phase': phase,
                              'latency': delay - 0.5 * period})


@register(KNOWN, 'drive', 'class AB output into the real, hysteretic load, behind a second pole',
          ALL, time_constant=log(2e-6, 4e-4), inner=uniform(0.1, 0.25), quiescent=log(0.02, 0.2))
def amplifier_bandwidth(unit, time_constant, inner, quiescent):
    # 0.8 uF: the large-signal capacitance about which the stack really varies.
    return unit.change(stack={'output_resistance': (1.0 - inner) * time_constant / 0.8e-6,
                              'amplifier_lag': inner * time_constant,
                              'quiescent_current': quiescent})


@register(KNOWN, 'drive', 'a driver that gives only so much current', ALL,
          without={'limit': np.inf}, limit=log(6e-3, 0.1), sinks=uniform(0.6, 0.95),
          resistance=log(8.0, 25.0), first=uniform(0.1, 0.35), second=uniform(0.05, 0.2),
          third=log(3e-3, 3e-2))
def amplifier_current_limit(unit, limit, sinks, resistance, first, second, third):
    return unit.change(stack={'current_limit': limit, 'sink_share': sinks, 'stage_first': first,
                              'stage_second': second, 'stage_third': third,
                              'output_resistance': max(resistance,
                                                       unit.stack.output_resistance)})


@register(KNOWN, 'drive', 'gain and offset error, and a characteristic that is not quite straight',
          ALL, gain_error=either_sign(5e-4, 4e-2), offset=either_sign(5e-3, 0.3),
          curvature=uniform(-0.25, 0.25))
def amplifier_gain(unit, gain_error, offset, curvature):
    # Engineering estimate: mostly below 0.1 % of the range. Of either sign, as a bootstrapped
    # stage may make up for more than its loop gain loses.
    return unit.change(drive={'gain': 1.0 + gain_error, 'offset': offset,
                              'curvature': 100.0 * curvature * abs(gain_error)})


@register(KNOWN, 'drive', 'an output stage that gives way little by little near its rail', ALL,
          rail=of_top(0.7, 1.01), knee=log(0.15, 1.0))
def amplifier_saturation(unit, rail, knee):
    return unit.change(drive={'upper_rail': rail, 'knee': knee})


# -- electrical ------------------------------------------------------------------------------

@register(KNOWN, 'electrical', 'charge follows the logarithm of time: fading memory of the past',
          BOTH, per_decade=log(2e-4, 2.5e-2), onset=log(1e-3, 1e-2))
def creep(unit, per_decade, onset):
    return unit.change(stack={'creep_per_decade': per_decade, 'creep_onset': onset})


@register(KNOWN, 'electrical', 'break voltages that grow with the logarithm of the current', BOTH,
          growth=log(4e-3, 0.12), reference=log(4e-3, 2e-2))
def rate_dependent_hysteresis(unit, growth, reference):
    return unit.change(stack={'rate_gain': growth, 'rate_reference': reference})


@register(KNOWN, 'electrical', 'exponential restoring voltage and unequal branches', BOTH,
          bow=either_sign(2e-2, 3.0), charge=log(2.5e-5, 6e-5), branch=uniform(0.005, 0.03))
def asymmetric_hysteresis(unit, bow, charge, branch):
    # `bow` is the voltage at 130 uC; the branches differ by `branch` per volt of it.
    full = 1.3e-4
    shape = charge * (np.exp(full / charge) - 1.0) - full
    return unit.change(stack={'bow_stiffness': bow / shape, 'bow_charge': charge,
                              'branch_difference': bow * branch})


@register(KNOWN, 'electrical', 'leakage current that grows exponentially with the voltage (sinh)',
          'charge', needs=('charge',), recordings=('steps',),
          resistance=log(1e7, 2e10), voltage=log(30.0, 120.0))
def leakage(unit, resistance, voltage):
    return unit.change(sensing={'leak_resistance': resistance, 'leak_voltage': voltage})


@register(KNOWN, 'electrical', 'remanence of a random sequence of slow voltage swings that has '
          'faded unequally', BOTH,
          peak=log(2.0, 100.0), seed=whole(1 << 30), faded=uniform(0.05, 0.2))
def initial_polarisation(unit, peak, seed, faded):
    # Each swing smaller than the one before, so that none wipes out the others.
    random = np.random.default_rng(seed)
    turns, size = [peak], peak
    for _ in range(random.integers(1, 4)):
        turns += [-size * random.uniform(0.05, 0.35), size * random.uniform(0.4, 0.9)]
        size = turns[-1]
    # Each element has lost another part of its strain since, `faded` in the mean.
    return unit.change(history=(*turns, 0.0),
                       faded=random.uniform(0.0, 2.0 * faded, unit.stack.K.size))


# -- transducer ------------------------------------------------------------------------------

@register(KNOWN, 'transducer', 'electrostriction from a coupling energy: a force in q^2 and its '
          'reaction on the voltage under load', BOTH, share=either_sign(1e-3, 4e-2),
          balanced_at=uniform(0.7, 1.2))
def transducer_nonlinearity(unit, share, balanced_at):
    # `share` of the displacement at 133 uC; the data sheet's ratio is that of a chord.
    stiffness = unit.stack.k + unit.stack.T ** 2 / unit.stack.C
    return unit.change(stack={
        'electrostriction': 2.0 * share * 1.24e-5 * stiffness / 1.33e-4 ** 2,
        'chord_charge': 1.33e-4 * balanced_at})


@register(KNOWN, 'transducer', 'direct and converse effect off by unequal amounts, and the '
          'converse one further under pressure', BOTH,
          error=either_sign(2.5e-2, 0.15), inequality=either_sign(0.05, 0.2),
          pressure=log(500.0, 3000.0))
def transducer_ratio(unit, error, inequality, pressure):
    return unit.change(stack={'converse_error': error * (1.0 + inequality),
                              'direct_error': error * (1.0 - inequality),
                              'depoling_force': pressure})


# -- mechanical ------------------------------------------------------------------------------

@register(KNOWN, 'mechanical', 'a payload on a lightly damped joint that slips a little', BOTH,
          mass=log(5e-4, 0.1), joint_frequency=uniform(4.5e4, 6.5e4))
def added_mass(unit, mass, joint_frequency):
    reduced = mass * unit.stack.m / (mass + unit.stack.m)
    stiffness = reduced * (2.0 * np.pi * joint_frequency) ** 2
    damping = 0.1 * np.sqrt(stiffness * reduced)
    return unit.change(stack={'body_mass': mass, 'body_stiffness': stiffness,
                              'body_damping': damping})


@register(KNOWN, 'mechanical', 'a joint that closes under load: deflection grows with log(force)',
          'displacement', recordings=('force',), stiffness=log(2e7, 2e10), load=log(40.0, 200.0))
def series_compliance(unit, stiffness, load):
    return unit.change(sensing={'joint_stiffness': stiffness, 'joint_force': load})


@register(KNOWN, 'mechanical', 'a progressive spring (quadratic share)', BOTH,
          stiffness=log(1e6, 2.5e7), length=log(1.5e-4, 5e-4))
def parallel_stiffness(unit, stiffness, length):
    return unit.change(stack={'spring_stiffness': stiffness, 'spring_length': length})


@register(KNOWN, 'mechanical', 'restoring force with a high, broken power of the displacement',
          BOTH, force=log(0.05, 60.0), power=uniform(3.5, 5.5))
def stiffness_hardening(unit, force, power):
    return unit.change(stack={'hardening_force': force, 'hardening_power': power})


@register(KNOWN, 'mechanical', 'sliding in the guide of the moving part', BOTH,
          force=log(0.028, 8.5), way=log(3e-8, 1.3e-7), mix=uniform(0.5, 1.0),
          turn=log(0.025, 0.05))
def friction(unit, force, way, mix, turn):
    first, second = guide_of(force, way, mix)
    return unit.change(stack={'guide_first': first, 'guide_second': second, 'guide_third': turn})


@register(KNOWN, 'mechanical', 'a structure between the stack and the sensor, on joints that '
          'are not linear', 'displacement',
          participation=either_sign(0.02, 0.6), frequency=log(500.0, 8e3),
          spread=uniform(1.3, 2.2), second=uniform(0.1, 0.3), damping=log(0.012, 0.06),
          way=log(6e-6, 1.5e-5))
def mechanical_resonance(unit, participation, frequency, spread, second, damping, way):
    return unit.change(sensing={
        'mode_parts': ((1.0 - second) * participation, second * participation),
        'mode_frequencies': (frequency, spread * frequency), 'mode_damping': damping,
        'mode_way': way * 1e3 / frequency})


@register(KNOWN, 'mechanical', 'Hertzian contact of rough faces: force in the 3/2 power of the '
          'indentation, asperities first', BOTH,
          gap=of_stroke(0.3, 0.95), force=log(0.3, 200.0), roughness=log(1e-7, 4e-7))
def contact(unit, gap, force, roughness):
    # `force` is that at an indentation of one micrometre.
    return unit.change(stack={'hertz_gap': gap, 'hertz_stiffness': force * 1e9,
                              'hertz_roughness': roughness})


@register(KNOWN, 'mechanical', 'a glued mount that yields slowly under what it carries', BOTH,
          stiffness=log(7e4, 8e6), time=log(10.0, 40.0), mix=uniform(0.08, 0.22),
          way=log(2.5e-6, 6e-6), nominal_after=log(0.03, 0.3))
def mount_creep(unit, stiffness, time, mix, way, nominal_after):
    shares, times = mount_of(time, mix)
    # So long after a step the stiffness is that of the data sheet.
    then = stiffness * kept_after(shares, times, nominal_after)
    return unit.change(stack={'k': unit.stack.k - then, 'mount_stiffness': stiffness,
                              'mount_first': time, 'mount_second': mix, 'mount_third': way})


# -- environment -----------------------------------------------------------------------------

@register(KNOWN, 'environment', 'two time constants and a slow swing of the ambient',
          'displacement', recordings=('steps',),
          size=either_sign(2e-9, 1e-6), time_constant=log(2.0, 15.0), share=uniform(0.15, 0.4),
          swing=uniform(0.05, 0.15))
def thermal_drift(unit, size, time_constant, share, swing):
    return unit.change(sensing={'warming': size, 'warming_time': time_constant,
                                'warming_share': share, 'swing': swing * size})


@register(KNOWN, 'environment', 'a tone with its second harmonic, not always synchronised',
          'displacement', size=log(5e-10, 1e-7), frequency=log(15.0, 400.0),
          harmonic=uniform(0.1, 0.4), free=uniform(0.0, 1.0), seed=whole(1 << 30))
def periodic_disturbance(unit, size, frequency, harmonic, free, seed):
    return unit.change(sensing={'vibration': size, 'vibration_frequency': frequency,
                                'vibration_harmonic': harmonic, 'seed': seed,
                                'vibration_free_running': free < 0.5})


# -- sensor ----------------------------------------------------------------------------------

@register(KNOWN, 'sensor', 'the pole of a sensor head, and the low pass of what reads it',
          'displacement', time_constant=log(1e-6, 4e-4), quality=uniform(0.55, 0.75),
          head=uniform(0.15, 0.5))
def sensor_lag(unit, time_constant, quality, head):
    # Between a Bessel filter, which keeps the shape, and a Butterworth filter, which is flat.
    return unit.change(sensing={'head_lag': head * time_constant, 'lag_quality': quality,
                                'lag': (1.0 - head) * time_constant})


@register(KNOWN, 'sensor', 'a converter with its own clock that shows its last finished reading',
          'displacement', delay=log(1e-6, 3e-4), share=uniform(0.1, 0.6))
def sensor_delay(unit, delay, share):
    period = min(share * delay, 4e-5)
    return unit.change(sensing={'conversion_period': period,
                                'conversion_latency': delay - 0.5 * period})


@register(KNOWN, 'sensor', 'a gain error that swings slightly with time', 'displacement',
          error=either_sign(1e-2, 0.12), swing=uniform(0.02, 0.08))
def sensor_gain(unit, error, swing):
    return unit.change(sensing={'gain': 1.0 + error, 'gain_swing': swing * error})


@register(KNOWN, 'sensor', 'linearity error of two half waves over the range', 'displacement',
          size=either_sign(1e-9, 4e-7), length=uniform(1.2e-5, 2e-5))
def sensor_nonlinearity(unit, size, length):
    return unit.change(sensing={'bend': size, 'bend_length': length})


@register(KNOWN, 'sensor', 'a trend with a random walk', 'displacement', recordings=('steps',),
          rate=either_sign(1e-10, 4e-8), walk=uniform(0.1, 0.4), seed=whole(1 << 30))
def sensor_drift(unit, rate, walk, seed):
    return unit.change(sensing={'drift': rate, 'drift_walk': abs(rate) * walk, 'seed': seed})
