# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""From bags to an identified file to a running node: the way of an experimentalist."""

import numpy as np
from piezo_stack_sim.cli import main
from piezo_stack_sim.plant import load_device, simulate
from piezo_stack_sim.recording import write_bag
from piezo_stack_sim.recording.write import write_csv_set
import pytest
from ros_process import Client, node_arguments, NodeProcess, SPACE
from test_identify import answered, noisy, push, quick, slow, STACK


@pytest.fixture(scope='module')
def measured():
    return noisy(answered(slow(), quick(), push()), 4)


@pytest.fixture(scope='module')
def from_bags(measured, tmp_path_factory):
    folder = tmp_path_factory.mktemp('bags')
    (folder / 'set').mkdir()
    for recording in measured:
        write_bag(recording, folder / 'set' / recording.name)
    out = folder / 'actuator.yaml'
    assert main(['identify', str(folder / 'set'), '--out', str(out), '--elements', '4']) == 0
    return out


def test_bags_tell_what_csv_files_tell(measured, from_bags, tmp_path):
    write_csv_set(measured, tmp_path / 'set')
    out = tmp_path / 'actuator.yaml'
    assert main(['identify', str(tmp_path / 'set'), '--out', str(out), '--elements', '4']) == 0
    ours, theirs = load_device(from_bags).actuator, load_device(out).actuator
    for name in ('mass', 'damping', 'linear_capacitance', 'transformer_ratio'):
        assert getattr(ours, name) == pytest.approx(getattr(theirs, name), rel=2e-3), name
    assert ours.maxwell_stiffness == pytest.approx(theirs.maxwell_stiffness, rel=2e-3)


def test_the_identified_file_starts_a_node_that_answers_as_the_stack_does(from_bags):
    node = NodeProcess(*node_arguments('stepping:=lockstep', 'rate:=1000.0', file=from_bags,
                                       name='identified'))
    client = Client(f'{SPACE}/identified')
    client.connect()
    voltages = 40.0 - 40.0 * np.cos(2.0 * np.pi * 25.0 * np.arange(80) * 1e-3)
    client.send('voltage_command', *voltages)
    heard = np.array([row[0] for row in client.wait_for_states(80)])
    client.close()
    node.end()
    time = np.arange(81) * 1e-3
    true = simulate(STACK, time, np.append(voltages, 0.0)).displacement[1:]
    assert np.abs(heard - true).max() < 2e-3 * np.ptp(true)
