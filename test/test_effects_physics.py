# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Magnitudes, energy and signatures of the effects, against published or recomputed numbers."""

import math
from types import SimpleNamespace

from effect_probes import (
    device, fundamental, IDEAL, lags, mixed, only, rise_time, sine, triangle)
import numpy as np
from piezo_stack_sim.effects.registry import EFFECTS
from piezo_stack_sim.errors import InputError
from piezo_stack_sim.plant import Device, layout, Plant, PlantState, simulate
from piezo_stack_sim.plant.build import build_model
import pytest
from scipy.integrate import solve_ivp, trapezoid
from scipy.signal import cont2discrete, lfilter

SOURCE = {'output_resistance': 50.0}  # ohm, keeps a step from ringing past its end
DECADES = np.concatenate([[0.0], np.logspace(-2, 2, 41)])


def stroke(target, peak=90.0):
    """Return the stroke in the last cycle of a slow triangle, in metres."""
    time, voltage = triangle(1.0, peak, 3, 2000)
    return float(np.ptp(simulate(target, time, voltage).displacement[4000:]))


def at(time, values, moment):
    """Return a value at a moment."""
    return float(np.interp(moment, time, values))


# -- drive ---------------------------------------------------------------------


@pytest.mark.parametrize('resistance, microseconds', [(10, 32), (50, 210), (100, 413)])
def test_rise_of_a_90_volt_step_through_a_resistance(resistance, microseconds):
    target = only('amplifier_bandwidth', output_resistance=resistance)
    assert rise_time(target) == pytest.approx(microseconds * 1e-6, rel=0.02)


@pytest.mark.parametrize('limit, milliseconds', [(1.0, 0.12), (0.3, 0.40), (0.1, 1.20)])
def test_a_limited_current_makes_a_90_volt_step_a_ramp(limit, milliseconds):
    target = device('amplifier_current_limit', limit=limit)
    assert rise_time(target) == pytest.approx(milliseconds * 1e-3, rel=0.04)
    time = np.arange(400) * 1e-6
    charge = simulate(target, time, np.full(400, 90.0)).charge
    if limit < 1.0:
        assert np.diff(charge[20:300]) == pytest.approx(limit * 1e-6, rel=1e-6)


def test_a_driver_that_sinks_less_than_it_sources_falls_slower_than_it_rises():
    time = np.arange(2000) * 2e-6
    voltage = np.where(time < 2e-3, 60.0, 0.0)
    target = device('amplifier_current_limit', limit=0.1, sink_share=0.5)
    rate = np.diff(simulate(target, time, voltage).charge) / 2e-6
    assert rate[20:300] == pytest.approx(0.1, rel=1e-6)
    assert rate[1020:1500] == pytest.approx(-0.05, rel=1e-6)
    assert rate.min() > -0.05 * (1.0 + 1e-6)


@pytest.mark.parametrize('resistance', [1.0, 5.0])
def test_a_small_step_passes_the_current_limit_as_its_resistance_lets_it(resistance):
    time = np.arange(500) * 2e-6
    small = np.full(500, 0.02)  # 0.02 V over 1 ohm is 20 mA
    limited = simulate(device('amplifier_current_limit', output_resistance=resistance),
                       time, small)
    plain = simulate(only('amplifier_bandwidth', output_resistance=resistance), time, small)
    assert np.abs(limited.displacement - plain.displacement).max() < 1e-15


@pytest.mark.parametrize('internal', [0.0, 4.0])
@pytest.mark.parametrize('knee', [0.3, 0.6, 0.9])
def test_a_current_limit_that_sets_in_little_by_little(knee, internal):
    limit, sink, resistance, rise = 0.1, 0.7, 5.0, 2.0
    given = {'amplifier_current_limit': {
        'limit': limit, 'sink_share': sink, 'output_resistance': resistance, 'rise': rise,
        'knee': knee}}
    if internal:
        # A loss inside the stack is in series with the driver's, and behind the terminals.
        given['rate_dependent_hysteresis'] = {'resistance': internal}
    time = np.arange(40001) * 1e-7
    command = 45.0 * (1.0 - np.cos(2.0 * math.pi * 400.0 * time))
    response = simulate(IDEAL.with_effects(given), time, command)
    # Of a row, in which the command is held.
    current = np.diff(response.charge) / 1e-7
    drop = command[:-1] - 0.5 * (response.voltage[:-1] + response.voltage[1:])
    above = np.maximum(np.abs(current) - knee * np.where(current > 0.0, limit, sink * limit), 0.0)
    expected = resistance * (current + np.sign(current) * rise * above)
    free = (current < 0.99 * limit) & (current > -0.99 * sink * limit) & (time[1:] > 1e-5)
    assert current.max() == pytest.approx(limit, rel=1e-3)
    assert current.min() == pytest.approx(-sink * limit, rel=1e-3)
    assert 200 < np.count_nonzero(above[free] > 0.1 * (1.0 - knee) * limit) < free.sum() - 200
    assert np.abs(drop - expected)[free].max() < 0.02 * resistance * limit


@pytest.mark.parametrize('frequency, percent', [(10.0, 0.22), (100.0, 2.2), (1000.0, 22.0)])
def test_error_of_100_microseconds_delay_grows_with_frequency(frequency, percent):
    time, voltage = sine(frequency, 0.0, 90.0, 3, 1000)
    without = simulate(IDEAL, time, voltage).displacement[2000:]
    late = simulate(device('command_delay', delay=1e-4), time, voltage).displacement[2000:]
    error = 100.0 * math.sqrt(np.mean((late - without) ** 2)) / np.ptp(without)
    assert error == pytest.approx(percent, rel=0.06)


@pytest.mark.parametrize('frequency, gain, phase', [
    (1000.0, 73.1, -20.5), (3000.0, 57.3, -43.7), (5000.0, 44.4, -58.0)])
def test_response_to_20_volts_through_50_ohm(frequency, gain, phase):
    time, voltage = sine(frequency, 0.0, 20.0, 8, 200)
    x = simulate(only('amplifier_bandwidth', **SOURCE), time, voltage).displacement
    # The held command is half a row late, and so is its effect.
    ratio = fundamental(time, x, frequency) / fundamental(time, voltage, frequency)
    ratio *= np.exp(1j * math.pi / 200)
    assert abs(ratio) * 1e9 == pytest.approx(gain, rel=0.01)
    assert np.angle(ratio, deg=True) == pytest.approx(phase, abs=1.5)


def test_rails_cut_at_the_same_voltage_whatever_came_before():
    time, voltage = triangle(10.0, 90.0, 3, 1000)
    response = simulate(device('amplifier_saturation', upper=70.0, knee=0.0), time, voltage)
    assert response.voltage.max() == 70.0
    assert np.count_nonzero(response.voltage == 70.0) > 600


