# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""From a gap to its cause to a parameter file to a running node, and the gap is gone."""

import json
import subprocess
import sys

import pytest
from ros_process import ENVIRONMENT, FIRST_START, PATIENCE

pytest.importorskip('rclpy')

from piezo_stack_sim.examples import walkthrough  # noqa: E402, I100
from piezo_stack_sim.plant.parameters import Device, load_device  # noqa: E402, I100

SEED = 11


@pytest.fixture(scope='module')
def walked(tmp_path_factory):
    """Return the folder of one walk by two nodes and what it printed."""
    folder = tmp_path_factory.mktemp('walk') / 'walkthrough'
    done = subprocess.run(
        [sys.executable, '-m', 'piezo_stack_sim.examples.walkthrough', '--seed', str(SEED),
         '--out', str(folder)],
        env=ENVIRONMENT, capture_output=True, text=True, timeout=FIRST_START + 10 * PATIENCE)
    assert done.returncode == 0, done.stderr
    return folder, done.stdout


@pytest.fixture(scope='module')
def diagnosis(walked):
    """Return what was diagnosed."""
    return json.loads((walked[0] / 'diagnosis' / 'diagnosis.json').read_text())


def test_the_diagnosis_finds_the_secret(walked, diagnosis):
    assert diagnosis['verdict'] == 'CAUSE'
    assert diagnosis['selected'] == list(walkthrough.secret_device(SEED).effects)
    assert f'the secret was: {diagnosis["selected"][0]}' in walked[1]


@pytest.mark.parametrize('stage', ['before', 'after'])
def test_the_running_node_shows_the_gap_that_the_diagnosis_claims(walked, diagnosis, stage):
    folder, _ = walked
    shown = walkthrough.powers(folder / 'real', folder / stage, Device.nominal())
    assert set(shown) == {'voltage', 'charge', 'displacement'}
    for channel, power in shown.items():
        assert power == pytest.approx(diagnosis['shrinkage'][channel][stage], rel=1e-6), channel


def test_started_again_from_corrected_yaml_the_gap_is_gone(walked):
    folder, output = walked
    before, after = (walkthrough.powers(folder / 'real', folder / stage, Device.nominal())
                     for stage in ('before', 'after'))
    for channel in ('charge', 'displacement'):
        assert after[channel] < 0.01 * before[channel]
    # What remains is the noise of the sensors.
    assert after['displacement'] ** 0.5 < 1.1 * walkthrough.NOISE['displacement']
    assert after['charge'] ** 0.5 < 1.1 * walkthrough.NOISE['charge']


def test_the_corrected_file_holds_the_effect_about_as_large_as_it_is(walked, diagnosis):
    found = load_device(walked[0] / 'diagnosis' / 'corrected.yaml').effects
    for name, values in walkthrough.secret_device(SEED).effects.items():
        for parameter in values:
            if parameter == 'gain_per_decade':
                assert found[name][parameter] == pytest.approx(values[parameter], rel=0.1)


def test_the_pictures_are_drawn(walked):
    for name in ('traces.png', 'traces.svg', 'gap.png', 'gap.svg', 'diagnosis/report.html'):
        assert (walked[0] / name).stat().st_size > 5000


def test_the_secret_is_told_by_the_seed_alone():
    first, again = (walkthrough.secret_device(3) for _ in range(2))
    assert first == again
    names = {next(iter(walkthrough.secret_device(seed).effects)) for seed in range(40)}
    assert names == set(walkthrough.SECRETS)
