# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""The speed table. What is asserted is accuracy: speed is for people to read."""

import json

from piezo_stack_sim.bench import effects, ngspice
from piezo_stack_sim.bench.speed import measure
from piezo_stack_sim.cli import main
from piezo_stack_sim.commands.bench import _print_effects, _print_speed
from piezo_stack_sim.effects.registry import EFFECTS
import pytest


@pytest.fixture(scope='module')
def speed():
    return measure(quick=True)


def test_plant_and_peers_compute_the_same_device(speed):
    assert speed['reference']['displacement_error'] < 0.1e-9
    assert speed['plant']['displacement_error'] < 0.1e-9
    assert speed['plant']['charge_error'] < 1e-9
    for peer in speed['peers']:
        assert peer['displacement_error'] < 5e-9, peer['name']
        assert peer['charge_error'] < 50e-9, peer['name']


def test_the_table_holds_every_programme_and_peer(speed, capsys):
    names = [peer['name'] for peer in speed['peers']]
    assert len(names) == 3 + ngspice.available()
    assert set(speed['plant']['programmes']) == {
        'triangle', 'decay', 'steps', 'multisine', 'force'}
    _print_speed(json.loads(json.dumps(speed)))
    text = capsys.readouterr().out
    assert all(name in text for name in (*names, 'multisine', 'extrapolated'))


def test_the_cost_of_every_effect_is_listed(monkeypatch, capsys):
    monkeypatch.setattr(effects, 'TURNS', 1)
    monkeypatch.setattr(effects, 'TURNS_NEUTRAL', 1)
    cost = effects.measure()
    assert set(cost['effects']) == set(EFFECTS)
    for row in (cost['neutral'], cost['all'], *cost['effects'].values()):
        assert row['ratio'] > 0.0 and row['time'] > 0.0
    _print_effects(json.loads(json.dumps(cost)))
    text = capsys.readouterr().out
    assert all(name.replace('_', ' ') in text for name in EFFECTS)


def test_a_wrong_parameter_file_ends_the_bench_at_once(capsys):
    assert main(['bench', '--params', 'nowhere.yaml']) == 2
    assert 'nowhere.yaml' in capsys.readouterr().err