def test_a_soft_rail_is_met_little_by_little():
    """At the rail it takes knee ln 2, three knees off a twentieth of one, and far off nothing."""
    command = np.array([0.0, -50.0, -20.0, 20.0, 67.0, 70.0, 73.0, 90.0])
    target = only('amplifier_saturation', lower=-20.0, upper=70.0, knee=1.0)
    # A row is sampled just before its command takes effect.
    voltage = simulate(target, np.arange(9) * 1e-3, np.append(command, 90.0)).voltage[1:]
    softly = math.log(2.0)
    assert voltage[:4] == pytest.approx([0.0, -20.0, -20.0 + softly, 20.0], abs=1e-8)
    assert voltage[4:] == pytest.approx([
        67.0 - 0.0486, 70.0 - softly, 70.0 - 0.0486, 70.0], abs=1e-4)
    # Symmetric about the rail: what it stops short of is what it lets through beyond.
    assert 67.0 - voltage[4] == pytest.approx(70.0 - voltage[6], abs=1e-9)


def test_the_line_of_a_driver_bows_between_the_ends_of_its_range():
    full = build_model(Device.nominal(), 'voltage').reference.voltage
    target = only('amplifier_gain', gain_error=0.01, offset=0.3, curvature=0.002)
    command = full * np.array([0.0, 0.25, 0.5, 0.75, 1.0, 1.0])
    voltage = simulate(target, np.arange(6) * 1e-3, command).voltage[1:]
    straight = 1.01 * command[:-1] + 0.3
    assert (voltage - straight) / full == pytest.approx(
        0.002 * np.array([0.0, 0.75, 1.0, 0.75, 0.0]), abs=1e-9)


def test_a_charge_driver_has_no_voltage_offset():
    time = np.arange(100) * 1e-4
    charge = np.linspace(0.0, 1e-4, 100)
    target = only('amplifier_gain', offset=1.0)
    ideal = simulate(IDEAL, time, charge, drive='charge')
    assert np.array_equal(simulate(target, time, charge, drive='charge').charge, ideal.charge)


# -- electrical ------------------------------------------------------------------


def test_charge_and_displacement_creep_one_to_two_percent_a_decade_together():
    target = device('creep').with_effects({'amplifier_bandwidth': SOURCE})
    response = simulate(target, DECADES, np.full(DECADES.size, 90.0))
    x, q = response.displacement, response.charge
    for start in (0.1, 1.0, 10.0):
        grown = [at(DECADES, y, 10.0 * start) - at(DECADES, y, start) for y in (x, q)]
        assert 0.01 < grown[0] / at(DECADES, x, 0.1) < 0.02
        assert grown[0] / grown[1] == pytest.approx(10.0 / 107.2, rel=0.01)
    whole = x[-1] / at(DECADES, x, 0.1) - 1.0
    assert whole == pytest.approx(3 * 0.015, rel=0.1)  # 4.5 % in a hold of 100 s


def test_the_nominal_curve_holds_at_the_reference_time_of_creep():
    command = np.full(DECADES.size, 90.0)
    source = IDEAL.with_effects({'amplifier_bandwidth': SOURCE})
    ideal = simulate(source, DECADES, command).displacement[-1]
    for moment, decades in ((0.1, 3), (1.0, 4)):
        target = device('creep', reference_time=moment).with_effects({
            'amplifier_bandwidth': SOURCE})
        x = simulate(target, DECADES, command).displacement
        # The charge that comes late takes less than a tenth of the voltage off the Maxwell
        # elements, which then hold what they were led beyond.
        assert 0.0 <= at(DECADES, x, moment) / ideal - 1.0 < 0.1 * decades * 0.015


@pytest.mark.parametrize('power', [-0.1, 0.0, 0.15])
def test_creep_slows_with_a_power_of_time_or_with_its_logarithm(power):
    time = np.concatenate([[0.0], np.logspace(-2, 3, 51)])
    target = only('creep', gain_per_decade=0.005, power=power).with_effects({
        'amplifier_bandwidth': SOURCE})
    charge = simulate(target, time, np.full(time.size, 90.0)).charge
    grown = [at(time, charge, 10.0 * start) - at(time, charge, start)
             for start in (0.1, 1.0, 10.0)]
    ratios = np.array(grown[1:]) / grown[:-1]
    assert ratios == pytest.approx(10.0 ** -power, rel=0.03)


def test_nothing_creeps_before_the_shortest_time_it_takes():
    time = np.concatenate([[0.0], np.logspace(-4, 1, 51)])
    early, late = (simulate(only('creep', gain_per_decade=0.02, onset=onset).with_effects({
        'amplifier_bandwidth': SOURCE}), time, np.full(time.size, 90.0)).charge
        for onset in (1e-3, 1e-1))

    def crept(charge, start, end):
        return at(time, charge, end) / at(time, charge, start) - 1.0

    assert crept(early, 2e-3, 2e-2) > 0.015 > 0.005 > crept(late, 2e-3, 2e-2)
    assert crept(late, 1.0, 10.0) == pytest.approx(crept(early, 1.0, 10.0), rel=0.05)


def test_gain_falls_by_creep_with_each_decade_of_frequency():
    strokes = []
    for frequency in (0.1, 1.0, 10.0, 100.0):
        time, voltage = triangle(frequency, 90.0, 3, 1000)
        strokes.append(np.ptp(simulate(device('creep'), time, voltage).displacement[2000:]))
    falls = -np.diff(strokes) / strokes[1]
    assert np.all((0.008 < falls) & (falls < 0.02))  # about 1.4 %


def test_a_held_stack_creeps_on_a_voltage_only_and_a_given_charge_keeps_the_displacement():
    time = np.concatenate([[0.0], np.logspace(-3, 2, 30)])
    response = simulate(device('creep'), time, np.full(time.size, 5e-5), drive='charge')
    assert np.ptp(response.displacement[5:]) < 1e-12
    assert response.voltage[-1] < response.voltage[5] - 0.5


def test_what_leaks_past_the_stack_does_not_bow_its_displacement():
    time = np.arange(5000) / 1e3
    command = 45.0 - 45.0 * np.cos(2.0 * np.pi * time / 5.0)
    bowed = {'transducer_nonlinearity': {'curvature': 0.03}}
    tight, leaky = (simulate(Device.nominal().with_effects(effects), time, command)
                    for effects in (bowed, {**bowed, 'leakage': {'resistance': 1e7}}))
    assert np.ptp(leaky.charge - tight.charge) > 1e-5
    assert np.allclose(leaky.displacement, tight.displacement, atol=1e-13)


