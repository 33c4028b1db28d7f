# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""``piezo_stack from-datasheet``: an actuator that shows what its catalogue says."""

import math
from pathlib import Path
import re

from piezo_stack_sim.cli import main
from piezo_stack_sim.identify.datasheet import actuator_from, DataSheet
from piezo_stack_sim.plant import load_device, simulate
from piezo_stack_sim.plant.analysis import voltage_row
from piezo_stack_sim.plant.parameters import Device
import pytest

SHEET = {'free_stroke': 17.4e-6, 'blocking_force': 850.0, 'capacitance': 1.4e-6,
         'voltage_range': (0.0, 150.0), 'resonance': 34.5e3}
ARGUMENTS = ['from-datasheet', '--free-stroke', '17.4e-6', '--blocking-force', '850',
             '--capacitance', '1.4e-6', '--voltage-range', '0', '150']


@pytest.mark.parametrize('hysteresis', [0.08, 0.15, 0.2])
def test_the_actuator_shows_stroke_charge_loop_and_force_of_its_sheet(hysteresis):
    actuator, _ = actuator_from(DataSheet(**SHEET, hysteresis=hysteresis))
    row = voltage_row(Device(actuator), 150.0)
    assert row.stroke == pytest.approx(17.4e-6, rel=0.01)
    assert row.capacitance == pytest.approx(1.4e-6, rel=0.01)
    assert row.loop_width_share == pytest.approx(hysteresis, rel=0.02)
    assert row.blocked_force == pytest.approx(850.0, rel=0.05)


def test_a_sheet_of_a_bigger_stack_scales():
    actuator, _ = actuator_from(DataSheet(80e-6, 3500.0, 20e-6, (-20.0, 120.0), mass=0.08))
    row = voltage_row(Device(actuator.replace(voltage_range=(0.0, 140.0))), 140.0)
    assert row.stroke == pytest.approx(80e-6, rel=0.02)
    assert actuator.mass == pytest.approx(0.08 / 3.0)


def test_the_file_loads_runs_and_says_what_was_assumed(tmp_path, capsys):
    out = tmp_path / 'sheet.yaml'
    assert main([*ARGUMENTS, '--length', '0.02', '--area', '25e-6', '--out', str(out)]) == 0
    text = out.read_text(encoding='utf-8')
    for word in ('not measured', 'density 7500', 'hysteresis 0.15', 'damping ratio'):
        assert word in text
    assert 'density' in capsys.readouterr().out
    device = load_device(out)
    assert math.isinf(device.actuator.maxwell_break_voltage[-1])
    response = simulate(device, [0.0, 0.01, 0.02], [100.0, 100.0, 100.0])
    assert 5e-6 < response.displacement[-1] < 20e-6


SIZE = ['--length', '0.02', '--area', '2.5e-5']


@pytest.mark.parametrize('more, mass, words', [
    (['--mass', '0.016', *SIZE, '--resonance', '69000'], 2.6e-4, [
        'of --resonance, although --mass says 20.5 times as much, --length with --area says '
        '4.81 times as much', 'give half of it, --resonance 34500']),
    (['--mass', '0.016', *SIZE], 0.016 / 3.0, [
        'of --mass, although --length with --area says 0.234 times as much']),
    ([*SIZE, '--resonance', '34500'], 1.04e-3, []),
    (['--mass', '0.0037', *SIZE, '--resonance', '34500'], 1.04e-3, [])])
def test_numbers_for_the_mass_that_disagree_are_told_in_one_line(
        more, mass, words, tmp_path, capsys):
    out = tmp_path / 'sheet.yaml'
    assert main([*ARGUMENTS, *more, '--out', str(out)]) == 0
    printed = capsys.readouterr().out
    told = [line for line in printed.splitlines() if 'although' in line]
    assert len(told) == bool(words)
    for word in words:
        assert word in told[0] and word in out.read_text(encoding='utf-8')
    assert load_device(out).actuator.mass == pytest.approx(mass, rel=0.01)


def test_the_stack_of_the_how_to_has_the_mass_of_its_size():
    # The 69 kHz of the stack free at both ends would give a quarter of it.
    by_size, _ = actuator_from(DataSheet(**{**SHEET, 'resonance': None}, length=0.02, area=25e-6))
    by_resonance, _ = actuator_from(DataSheet(**SHEET))
    assert by_resonance.mass == pytest.approx(by_size.mass, rel=0.2)


def test_the_how_tos_give_the_resonance_with_one_end_held():
    pages = Path(__file__).resolve().parent.parent / 'doc' / 'how-to'
    if not pages.is_dir():
        pytest.skip('the tests run outside a checkout')
    for page in pages.glob('*.md'):
        given = re.findall(r'--resonance (\d+)', page.read_text(encoding='utf-8'))
        assert set(given) <= {'34500'}, page.name


@pytest.mark.parametrize('arguments, words', [
    ([*ARGUMENTS], '--mass'),
    ([*ARGUMENTS, '--mass', '4e-3', '--hysteresis', '15'], '0.15'),
    ([*ARGUMENTS[:4], '8.5e6', *ARGUMENTS[5:], '--mass', '4e-3'],
     '--blocking-force 8.5e+06: expected N'),
    ([*ARGUMENTS[:-2], '150', '0', '--mass', '4e-3'], 'write 0 150'),
])
def test_wrong_numbers_are_named(arguments, words, tmp_path, capsys):
    assert main([*arguments, '--out', str(tmp_path / 'x.yaml')]) == 2
    error = capsys.readouterr().err
    assert words in error and error.count('\n') == 1


@pytest.mark.parametrize('option, given, meant', [
    ('--resonance', '69', '69000'), ('--capacitance', '1.4', '1.4e-06'), ('--mass', '16', '0.016'),
    ('--length', '20', '0.02'), ('--area', '25', '2.5e-05'),
    ('--free-stroke', '17.4', '1.74e-05'), ('--hysteresis', '15', '0.15')])
def test_a_number_in_another_unit_is_named_with_what_it_may_stand_for(
        option, given, meant, tmp_path, capsys):
    """What follows from it, a mass of 260 kg say, nobody has given."""
    out = tmp_path / 'x.yaml'
    assert main([*ARGUMENTS, option, given, '--out', str(out)]) == 2
    said = capsys.readouterr().err.strip()
    assert said.startswith(f'{option} {given}: expected ') and said.endswith(f'write {meant}')
    assert '\n' not in said and not out.exists()
