# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""The ceramic: creep, leakage, history and bows, against published or recomputed numbers."""

import math

from effect_probes import at, device, IDEAL, only, sine, triangle
import numpy as np
from piezo_stack_sim.effects.registry import EFFECTS
from piezo_stack_sim.plant import Device, layout, Plant, simulate
from piezo_stack_sim.plant.build import build_model
import pytest
from scipy.integrate import trapezoid

DECADES = np.concatenate([[0.0], np.logspace(-2, 2, 41)])

SOURCE = {'output_resistance': 50.0}  # ohm, keeps a step from ringing past its end


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


def test_unequal_branches_do_not_slip_beyond_the_table():
    printed = Device.nominal().with_effects({'asymmetric_hysteresis': {'branch': 0.05}})
    plant = Plant(printed, 1e-3, 'voltage')
    plant.run(np.linspace(0.0, 20.0, 50))
    assert not plant.charge_out_of_range
    plant.run(np.linspace(20.0, 140.0, 500))
    assert plant.charge_out_of_range