@pytest.mark.parametrize('exponent', [0.5, 1.0])
@pytest.mark.parametrize('period', [2e-5, 2e-4])
def test_break_voltages_grow_with_a_power_of_the_current(exponent, period):
    current, growth = 5e-3, 0.03
    time = period * np.arange(round(0.04 / period))
    fast = only('rate_dependent_hysteresis', growth=growth, exponent=exponent)
    answers = [simulate(target, time, current * time, drive='charge') for target in (fast, IDEAL)]
    # Charge that comes in steps: each counts, and fades with 0.25 ms until the next.
    steps = period / 2.5e-4
    late = current * steps / math.expm1(steps)
    actuator, charge = IDEAL.actuator, answers[0].charge[-1]
    slow = np.array(actuator.maxwell_break_voltage)
    wanted = [np.minimum(np.array(actuator.maxwell_stiffness) * charge, breaks).sum()
              for breaks in (slow * (1.0 + growth * (late / 1e-2) ** exponent), slow)]
    assert answers[0].voltage[-1] - answers[1].voltage[-1] == pytest.approx(
        wanted[0] - wanted[1], rel=1e-3)


def test_break_voltages_that_grow_widen_fast_loops_alone():
    def area(target, frequency):
        time, voltage = sine(frequency, 0.0, 80.0, 3, 400)
        answer = simulate(target, time, voltage)
        last = slice(800, None)
        return abs(trapezoid(voltage[last], answer.charge[last]))

    growing = only('rate_dependent_hysteresis', growth=0.03, exponent=1.0)
    assert area(growing, 0.1) == pytest.approx(area(IDEAL, 0.1), rel=1e-3)
    assert area(growing, 50.0) > 1.02 * area(IDEAL, 50.0)


@pytest.mark.parametrize('resistance, microcoulomb', [(1e7, 900.0), (1e8, 90.0)])
def test_leakage_adds_to_the_measured_charge_of_a_held_stack(resistance, microcoulomb):
    time = np.linspace(0.0, 100.0, 101)
    command = np.full(101, 90.0)
    source = {'amplifier_bandwidth': SOURCE}
    tight = simulate(IDEAL.with_effects(source), time, command)
    leaky = simulate(device('leakage', resistance=resistance).with_effects(source), time, command)
    assert (leaky.charge - tight.charge)[-1] * 1e6 == pytest.approx(microcoulomb, rel=1e-3)
    assert np.abs(leaky.displacement - tight.displacement).max() < 1e-11


def test_open_leads_lose_their_charge_through_the_insulation():
    plant = Plant(device('leakage', resistance=1e7), 1e-2)
    plant.run(np.linspace(0.0, 90.0, 100))
    plant.set_drive('open')
    time = np.arange(1, 3001) * 1e-2
    response = plant.run(np.zeros(3000))
    # About v/R of current from about 1 uF: after 14 s a third is left.
    third = time[np.argmax(response.voltage < 90.0 / math.e)]
    assert 8.0 < third < 16.0
    assert response.displacement[-1] < 0.5 * response.displacement[0]
    assert np.ptp(response.charge) < 1e-15, 'no charge comes through open leads'


def test_a_used_stack_differs_in_its_first_cycle_only():
    time, voltage = triangle(1.0, 90.0, 3, 2000)
    fresh = simulate(IDEAL, time, voltage).displacement
    used = simulate(device('initial_polarisation'), time, voltage).displacement
    difference = fresh - used
    assert abs(difference[0]) < 1e-15, 'the sensors are zeroed where the recording begins'
    # Later the two differ by the zero of the sensor alone, which is the remanence.
    assert 2.1e-6 < difference[-1] < 2.4e-6
    assert np.ptp(difference[1001:]) < 1e-9


@pytest.mark.parametrize('also', ['creep', 'mount_creep', 'series_compliance', 'sensor_lag',
                                  'asymmetric_hysteresis', 'parallel_stiffness', 'leakage'])
def test_a_used_stack_rests_before_the_first_command(also):
    target = device('initial_polarisation').with_effects({also: EFFECTS[also].typical()})
    target = target.replace(load={'mass': 0.05, 'stiffness': 1e6, 'damping': 10.0})
    x = simulate(target, np.arange(200) * 1e-4, np.zeros(200)).displacement
    assert np.abs(x).max() < 1e-10


@pytest.mark.parametrize('swings', [(60.0, 0.0, 0.0), (60.0, -10.0, 20.0), (-30.0, 12.0, 0.0)])
@pytest.mark.parametrize('also', [None, 'parallel_stiffness'])
def test_how_strained_the_elements_are_says_what_earlier_swings_did(swings, also):
    time, voltage = triangle(1.0, 90.0, 2, 2000)
    target = IDEAL if also is None else device(also)
    swings = dict(zip(('peak_voltage', 'turn_voltage', 'return_voltage'), swings))
    used = target.with_effects({'initial_polarisation': swings})
    strains = Plant(used).strains
    assert strains[0] == pytest.approx(-1.0) and np.abs(strains).max() <= 1.0 + 1e-12
    known = target.with_effects({'initial_polarisation': {
        f'strain_{i + 1}': z for i, z in enumerate(strains.tolist())}})
    assert Plant(known).strains == pytest.approx(strains, abs=1e-12)
    expected, found = simulate(used, time, voltage), simulate(known, time, voltage)
    assert found.displacement == pytest.approx(expected.displacement, abs=1e-17)
    assert found.charge == pytest.approx(expected.charge, abs=1e-17)


def test_a_stack_with_strained_elements_rests_without_voltage():
    # Eqs. 12 and 16 by hand: half of the break voltages of eight, held by the capacitors.
    actuator = IDEAL.actuator
    given = {f'strain_{i}': 0.5 for i in range(1, 9)}
    plant = Plant(IDEAL.with_effects({'initial_polarisation': given}))
    held = 0.5 * sum(actuator.maxwell_break_voltage[:8])
    stiff = sum(actuator.maxwell_stiffness[8:])
    free = actuator.linear_capacitance + actuator.transformer_ratio ** 2 / actuator.stiffness
    assert plant.strains[:8] == pytest.approx(np.full(8, 0.5), abs=1e-12)
    assert plant.state.memory[layout.M_CHARGE] == pytest.approx(
        -held / (stiff + 1.0 / free), rel=1e-9)


def test_neighbours_that_no_history_leaves_so_give_way():
    given = {'strain_7': 1.0, 'strain_8': -1.0}
    blocks = np.array(Plant(IDEAL.with_effects({'initial_polarisation': given})).state.blocks)
    actuator = IDEAL.actuator
    charges = np.array(actuator.maxwell_break_voltage) / np.array(actuator.maxwell_stiffness)
    assert np.all(np.abs(np.diff(blocks)) <= np.diff(charges) * (1.0 + 1e-9))
    assert blocks[7] - blocks[6] == pytest.approx(charges[7] - charges[6])


def test_a_bowed_stack_takes_more_voltage_for_the_same_charge_by_what_the_numbers_say():
    full = build_model(device('asymmetric_hysteresis')).reference
    charge = np.linspace(-0.3, 1.0, 14) * full.charge
    time = np.arange(14) * 1e-3
    answers = [simulate(target, time, charge, drive='charge').voltage for target in (
        IDEAL, device('asymmetric_hysteresis', quadratic=0.2, cubic=0.05))]
    s = charge[:-1] / full.charge  # a command holds from its row on
    assert (answers[1] - answers[0])[1:] == pytest.approx(
        full.voltage * (0.2 * s ** 2 + 0.05 * s ** 3), abs=1e-6 * full.voltage)


