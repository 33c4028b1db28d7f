# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""The speed table. What is asserted is accuracy: speed is for people to read."""

import json

from piezo_stack_sim.bench import ngspice
from piezo_stack_sim.bench.speed import measure
from piezo_stack_sim.cli import main
from piezo_stack_sim.commands.bench import _print_speed
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


def test_a_wrong_parameter_file_ends_the_bench_at_once(capsys):
    assert main(['bench', '--params', 'nowhere.yaml']) == 2
    assert 'nowhere.yaml' in capsys.readouterr().err
