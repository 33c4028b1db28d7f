# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""``piezo_stack compare`` and ``diagnose``: what a person reads and where it is written."""

import json
import shlex

import numpy as np
from piezo_stack_sim.cli import main
from piezo_stack_sim.commands import diagnose
from piezo_stack_sim.gap.compare import compare_set
from piezo_stack_sim.gap.report.wording import cut
from piezo_stack_sim.gap.write import command_of
from piezo_stack_sim.plant import Device, simulate
from piezo_stack_sim.progress import Bars, Stage, track
from piezo_stack_sim.recording import programmes, read_set
from piezo_stack_sim.recording.recording import RecordingSet
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
    assert 'blocks drive to sensor, in one cut' in said  # for only the displacement was read
    assert 'displacement [um]' in said


def test_what_was_found_in_the_recordings_is_told_with_its_mend(bench, capsys):
    file, = bench.iterdir()
    rows = file.read_text().replace('displacement [um]', 'displacement').splitlines()
    file.write_text('\n'.join([rows[0], *rows[1:500], rows[499], *rows[500:], '']))
    assert main(['compare', str(bench), '--params', PARAMS]) == 0
    said = ' '.join(capsys.readouterr().out.split())
    assert 'row 501: 1 rows are there twice: the second one is dropped' in said
    assert 'displacement is in um, as its size tells: multiplied by 1e-6' in said


@pytest.mark.parametrize('channels', [('voltage', 'charge', 'displacement'), ('displacement',)])
def test_a_device_as_its_file_that_was_led_to_a_bias_before_has_no_gap(tmp_path, channels):
    """A bench that keeps its stack at 50 V and zeroes its sensors there."""
    time = np.arange(60000) * 1e-4
    rise = np.clip(time / 3.0, 0.0, 1.0)
    command = 50.0 * rise * rise * (3.0 - 2.0 * rise) + np.where(
        time < 4.0, 0.0, 15.0 * np.sin(2.0 * np.pi * 1.5 * (time - 4.0)))
    answer, random = simulate(Device.nominal(), time, command), np.random.default_rng(5)
    rows, noise = slice(39000, None), {'voltage': 1e-2, 'charge': 5e-9, 'displacement': 1e-9}
    columns = [time[rows], command[rows]]
    for channel in channels:
        values = getattr(answer, channel)[rows]
        values = values if channel == 'voltage' else values - values[0]
        columns.append(values + noise[channel] * random.standard_normal(values.size))
    (tmp_path / 'set').mkdir()
    np.savetxt(tmp_path / 'set' / 'sine.csv', np.column_stack(columns), '%.10g', ',',
               header=','.join(('time', 'voltage_command', *channels)), comments='')
    found = compare_set(read_set(tmp_path / 'set'), Device.nominal())
    assert any('rests at 50 V' in finding['what'] for finding in found['preflight'])
    for channel in channels:
        assert found['gap'][channel]['over_noise'] < 1.1


def test_the_gap_is_what_the_sensor_reads_too_much(bench, capsys):
    assert main(['compare', str(bench), '--params', PARAMS, '--json']) == 0
    found = json.loads(capsys.readouterr().out)
    programme = programmes.triangle(peaks=(60.0,), cycles=1)
    moved = simulate(Device.nominal(), programme.time, programme.command).displacement
    expected = 0.05 * np.sqrt(np.mean(moved ** 2))
    assert found['gap']['displacement']['rms'] == pytest.approx(expected, rel=0.02)
    assert found['where']['channels'] == {'displacement': 1.0}


@pytest.mark.parametrize(('channels', 'cuts'), [
    (('displacement',), ['drive to sensor']),
    (('charge', 'displacement'), ['drive to electrical', 'transducer to sensor']),
    (('voltage', 'charge', 'displacement'), ['transducer to sensor'])])