def test_a_saturating_stack_loses_stroke_at_the_top_and_has_even_harmonics():
    time, voltage = triangle(1.0, 90.0, 3, 2000)
    plain = simulate(IDEAL, time, voltage).displacement[4000:]
    bowed = simulate(device('asymmetric_hysteresis', quadratic=0.2), time, voltage)
    bowed = bowed.displacement[4000:]
    assert np.ptp(bowed) < np.ptp(plain)
    assert plain.max() - bowed.max() > plain.min() - bowed.min() > 0.0

    def second(x):
        tones = np.abs(np.fft.rfft(x[:-1]))
        return tones[2] / tones[1]
    assert second(bowed) > 3.0 * second(plain)


# -- transducer ------------------------------------------------------------------


def test_a_charge_drive_leaves_the_bow_of_the_transducer():
    time, wave = triangle(10.0, 1.0, 2, 1000)
    charge = 1.3e-4 * wave
    plain = simulate(IDEAL, time, charge, drive='charge')
    bowed = simulate(device('transducer_nonlinearity'), time, charge, drive='charge')
    departure = np.abs(bowed.displacement - plain.displacement).max() / np.ptp(plain.displacement)
    assert 0.01 < departure < 0.05  # published: at most 4.65 %
    # A function of the charge: no loop, but for the ringing of the stairs.
    rise, fall = bowed.displacement[1:501], bowed.displacement[502:1002][::-1]
    assert np.abs(rise - fall).max() < 1e-3 * np.ptp(rise)


def test_a_transducer_ratio_changes_both_directions():
    charge = np.full(200, 1e-4)
    time = np.arange(200) * 1e-4
    ideal = simulate(IDEAL, time, charge, drive='charge').displacement[-1]
    off = simulate(device('transducer_ratio', ratio_error=0.1), time, charge, drive='charge')
    ratio, spring = 11.0, 6e6 * 1.2e-6
    assert off.displacement[-1] / 1e-4 == pytest.approx(ratio / (ratio ** 2 + spring), rel=1e-6)
    assert off.displacement[-1] < ideal


@pytest.mark.parametrize('more', [{}, {'amplifier_bandwidth': {'output_resistance': 20.0}}])
def test_unequal_directions_are_a_scale_of_the_displacement_and_another_of_the_force(more):
    """Scales of x and F in Eqs. 11, 14 and 15 make the geometric mean of the two ratios."""
    converse, direct = 1.0 + 0.1 * 1.2, 1.0 + 0.1 * 0.8
    time, voltage = triangle(100.0, 60.0, 1, 500)
    force = 80.0 * np.sin(2.0 * np.pi * 130.0 * time)
    unequal = simulate(IDEAL.with_effects({
        'transducer_ratio': {'ratio_error': 0.1, 'inequality': 0.2}, **more}),
        time, voltage, force)
    scale = np.sqrt(converse / direct)
    equal = simulate(IDEAL.with_effects({
        'transducer_ratio': {'ratio_error': np.sqrt(converse * direct) - 1.0}, **more}),
        time, voltage, force / scale)
    # Rounding decides when a slip is noticed: a picometre.
    np.testing.assert_allclose(unequal.displacement, scale * equal.displacement, atol=1e-12)
    np.testing.assert_allclose(unequal.charge, equal.charge, atol=1e-11)
    np.testing.assert_allclose(unequal.voltage, equal.voltage, atol=1e-6)
    np.testing.assert_allclose(unequal.force, scale * equal.force, atol=1e-5)


# -- mechanical ------------------------------------------------------------------


def ringing(target, force=-1.0):
    """Return the natural frequency (Hz) with leads open after a small push."""
    time = np.arange(8192) * 2e-6
    push = np.where(time > 0.0, force, 0.0)
    x = simulate(target, time, np.zeros(time.size), push, drive='open').displacement
    tone = np.abs(np.fft.rfft((x - x[-1]) * np.exp(-time / 4e-3), 1 << 17))
    return float(np.fft.rfftfreq(1 << 17, 2e-6)[1 + np.argmax(tone[1:])])


def test_added_mass_lowers_the_natural_frequency():
    expected = math.sqrt(89.3333e6 / (0.00375 + 0.05)) / (2.0 * math.pi)
    assert ringing(device('added_mass', mass=0.05)) == pytest.approx(expected, rel=0.02)


def test_a_payload_on_a_joint_swings_as_two_masses_on_springs_do():
    m, mass, stiffness = 0.00375, 0.05, 89.3333e6
    joint = m * mass / (m + mass) * (2.0 * math.pi * 2e4) ** 2
    slow, _ = np.linalg.eigvalsh(np.array([
        [(stiffness + joint) / m, -joint / math.sqrt(m * mass)],
        [-joint / math.sqrt(m * mass), joint / mass]]))  # stiffness over masses, symmetrical
    swinging = ringing(device('added_mass', mass=mass, joint_frequency=2e4))
    assert swinging == pytest.approx(math.sqrt(slow) / (2.0 * math.pi), rel=0.01)
    assert swinging < 0.85 * ringing(device('added_mass', mass=mass))


def test_a_payload_on_a_stiff_joint_is_a_rigid_one():
    held, rigid = (ringing(device('added_mass', mass=0.05, joint_frequency=frequency))
                   for frequency in (1.9e5, math.inf))
    assert held == pytest.approx(rigid, rel=0.01)


def test_a_series_compliance_softens_against_forces_and_keeps_the_free_stroke():
    soft = device('series_compliance', compliance=5e-9, stiffening=0.0)
    assert stroke(soft) == pytest.approx(stroke(IDEAL), rel=1e-6)
    time = np.arange(400) * 1e-4
    force = np.full(400, -100.0)
    moved = [simulate(target, time, np.zeros(400), force, drive='open').displacement[-1]
             for target in (IDEAL, soft)]
    assert moved[1] - moved[0] == pytest.approx(-100.0 * 5e-9, rel=1e-6)


@pytest.mark.parametrize('load', [{}, {'mass': 0.05, 'damping': 200.0}])
@pytest.mark.parametrize('force', [-100.0, -20.0, 40.0])
def test_a_joint_that_closes_gives_way_by_a_hyperbola_of_the_force(force, load):
    def moved(**values):
        target = device('series_compliance', **values).replace(load=load)
        return simulate(target, np.arange(2000) * 1e-4, np.zeros(2000), np.full(2000, force),
                        drive='open').displacement[-1]

    rigid = moved(compliance=0.0, stiffening=0.02)
    given = moved(compliance=5e-9, stiffening=0.02) - rigid
    assert given == pytest.approx(5e-9 * force / (1.0 + 0.02 * abs(force)), rel=1e-3)
    assert moved(compliance=5e-9, stiffening=0.0) - rigid == pytest.approx(5e-9 * force, rel=1e-3)


