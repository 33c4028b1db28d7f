# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""``piezo_stack effects``, the pages it writes, and the realistic device."""

from pathlib import Path
import re
import types

from effect_probes import IDEAL
import numpy as np
from piezo_stack_sim.cli import main
from piezo_stack_sim.effects import registry
from piezo_stack_sim.effects.registry import EFFECTS
from piezo_stack_sim.plant import load_device, Plant, simulate
from piezo_stack_sim.resources import config_file
from piezo_stack_sim.signature.experiment import experiments, telling
from piezo_stack_sim.signature.page import page
import pytest
import yaml

DOCUMENTATION = Path(__file__).resolve().parent.parent / 'doc' / 'effects'
REALISTIC = config_file('ae0505d16_realistic.yaml')


def test_all_effects_are_listed_with_their_block(capsys):
    assert main(['effects']) == 0
    out = capsys.readouterr().out
    for name, effect in EFFECTS.items():
        assert f' {name} ' in out and effect.block in out


def test_one_effect_is_explained_and_drawn(capsys, tmp_path):
    assert main(['effects', 'friction', '--set', 'coulomb_force=20', '--out', str(tmp_path)]) == 0
    out = capsys.readouterr().out
    assert 'coulomb_force' in out and 'Look-alikes' in out and 'coulomb_force = 20' in out
    picture = tmp_path / 'friction.png'
    assert str(picture) in out
    assert picture.read_bytes().startswith(b'\x89PNG')


@pytest.mark.parametrize('arguments, words', [
    (['crep'], "did you mean 'creep'"),
    (['friction', '--all'], 'give one effect or --all'),
    (['friction', '--set', 'force=5'], 'coulomb_force, presliding'),
    (['friction', '--set', 'coulomb_force=much'], "'much' is not a number"),
    (['friction', '--set', 'coulomb_force=500'], 'from 0 to 50 N'),
    (['friction', '--test', 'square'], 'triangle, sine, step'),
    (['--set', 'coulomb_force=5'], 'needs the id of an effect'),
])
def test_wrong_arguments_are_told_in_one_line(arguments, words, capsys, tmp_path):
    assert main(['effects', *arguments, '--out', str(tmp_path)]) == 2
    error = capsys.readouterr().err
    assert words in error and error.count('\n') == 1


@pytest.mark.parametrize('name, test, channel', [
    ('creep', 'hold', 'displacement'), ('leakage', 'hold', 'charge'),
    ('thermal_drift', 'wait', 'displacement'), ('series_compliance', 'push', 'displacement'),
    ('sensor_delay', 'step', 'displacement'), ('contact', 'triangle', 'displacement'),
    ('periodic_disturbance', 'rest', 'displacement')])
def test_an_effect_is_shown_in_the_test_that_tells_most(name, test, channel):
    assert telling(EFFECTS[name], IDEAL, EFFECTS[name].typical()) == (test, channel)
    assert test in experiments()


@pytest.mark.parametrize('name', EFFECTS)
def test_the_documentation_has_the_page_and_the_picture_of_an_effect(name):
    if not DOCUMENTATION.is_dir():
        pytest.skip('not a checkout')
    written = (DOCUMENTATION / f'{name}.md').read_text(encoding='utf-8')
    assert written == page(EFFECTS[name]), 'piezo_stack effects --all --out doc/effects'
    assert f'({name}.md)' in (DOCUMENTATION / 'README.md').read_text(encoding='utf-8')
    assert (DOCUMENTATION / f'{name}.png').stat().st_size < 60_000
    snippet = yaml.safe_load(re.search('```yaml\n(.*?)```', written, re.S)[1])
    effect = EFFECTS[name]
    assert effect.values(snippet['effects'][name]) == pytest.approx(effect.typical())


def test_the_effect_of_the_contributor_page_works(monkeypatch):
    if not DOCUMENTATION.is_dir():
        pytest.skip('not a checkout')
    text = (DOCUMENTATION / 'adding.md').read_text(encoding='utf-8')
    module = types.ModuleType('sense_capacitor')
    exec(re.search('```python\n(# Copyright.*?)```', text, re.S)[1], module.__dict__)
    effect = module.EFFECT
    monkeypatch.setitem(registry.EFFECTS, effect.id, effect)
    time = np.concatenate([np.linspace(0.0, 1.0, 101), np.linspace(2.0, 301.0, 300)])
    voltage = 90.0 * np.minimum(time, 1.0)
    ideal = simulate(IDEAL, time, voltage)
    burdened = simulate(IDEAL.with_effects({effect.id: effect.typical()}), time, voltage)
    lost = ideal.displacement - burdened.displacement
    assert 1.3 * 0.11e-6 < lost[102] < 1.3 * 0.2e-6, '1.3 V of 90 V'
    assert abs(lost[-1]) < 0.25 * lost[102], 'the resistor gives it back, but for the loop'
    assert burdened.charge[-1] < 0.06 * ideal.charge[-1], 'and the reading sinks'
    neutral = simulate(IDEAL.with_effects({effect.id: {}}), time, voltage)
    assert np.array_equal(neutral.displacement, ideal.displacement)


def test_the_realistic_device_has_a_source_for_every_value_and_runs():
    text = REALISTIC.read_text(encoding='utf-8')
    section = text[text.index('effects:'):text.index('rate:')]
    lines = [line.strip() for line in section.splitlines()]
    for before, line in zip(lines, lines[1:]):
        if line.startswith(('#', 'noise:', 'amplifier_current_limit')) or not line:
            continue  # the limit shares the comment of the driver above it
        assert '#' in line or before.startswith('#'), line
    device = load_device(REALISTIC)
    blocks = {EFFECTS[name].block for name in device.effects}
    assert {'drive', 'electrical', 'sensor'} <= blocks
    plant = Plant(device)
    command = 75.0 - 75.0 * np.cos(2.0 * np.pi * 5.0 * np.arange(1000) * 1e-3)
    response = plant.run(command)
    assert not response.charge_out_of_range
    assert 15e-6 < np.ptp(response.displacement) < 24e-6  # data sheet: 17.4 um at 150 V
    again = Plant(device).run(command)
    assert np.array_equal(response.displacement, again.displacement), 'noise is seeded'
    quiet = Plant(device, noise=False).run(command)
    assert 5e-10 < np.std(response.displacement - quiet.displacement) < 3e-9
