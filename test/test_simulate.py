# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""``piezo_stack simulate``: a recording set in, the model's answers out."""

import gzip

import numpy as np
from piezo_stack_sim.cli import main
from piezo_stack_sim.errors import InputError
from piezo_stack_sim.plant import Device, simulate
from piezo_stack_sim.recording.read import read_set
from piezo_stack_sim.recording.write import write_csv_set
from piezo_stack_sim.resources import config_file
import pytest

PARAMS = str(config_file('ae0505d16.yaml'))
TIME = np.arange(200) / 1000.0


def write(path, **columns):
    """Write a CSV recording."""
    rows = np.column_stack([TIME, *columns.values()])
    header = ','.join(['time', *columns])
    np.savetxt(path, rows, delimiter=',', header=header, comments='', fmt='%.17g')


@pytest.fixture
def recordings(tmp_path):
    """Return a set with one recording by voltage, with force, and one by charge."""
    folder = tmp_path / 'set'
    folder.mkdir()
    write(folder / 'rise.csv', voltage_command=300.0 * TIME, external_force=-100.0 * TIME)
    write(folder / 'push.csv', charge_command=5e-4 * TIME)
    return folder


def test_the_set_comes_back_with_what_the_plant_computes(recordings, tmp_path, capsys):
    assert main(['simulate', str(recordings), '--params', PARAMS,
                 '--out', str(tmp_path / 'out')]) == 0
    assert '2 recordings, 400 rows' in capsys.readouterr().out
    given = {r.name: r for r in read_set(recordings).recordings}
    answers = {r.name: r for r in read_set(tmp_path / 'out').recordings}
    assert sorted(answers) == ['push', 'rise']
    for name, answer in answers.items():
        asked = given[name]
        assert np.array_equal(answer.command, asked.command)
        assert np.array_equal(answer.external_force, asked.external_force)
        expected = simulate(Device.nominal(), asked.time, asked.command, asked.external_force,
                            drive=asked.drive)
        assert answer.measured['displacement'] == pytest.approx(
            expected.displacement, abs=1e-15)
        assert answer.measured['charge'] == pytest.approx(expected.charge, abs=1e-15)


def test_what_the_reader_found_is_told(recordings, tmp_path, capsys):
    path = recordings / 'rise.csv'
    path.write_text(path.read_text().replace('external_force', 'external_force [mN]'))
    assert main(['simulate', str(path), '--params', PARAMS, '--out', str(tmp_path / 'out')]) == 0
    error = capsys.readouterr().err
    assert f"note: {path}: column 'external_force [mN]': the header gives" in error


def test_a_file_is_no_folder_to_write_into(recordings, tmp_path, capsys):
    (tmp_path / 'file').write_text('mine')
    for out in ('file', 'file/deeper'):
        assert main(['simulate', str(recordings), '--params', PARAMS,
                     '--out', str(tmp_path / out)]) == 2
        error = capsys.readouterr().err
        assert f'{tmp_path / "file"} is no folder' in error and error.count('\n') == 1
    with pytest.raises(InputError, match='is no folder'):
        write_csv_set(read_set(recordings), tmp_path / 'file', remark='mine')


def test_the_same_seed_gives_the_same_noise(recordings, tmp_path):
    params = tmp_path / 'noisy.yaml'
    params.write_text(config_file('ae0505d16.yaml').read_text(encoding='utf-8').replace(
        'drive: voltage', 'noise: {displacement: 1.0e-9}'), encoding='utf-8')

    def displacement(*options):
        out = tmp_path / 'out'
        arguments = ['simulate', str(recordings), '--params', str(params), '--out', str(out)]
        assert main([*arguments, *options]) == 0
        return read_set(out).recordings[1].measured['displacement']

    quiet = displacement()
    first, again, other = (displacement('--noise', '--seed', seed) for seed in '112')
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)
    assert np.std(first - quiet) == pytest.approx(1e-9, rel=0.3)


@pytest.mark.parametrize('text, words', [
    ('time,displacement\n0,0\n', ['voltage_command']),
    ('', ['set.csv']),
])
def test_a_set_that_cannot_be_simulated_is_refused_in_one_line(tmp_path, capsys, text, words):
    path = tmp_path / 'set.csv'
    path.write_text(text, encoding='utf-8')
    assert main(['simulate', str(path), '--params', PARAMS, '--out', str(tmp_path / 'o')]) == 2
    out, err = capsys.readouterr()
    assert out == ''
    assert err.count('\n') == 1
    for word in words:
        assert word in err


@pytest.mark.parametrize('given', ['set', 'set/rise.csv'])
def test_a_measurement_is_not_overwritten_by_its_simulation(given, recordings, tmp_path, capsys):
    before = (recordings / 'rise.csv').read_bytes()
    assert main(['simulate', str(tmp_path / given), '--params', PARAMS,
                 '--out', str(recordings)]) == 2
    assert 'would be overwritten' in capsys.readouterr().err
    assert sorted(path.name for path in recordings.iterdir()) == ['push.csv', 'rise.csv']
    assert (recordings / 'rise.csv').read_bytes() == before