def test_a_joint_that_closes_answers_row_by_row_as_all_at_once():
    target = device('series_compliance', compliance=5e-9, stiffening=0.02)
    target = target.replace(load={'mass': 0.05, 'damping': 20.0})
    rows = np.arange(60)
    command, force = 30.0 * np.sin(0.1 * rows), 50.0 * np.sin(0.3 * rows)
    plant = Plant(target, 1e-4, 'voltage', noise=False)
    one_by_one = [plant.advance(u, f).displacement for u, f in zip(command, force)]
    together = Plant(target, 1e-4, 'voltage', noise=False).run(command, force).displacement
    assert np.abs(together).max() > 1e-7
    assert np.abs(one_by_one - together).max() < 1e-15


@pytest.mark.parametrize('irregular', [False, True])
def test_a_joint_that_closes_is_read_as_late_as_the_rest(irregular):
    rows = np.arange(2000)
    time, force = rows * 1e-5, 80.0 * np.sin(2e-3 * np.pi * rows)
    if irregular:
        time = np.delete(time, [700, 1301])
        force = np.delete(force, [700, 1301])

    def seen(**effects):
        target = device('series_compliance', compliance=5e-9, stiffening=0.02)
        return simulate(target.with_effects(effects), time, np.zeros(time.size), force,
                        'voltage').displacement

    late = seen(sensor_delay={'delay': 5e-4})
    # It moves by 3 nm from row to row, which is what a missing row may be off by.
    off = np.abs(late[100:] - np.interp(time[100:] - 5e-4, time, seen())).max()
    assert off < (4e-9 if irregular else 1e-12)
    assert np.abs(late - seen()).max() > 1e-7


def _through_a_low_pass(time, values, constant, quality):
    """Return values behind a low pass, by hundreds of times as many rows."""
    fine = np.linspace(time[0], time[-1], 400 * time.size)
    up, down, _ = cont2discrete(((1.0,), ((quality * constant) ** 2, constant, 1.0)[not quality:]),
                                fine[1] - fine[0], 'foh')
    return np.interp(time, fine, lfilter(np.ravel(up), down, np.interp(fine, time, values)))


@pytest.mark.parametrize('irregular', [False, True])
@pytest.mark.parametrize('quality', [0.0, 0.4, 0.65])
@pytest.mark.parametrize('what, given, force', [
    ('transducer_nonlinearity', {'curvature': 0.1}, 0.0),
    ('series_compliance', {'compliance': 1e-8}, -100.0),
    ('series_compliance', {'compliance': 1e-8, 'stiffening': 0.02}, -100.0)])
def test_a_slow_sensor_sees_late_whatever_moves_it(what, given, force, quality, irregular):
    """What follows charge or force at once is shown to the sensor, too."""
    row = 9e-9  # m; it moves by 9 um in 1000 rows, and between rows the reference is a line
    time = np.arange(2001) * 1e-4
    if irregular:  # rows in which the command stands: where it moves it would stand for longer
        time = np.delete(time, [1300, 1301, 1702])
    rise = np.clip(time / 0.1, 0.0, 1.0)
    command, push = (0.0 * rise, force * rise) if force else (60.0 * rise, 0.0 * rise)

    def seen(**effects):
        return simulate(device(what, **given).with_effects(effects), time, command, push,
                        'voltage').displacement

    at_once = seen()
    slow = seen(sensor_lag={'time_constant': 0.01, 'quality_factor': quality})
    assert np.abs(at_once - slow).max() > 2e-7
    assert np.abs(slow - _through_a_low_pass(time, at_once, 0.01, quality)).max() < row
    for delay in (0.02, 0.02003):
        late = seen(sensor_delay={'delay': delay})
        assert np.abs(late[time < delay]).max() < 1e-12  # nothing before its time
        # A ramp in steps swings by some nanometres between rows.
        assert np.abs(late - np.interp(time - delay, time, at_once)).max() < row


@pytest.mark.parametrize('quality', [0.0, 0.65])
def test_what_a_slow_sensor_is_shown_goes_on_in_calls_of_any_size(quality):
    target = device('transducer_nonlinearity', curvature=0.1).with_effects(
        {'sensor_lag': {'time_constant': 0.01, 'quality_factor': quality},
         'sensor_delay': {'delay': 1.23e-3}})
    command = 60.0 * np.clip(np.arange(2000) / 1000.0, 0.0, 1.0)
    whole = Plant(target, 1e-4).run(command).displacement
    plant = Plant(target, 1e-4)
    parts = [plant.run(command[:7]).displacement, plant.run(command[7:700]).displacement]
    state = PlantState.from_dict(plant.state.to_dict())
    other = Plant(target, 1e-4)
    other.restore(state)
    assert np.array_equal(np.concatenate([*parts, other.run(command[700:]).displacement]), whole)
    with pytest.raises(InputError, match='shown besides'):
        bare = only('sensor_lag', time_constant=0.01, quality_factor=quality).with_effects(
            {'sensor_delay': {'delay': 1.23e-3}})
        Plant(bare, 1e-4).restore(state)


@pytest.mark.parametrize('sensor', [
    {'time_constant': 4e-3}, {'time_constant': 2e-3, 'quality_factor': 0.9},
    {'time_constant': 2e-3, 'quality_factor': 0.3},
    {'time_constant': 4e-3, 'quality_factor': 0.65}])
@pytest.mark.parametrize('quality', [0.0, 0.4, 0.65])
def test_another_filter_before_a_device_at_rest_shows_what_the_one_before_did(quality, sensor):
    bowed = device('transducer_nonlinearity', curvature=0.1)
    plant = Plant(bowed.with_effects({'sensor_lag': {
        'time_constant': 2e-3, 'quality_factor': quality}}), 1e-3, 'voltage', noise=False)
    before = plant.run(np.full(60, 60.0)).displacement[-1]
    plant.set_device(bowed.with_effects({'sensor_lag': sensor}))
    assert plant.run(np.full(60, 60.0)).displacement == pytest.approx(before, abs=1e-12)


def test_a_sensor_that_gets_later_shows_what_it_showed_until_then():
    slow, slower = (device('sensor_delay', delay=delay) for delay in (5e-3, 1e-2))
    plant = Plant(slow, 1e-3, 'voltage', noise=False)
    before = plant.run(np.arange(40.0)).displacement
    plant.set_device(slower)
    after = plant.run(np.arange(40.0, 60.0)).displacement
    steps = np.diff(np.concatenate([before[-1:], after]))
    assert np.all(steps > -1e-10)  # the device only grows longer
    assert np.all(np.abs(after[:5] - after[0]) < 1e-10)  # it stands still for 5 ms


