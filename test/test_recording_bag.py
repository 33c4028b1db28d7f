# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Bags become rows without clocks agreeing, and what was written comes back to the bit."""

import subprocess
import sys

import numpy as np
from piezo_stack_sim.errors import InputError
from piezo_stack_sim.recording import (
    parse_mapping, parse_units, preflight, read_bag, read_set, write_bag,
)
from piezo_stack_sim.recording.bag_file import open_bag
import pytest
from recorded import answered, DEVICE, pushed, slow, triangle
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import get_types_from_msg, get_typestore, Stores

TYPES = get_typestore(Stores.ROS2_JAZZY)
FLOAT, STATE = 'std_msgs/msg/Float64', 'sensor_msgs/msg/JointState'
PERIOD = 1_000_000


def number(value):
    """Return a serialised Float64."""
    return FLOAT, TYPES.serialize_cdr(TYPES.types[FLOAT](float(value)), FLOAT)


def state(stamp, *position):
    """Return a serialised JointState with a stamp in ns."""
    header = TYPES.types['std_msgs/msg/Header'](
        TYPES.types['builtin_interfaces/msg/Time'](stamp // 10**9, stamp % 10**9), '')
    message = TYPES.types[STATE](
        header, ['stack'], np.array(position, dtype=float), np.empty(0), np.empty(0))
    return STATE, TYPES.serialize_cdr(message, STATE)


def bag(path, messages, storage='mcap'):
    """Write (arrival in ns, topic, (type, raw)) into a bag and return its path."""
    connections = {}
    with Writer(path, version=9, storage_plugin=StoragePlugin[storage.upper()]) as writer:
        for arrival, topic, (kind, raw) in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=TYPES)
            writer.write(connections[topic], int(arrival), raw)
    return path


def ticks(count, offset=0):
    """Return messages of a device that answers command k with position 10 k, one tick each."""
    for k in range(count):
        at = 5 * PERIOD + k * PERIOD
        yield at, '/stage/voltage_command', number(k)
        yield at + 700_000, '/stage/state', state(offset + (k + 1) * PERIOD, 10.0 * k)
        yield at + 700_100, '/stage/voltage', number(k + 0.5)


def error(path, mapping=()):
    """Return what reading complains about."""
    with pytest.raises(InputError) as caught:
        read_bag(path, parse_mapping(mapping))
    assert str(caught.value).startswith((str(path), '--map')) and '\n' not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
@pytest.mark.parametrize('recording', [
    slow(400), pushed(400), slow(400).replace(drive='open'), slow(400).replace(measured={}),
    answered(triangle(400, 1e-4), drive='charge', rate=50e3),
    slow(400).replace(measured={'charge': slow(400).measured['charge']}),
], ids=['slow', 'pushed', 'open', 'bare', 'charge', 'one channel'])
def test_what_is_written_to_a_bag_comes_back_to_the_bit(tmp_path, recording, storage):
    write_bag(recording, tmp_path / 'run', storage)
    again = read_bag(tmp_path / 'run')
    assert (again.drive, again.has_force) == (recording.drive, recording.has_force)
    assert again.columns().keys() == recording.columns().keys()
    for name, values in recording.columns().items():
        assert np.array_equal(again.columns()[name], values), name
    assert again.rows.tolist() == list(range(1, 401))


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_a_storage_file_alone_is_a_bag(tmp_path, storage):
    write_bag(slow(100), tmp_path / 'run', storage)
    file = next(each for each in (tmp_path / 'run').iterdir() if each.name != 'metadata.yaml')
    again = read_bag(file)
    assert again.name == 'run' and np.array_equal(again.command, slow(100).command)


@pytest.mark.parametrize('storage, ending', [('mcap', '.MCAP'), ('sqlite3', '.Db3')])
def test_the_ending_of_a_bag_may_be_written_in_capitals(tmp_path, storage, ending):
    write_bag(slow(100), tmp_path / 'run', storage)
    file = next(each for each in (tmp_path / 'run').iterdir() if each.name != 'metadata.yaml')
    again = read_set(file.rename(tmp_path / f'RUN{ending}'))['RUN']
    assert np.array_equal(again.command, slow(100).command)


def test_a_command_acts_until_the_sample_that_follows_it(tmp_path):
    recording = read_bag(bag(tmp_path / 'run', ticks(50, offset=10**15)))
    # Sample k is the answer to command k: the row before it carries that command.
    assert recording.command[:-1].tolist() == list(range(1, 50))
    assert recording.measured['displacement'].tolist() == [10.0 * k for k in range(50)]
    assert recording.measured['voltage'].tolist() == [k + 0.5 for k in range(50)]
    assert np.allclose(np.diff(recording.time), 1e-3, rtol=1e-12)


def test_a_device_stepped_from_zero_gets_its_row_at_rest(tmp_path):
    messages = [(at, topic, number(float(k // 3) + 3.0) if topic.endswith('command') else raw)
                for k, (at, topic, raw) in enumerate(ticks(50))]
    recording = read_bag(bag(tmp_path / 'run', messages))
    assert len(recording) == 51 and recording.rows[0] == 0
    assert recording.command.tolist() == [*(k + 3.0 for k in range(50)), 52.0]
    assert recording.measured['displacement'][:3].tolist() == [0.0, 0.0, 10.0]
    assert recording.time[:3].tolist() == pytest.approx([0.0, 1e-3, 2e-3])
    assert any('a row at rest is put before it' in str(each) for each in recording.findings)


def test_lockstep_faster_than_time_joins_as_well(tmp_path):
    # All 50 ticks arrive within 50 us, while the stamps say 50 ms.
    messages = [(10**9 + k * 300, topic, raw) for k, (_, topic, raw) in enumerate(ticks(50))]
    recording = read_bag(bag(tmp_path / 'run', messages))
    assert recording.command[:-1].tolist() == list(range(1, 50))
    assert recording.measured['voltage'].tolist() == [k + 0.5 for k in range(50)]
    assert recording.duration == pytest.approx(0.049)


def test_rest_before_the_first_command_is_kept_short(tmp_path):
    rest = [(k * PERIOD, '/stage/state', state(10**15 + k * PERIOD, 0.0)) for k in range(500)]
    run = [(at + 500 * PERIOD, topic, raw) for at, topic, raw in ticks(50, 10**15 + 500 * PERIOD)]
    recording = read_bag(bag(tmp_path / 'run', [
        each for each in rest + run if not each[1].endswith('voltage')]))
    assert len(recording) == 151 and recording.time[0] == 0.0
    assert recording.command[:103].tolist() == [0.0] * 101 + [1.0, 2.0]
    assert any('499 rows before' in str(each) for each in recording.findings)


def _held_at(level, moving=0.0):
    """Return 500 messages of a device that is held at a voltage, then 50 ticks of it led on."""
    held = [(k * PERIOD, '/stage/voltage', number(level + moving * k)) for k in range(500)]
    return held + [(at + 500 * PERIOD, topic, number(level + 1 + number_of))
                   for number_of, at, topic in (
                       (k // 2, (k // 2) * PERIOD + (k % 2) * 1000,
                        ('/stage/voltage_command', '/stage/voltage')[k % 2])
                       for k in range(100))]


def test_what_was_held_before_the_first_command_is_taken_from_the_measured_voltage(tmp_path):
    recording = read_bag(bag(tmp_path / 'run', _held_at(40.0)))
    assert recording.command[:90].tolist() == [40.0] * 90
    assert any('command of 40, as was measured' in str(each) for each in recording.findings)


def test_rows_before_the_first_command_in_which_the_device_moves_are_left_out(tmp_path):
    recording = read_bag(bag(tmp_path / 'run', _held_at(40.0, moving=0.1)))
    assert len(recording) <= 51
    assert any('nobody knows by which command' in str(each) for each in recording.findings)


def unstamped(path, lost=(), jitter=0.1, count=1000):
    """Write a bag of plain numbers with late arrivals; `lost` voltages never arrive."""
    random = np.random.default_rng(0)
    messages = []
    for k in range(count):
        at = k * PERIOD + 10**9
        late = random.exponential(jitter * PERIOD, 3)
        messages += [
            (at + min(late[0], 0.4 * PERIOD), '/s/voltage_command', number(k % 90)),
            (at + 0.5 * PERIOD + min(late[1], 0.4 * PERIOD), '/s/displacement', number(k * 1e-8)),
        ]
        if k not in lost:
            messages.append((messages[-1][0] + 50_000, '/s/voltage', number(k * 0.1)))
    return bag(path, sorted(messages, key=lambda each: each[0]))


def test_unstamped_topics_use_their_times_of_arrival_and_preflight_finds_the_grid(tmp_path):
    recording = read_bag(unstamped(tmp_path / 'run'))
    assert any('no stamp' in str(each) for each in recording.findings)
    assert np.allclose(recording.measured['voltage'], 0.1 * np.arange(1000))
    assert np.std(np.diff(recording.time)) > 5e-5
    passed, findings = preflight(read_set(tmp_path / 'run'))
    assert any('jitter' in str(each) for each in findings)
    assert np.allclose(np.diff(passed.recordings[0].time), 1e-3, rtol=1e-4)


def test_a_lost_message_of_one_topic_shifts_nothing(tmp_path):
    recording = read_bag(unstamped(tmp_path / 'run', lost=(200, 201, 640)))
    voltage = recording.measured['voltage']
    assert np.flatnonzero(np.isnan(voltage)).tolist() == [200, 201, 640]
    kept = ~np.isnan(voltage)
    assert np.allclose(voltage[kept], 0.1 * np.arange(1000)[kept])


def test_a_topic_of_another_rate_is_interpolated_with_a_word(tmp_path):
    messages = list(ticks(100, offset=10**15))
    messages += [(5 * PERIOD + k * 5 * PERIOD + 700_000, '/laser/charge', number(50.0 * k))
                 for k in range(20)]
    recording = read_bag(bag(tmp_path / 'run', sorted(messages, key=lambda each: each[0])))
    assert np.allclose(recording.measured['charge'][:95], 10.0 * np.arange(95))
    # Which were measured is known: what lies between tells nothing of the device.
    assert np.flatnonzero(~recording.filled['charge'])[:5].tolist() == [0, 5, 10, 15, 20]
    assert any('charge came at' in str(each) for each in recording.findings)


def test_stamps_of_another_clock_are_joined_by_arrival(tmp_path):
    messages = list(ticks(100, offset=10**15))
    messages += [(5 * PERIOD + k * PERIOD + 700_200, '/laser/joint', state(7 + k * PERIOD, k, 9.0))
                 for k in range(99)]
    path = bag(tmp_path / 'run', sorted(messages, key=lambda each: each[0]))
    recording = read_bag(path, parse_mapping(['charge=/laser/joint.position[0]']))
    assert np.allclose(recording.measured['charge'][:99], np.arange(99))
    assert any('the clock of charge' in str(each) for each in recording.findings)


def test_a_command_that_dies_half_way_is_noted(tmp_path):
    messages = list(ticks(1000, offset=10**15))
    cut = [each for k, each in enumerate(messages) if k < 1500 or 'command' not in each[1]]
    notes = [[str(each) for each in read_bag(bag(tmp_path / name, which)).findings]
             for name, which in (('whole', messages), ('cut', cut))]
    assert [any('voltage_command ends there' in each for each in found) for found in notes] == [
        False, True]
    found, = (each for each in notes[1] if 'ends there' in each)
    assert 'row 499: ' in found and '0.5007 s before' in found
    # A command that is sent when it changes, and then held, has ended.
    few = [each for k, each in enumerate(messages) if k < 45 or 'command' not in each[1]]
    assert not any('ends there' in str(each)
                   for each in read_bag(bag(tmp_path / 'few', few)).findings)


def test_commands_faster_than_the_measurement_keep_their_rate(tmp_path):
    messages = [(10**9 + k * PERIOD // 5, '/s/voltage_command', number(k)) for k in range(500)]
    messages += [(10**9 + k * PERIOD + 1, '/s/displacement', number(k)) for k in range(100)]
    recording = read_bag(bag(tmp_path / 'run', sorted(messages, key=lambda each: each[0])))
    assert recording.command.tolist() == list(range(500))
    assert np.allclose(recording.measured['displacement'][:490], np.arange(490) / 5, atol=1e-3)


def test_topics_and_fields_are_mapped_with_units(tmp_path):
    messages = [(at, topic.replace('stage/voltage_command', 'amp/set'), raw)
                for at, topic, raw in ticks(50, 10**15)]
    path = bag(tmp_path / 'run', messages)
    recording = read_bag(path, parse_mapping(
        ['voltage_command=/amp/set', 'displacement=/stage/state.position[0]']),
        parse_units(['displacement=um', 'voltage_command=20']))
    assert recording.measured['displacement'][:3].tolist() == pytest.approx([0.0, 1e-5, 2e-5])
    assert recording.command[:2].tolist() == [20.0, 40.0]


@pytest.mark.parametrize('mapping, complaint', [
    (['displacement=/stage/stat.position[0]'], "no such topic (did you mean '/stage/state'?)"),
    (['displacement=/stage/state.positon[0]'], "no field 'positon' (did you mean 'position'?)"),
    (['displacement=/stage/state.position'], 'is not a number: say which, as in position[0]'),
    (['displacement=/stage/state.name[0]'], 'is not a number'),
    (['displacement=/stage/state.header[0]'], '[0] of no list'),
    (['displacement=/stage/state'], "no field 'data'"),
])
def test_a_field_that_is_no_number_is_named(tmp_path, mapping, complaint):
    assert complaint in error(bag(tmp_path / 'run', ticks(5)), mapping)


def test_two_devices_in_one_bag_must_be_told_apart(tmp_path):
    messages = [(at, topic.replace('/stage', name), raw)
                for at, topic, raw in ticks(50, 10**15) for name in ('/left', '/right')]
    path = bag(tmp_path / 'run', messages)
    assert 'may both be' in error(path) and '--map' in error(path)
    recording = read_bag(path, parse_mapping([
        'voltage_command=/left/voltage_command', 'voltage=/left/voltage',
        'displacement=/left/state.position[0]']))
    assert len(recording) == 50


def test_both_drives_in_one_bag_are_refused(tmp_path):
    messages = [(at, topic.replace('/stage/voltage', '/stage/charge') if k > 60 else topic, raw)
                for k, (at, topic, raw) in enumerate(ticks(50, 10**15))]
    assert 'both voltage_command and charge_command' in error(bag(tmp_path / 'run', messages))


def test_a_bag_without_our_topics_is_refused_with_a_mend(tmp_path):
    messages = [(k, '/chatter', number(k)) for k in range(5)]
    assert 'no topic of a command or a measurement' in error(bag(tmp_path / 'run', messages))


def test_a_message_type_of_ones_own_is_understood(tmp_path):
    types = get_typestore(Stores.ROS2_JAZZY)
    kind = 'lab_msgs/msg/Laser'
    types.register(get_types_from_msg('std_msgs/Header header\nfloat32[3] beams', kind))
    path = tmp_path / 'run'
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        laser = writer.add_connection('/laser', kind, typestore=types)
        command = writer.add_connection('/x/voltage_command', FLOAT, typestore=types)
        for k in range(30):
            stamp = types.types['builtin_interfaces/msg/Time'](5, k * PERIOD)
            message = types.types[kind](types.types['std_msgs/msg/Header'](stamp, ''),
                                        np.array([0, k, 0], dtype=np.float32))
            writer.write(laser, 10**9 + k * PERIOD, types.serialize_cdr(message, kind))
            writer.write(command, 10**9 + k * PERIOD + 1, number(k)[1])
    recording = read_bag(path, parse_mapping(['displacement=/laser.beams[1]']))
    assert recording.measured['displacement'].tolist() == list(range(30))


def test_a_short_list_is_a_missing_sample(tmp_path):
    messages = [(at, topic, state(10**15 + at, *([] if k == 31 else [1.0]))
                 if topic.endswith('state') else raw)
                for k, (at, topic, raw) in enumerate(ticks(50))]
    recording = read_bag(bag(tmp_path / 'run', messages))
    assert np.flatnonzero(np.isnan(recording.measured['displacement'])).tolist() == [10]


def test_a_large_bag_is_thinned_out_and_keeps_its_commands(tmp_path):
    path = bag(tmp_path / 'run', ticks(600, 10**15))
    recording = read_bag(path, max_values=1800)
    assert recording.rows.tolist() == list(range(1, 601, 3))
    # The mean of the commands that acted from the kept sample on, until the next one.
    assert recording.command[:-1].tolist() == [k + 2.0 for k in range(0, 597, 3)]
    assert recording.measured['voltage'].tolist() == [k + 0.5 for k in range(0, 600, 3)]
    assert any('one row in 3 was kept' in str(each) for each in recording.findings)


@pytest.mark.parametrize('step', [3, 7])
def test_a_message_that_a_large_bag_lacks_shifts_nothing(tmp_path, step):
    lost = (100, 101, 102, 107, 500)
    path = unstamped(tmp_path / 'run', lost=lost, count=1050)
    recording = read_bag(path, max_values=9450 // step)
    rows = np.arange(0, 1050, step)
    assert recording.rows.tolist() == (rows + 1).tolist()
    voltage = recording.measured['voltage']
    assert rows[np.isnan(voltage)].tolist() == [k for k in lost if k % step == 0]
    kept = ~np.isnan(voltage)
    assert np.allclose(voltage[kept], 0.1 * rows[kept])


def test_a_slower_topic_of_a_large_bag_is_interpolated_between_its_own_messages(tmp_path):
    messages = list(ticks(600, offset=10**15))
    messages += [(5 * PERIOD + k * 5 * PERIOD + 700_000, '/laser/charge', number(50.0 * k))
                 for k in range(120) if k != 17]
    path = bag(tmp_path / 'run', sorted(messages, key=lambda each: each[0]))
    recording = read_bag(path, max_values=1000)
    step = int(recording.rows[1] - recording.rows[0])
    assert step > 1
    assert np.allclose(recording.measured['charge'][:-2], 10.0 * (recording.rows[:-2] - 1.0))


def test_a_killed_recorders_mcap_is_read_up_to_its_end(tmp_path):
    write_bag(pushed(300), tmp_path / 'run')
    data = (tmp_path / 'run/run.mcap').read_bytes()
    whole = read_bag(tmp_path / 'run')
    cut = tmp_path / 'cut.mcap'
    lengths = []
    for part in (0.3, 0.5, 0.7, 0.95, 0.9999):
        cut.write_bytes(data[:int(part * len(data))])
        recording = read_bag(cut)
        assert any('its recorder was killed' in str(each) for each in recording.findings)
        rows = len(recording)
        assert np.array_equal(recording.measured['displacement'],
                              whole.measured['displacement'][:rows])
        assert np.array_equal(recording.command[:rows - 1], whole.command[:rows - 1])
        lengths.append(rows)
    assert lengths == sorted(lengths) and lengths[-1] == 300 and 50 < lengths[0] < 120


def test_a_killed_recorders_folder_is_read_without_its_metadata(tmp_path):
    write_bag(slow(100), tmp_path / 'run')
    (tmp_path / 'run/metadata.yaml').unlink()
    (tmp_path / 'run/run.mcap').rename(tmp_path / 'run/run_0.mcap')
    found = read_set(tmp_path / 'run')
    assert len(found['run']) == 100
    assert 'metadata.yaml is missing' in str(found['run'].findings[0])


def test_rows_in_a_write_ahead_log_are_not_lost_in_silence(tmp_path):
    write_bag(slow(100), tmp_path / 'run', 'sqlite3')
    (tmp_path / 'run/run.db3-wal').write_bytes(b'rows')
    assert 'wal_checkpoint' in error(tmp_path / 'run/run.db3')


@pytest.mark.parametrize('name', ['run.mcap', 'run.db3'])
def test_a_file_that_is_no_bag_is_an_input_error(tmp_path, name):
    (tmp_path / name).write_bytes(b'no bag at all' * 100)
    error(tmp_path / name)
    (tmp_path / name).write_bytes(b'')
    error(tmp_path / name)


def test_a_bag_is_not_written_over_another(tmp_path):
    write_bag(slow(50), tmp_path / 'run')
    with pytest.raises(InputError, match='exists already'):
        write_bag(slow(60), tmp_path / 'run')
    assert len(read_bag(tmp_path / 'run')) == 50
    assert [each.name for each in tmp_path.iterdir()] == ['run']


def test_an_interrupted_writer_leaves_no_folder(tmp_path, monkeypatch):
    def stop(*_):
        raise KeyboardInterrupt
    monkeypatch.setattr(Writer, 'close', stop)
    with pytest.raises(KeyboardInterrupt):
        write_bag(slow(50), tmp_path / 'run')
    assert not list(tmp_path.iterdir())


def test_without_the_bag_library_one_is_told_to_install_it(tmp_path, monkeypatch):
    write_bag(slow(50), tmp_path / 'run')
    monkeypatch.setitem(sys.modules, 'rosbags.rosbag2', None)
    assert 'pip install rosbags' in error(tmp_path / 'run')
    with pytest.raises(InputError, match='pip install rosbags'):
        write_bag(slow(50), tmp_path / 'other')


def test_tables_are_read_without_loading_anything_heavy():
    program = ('import sys, piezo_stack_sim.recording as r\n'
               'heavy = {"rosbags", "scipy", "numba", "matplotlib", "rclpy", "pandas"}\n'
               'sys.exit(str(sorted(heavy & set(sys.modules)) or ""))')
    result = subprocess.run([sys.executable, '-c', program], capture_output=True, text=True)
    assert result.stderr.strip() == ''


def test_a_bag_says_what_it_holds(tmp_path):
    with open_bag(bag(tmp_path / 'run', ticks(5))) as opened:
        assert opened.topics['/stage/state'] == (STATE, 5, True)
        assert opened.topics['/stage/voltage'] == (FLOAT, 5, False)


def test_a_bag_of_a_slow_triangle_passes_preflight(tmp_path):
    write_bag(slow(), tmp_path / 'run')
    _, findings = preflight(read_set(tmp_path / 'run'), DEVICE)
    assert not findings