def test_a_measurement_of_the_same_name_elsewhere_is_not_overwritten_either(
        recordings, tmp_path, capsys):
    other = tmp_path / 'other'
    other.mkdir()
    with gzip.open(other / 'rise.csv.gz', 'wb') as file:
        file.write((recordings / 'rise.csv').read_bytes())
    before = (other / 'rise.csv.gz').read_bytes()
    arguments = ['simulate', str(recordings), '--params', PARAMS, '--out']
    assert main([*arguments, str(other)]) == 2
    assert 'rise.csv.gz: is there and does not begin with' in capsys.readouterr().err
    assert (other / 'rise.csv.gz').read_bytes() == before
    # What a simulation wrote is written again.
    assert [main([*arguments, str(tmp_path / 'again')]) for _ in range(2)] == [0, 0]


@pytest.mark.parametrize('column, value, words', [
    ('time', '0.0', 'row 4: time 0 s does not come after'),
    ('voltage_command', '1e29', 'voltage_command reaches 1e+29 V'),
    ('voltage_command', 'nan', 'row 4: voltage_command is no finite number')])
def test_inputs_that_no_device_can_be_asked_are_named_with_file_and_row(
        column, value, words, tmp_path, capsys):
    path = tmp_path / 'run.csv'
    rows = [['0.0', '0'], ['0.1', '1'], ['0.2', '2']]
    rows[2][column == 'voltage_command'] = value
    path.write_text('time,voltage_command\n' + ''.join(f'{a},{b}\n' for a, b in rows))
    assert main(['simulate', str(path), '--params', PARAMS, '--out', str(tmp_path / 'o')]) == 2
    error = capsys.readouterr().err
    assert str(path) in error and words in error and error.count('\n') == 1


@pytest.mark.parametrize('scale, status, words', [
    (15.0, 2, 'voltage_command reaches 1350 V, far beyond the device'),
    (2.0, 0, "voltage_command is 180 V there, outside the device's range"),
    (-1.0, 0, "voltage_command is -90 V there, outside the device's range"),
    (0.001, 0, 'voltage_command reaches 0.09 V of 150'),
    (1.0, 0, '')])
def test_commands_outside_the_range_are_told_as_compare_tells_them(
        scale, status, words, tmp_path, capsys):
    path, command = tmp_path / 'run.csv', scale * 900.0 * np.minimum(TIME, 0.2 - TIME)
    write(path, voltage_command=command)
    out = tmp_path / 'out'
    assert main(['simulate', str(path), '--params', PARAMS, '--out', str(out)]) == status
    error = capsys.readouterr().err
    assert words in error and error.count('\n') == bool(words)
    assert (f'{path}: ' in error) == bool(words)
    assert out.exists() == (status == 0)
    if scale >= 1.0:  # others are turned or scaled if something was measured beside them
        write(path, voltage_command=command,
              displacement=simulate(Device.nominal(), TIME, command).displacement)
        assert main(['compare', str(path), '--params', PARAMS]) == status
        told = ' '.join(''.join(capsys.readouterr()).split())
        assert words in told
        assert (' range' in told or ' beyond' in told) == bool(words)


def test_a_charge_far_beyond_and_a_force_beyond_blocking_are_told(tmp_path, capsys):
    arguments = ['simulate', str(tmp_path / 'run.csv'), '--params', PARAMS, '--out',
                 str(tmp_path / 'out')]
    write(tmp_path / 'run.csv', charge_command=0.04 * TIME)
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert 'far beyond the device' in error and '--unit charge_command=mC' in error
    write(tmp_path / 'run.csv', charge_command=5e-4 * TIME, external_force=-4e4 * TIME)
    assert main(arguments) == 0
    assert 'beyond the blocking force' in capsys.readouterr().err


@pytest.mark.parametrize('time, status, severity, words, last', [
    (1.7e12 + 1e3 * TIME, 0, 'repaired', 'taken as ms since 1970', 0.199),
    (1e3 * TIME, 0, 'note', 'rows are 1 s apart: if time is not in s, give its unit', 199.0),
    (1e6 * TIME, 2, 'refused', 'rows are 1000 s apart: time is hardly in s', None),
    (5.0 + TIME, 0, None, '', 5.199)])
def test_times_that_are_hardly_seconds_are_told_as_compare_tells_them(
        time, status, severity, words, last, tmp_path, capsys):
    path = tmp_path / 'run.csv'
    np.savetxt(path, np.column_stack([time, 300.0 * TIME]), delimiter=',', comments='',
               header='time,voltage_command', fmt='%.17g')
    assert main(['simulate', str(path), '--params', PARAMS,
                 '--out', str(tmp_path / 'out')]) == status
    error = capsys.readouterr().err
    assert error.startswith(severity or '') and words in error
    assert error.count('\n') == bool(words)
    if last:
        assert read_set(tmp_path / 'out').recordings[0].time[-1] == pytest.approx(last, abs=1e-6)


def test_a_seed_without_noise_is_refused(recordings, tmp_path, capsys):
    assert main(['simulate', str(recordings), '--params', PARAMS, '--seed', '3',
                 '--out', str(tmp_path / 'out')]) == 2
    assert '--noise' in capsys.readouterr().err
