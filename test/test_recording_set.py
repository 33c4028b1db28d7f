# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Recording sets are found in folders and files; names and units are parsed, never evaluated."""

import copy
import pickle

from hypothesis import given, settings, strategies
import numpy as np
from piezo_stack_sim.errors import InputError
from piezo_stack_sim.recording import (
    Finding, parse_mapping, parse_units, read_set, Recording, write_bag, write_csv, write_csv_set,
)
import pytest
from recorded import pushed, set_of, slow

TEXT = strategies.one_of(
    strategies.text(max_size=30),
    strategies.text('/abz._[]0=~-', max_size=30).map(lambda text: 'displacement=/' + text),
    strategies.text('+-.0123456789eunmkV* ', max_size=12).map(lambda text: 'voltage=' + text))


def test_a_folder_is_a_set_and_its_files_are_the_recordings(tmp_path):
    write_csv_set(set_of(slow(), pushed()), tmp_path / 'device')
    write_csv(slow(seed=1), tmp_path / 'device/decay.csv')
    (tmp_path / 'device/notes.md').write_text('by hand')
    (tmp_path / 'device/.partial-x.csv').write_text('half')
    found = read_set(tmp_path / 'device')
    assert found.name == 'device' and not found.findings
    assert [each.name for each in found] == ['decay', 'force', 'triangle']
    assert found['force'].has_force and found.channels == ('voltage', 'charge', 'displacement')


def test_bags_and_tables_share_a_folder(tmp_path):
    write_csv(slow(), tmp_path / 'triangle.csv.gz')
    write_bag(pushed(300), tmp_path / 'force')
    write_bag(slow(300), tmp_path / 'other', 'sqlite3')
    (tmp_path / 'other/other.db3').rename(tmp_path / 'single.db3')
    (tmp_path / 'other/metadata.yaml').unlink()
    found = read_set(tmp_path)
    assert [(each.name, len(each)) for each in found] == [
        ('force', 300), ('single', 300), ('triangle', 3000)]


def test_files_can_be_given_one_by_one(tmp_path):
    write_csv_set(set_of(slow(), pushed()), tmp_path)
    single = read_set(tmp_path / 'force.csv.gz')
    assert (single.name, len(single)) == ('force', 1)
    both = read_set([tmp_path / 'force.csv.gz', tmp_path / 'triangle.csv.gz'])
    assert [each.name for each in both] == ['force', 'triangle']