def test_a_second_harmonic_hums_by_itself():
    def moved(**values):
        return np.ptp(simulate(device('periodic_disturbance', **values), np.arange(400) * 1e-4,
                               np.zeros(400)).displacement)

    assert moved(displacement=0.0, harmonic=1e-8) == pytest.approx(2e-8, rel=1e-3)


def test_unequal_branches_do_not_slip_beyond_the_table():
    printed = Device.nominal().with_effects({'asymmetric_hysteresis': {'branch': 0.05}})
    plant = Plant(printed, 1e-3, 'voltage')
    plant.run(np.linspace(0.0, 20.0, 50))
    assert not plant.charge_out_of_range
    plant.run(np.linspace(20.0, 140.0, 500))
    assert plant.charge_out_of_range


def test_a_preload_spring_takes_its_share_of_the_stroke():
    loss = 1.0 - stroke(device('parallel_stiffness')) / stroke(IDEAL)
    assert 0.08 < loss < 0.12  # 5 N/um: 9 % with 49 N/um, 12 % with 37 N/um
    assert 1.0 - stroke(device('parallel_stiffness', stiffness=1e6)) / stroke(
        IDEAL) == pytest.approx(0.023, abs=0.005)


def test_a_hardening_spring_stiffens_by_what_it_says():
    model = build_model(device('stiffness_hardening', quadratic=0.2, cubic=0.1))
    k2, k3 = model.smooth_force
    x, k_s = model.reference.stroke, model.reference.stiffness
    assert (2.0 * k2 * x + 3.0 * k3 * x ** 2) / k_s == pytest.approx(0.3)
    assert stroke(device('stiffness_hardening', cubic=0.2)) < stroke(
        device('stiffness_hardening', cubic=0.1)) < stroke(IDEAL)


def test_friction_holds_the_position_back_at_every_speed():
    gaps = []
    for frequency in (1.0, 10.0):
        time, voltage = triangle(frequency, 90.0, 3, 2000)
        plain = simulate(IDEAL, time, voltage).displacement[4000:]
        rubbed = simulate(device('friction'), time, voltage).displacement[4000:]
        gaps.append((plain - rubbed)[500] - (plain - rubbed)[1500])
    # 5 N both ways over the stiffness of the driven stack, 37 to 75 N/um.
    assert 2 * 5.0 / 75e6 < gaps[0] < 2 * 5.0 / 37e6 * 1.15
    assert gaps[1] == pytest.approx(gaps[0], rel=0.02)


@pytest.mark.parametrize('damping_ratio', [0.01, 0.05])
def test_quality_of_a_resonance_is_that_of_its_damping_ratio(damping_ratio):
    target = device('mechanical_resonance', participation=1.0, frequency=2000.0,
                    damping_ratio=damping_ratio)
    cycles = round(3.0 / damping_ratio)
    time, voltage = sine(2000.0, 0.0, 2.0, cycles, 100)
    gain = [abs(fundamental(time, simulate(dev, time, voltage).displacement, 2000.0, 4))
            for dev in (IDEAL, target)]
    assert gain[1] / gain[0] == pytest.approx(0.5 / damping_ratio, rel=0.02)


@pytest.mark.parametrize('frequency', [1500.0, 2000.0, 3300.0])
def test_two_modes_of_a_structure_add_up_and_neither_moves_the_other(frequency):
    first = {'participation': 0.3, 'frequency': 2000.0, 'damping_ratio': 0.02}
    second = {'second_participation': -0.1, 'second_frequency': 3300.0,
              'second_damping_ratio': 0.05}
    time, voltage = sine(frequency, 0.0, 2.0, 150, 100)
    plain, rings = (fundamental(time, simulate(dev, time, voltage).displacement, frequency, 4)
                    for dev in (IDEAL, device('mechanical_resonance', **first, **second)))

    def swing(part, natural, ratio):
        at = frequency / natural
        return part * (1.0 / (1.0 - at ** 2 + 2.0j * ratio * at) - 1.0)

    assert rings / plain == pytest.approx(
        1.0 + swing(*first.values()) + swing(*second.values()), rel=0.02)


def test_a_stop_is_met_at_its_gap():
    time, voltage = triangle(1.0, 90.0, 2, 2000)
    plain = simulate(IDEAL, time, voltage).displacement
    stopped = simulate(device('contact', gap=8e-6, stiffness=1e9), time, voltage).displacement
    before = np.argmax(plain > 8e-6) - 1
    assert np.abs(stopped - plain)[:before].max() < 1e-12
    assert 8.0e-6 < stopped.max() < 8.3e-6


@pytest.mark.parametrize('exponent', [1.0, 1.5, 1.9])
def test_a_stop_pushes_back_with_the_power_of_the_indentation(exponent):
    time, voltage = triangle(0.1, 90.0, 2, 2000)
    gap, stiffness = 7e-6, 3e7
    answer = simulate(device('contact', gap=gap, stiffness=stiffness, exponent=exponent),
                      time, voltage)
    q, x = answer.charge, answer.displacement
    # At rest Eqs. 11, 14 and 15 leave the stop what the transducer has over the spring.
    pushed = 10.0 * (q - 10.0 * x) / 1.2e-6 - 6e6 * x
    deep = np.maximum(x - gap, 0.0)
    assert deep.max() > 1e-6
    assert pushed == pytest.approx(stiffness * deep * (deep / 1e-6) ** (exponent - 1.0), abs=1e-3)


def test_the_end_bounces_on_a_ball_as_its_equation_of_motion_says():
    time = np.linspace(0.0, 1e-3, 1001)
    charge = 8e-5  # at once, so that the end swings about 7.5 um
    target = device('contact', gap=6e-6, stiffness=4e7, exponent=1.5)

    def motion(_, state):
        x, w = state
        stop = 4e10 * max(x - 6e-6, 0.0) ** 1.5
        return w, (10.0 * (charge - 10.0 * x) / 1.2e-6 - 6e6 * x - 150.0 * w - stop) / 3.75e-3

    exact = solve_ivp(motion, (0.0, 1e-3), (0.0, 0.0), t_eval=time, rtol=1e-10, atol=1e-16,
                      max_step=2e-7).y[0]
    assert exact.max() > 8e-6 and 6e-6 < exact[-1]
    answer = simulate(target, time, np.full(time.size, charge), drive='charge')
    assert answer.displacement == pytest.approx(exact, abs=2e-10)


def test_a_mount_creeps_more_in_displacement_than_in_charge():
    target = device('mount_creep', power=0.0).with_effects({'amplifier_bandwidth': SOURCE})
    response = simulate(target, DECADES, np.full(DECADES.size, 90.0))
    shares = []
    for y in (response.displacement, response.charge):
        shares.append((at(DECADES, y, 10.0) - at(DECADES, y, 1.0)) / at(DECADES, y, 0.1))
    assert shares[0] == pytest.approx(0.01, rel=0.1)
    # What the motion draws at constant voltage: dq = T/(1 + C K) dx (Eqs. 11, 12).
    drawn = 10.0 / (1.0 + 1.2e-6 * 0.5e6) * 12.4e-6 / 133e-6
    assert shares[1] / shares[0] == pytest.approx(drawn, rel=0.03)


