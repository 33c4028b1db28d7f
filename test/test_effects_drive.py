# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""The driver: rise times, rails, limits and delays, against published or recomputed numbers."""

import math

from effect_probes import device, fundamental, IDEAL, only, rise_time, sine, triangle
import numpy as np
from piezo_stack_sim.plant import Device, simulate
from piezo_stack_sim.plant.build import build_model
import pytest

SOURCE = {'output_resistance': 50.0}  # ohm, keeps a step from ringing past its end


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
