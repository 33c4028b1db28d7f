# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""The device as a circuit: ngspice, which knows nothing of the plant, computes the same."""

import subprocess

import numpy as np
from piezo_stack_sim.bench import ngspice
from piezo_stack_sim.cli import main
from piezo_stack_sim.errors import InputError
from piezo_stack_sim.plant import Device, simulate
from piezo_stack_sim.plant.spice import netlist, subcircuit
from piezo_stack_sim.resources import config_file
import pytest

DEVICE = Device.nominal()
PARAMS = str(config_file('ae0505d16.yaml'))
STROKE = 10.24e-6  # m, cycled, at 90 V
BAR = 0.005 * STROKE

with_ngspice = pytest.mark.skipif(not ngspice.available(), reason='ngspice is not installed')


def triangle(time, peak=90.0, frequency=100.0):
    return peak * (1.0 - np.abs((time * frequency) % 1.0 * 2.0 - 1.0))


@with_ngspice
def test_ngspice_agrees_on_the_90_volt_triangle():
    time = np.arange(2001) * 1e-5
    circuit = ngspice.run(DEVICE, time, triangle(time), held=True)
    plant = simulate(DEVICE, time, triangle(time))
    assert np.abs(circuit['displacement'] - plant.displacement).max() < BAR
    assert np.abs(circuit['charge'] - plant.charge).max() < 0.005 * np.ptp(plant.charge)
    # Rows as short as these are not what limits it: it is a hundred times better than the bar.
    assert np.abs(circuit['displacement'] - plant.displacement).max() < 2e-9


@with_ngspice
@pytest.mark.parametrize('drive', ['open', 'shorted'])
def test_ngspice_agrees_on_the_force_test(drive):
    time = np.arange(2001) * 1e-4
    force = -100.0 * (1.0 - np.cos(2 * np.pi * 10.0 * time))
    held = -100.0 * (1.0 - np.cos(2 * np.pi * 10.0 * (time + 0.5e-4)))  # in the middle of a row
    circuit = ngspice.run(DEVICE, time, 0 * time, force, drive, step=1e-5, held=False)
    plant = simulate(DEVICE, time, 0 * time, held, drive=drive)
    stroke = np.ptp(plant.displacement)
    assert np.abs(circuit['displacement'] - plant.displacement).max() < 0.005 * stroke


@with_ngspice
def test_ngspice_confirms_that_an_ideal_step_overshoots_the_hysteresis():
    time = np.arange(101) * 1e-5
    circuit = ngspice.run(DEVICE, time, np.full(time.size, 90.0), step=1e-8)
    assert circuit['displacement'][-1] == pytest.approx(16.06e-6, abs=0.05e-6)


@with_ngspice
def test_ngspice_agrees_with_a_load_and_with_a_clamp():
    time = np.arange(501) * 1e-5
    for load in ({'mass': 0.01, 'stiffness': 5e6, 'damping': 50.0}, {'clamped': True}):
        device = DEVICE.replace(load=load)
        circuit = ngspice.run(device, time, triangle(time))
        plant = simulate(device, time, triangle(time))
        assert np.abs(circuit['displacement'] - plant.displacement).max() < BAR
        assert np.abs(circuit['charge'] - plant.charge).max() < 0.005 * np.ptp(plant.charge)


def test_every_element_stands_in_the_netlist():
    text = subcircuit(DEVICE)
    for i, stiffness in enumerate(DEVICE.actuator.maxwell_stiffness, 1):
        assert f'CM{i} ' in text and f'{1.0 / stiffness:.12g}' in text and f'BM{i} ' in text


def test_an_element_that_does_not_slip_has_no_clamp():
    full = DEVICE.replace(actuator={
        'maxwell_break_voltage': (*DEVICE.actuator.maxwell_break_voltage[:-1], float('inf'))})
    assert 'CM10 ' in subcircuit(full) and 'BM10 ' not in subcircuit(full)


def test_the_netlist_names_the_effects_it_leaves_out():
    assert 'left out: amplifier_gain' in subcircuit(
        DEVICE.with_effects({'amplifier_gain': {'gain': 1.01}}))


def test_an_unknown_drive_is_refused():
    with pytest.raises(InputError, match='drive'):
        netlist(DEVICE, [0.0, 1.0], [0.0, 1.0], drive='sideways')


@with_ngspice
def test_the_exported_file_runs_as_it_is(tmp_path, capsys):
    path = tmp_path / 'stack.cir'
    assert main(['export', 'spice', '--params', PARAMS, '--out', str(path)]) == 0
    ended = subprocess.run(['ngspice', '-b', path.name], cwd=tmp_path, capture_output=True,
                           text=True, timeout=120)
    assert ended.returncode == 0
    last = [line.split() for line in ended.stdout.splitlines() if line[:1].isdigit()][-1]
    assert float(last[-1]) == pytest.approx(2.177, abs=0.02)  # um left after three cycles


def test_the_subcircuit_is_printed(capsys):
    assert main(['export', 'spice', '--params', PARAMS, '--subcircuit']) == 0
    assert capsys.readouterr().out == subcircuit(DEVICE)


def test_a_recording_is_played(tmp_path, capsys):
    path = tmp_path / 'squeeze.csv'
    path.write_text('time,voltage_command,external_force\n0,0,0\n0.001,5,-3\n0.002,5,-3\n')
    assert main(['export', 'spice', '--params', PARAMS, '--recording', str(path)]) == 0
    text = capsys.readouterr().out
    assert '+ 0.001 0\n+ 0.0010001 5\n' in text and '+ 0.0010001 -3\n' in text


@pytest.mark.parametrize('cell', ['nan', 'inf', ''])
def test_a_recording_with_cells_that_are_no_numbers_is_not_played(cell, tmp_path, capsys):
    path = tmp_path / 'squeeze.csv'
    path.write_text(f'time,voltage_command\n0,0\n0.001,{cell}\n0.002,5\n')
    assert main(['export', 'spice', '--params', PARAMS, '--recording', str(path)]) == 2
    out, error = capsys.readouterr()
    assert f'{path}: row 3: voltage_command is no finite number' in error and not out


def test_what_the_reader_found_of_a_recording_is_told(tmp_path, capsys):
    path = tmp_path / 'squeeze.csv'
    path.write_text('time_ms,voltage_command\n0,0\n1,5\n2,5\n')
    assert main(['export', 'spice', '--params', PARAMS, '--recording', str(path)]) == 0
    assert 'the header gives time in ms' in capsys.readouterr().err


@pytest.mark.parametrize('volts, status, words', [
    (1350, 2, 'far beyond the device'), (-90, 0, 'voltage_command is -90 V')])
def test_what_leaves_the_range_of_the_device_is_told_or_refused(
        volts, status, words, tmp_path, capsys):
    path = tmp_path / 'squeeze.csv'
    path.write_text(f'time,voltage_command\n0,0\n0.001,{volts}\n0.002,{volts}\n')
    assert main(['export', 'spice', '--params', PARAMS, '--recording', str(path)]) == status
    assert words in capsys.readouterr().err
