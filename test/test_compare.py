# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""``piezo_stack compare`` and ``diagnose``: what a person reads and where it is written."""

import json

import numpy as np
from piezo_stack_sim.cli import main
from piezo_stack_sim.plant import Device, simulate
from piezo_stack_sim.progress import Bars, Stage, track
from piezo_stack_sim.recording import programmes
from piezo_stack_sim.resources import config_file
import pytest

PARAMS = str(config_file('ae0505d16.yaml'))


@pytest.fixture
def bench(tmp_path):
    """Return the folder of a device whose sensor reads 5 % too much, in micrometres."""
    programme = programmes.triangle(peaks=(60.0,), cycles=1)
    answer = simulate(Device.nominal(), programme.time, programme.command)
    random = np.random.default_rng(3)
    read = 1.05 * answer.displacement + 2e-9 * random.standard_normal(len(programme))
    folder = tmp_path / 'bench [new]'
    folder.mkdir()
    np.savetxt(folder / 'run [old].csv',
               np.column_stack([programme.time, programme.command, 1e6 * read]), '%.9g', ',',
               header='time,voltage_command,displacement [um]', comments='')
    return folder


def test_brackets_in_names_and_headers_are_shown_as_they_are(bench, capsys):
    assert main(['compare', str(bench), '--params', PARAMS]) == 0
    said = capsys.readouterr().out
    assert 'bench [new]' in said and 'recording run [old]' in said
    assert 'displacement [um]' in said


def test_what_was_found_in_the_recordings_is_told_with_its_mend(bench, capsys):
    file, = bench.iterdir()
    rows = file.read_text().replace('displacement [um]', 'displacement').splitlines()
    file.write_text('\n'.join([rows[0], *rows[1:500], rows[499], *rows[500:], '']))
    assert main(['compare', str(bench), '--params', PARAMS]) == 0
    said = ' '.join(capsys.readouterr().out.split())
    assert 'row 501: 1 rows are there twice: the second one is dropped' in said
    assert 'displacement is in um, as its size tells: multiplied by 1e-6' in said


def test_the_gap_is_what_the_sensor_reads_too_much(bench, capsys):
    assert main(['compare', str(bench), '--params', PARAMS, '--json']) == 0
    found = json.loads(capsys.readouterr().out)
    programme = programmes.triangle(peaks=(60.0,), cycles=1)
    moved = simulate(Device.nominal(), programme.time, programme.command).displacement
    expected = 0.05 * np.sqrt(np.mean(moved ** 2))
    assert found['gap']['displacement']['rms'] == pytest.approx(expected, rel=0.02)
    assert found['where']['channels'] == {'displacement': 1.0}


def test_a_folder_that_cannot_be_made_is_told_before_the_work(bench, tmp_path, capsys):
    out = tmp_path / 'taken'
    out.write_text('a file')
    assert main(['diagnose', str(bench), '--params', PARAMS, '--out', str(out)]) == 2
    said = capsys.readouterr().err
    assert len(said.splitlines()) == 1 and 'taken' in said and 'cannot be made a folder' in said


@pytest.mark.parametrize('command', ['compare', 'diagnose'])
def test_too_few_rows_to_tell_noise_are_refused_in_one_line(command, tmp_path, capsys):
    short = tmp_path / 'short.csv'
    short.write_text('time,voltage_command,displacement\n' + ''.join(
        f'{1e-3 * k},{k},{1e-7 * k}\n' for k in range(30)))
    out = ['--out', str(tmp_path / 'out')] if command == 'diagnose' else []
    assert main([command, str(short), '--params', PARAMS, *out]) == 2
    said = capsys.readouterr().err
    assert len(said.splitlines()) == 1 and '30 rows of displacement' in said and '50' in said


def test_progress_takes_any_name(monkeypatch):
    monkeypatch.setattr('sys.stderr.isatty', lambda: True, raising=False)
    monkeypatch.setenv('FORCE_COLOR', '1')
    with Bars() as bar:
        bar('run [/um]', 0.5)
    assert list(track([1, 2], 'reading [/um]')) == [1, 2]
    with Stage() as stage:
        stage('run [/um]')