def test_of_a_set_that_is_too_large_each_file_is_thinned_out_to_its_share(tmp_path):
    write_csv_set(set_of(slow(), pushed(300)), tmp_path)
    whole, share = read_set(tmp_path), read_set(tmp_path, max_values=20_000)
    numbers = {each.name: len(each) * (len(each.columns()) + 1) for each in whole}
    assert numbers['force'] < 10_000 < numbers['triangle'] < 20_000
    assert [len(each) for each in share] == [len(whole['force']), len(whole['triangle']) // 2]
    found, = share['triangle'].findings
    assert 'larger than 0.08 MB of numbers: one row in 2 was kept' in str(found)
    assert 'shorter part' in str(found)


def test_reading_tells_how_far_it_is(tmp_path):
    write_csv_set(set_of(slow(), pushed()), tmp_path)
    calls = []
    read_set(tmp_path, progress=lambda *each: calls.append(each))
    assert calls == [(0, 2, 'force.csv.gz'), (1, 2, 'triangle.csv.gz')]


def test_a_format_that_is_not_read_is_not_passed_over_in_silence(tmp_path):
    write_csv_set(set_of(slow()), tmp_path)
    (tmp_path / 'steps.mat').write_bytes(b'MATLAB')
    findings = read_set(tmp_path).findings
    assert 'steps.mat: not a format that is read: convert it to CSV' in str(findings[0])


def test_links_to_nothing_and_folders_with_the_name_of_a_file_are_named(tmp_path):
    (tmp_path / 'run.csv').symlink_to(tmp_path / 'gone.csv')
    with pytest.raises(InputError, match='run.csv is a link to .*gone.csv, which is not there'):
        read_set(tmp_path)
    (tmp_path / 'other.csv').mkdir()
    (tmp_path / 'steps.csv').write_text('time,voltage_command,voltage\n0,0,0\n1,1,1\n')
    told = [str(each) for each in read_set(tmp_path).findings]
    assert any('run.csv: a link to' in each for each in told)
    assert any('other.csv: a folder with the name of a file' in each for each in told)


@pytest.mark.parametrize('make, complaint', [
    (lambda path: None, 'no such file or folder'),
    (lambda path: path.mkdir(), 'no recording in it: expected .csv'),
    (lambda path: (path / 'set_00').mkdir(parents=True), 'give one of its folders (set_00)'),
    (lambda path: path.write_text(''), 'not a recording: expected .csv'),
], ids=['missing', 'empty', 'folder of sets', 'other file'])
def test_a_path_that_is_no_set_is_named_with_the_mend(tmp_path, make, complaint):
    make(tmp_path / 'device')
    with pytest.raises(InputError) as error:
        read_set(tmp_path / 'device')
    assert str(error.value).startswith(f'{tmp_path / "device"}: ')
    assert complaint in str(error.value)


def test_a_misspelt_path_gets_a_suggestion(tmp_path):
    write_csv(slow(), tmp_path / 'triangle.csv')
    with pytest.raises(InputError, match="did you mean 'triangle.csv'"):
        read_set(tmp_path / 'triagnle.csv')


@pytest.mark.parametrize('mapping, complaint', [
    (['displacement=/stage/state.position[0]'], 'names a topic, but there is no bag'),
    (['displacment=x'], "'displacment': no such channel (did you mean 'displacement'?)"),
    (['displacement'], 'expected displacement=..., got nothing'),
    (['charge=a', 'charge=b'], 'charge: given twice'),
    (['time=/stage/state.header'], 'map a column only'),
    (['charge=/stage/state.position[-1]'], 'no topic with a field'),
    (['charge=/stage/state.position[__import__("os")]'], 'no topic with a field'),
    (['charge=/stage/state.__class__'], 'no topic with a field'),
    (['charge=/stage/sta te'], 'no topic with a field'),
])
def test_a_mapping_that_means_nothing_is_refused(tmp_path, mapping, complaint):
    write_csv(slow(), tmp_path / 'triangle.csv')
    with pytest.raises(InputError) as error:
        read_set(tmp_path, mapping=mapping)
    assert complaint in str(error.value)


def test_a_column_mapping_needs_a_table(tmp_path):
    write_bag(slow(50), tmp_path / 'run')
    with pytest.raises(InputError, match='names a column, but there is no CSV file'):
        read_set(tmp_path, mapping=['displacement=stage'])


def test_a_unit_of_what_nobody_recorded_is_refused(tmp_path):
    write_csv(slow().replace(measured={'voltage': slow().measured['voltage']}),
              tmp_path / 'a.csv')
    for unit in ('charge=uC', 'displacement=arbitrary', 'external_force=kN'):
        channel = unit.partition('=')[0]
        with pytest.raises(InputError, match=(
                f'--unit {channel}: no recording has {channel}, but time, voltage_command, voltage'
                f': leave it out.* --map {channel}=')):
            read_set(tmp_path, units=[unit])
    # One recording that has it is enough.
    write_csv(slow(name='b'), tmp_path / 'b.csv')
    assert len(read_set(tmp_path, units=['charge=uC'])) == 2


def test_a_topic_with_a_path_is_taken_apart():
    field = parse_mapping({'displacement': '/stage/joint_states.position[0]'})['displacement']
    assert (field.topic, field.path) == ('/stage/joint_states', ('position', 0))
    assert str(field) == '/stage/joint_states.position[0]'
    assert parse_mapping({'displacement': str(field)})['displacement'] == field


@pytest.mark.parametrize('text, scale', [
    ('displacement=um', 1e-6), ('displacement=-um', -1e-6), ('displacement=m', 1.0),
    ('displacement=µm', 1e-6), ('displacement=2.5*um', 2.5e-6), ('displacement=mm', 1e-3),
    ('voltage_command=20', 20.0), ('voltage_command=-1', -1.0), ('voltage=kV', 1e3),
    ('charge=uC', 1e-6), ('charge=1e-6', 1e-6), ('external_force=kN', 1e3), ('time=us', 1e-6),
    ('time=min', 60.0), ('displacement=-2*microns', -2e-6), ('time=Seconds', 1.0),
])
def test_a_unit_is_a_factor_to_si(text, scale):
    assert list(parse_units([text]).values()) == [pytest.approx(scale, rel=1e-15)]


@pytest.mark.parametrize('text', [
    'displacement=V', 'displacement=0', 'displacement=', 'displacement=inch', 'voltage=1/2',
    'voltage=1e999', 'voltage=--1', 'voltage=nan', 'time=days', 'charge=microns',
    'charge=2**3', 'voltag=V',
    'displacement=1e-300*pm', 'displacement=1e300*km',
])
def test_a_unit_of_something_else_is_refused(text):
    with pytest.raises(InputError, match='--unit'):
        parse_units([text])


@given(TEXT)
@settings(max_examples=300, deadline=None)
def test_a_mapping_or_unit_is_understood_or_refused(text):
    for parse in (parse_mapping, parse_units):
        try:
            parsed = parse([text])
        except InputError:
            continue
        assert len(parsed) == 1
        # What was understood is understood again.
        assert parse({name: str(value) for name, value in parsed.items()}) == parsed


@pytest.mark.parametrize('changes, complaint', [
    ({'drive': 'current'}, 'expected one of voltage, charge, open, shorted'),
    ({'command': np.zeros(7)}, 'command has 7 rows, time has 3000'),
    ({'measured': {'force': np.zeros(3000)}}, "measured channel 'force'"),
    ({'time': 'now'}, 'expected numbers'),
    ({'time': np.zeros((3000, 2))}, 'expected one dimension'),
    ({'rows': np.arange(7)}, 'rows have shape'),
])
def test_a_recording_that_does_not_fit_together_is_refused(changes, complaint):
    with pytest.raises(InputError, match=complaint):
        slow().replace(**changes)


def test_a_recording_cannot_be_changed_and_does_not_lock_what_it_was_given():
    time = np.arange(3.0)
    recording = Recording('run', time, 'voltage', np.zeros(3))
    with pytest.raises(ValueError):
        recording.time[0] = 1.0
    time[0] = 7.0


def test_a_recording_knows_its_rate_and_length():
    recording = slow()
    assert (len(recording), recording.duration) == (3000, pytest.approx(0.2999))
    assert recording.rate == pytest.approx(10e3)
    assert recording.take(slice(10, 20)).rows.tolist() == list(range(12, 22))


def test_a_set_can_be_sent_to_another_process():
    recordings = set_of(slow(), pushed())
    for again in (pickle.loads(pickle.dumps(recordings)), copy.deepcopy(recordings)):
        assert np.array_equal(again['force'].command, recordings['force'].command)


def test_a_finding_is_one_line():
    assert str(Finding('run.csv', 7, 'note', 'a\nb', 'c')) == 'note: run.csv: row 7: a b: c'
