# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the parameters imply: the facts of the paper's device, recomputed without the plant."""

from dataclasses import replace
import json
import math

import numpy as np
from piezo_stack_sim.cli import main
from piezo_stack_sim.errors import InputError
from piezo_stack_sim.plant import Device, simulate
from piezo_stack_sim.plant.analysis import analyse, charge_gain, damping_ratio
from piezo_stack_sim.plant.analysis import largest_voltage, mechanics, natural_frequency
from piezo_stack_sim.plant.analysis import open_stiffness, resonance_circuit, shorted_stiffness
from piezo_stack_sim.plant.analysis import small_signal_capacitance, voltage_row
from piezo_stack_sim.plant.quasi_static import cycle, force_cycle, lead
from piezo_stack_sim.plant.response import charge_to_displacement, impedance, simulated
from piezo_stack_sim.resources import config_file
import pytest

DEVICE = Device.nominal()
FULL = DEVICE.replace(actuator={
    'maxwell_break_voltage': (*DEVICE.actuator.maxwell_break_voltage[:-1], math.inf)})
CLAMPED = DEVICE.replace(load={'clamped': True})
MICRO = 1e6


@pytest.mark.parametrize('voltage, charge, displacement', [
    (10, 7.958683, 0.742414),
    (30, 32.362925, 3.018930),
    (60, 79.140940, 7.382550),
    (90, 133.100671, 12.416107),
    (100, 151.087248, 14.093960),
])
def test_first_rise_from_the_relaxed_state(voltage, charge, displacement):
    path = lead(DEVICE, voltage)
    assert path.charge[-1] * MICRO == pytest.approx(charge, abs=1e-5)
    assert path.displacement[-1] * MICRO == pytest.approx(displacement, abs=1e-5)


def test_a_path_does_not_depend_on_how_finely_it_is_led():
    coarse = lead(DEVICE, [90.0, 20.0, 70.0], [-50.0, 10.0, 0.0])
    legs = [np.linspace(a, b, 200)[1:] for a, b in ((0, 90), (90, 20), (20, 70))]
    pushes = [np.linspace(a, b, 200)[1:] for a, b in ((0, -50), (-50, 10), (10, 0))]
    fine = lead(DEVICE, np.concatenate(legs), np.concatenate(pushes))
    assert fine.charge[-1] == pytest.approx(coarse.charge[-1], rel=1e-9)
    assert fine.dissipated[-1] == pytest.approx(coarse.dissipated[-1], rel=1e-9)


@pytest.mark.parametrize('device, voltage, stroke', [
    (DEVICE, 90, 10.24), (DEVICE, 100, 11.66), (FULL, 150, 19.80)])
def test_cycled_stroke_is_the_one_of_the_data_sheet(device, voltage, stroke):
    assert voltage_row(device, voltage).stroke * MICRO == pytest.approx(stroke, abs=0.005)


def test_a_settled_cycle_closes():
    for path in (cycle(DEVICE, 0.0, 90.0), force_cycle(DEVICE, -200.0, 0.0)):
        assert path.displacement[0] == pytest.approx(path.displacement[-1], abs=1e-15)


def test_energy_lost_in_a_cycle_is_the_area_of_the_loop():
    path = cycle(DEVICE, 0.0, 90.0, points=4001)
    area = np.sum((path.voltage[1:] + path.voltage[:-1]) / 2 * np.diff(path.charge))
    assert area == pytest.approx(path.dissipated[-1], rel=1e-5)
    assert path.dissipated[-1] == pytest.approx(1.28e-3, rel=0.005)


def test_open_leads_are_stiff_and_show_no_hysteresis():
    path = lead(DEVICE, [0.0, 0.0, 0.0], [-200.0, -100.0, 0.0], drive='charge')
    assert open_stiffness(DEVICE) == pytest.approx(89.3333e6, rel=1e-6)
    assert path.displacement * MICRO == pytest.approx([-2.238806, -1.119403, 0.0], abs=1e-6)
    assert path.dissipated[-1] == 0.0


def test_shorted_leads_are_soft_and_remember():
    path = lead(DEVICE, [0.0, 0.0], [-200.0, 0.0])
    assert path.displacement * MICRO == pytest.approx([-3.84083, -0.22560], abs=1e-5)
    assert shorted_stiffness(DEVICE) == pytest.approx(74.9655e6, rel=1e-6)
    assert shorted_stiffness(DEVICE, 10) == pytest.approx(37.25e6, rel=1e-6)
    assert shorted_stiffness(DEVICE, 11) == DEVICE.actuator.stiffness


def test_resonances():
    opened, stuck = open_stiffness(DEVICE), shorted_stiffness(DEVICE)
    assert natural_frequency(DEVICE, opened) == pytest.approx(24565, rel=1e-4)
    assert natural_frequency(DEVICE, stuck) == pytest.approx(22500, rel=1e-3)
    assert damping_ratio(DEVICE, opened) == pytest.approx(0.1296, rel=1e-3)


def test_resonance_circuit_reflects_the_mechanics():
    circuit = resonance_circuit(DEVICE)
    assert circuit.L1 == pytest.approx(37.5e-6)
    assert circuit.R1 == pytest.approx(1.5)
    assert circuit.C1 == pytest.approx(16.6667e-6, rel=1e-5)
    assert circuit.C0 == pytest.approx(1.2e-6)


def test_a_load_raises_L1_and_R1_lowers_C1_and_leaves_C0():
    bare = resonance_circuit(DEVICE)
    loaded = resonance_circuit(DEVICE.replace(
        load={'mass': 0.01, 'damping': 50.0, 'stiffness': 1e6}))
    assert loaded.L1 > bare.L1 and loaded.R1 > bare.R1 and loaded.C1 < bare.C1
    assert loaded.C0 == bare.C0