def test_a_mount_that_yields_with_a_power_of_time_gives_less_in_each_decade():
    target = device('mount_creep', power=0.1).with_effects({'amplifier_bandwidth': SOURCE})
    x = simulate(target, DECADES, np.full(DECADES.size, 90.0)).displacement
    early, late = (at(DECADES, x, 10.0 * since) - at(DECADES, x, since) for since in (0.3, 3.0))
    assert late / early == pytest.approx(10.0 ** -0.1, rel=0.03)


def test_a_mount_relaxes_by_the_modified_power_law():
    branches = {}

    class Recorder:
        reference = SimpleNamespace(stiffness=1e7)

        def add_state(self, name, rates):
            branches[name] = [1.0 / rates['displacement'], 0.0]

        def add_force(self, gains):
            name, = gains.keys() - {'displacement'}
            branches[name][1] = gains[name]

    power, onset, since = 0.12, 2e-3, 0.1
    EFFECTS['mount_creep'].apply(Recorder(), 0.02, power, onset, since)
    times, stiffness = np.array(list(branches.values())).T
    t = np.geomspace(onset / 10.0, 5.0, 40)
    yielded = stiffness @ np.exp(-np.outer(1.0 / times, t))
    # Williams 1964: the spectrum tau^-n exp(-onset/tau) adds up to Gamma(n) (onset + t)^-n.
    whole = 2e5 / math.log(10.0) * math.gamma(power) * ((onset + t) / since) ** -power
    assert np.diff(yielded) == pytest.approx(np.diff(whole), rel=0.025)


# -- environment and sensor ---------------------------------------------------------


@pytest.mark.parametrize('hours', [0.1, 6.0])
def test_thermal_drift_goes_on_for_hours(hours):
    seconds = hours * 3600.0
    time = np.linspace(0.0, seconds, 61)
    x = simulate(device('thermal_drift'), time, np.zeros(61)).displacement
    assert x == pytest.approx(2e-7 * (1.0 - np.exp(-time / 300.0)), abs=1e-13)


def test_a_disturbance_is_there_at_rest_with_its_amplitude_and_frequency():
    time = np.arange(4000) * 5e-5
    zero = np.zeros(4000)
    seen = simulate(device('periodic_disturbance'), time, zero).displacement
    assert seen == pytest.approx(2e-8 * np.sin(100.0 * math.pi * time), abs=1e-14)
    twice = only('periodic_disturbance', displacement=2e-8, harmonic=5e-9, harmonic_phase=1.0)
    assert simulate(twice, time, zero).displacement - seen == pytest.approx(
        5e-9 * np.sin(200.0 * math.pi * time + 1.0), abs=1e-14)
    pushed = simulate(only('periodic_disturbance', force=1.0), time, zero, drive='open')
    amplitude = abs(fundamental(time, pushed.displacement, 50.0))
    assert amplitude == pytest.approx(1.0 / 89.3333e6, rel=1e-3)


def test_a_sensor_lag_halves_the_power_at_its_bandwidth():
    (gain, lag), (base, lead) = (lags(target, 1000.0)[2] for target in (
        only('sensor_lag', time_constant=1.0 / (2.0 * math.pi * 1000.0)), IDEAL))
    assert gain / base == pytest.approx(math.sqrt(0.5), rel=1e-3)
    assert lag - lead == pytest.approx(45.0, abs=0.2)


def test_a_sensor_with_a_filter_loses_half_the_amplitude_where_each_loses_half_the_power():
    tau = 1.0 / (2.0 * math.pi * 1000.0)
    (gain, lag), (base, lead) = (lags(target, 1000.0)[2] for target in (
        only('sensor_lag', time_constant=2.0 * tau, quality_factor=0.5), IDEAL))
    assert gain / base == pytest.approx(0.5, rel=1e-3)
    assert lag - lead == pytest.approx(90.0, abs=0.3)


def test_a_quality_of_next_to_nothing_is_one_pole():
    time, voltage = sine(100.0, 0.0, 60.0, 2, 100)
    one, two = (simulate(only('sensor_lag', time_constant=1e-3, quality_factor=quality), time,
                         voltage).displacement for quality in (0.0, 1e-200))
    assert np.array_equal(one, two)


@pytest.mark.parametrize('quality', [0.3, 0.577, 0.707, 1.0])
def test_a_sensor_with_a_filter_of_second_order_has_its_quality_at_its_corner(quality):
    tau = 1.0 / (2.0 * math.pi * 1000.0)
    (gain, lag), (base, lead) = (lags(target, 1000.0)[2] for target in (
        only('sensor_lag', time_constant=tau / quality, quality_factor=quality), IDEAL))
    assert gain / base == pytest.approx(quality, rel=1e-3)
    assert lag - lead == pytest.approx(90.0, abs=0.3)


@pytest.mark.parametrize('delay', [2e-4, 2.5e-4, 3.3e-5])
def test_a_sensor_delay_shifts_the_displacement_and_nothing_else(delay):
    time, voltage = sine(100.0, 0.0, 60.0, 2, 100)  # 0.1 ms rows: whole and split ones
    plain = simulate(IDEAL, np.arange(40001) * 5e-7, np.repeat(voltage, 200)[:40001])
    late = simulate(device('sensor_delay', delay=delay), time, voltage)
    shift = round(delay / 5e-7)
    wanted = np.concatenate([np.zeros(shift), plain.displacement])[::200][:201]
    assert np.abs(late.displacement - wanted).max() < 2e-10
    assert np.abs(late.charge - plain.charge[::200]).max() < 1e-10


def test_linearity_errors_of_a_sensor_vanish_at_both_ends():
    full = build_model(IDEAL).reference.stroke
    position = full * np.array([0.0, 0.5, 1.0 / math.sqrt(3.0), 1.0])

    def error(at=position, **values):
        model = build_model(only('sensor_nonlinearity', **values))
        return (model.reading_maps[0](at, 0.0) - at) / full

    wrong = error(quadratic=0.01, cubic=0.02)
    assert wrong[[0, 3]] == pytest.approx([0.0, 0.0], abs=1e-15)
    assert wrong[2] > wrong[1] > 0.01
    # The third turns back in the middle, alike on both sides of it.
    way = np.linspace(0.0, full, 1001)
    twice = error(way, quartic=0.03)
    assert twice[[0, 500, 1000]] == pytest.approx([0.0, 0.0, 0.0], abs=1e-15)
    assert twice.max() == pytest.approx(0.03, rel=1e-4)
    assert twice == pytest.approx(twice[::-1], abs=1e-15)


