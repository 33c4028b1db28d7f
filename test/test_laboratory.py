# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A stage as laboratories record it: no charge, a sensor in volts of unknown scale that drifts.

It is made by the physics of the blind benchmark, not by that which is fitted to it.
"""

import json
import sys

import numpy as np
from piezo_stack_sim.cli import main
from piezo_stack_sim.errors import InputError
from piezo_stack_sim.examples import laboratory, walkthrough
from piezo_stack_sim.gap.compare import compare_set
from piezo_stack_sim.plant import Device, simulate
from piezo_stack_sim.recording import programmes, RecordingSet
from piezo_stack_sim.recording.mapping import is_displacement_arbitrary, parse_units
from piezo_stack_sim.recording.preflight import preflight
import pytest

COLUMNS = ['--map', 'voltage_command=out', '--map', 'displacement=sensor',
           '--unit', 'voltage_command=15*V', '--unit', 'displacement=arbitrary']
LAGS = {'sensor_lag', 'sensor_delay', 'command_delay', 'amplifier_bandwidth'}


@pytest.fixture(scope='module')
def answer(tmp_path_factory):
    """Identify and diagnose a stage with a secret, once each."""
    found = {}

    def get(secret):
        if secret not in found:
            folder = tmp_path_factory.mktemp(secret)
            bench, params = folder / 'bench', folder / 'stage.yaml'
            laboratory.write(bench, secret)
            assert main(['identify', str(bench / 'slow.csv'), str(bench / 'noise.csv'), *COLUMNS,
                         '--out', str(params)]) == 0
            assert main(['diagnose', str(bench), '--params', str(params), *COLUMNS,
                         '--out', str(folder / 'out')]) == 0
            found[secret] = json.loads((folder / 'out' / 'diagnosis.json').read_text())
        return found[secret]

    return get


def named(diagnosis):
    return set(diagnosis['selected']) | set(diagnosis['ambiguity_set'])


@pytest.mark.parametrize('secret', laboratory.SECRETS)
def test_every_secret_of_the_laboratory_changes_the_stage(secret):
    # Units hold arrays, which do not compare as a whole.
    assert repr(laboratory.stage(secret)) != repr(laboratory.stage(''))


@pytest.mark.slow
def test_a_lag_of_the_measurement_is_no_rate_dependent_hysteresis(answer):
    """Beside it there is the drift of the stage's sensor, which one of the place does as well."""
    diagnosis = answer('sensor_lag')
    found = named(diagnosis)
    assert 'sensor_lag' in found
    assert found <= LAGS | {'sensor_drift', 'thermal_drift'}
    assert diagnosis['where']['block'] == 'sensor'


@pytest.mark.slow
def test_rate_dependent_hysteresis_is_no_lag_of_the_measurement(answer):
    """Break voltages that grow with the logarithm of the rate: the library has another form."""
    diagnosis = answer('rate_dependent_hysteresis')
    assert diagnosis['verdict'] == 'CAUSE'
    assert named(diagnosis) == {'rate_dependent_hysteresis'}


@pytest.mark.slow
def test_nothing_is_concluded_from_a_scale_that_nobody_knows(answer):
    diagnosis = answer('sensor_lag')
    assert 'sensor_gain' in diagnosis['isolability']['undetectable']
    assert diagnosis['calibration']['displacement_scale']['nominal'] == 1.0


@pytest.mark.parametrize('scale', [3.1e5, -2.0, 7e-3])
def test_a_displacement_of_any_scale_and_sign_gets_the_size_of_the_device(scale):
    device = Device.nominal()
    run = programmes.triangle(rate=2e3)
    moved = simulate(device, run.time, run.command).displacement
    given = run.replace(measured={'displacement': scale * moved}, arbitrary=True)
    checked, findings = preflight(RecordingSet('set', (given,)), device)
    ratio = checked['triangle'].measured['displacement'] / np.where(moved, moved, np.inf)
    assert np.ptp(ratio[moved > 1e-6]) < 1e-9
    assert 0.5 < np.median(ratio[moved > 1e-6]) < 2.0
    assert any('units of its own' in str(each) for each in findings)


def test_the_scale_that_is_told_is_the_one_that_is_used():
    """Preflight guesses by statics, which are 6 % off here; the simulation tells better."""
    device = Device.nominal()
    run = programmes.triangle((80.0,), 100.0, 4, 10e3)
    moved = simulate(device, run.time, run.command).displacement
    noise = 1e-9 * np.random.default_rng(5).standard_normal(len(run))
    given = run.replace(measured={'displacement': -4e5 * (moved + noise)}, arbitrary=True)
    told = [finding for finding in compare_set(RecordingSet('set', (given,)), device)['preflight']
            if 'units of its own' in finding['what']]
    assert len(told) == 1
    factor = float(told[0]['mend'].split()[2])
    assert factor == pytest.approx(-1.0 / 4e5, rel=2e-3)


@pytest.mark.parametrize('zero', [5e-7, -2e-8])
def test_a_sensor_of_unknown_scale_has_an_unknown_zero(zero):
    """Fast motion hides an offset of some per cent from whoever takes it for noise."""
    device = Device.nominal()
    run = programmes.triangle((80.0,), 100.0, 4, 10e3)
    moved = simulate(device, run.time, run.command).displacement
    given = run.replace(measured={'displacement': moved + zero}, arbitrary=True)
    checked, findings = preflight(RecordingSet('set', (given,)), device)
    read = checked['triangle'].measured['displacement']
    assert np.ptp(read) / np.ptp(moved) * moved == pytest.approx(read, abs=1e-9)
    assert any('displacement begins at' in str(each) for each in findings)


@pytest.mark.parametrize('arguments, words', [
    (['--seed', '-1'], "argument --seed: '-1': expected a whole number, zero or more"),
    (['--seed', '1.5'], "argument --seed: '1.5': expected a whole number, zero or more"),
    (['--out', ''], "argument --out: '': expected a folder"),
    (['--out', 'a file'], 'a file'), (['--out', 'a file/below'], 'a file/below')])
@pytest.mark.parametrize('example', [laboratory, walkthrough])
def test_what_is_wrong_with_an_argument_is_said(
        example, arguments, words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'a file').touch()
    if example is walkthrough:
        arguments = [*arguments, '--prepare']
    monkeypatch.setattr(sys, 'argv', ['example', *arguments])
    try:
        status = example.main()
    except SystemExit as ended:
        status = ended.code
    assert status == 2
    error = capsys.readouterr().err.splitlines()[-1]
    assert words in error and 'Errno' not in error
    assert [each.name for each in tmp_path.iterdir()] == ['a file']


def test_only_a_displacement_can_be_arbitrary():
    assert is_displacement_arbitrary(['displacement=arbitrary'])
    assert parse_units(['displacement=arbitrary', 'charge=uC']) == {'charge': pytest.approx(1e-6)}
    with pytest.raises(InputError, match='charge.*arbitrary.*no unit of it'):
        parse_units(['charge=arbitrary'])