def test_capacitances_and_gain():
    assert small_signal_capacitance(DEVICE) == pytest.approx(0.247e-6, rel=2e-3)
    assert small_signal_capacitance(DEVICE, clamped=True) == pytest.approx(0.207e-6, rel=2e-3)
    assert voltage_row(DEVICE, 90.0).capacitance == pytest.approx(1.22e-6, rel=2e-3)
    assert charge_gain(DEVICE) == pytest.approx(0.0932836, rel=1e-6)


def test_small_signal_capacitance_is_the_slope_of_a_small_quasi_static_step():
    assert lead(DEVICE, 0.1).charge[-1] / 0.1 == pytest.approx(small_signal_capacitance(DEVICE))
    assert lead(CLAMPED, 0.1).charge[-1] / 0.1 == pytest.approx(small_signal_capacitance(CLAMPED))


def test_blocked_force():
    assert voltage_row(DEVICE, 100.0).blocked_force == pytest.approx(529, abs=0.5)
    assert voltage_row(DEVICE, 150.0).blocked_force == pytest.approx(837.5, abs=0.5)


def test_loop_width_is_a_fifth_of_the_stroke():
    row = voltage_row(DEVICE, 90.0)
    assert row.loop_width_share == pytest.approx(0.198, abs=5e-4)
    assert row.loss_tangent == pytest.approx(0.167, abs=3e-3)


def test_voltages_at_which_the_last_element_slips_are_marked():
    assert largest_voltage(DEVICE) == pytest.approx(104.955, abs=1e-3)
    assert voltage_row(DEVICE, 104.0).in_range
    assert not voltage_row(DEVICE, 106.0).in_range
    assert math.isinf(largest_voltage(FULL)) and voltage_row(FULL, 150.0).in_range


def test_closed_form_and_simulated_responses_agree_to_one_percent():
    frequency = np.geomspace(10.0, 60e3, 14)
    gain, ohm = simulated(DEVICE, frequency)
    assert np.abs(gain / charge_to_displacement(DEVICE, frequency) - 1).max() < 0.01
    assert np.abs(ohm / impedance(DEVICE, frequency) - 1).max() < 0.01


def test_responses_agree_with_a_load_too():
    device = DEVICE.replace(load={'mass': 0.02, 'damping': 100.0, 'stiffness': 5e6})
    frequency = np.geomspace(100.0, 30e3, 6)
    gain, ohm = simulated(device, frequency)
    assert np.abs(gain / charge_to_displacement(device, frequency) - 1).max() < 0.01
    assert np.abs(ohm / impedance(device, frequency) - 1).max() < 0.01


def test_the_plant_led_slowly_goes_where_the_quasi_static_path_goes():
    time = np.arange(4001) * 1e-4
    voltage = 45.0 * (1.0 - np.cos(2 * np.pi * 10.0 * time)) * (1.0 - time)
    force = -30.0 * (1.0 - np.cos(2 * np.pi * 7.0 * time))
    plant = simulate(DEVICE, time, voltage, force)
    path = lead(DEVICE, voltage[:-1], force[:-1])
    # Each held step rings a little: 0.3 V and 2 nm where the command is steepest.
    assert np.abs(plant.displacement[1:] - path.displacement).max() < 0.03e-6
    assert np.abs(plant.charge[1:] - path.charge).max() < 0.3e-6


def test_an_actuator_with_one_linear_element_has_no_loop():
    actuator = replace(DEVICE.actuator, maxwell_stiffness=(0.7e6,),
                       maxwell_break_voltage=(math.inf,))
    row = voltage_row(Device(actuator), 100.0)
    assert row.loss == 0.0 and row.loop_width == pytest.approx(0.0, abs=1e-18)
    assert mechanics(Device(actuator)).mass == actuator.mass


def test_an_unknown_drive_is_refused():
    with pytest.raises(InputError, match='voltage or charge'):
        lead(DEVICE, 1.0, drive='open')


def test_analyse_prints_json_in_si_units(capsys):
    path = str(config_file('ae0505d16_full_range.yaml'))
    assert main(['analyse', '--params', path, '--json', '--voltage', '90']) == 0
    result = json.loads(capsys.readouterr().out)
    assert result['summary']['open_lead_stiffness']['value'] == pytest.approx(89.3333e6, rel=1e-5)
    assert result['summary']['largest_voltage']['value'] is None  # no limit: JSON has no infinity
    assert result['voltage'] == analyse(FULL, [90.0])['voltage']
    assert max(row['gain_deviation'] for row in result['response']) < 0.01


def test_analyse_prints_a_table(capsys):
    path = str(config_file('ae0505d16.yaml'))
    assert main(['analyse', '--params', path, '--voltage', '90', '--voltage', '120']) == 0
    text = capsys.readouterr().out
    assert '89.333 N/µm' in text and '10.239 µm' in text and 'beyond' in text


def test_analyse_refuses_a_voltage_of_zero(capsys):
    assert main(['analyse', '--params', str(config_file('ae0505d16.yaml')), '--voltage', '0']) == 2
    assert capsys.readouterr().err.count('\n') == 1


def test_a_last_element_that_never_slips_sets_no_limit(capsys):
    """The printed table stops at 105 V; an element that never slips is said to set no limit."""
    assert main(['analyse', '--params', str(config_file('ae0505d16_full_range.yaml'))]) == 0
    shown = capsys.readouterr().out
    assert 'no limit' in shown and 'element 10 never slips' in shown and ' inf ' not in shown