@pytest.mark.parametrize('name', ['quadratic', 'cubic', 'quartic'])
def test_beyond_the_stroke_an_error_of_linearity_goes_straight_on(name):
    model = build_model(only('sensor_nonlinearity', **{name: 0.01}))
    full, read = model.reference.stroke, model.reading_maps[0]
    step = 1e-4 * full
    for end, outwards in ((0.0, -step), (full, step)):
        inside, edge, near, far = (
            read(np.array([end + k * outwards]), 0.0)[0] for k in (-1, 0, 1, 3000))
        assert edge == pytest.approx(end, abs=1e-12 * full)
        # No corner at the end, and no bend after it.
        assert near - edge == pytest.approx(edge - inside, rel=1e-3)
        assert far - edge == pytest.approx(3000 * (near - edge), rel=1e-9)


# -- energy ------------------------------------------------------------------------

# A mode that is only read, and what a driver or a sensor does, carry no energy of the stack.
PASSIVE = ['transducer_ratio'] + [
    name for name, effect in EFFECTS.items()
    if effect.block in ('electrical', 'mechanical') and name != 'mechanical_resonance']


def work(response, voltage, force):
    """Return the work done on the device by source and force up to each row, in joules."""
    electrical = voltage[:-1] * np.diff(response.charge)  # the command holds from its row on
    mechanical = force[:-1] * np.diff(response.displacement)
    return np.concatenate([[0.0], np.cumsum(electrical + mechanical)])


@pytest.mark.parametrize('name', PASSIVE)
@pytest.mark.parametrize('strength', ['typical', 'upper', 'lower'])
def test_a_passive_effect_never_creates_energy(name, strength):
    values = {p.name: getattr(p, strength) if p.magnitude else p.typical
              for p in EFFECTS[name].parameters}
    if (name, strength) == ('asymmetric_hysteresis', 'lower'):
        values['cubic'] = -0.03  # both at their ends are refused
    target = IDEAL.with_effects({name: values}).replace(load={'mass': 0.01, 'stiffness': 1e6})
    random = np.random.default_rng(5)
    rows = 1500
    time = np.arange(rows) * 1e-4
    voltage = np.clip(np.cumsum(random.normal(0.0, 6.0, rows)), -40.0, 80.0)
    force = 60.0 * np.sin(2.0 * np.pi * 37.0 * time) + random.normal(0.0, 5.0, rows)
    energy = work(simulate(target, time, voltage, force), voltage, force)
    scale = np.ptp(energy)
    if name == 'initial_polarisation':
        return  # it starts with energy; the closed cycle below is its test
    assert energy.min() > -1e-6 * scale, 'a relaxed device cannot give energy away'


@pytest.mark.parametrize('name', PASSIVE)
def test_a_closed_cycle_only_loses_energy(name):
    time, voltage = sine(50.0, 0.0, 80.0, 6, 1000)
    force = -50.0 * (1.0 - np.cos(2.0 * np.pi * 50.0 * time + 1.0))
    energy = work(simulate(device(name), time, voltage, force), voltage, force)
    loss = energy[6000] - energy[5000]
    assert 2e-4 < loss < 4e-3  # 1.28 mJ a cycle at 90 V of the ideal stack


# -- who opens which loop ----------------------------------------------------------

FAMILY = {
    'command_delay': 'u-v', 'amplifier_bandwidth': 'u-v', 'amplifier_current_limit': 'u-v',
    'rate_dependent_hysteresis': 'v-q', 'sensor_lag': 'q-x', 'sensor_delay': 'q-x'}
PAIRS = ('u-v', 'v-q', 'q-x')
FREQUENCIES = (10.0, 100.0, 1000.0)


@pytest.fixture(scope='module')
def table():
    """Return lag (degrees) and gain added to each pair of signals, by effect and frequency."""
    ideal = {f: lags(IDEAL, f) for f in FREQUENCIES}
    rows = {}
    for name in FAMILY:
        for f in FREQUENCIES:
            pairs = zip(lags(device(name), f), ideal[f])
            rows[name, f] = [(lag - lag0, gain / gain0 - 1.0)
                             for (gain, lag), (gain0, lag0) in pairs]
    print(f'\n{"lag (degrees) and gain (%) added":36s}' + ''.join(f'{p:>18s}' for p in PAIRS))
    for (name, f), row in rows.items():
        print(f'{name:28s}{f:5.0f} Hz' + ''.join(f'{a:9.2f}{100 * g:9.2f}' for a, g in row))
    return rows


@pytest.mark.parametrize('name', FAMILY)
def test_each_of_the_lag_family_opens_its_own_loop(name, table):
    own = PAIRS.index(FAMILY[name])
    opened = [abs(lag) for lag, _ in table[name, 1000.0]]
    assert opened[own] > 2.0
    for pair, lag in enumerate(opened):
        if pair != own:
            assert lag < 0.35 * opened[own], PAIRS[pair]


@pytest.mark.parametrize('name, growth, gain', [
    ('command_delay', (9.9, 10.1), (-1e-3, 1e-3)),  # lag in proportion, gain flat
    ('sensor_delay', (9.9, 10.1), (-1e-3, 1e-3)),
    ('sensor_lag', (6.0, 9.9), (-0.4, -0.2)),  # lag saturates, gain falls
    ('amplifier_bandwidth', (8.0, 20.0), (-0.1, -0.01)),
    ('amplifier_current_limit', (50.0, math.inf), (-0.2, -0.01)),  # nothing, then a lot
    ('rate_dependent_hysteresis', (3.0, 30.0), (-0.1, -0.01)),
])
def test_how_a_lag_grows_from_100_to_1000_hertz(name, growth, gain, table):
    pair = PAIRS.index(FAMILY[name])
    slow, fast = table[name, 100.0][pair], table[name, 1000.0][pair]
    assert growth[0] < fast[0] / max(slow[0], 1e-3) < growth[1]
    assert gain[0] < fast[1] < gain[1]


def test_a_current_limit_depends_on_amplitude_and_a_resistance_does_not():
    added = {}
    for name, given in (('amplifier_current_limit', {'output_resistance': 1.0}),
                        ('amplifier_bandwidth', {})):
        for high in (25.0, 60.0):
            lag = lags(device(name, **given), 1000.0, high=high)[0][1]
            added[name, high] = lag - lags(IDEAL, 1000.0, high=high)[0][1]
    assert added['amplifier_current_limit', 25.0] < 0.1
    assert added['amplifier_current_limit', 60.0] > 2.0
    assert added['amplifier_bandwidth', 25.0] == pytest.approx(
        added['amplifier_bandwidth', 60.0], rel=0.3)


def test_the_mixed_probe_stays_in_the_range_of_the_table():
    time, voltage, force = mixed()
    assert not simulate(IDEAL, time, voltage, force).charge_out_of_range