def test_blocks_between_which_nothing_was_measured_are_told_as_one_cut(channels, cuts):
    programme = programmes.triangle(peaks=(60.0,), cycles=1)
    answer = simulate(Device.nominal(), programme.time, programme.command)
    random = np.random.default_rng(5)
    noise = {'voltage': 5e-3, 'charge': 5e-9, 'displacement': 2e-9}
    measured = {channel: getattr(answer, channel) + noise[channel] * random.standard_normal(
        len(programme)) for channel in channels}
    measured['displacement'] = 1.05 * measured['displacement']
    result = compare_set(RecordingSet('bench', (programme.replace(measured=measured),)),
                         Device.nominal())
    where = result['where']
    assert [cut(block, where) for block, row in where['blocks'].items()
            if 'spans' in row] == cuts
    assert set().union(*(row.get('spans', {block}) for block, row in where['blocks'].items())) == {
        'drive', 'electrical', 'transducer', 'mechanical', 'environment', 'sensor'}


def test_a_folder_that_cannot_be_made_is_told_before_the_work(bench, tmp_path, capsys):
    out = tmp_path / 'taken'
    out.write_text('a file')
    assert main(['diagnose', str(bench), '--params', PARAMS, '--out', str(out)]) == 2
    said = capsys.readouterr().err
    assert len(said.splitlines()) == 1 and 'taken' in said and 'cannot be made a folder' in said


def test_the_command_that_is_told_can_be_given_to_a_shell():
    given = ['bench [new]', "it's.csv"], PARAMS, '/tmp/an out', ['displacement=/s.position[0]'], (
        'displacement=um', 'charge=uC')
    parsed = diagnose.command.make_context('diagnose', shlex.split(command_of(*given))[2:]).params
    assert [list(parsed[name]) for name in ('recordings', 'maps', 'units')] == [
        list(given[0]), given[3], list(given[4])]
    assert (parsed['params'], parsed['out']) == given[1:3]


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


def with_monitor(standing, read):
    """Return recordings of a device whose driver stands at a voltage, read too high, as a set."""
    device, rows = Device.nominal(), []
    noise = {'voltage': 5e-3, 'charge': 2e-9, 'displacement': 1e-9}
    for seed, programme in enumerate((programmes.triangle(peaks=(30.0, 90.0), cycles=2),
                                      programmes.multisine(periods=2))):
        random = np.random.default_rng(seed)
        answer = simulate(device, programme.time, programme.command + standing,
                          start=(standing, 0.0))
        clean = {channel: getattr(answer, channel) for channel in noise}
        measured = {channel: values + level * random.standard_normal(values.size)
                    for (channel, values), level in zip(clean.items(), noise.values())}
        measured['voltage'] += read
        for channel in ('charge', 'displacement'):
            measured[channel] -= clean[channel][0]
        rows.append(programme.replace(measured=measured))
    return RecordingSet('bench', tuple(rows))


def test_an_offset_that_only_the_reading_of_the_voltage_has_is_no_gap():
    told = compare_set(with_monitor(0.0, -0.3), Device.nominal())
    assert [row['over_noise'] for row in told['gap'].values()] == pytest.approx([1.0] * 3, abs=.05)
    said = [finding['what'] for finding in told['preflight'] if finding['severity'] == 'repaired']
    assert said == ['voltage reads 0.3 V too little in every row'] * 2


def test_an_offset_at_which_the_stack_stands_is_one_of_the_driver():
    told = compare_set(with_monitor(0.6, 0.0), Device.nominal())
    assert told['gap']['voltage']['over_noise'] > 50.0
    assert not any(finding['severity'] == 'repaired' for finding in told['preflight'])


def test_no_share_is_told_of_a_band_that_no_recording_sees():
    slow = RecordingSet('bench', tuple(
        each.replace(time=0.01 * np.arange(len(each)), measured={
            'voltage': 1.1 * each.measured['voltage']}) for each in with_monitor(0.0, 0.0)))
    seen = compare_set(slow, Device.nominal())['where']['bands']
    assert [row['low'] for row in seen] == [0.0, 1.0, 10.0]  # half the rate is 50 Hz
    assert sum(row['share'] for row in seen) == pytest.approx(1.0)
