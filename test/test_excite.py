# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Claims about test programmes played over topics: what is recorded, and what a device suffers."""

import os
import signal
import subprocess
import sys

import numpy as np
from piezo_stack_sim import cli
from piezo_stack_sim.errors import InputError
from piezo_stack_sim.plant import Device, simulate
from piezo_stack_sim.recording.programmes import steps, triangle
from piezo_stack_sim.recording.read import read_set
from piezo_stack_sim.resources import config_file
import pytest
from ros_process import (
    Client, ENVIRONMENT, node_arguments, NodeProcess, NOMINAL, PATIENCE, SPACE, until)

from piezo_stack_sim.node.excite_limits import Limits  # noqa: I100

STACK = f'{SPACE}/stack'
SHORT = ('--peaks', '30', '60', '--frequency', '20', '--cycles', '1')


@pytest.fixture(scope='module')
def device():
    """One device in lockstep for all tests."""
    node = NodeProcess(*node_arguments('stepping:=lockstep'))
    yield STACK
    assert node.end()[0] == 0


@pytest.fixture(scope='module')
def wall_device():
    """One device by wall time for all tests."""
    node = NodeProcess(*node_arguments('rate:=200', name='wall'))
    yield f'{SPACE}/wall'
    assert node.end()[0] == 0


def excite(*arguments):
    """Run the command in this process, patient with a busy machine; return its exit status."""
    if '--patience' not in arguments:
        arguments += ('--patience', PATIENCE)
    return cli.main(['excite', *(str(a) for a in arguments)])


def offline(recording):
    """Return what the plant answers to the commands of a recording."""
    return simulate(Device.nominal(), recording.time, recording.command,
                    recording.external_force, recording.drive)


def error_of(capfd, *arguments):
    """Return the one line that a refused command prints."""
    assert excite(*arguments) == 2
    errors = capfd.readouterr().err
    assert errors.count('\n') == 1
    return errors


# -- limits ----------------------------------------------------------------------------


def test_a_programme_beyond_the_voltage_limits_is_refused_in_words():
    with pytest.raises(InputError, match='triangle: 0 to 90 V exceeds the limits 0 to 60 V.*clip'):
        Limits((0.0, 60.0)).enforce(triangle(rate=1000.0), clip=False)


def test_a_clipped_programme_keeps_voltage_and_slew_limits():
    limits = Limits((0.0, 60.0), slew=500.0)
    clipped, remarks = limits.enforce(triangle(rate=1000.0), clip=True)
    assert len(remarks) == 2 and '500 V/s' in remarks[1]
    assert clipped.command.max() <= 60.0
    assert np.abs(np.diff(clipped.command)).max() * 1000.0 <= 500.0 * (1.0 + 1e-9)


def test_a_current_limit_limits_the_slew_by_the_capacitance():
    limits = Limits(current=0.01, capacitance=2e-6)
    assert limits.fastest(90.0) == pytest.approx(5000.0)
    with pytest.raises(InputError, match='current limit 0.01 A'):
        limits.enforce(triangle((90.0,), 100.0, rate=10e3), clip=False)
    with pytest.raises(InputError, match='--params'):
        Limits(current=0.01)


def test_a_programme_within_the_limits_is_left_alone():
    programme = steps(hold=0.5, rate=1000.0)
    kept, remarks = Limits((0.0, 80.0), slew=1e4).enforce(programme, clip=False)
    assert kept is programme and not remarks


@pytest.mark.parametrize('channel', ['command', 'external_force'])
@pytest.mark.parametrize('value', [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize('clip', [False, True])
def test_what_is_no_finite_number_is_refused_whatever_the_limits(channel, value, clip):
    programme = triangle(rate=1000.0)
    values = getattr(programme, channel).copy()
    values[41] = value
    for limits in (Limits(), Limits((0.0, 100.0), slew=1e6)):
        with pytest.raises(InputError, match='triangle: row 42: .* is no finite number'):
            limits.enforce(programme.replace(**{channel: values}), clip)


@pytest.mark.parametrize('slew', [None, 40.0, 1e6])
def test_a_ramp_ends_where_it_should_and_keeps_the_slew(slew):
    ramp = Limits(slew=slew).ramp(80.0, 0.0, 1000.0)
    assert ramp[-1] == 0.0
    assert np.abs(np.diff(ramp, prepend=80.0)).max() * 1000.0 <= (slew or 161.0) * (1 + 1e-9)
    assert ramp.size >= 500


def test_the_safe_voltage_is_the_allowed_one_nearest_to_zero():
    assert Limits().safe == 0.0
    assert Limits((10.0, 60.0)).safe == 10.0
    assert Limits((-30.0, 60.0)).safe == 0.0


# -- a device in lockstep ------------------------------------------------------------------


def test_a_recording_from_lockstep_is_the_offline_simulation_to_the_bit(device, tmp_path, capfd):
    out = tmp_path / 'set'
    assert excite('triangle', *SHORT, '--reset', '--node', device, '--out', out) == 0
    assert capfd.readouterr().out == f'1 recordings, 100 rows: {out}\n'
    recording = read_set(out)['triangle']
    assert list(recording.measured) == ['voltage', 'charge', 'displacement']
    assert list(recording.command) == list(triangle((30.0, 60.0), 20.0, 1, 1000.0).command)
    answer = offline(recording)
    for channel, values in recording.measured.items():
        assert np.array_equal(values, getattr(answer, channel)), channel


def test_force_is_recorded_with_the_row_from_which_it_acts(device, tmp_path):
    assert excite('force', '--frequency', '20', '--cycles', '1', '--reset', '--node', device,
                  '--out', tmp_path) == 0
    recording = read_set(tmp_path)['force']
    assert recording.external_force.min() == pytest.approx(-120.0, rel=1e-3)
    assert np.array_equal(recording.measured['displacement'], offline(recording).displacement)


def test_open_leads_are_played_by_force_alone_and_the_drive_is_set_back(device, tmp_path):
    assert excite('force', '--drive', 'open', '--frequency', '20', '--cycles', '1', '--reset',
                  '--node', device, '--out', tmp_path) == 0
    recording = read_set(tmp_path)['force']
    assert recording.drive == 'open'
    assert np.array_equal(recording.measured['displacement'], offline(recording).displacement)
    assert excite('triangle', *SHORT, '--node', device, '--out', tmp_path) == 0


def test_charge_drive_plays_coulombs(device, tmp_path):
    assert excite('triangle', *SHORT, '--drive', 'charge', '--charge-per-volt', '1e-6', '--reset',
                  '--node', device, '--out', tmp_path) == 0
    recording = read_set(tmp_path)['triangle']
    assert recording.drive == 'charge'
    assert recording.command.max() == pytest.approx(60e-6)
    assert np.array_equal(recording.measured['displacement'], offline(recording).displacement)


def test_a_recording_set_is_played_again(device, tmp_path):
    assert excite('steps', '--levels', '0,20,5', '--hold', '0.1', '--transition', '0.02',
                  '--reset', '--node', device, '--out', tmp_path / 'a') == 0
    assert excite(tmp_path / 'a', '--reset', '--node', device, '--out', tmp_path / 'b') == 0
    first, second = ((tmp_path / name / 'steps.csv').read_bytes() for name in 'ab')
    assert first == second


def test_what_does_not_begin_at_rest_is_led_up_to_on_record(device, tmp_path):
    assert excite('steps', '--levels', '40', '20', '--hold', '0.1', '--transition', '0.02',
                  '--reset', '--node', device, '--out', tmp_path) == 0
    recording = read_set(tmp_path)['steps']
    assert np.abs(np.diff(recording.command, prepend=0.0)).max() < 2.0
    assert np.array_equal(recording.measured['charge'], offline(recording).charge)


def test_a_device_is_left_at_the_safe_voltage(device, tmp_path):
    assert excite('steps', '--levels', '0', '40', '--hold', '0.1', '--voltage-limits', '-5', '100',
                  '--node', device, '--out', tmp_path) == 0
    client = Client()
    client.until(client._services['step'].service_is_ready, 'services')
    client.until(lambda: client.call('step') and client.heard['voltage'], 'the voltage')
    client.close()
    assert client.heard['voltage'][-1] == pytest.approx(0.0, abs=1e-9)


def test_a_lost_answer_is_asked_for_again(device, tmp_path, monkeypatch):
    from piezo_stack_sim.node import asking
    from rclpy.client import Client as ServiceClient
    from rclpy.task import Future
    monkeypatch.setattr(asking, 'RETRY', 0.3)
    asked, real = [], ServiceClient.call_async

    def lose_the_first(client, request):
        asked.append(client.srv_name)
        return Future() if asked.count(client.srv_name) == 1 else real(client, request)

    monkeypatch.setattr(ServiceClient, 'call_async', lose_the_first)
    assert excite('triangle', *SHORT, '--reset', '--node', device, '--out', tmp_path) == 0
    assert asked.count(f'{device}/reset') == 2
    recording = read_set(tmp_path)['triangle']
    assert np.array_equal(recording.measured['charge'], offline(recording).charge)


def test_ticks_that_somebody_else_commands_are_noticed(tmp_path):
    node = NodeProcess(*node_arguments('stepping:=lockstep', name='shared'))
    client = Client(f'{SPACE}/shared')
    client.until(lambda: client.inputs['voltage_command'].get_subscription_count(), 'the device')
    process = subprocess.Popen(
        [sys.executable, '-m', 'piezo_stack_sim', 'excite', 'steps', '--hold', '2', '--node',
         f'{SPACE}/shared', '--out', str(tmp_path)],
        env=ENVIRONMENT, stderr=subprocess.PIPE, text=True)
    client.until(lambda: len(client.heard['state']) > 200, 'the programme')
    while process.poll() is None:
        client.send('voltage_command', 5.0)
        client.listen(0.02)
    errors = process.communicate()[1]
    client.close()
    node.end()
    assert process.returncode == 2 and errors.count('\n') == 1
    assert 'ticks that were not commanded here' in errors


# -- a device by wall time -----------------------------------------------------------------


def test_by_wall_time_rows_carry_stamps_and_the_commands_that_act_from_them(wall_device, tmp_path):
    assert excite('triangle', '--peaks', '60', '--frequency', '0.5', '--cycles', '1', '--reset',
                  '--node', wall_device, '--out', tmp_path) == 0
    recording = read_set(tmp_path)['triangle']
    # On a busy machine the first row may already show one of the first commands, 0.3 V apart.
    assert recording.time[0] == 0.0 and recording.command[0] < 3.0
    assert recording.period == pytest.approx(0.005, rel=1e-3)
    # Between two rows at most 1 % of the stroke happens: a command off by a row would show.
    answer = offline(recording)
    for channel in ('charge', 'displacement'):
        span = np.ptp(recording.measured[channel])
        gap = np.abs(recording.measured[channel] - getattr(answer, channel))
        assert np.nanmedian(gap) < 2e-3 * span, channel
    # A command acts from its row on and shows at the next one. Those tell that hold for one row:
    # a busy machine sends some late, and the one before is held.
    voltage, command = recording.measured['voltage'], recording.command
    alone = 1 + np.flatnonzero(np.diff(command)[:-1] * np.diff(command)[1:])[:-1]
    shown = [np.mean(np.abs(voltage[alone + lag] - command[alone]) < 1e-9) for lag in range(3)]
    assert alone.size > 50
    assert shown[1] > 0.5 and shown[1] > 2.0 * max(shown[0], shown[2])


def test_by_wall_time_who_begins_to_command_ends_the_programme(wall_device, tmp_path):
    process = subprocess.Popen(
        [sys.executable, '-m', 'piezo_stack_sim', 'excite', 'steps', '--levels', '0', *99 * ['40'],
         '--hold', '1', '--node', wall_device, '--out', str(tmp_path)],
        env=ENVIRONMENT, stderr=subprocess.PIPE, text=True)
    until(lambda: (tmp_path / 'steps.csv').exists(), 'the programme')
    client = Client(wall_device)  # later than the recorder, who cannot have known of it
    listening = client.inputs['voltage_command'].get_subscription_count
    client.until(lambda: listening() > 1, 'the device and the recorder')
    client.until(lambda: client.heard['voltage'] and client.heard['voltage'][-1] > 39.9, '40 V')
    for _ in range(5):
        client.send('voltage_command', 5.0)
    client.until(lambda: process.poll() is not None, 'the end')
    errors = process.communicate()[1]
    name = client.node.get_name()
    client.close()
    assert process.returncode == 2 and errors.count('\n') == 1
    assert f'{name} commands it, too, the recording is wrong' in errors
    rows = len(read_set(tmp_path)['steps'])
    assert 100 < rows < 0.9 * 200 * 100  # what was recorded is kept; not all of 100 s was played


def test_who_could_send_commands_by_wall_time_and_does_not_is_no_hindrance(wall_device, tmp_path):
    client = Client(wall_device)
    assert excite('triangle', '--peaks', '20', '--frequency', '2', '--cycles', '1', '--reset',
                  '--node', wall_device, '--out', tmp_path) == 0
    client.close()


def test_ctrl_c_keeps_what_was_recorded_and_ramps_down(wall_device, tmp_path):
    client = Client(wall_device)
    process = subprocess.Popen(
        [sys.executable, '-m', 'piezo_stack_sim', 'excite', 'steps', '--levels', '0', *30 * ['80'],
         '--hold', '1', '--node', wall_device, '--out', str(tmp_path)],
        env=ENVIRONMENT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    client.until(lambda: client.heard['voltage'] and client.heard['voltage'][-1] > 79.999, '80 V')
    process.send_signal(signal.SIGINT)
    client.until(lambda: process.poll() is not None, 'the end')
    output, errors = process.communicate(timeout=PATIENCE)
    assert process.returncode == 130, errors
    assert 'left at 0 V' in errors
    client.until(lambda: client.heard['voltage'][-1] < 0.5, '0 V')
    client.close()
    rows = read_set(tmp_path)['steps']
    assert 200 < len(rows) < 6000  # of 31 s
    assert rows.command[-1] == 80.0
    # Half a second for 80 V, many voltages on the way: no step.
    heard = np.array(client.heard['voltage'])
    down = heard[np.flatnonzero(heard > 79.999)[-1]:]
    assert np.unique(down[(down > 1.0) & (down < 79.0)]).size > 50
    assert np.all(np.diff(down) < 0.01)


def test_a_recording_that_cannot_be_written_ends_with_the_ramp_down(
        wall_device, tmp_path, monkeypatch, capfd):
    from piezo_stack_sim.recording.write import CsvWriter

    def full(writer, rows):
        # Not after so many writes: on a busy machine these may be over before it is up.
        if np.array(rows)[:, writer.columns.index('voltage_command')].max(initial=0.0) > 79.0:
            raise OSError(28, 'No space left on device', str(tmp_path / 'steps.csv'))

    monkeypatch.setattr(CsvWriter, 'write', full)
    client = Client(wall_device)
    client.until(lambda: client.heard['voltage'], 'the voltage')
    assert excite('steps', '--levels', '0', '80', '80', '--hold', '1', '--transition', '0.1',
                  '--node', wall_device, '--out', tmp_path) != 0
    assert 'No space left' in capfd.readouterr().err
    heard = client.heard['voltage']
    client.until(lambda: max(heard) > 70.0 and abs(heard[-1]) < 0.5, 'up and down again')
    client.close()
    down = heard[np.flatnonzero(np.array(heard) > 70.0)[-1]:]
    assert np.abs(np.diff(down)).max() < 8.0


DRIVER = """
import sys, time
import rclpy
from rclpy.node import Node
from rclpy.time import Time
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64
rclpy.init()
node = Node('driver', namespace=sys.argv[1], start_parameter_services=False)
value = [0.0]
def take(message):
    value[0] = message.data
node.create_subscription(Float64, '~/voltage_command', take, 10)
state = node.create_publisher(JointState, '~/state', 10)
start, count = time.time(), 0
def tick():
    # Its converter has a clock of its own, 20 us uneven, however late a busy machine is.
    global count
    count = max(count + 1, round((time.time() - start) / 0.005))
    stamp = start + 0.005 * count + 2e-5 * (count % 3 - 1)
    message = JointState(name=['stage'], position=[1e-7 * value[0]])
    message.header.stamp = Time(nanoseconds=round(1e9 * stamp)).to_msg()
    state.publish(message)
node.create_timer(0.005, tick)
print('up', flush=True)
rclpy.spin(node)
"""


def test_a_driver_that_tells_no_rate_is_commanded_at_the_round_one_that_its_stamps_show(tmp_path):
    driver = subprocess.Popen([sys.executable, '-c', DRIVER, SPACE], env=ENVIRONMENT,
                              stdout=subprocess.PIPE, text=True)
    try:
        assert driver.stdout.readline() == 'up\n'
        assert excite('triangle', '--peaks', '60', '--frequency', '1', '--cycles', '1',
                      '--patience', '3', '--node', f'{SPACE}/driver', '--out', tmp_path) == 0
    finally:
        driver.kill()
        driver.wait(PATIENCE)
    recording = read_set(tmp_path)['triangle']
    assert recording.period == pytest.approx(0.005, rel=0.02)
    assert len(recording) > 180  # one second of 200 Hz, more where commands came late
    measured = recording.measured['displacement']
    assert measured.max() == pytest.approx(60e-7, rel=0.03)


def test_a_killed_recording_can_be_read(wall_device, tmp_path):
    process = subprocess.Popen(
        [sys.executable, '-m', 'piezo_stack_sim', 'excite', 'steps', '--node', wall_device,
         '--out', str(tmp_path)], env=ENVIRONMENT)
    file = tmp_path / 'steps.csv'
    until(lambda: file.exists() and file.stat().st_size > 2000, 'rows')
    process.kill()
    process.wait(PATIENCE)
    assert len(read_set(tmp_path)['steps']) > 20


# -- what is refused -----------------------------------------------------------------------


@pytest.mark.parametrize('arguments, reason', [
    (['triangel'], 'did you mean triangle?'),
    (['decay', '--peaks', '30'], '--peaks: decay has no such setting'),
    (['triangle', '--current', '0.1'], '--params'),
    (['triangle', '--slew', '-1'], '--slew -1: expected a positive number'),
    (['triangle', '--voltage-limits', '50', '20'], 'lower one first'),
    (['multisine', '--band', '20'], 'expected two numbers'),
    (['triangle', '--drive', 'charge'], '--charge-per-volt'),
    (['triangle', '--drive', 'open'], 'only the programme force'),
    (['triangle', '--rest', '-1'], '--rest -1'),
    (['triangle', '--rest', 'nan'], '--rest nan'),
    (['triangle', '--rest', 'inf'], '--rest inf'),
    (['triangle', '--slew', 'nan'], '--slew nan: expected a positive number'),
    (['triangle', '--slew', 'inf'], '--slew inf'),
    (['triangle', '--current', 'nan', '--capacitance', '2e-6'], '--current nan'),
    (['triangle', '--voltage-limits', 'nan', '50'], '--voltage-limits nan 50: expected finite'),
    (['triangle', '--voltage-limits', '0', 'inf'], '--voltage-limits 0 inf: expected finite'),
    (['bench', '--drive', 'charge', '--charge-per-volt', '2e-6'], '--charge-per-volt'),
    (['triangle', '--frequency', '0'], '--frequency 0: expected a positive number'),
    (['triangle', '--cycles', '0'], '--cycles 0: expected a whole number from 1'),
    (['force', '--cycles', '-1'], '--cycles -1: expected a whole number from 1'),
    (['triangle', '--peaks'], 'expected numbers, such as --peaks 30 60 90'),
    (['triangle', '--peaks', 'abc'], "'--peaks': 'abc': expected numbers"),
    (['triangle', '--peaks', 'abc', '30'], "'--peaks': 'abc,30': expected numbers"),
    (['triangle', '--peaks', '--quick'], "'--peaks': nothing after it: expected numbers"),
    (['triangle', '--peaks', '30', 'nan'], '--peaks nan: expected a finite number'),
    (['multisine', '--lines', '0'], '--lines 0'),
    (['multisine', '--lines', '-1'], '--lines -1'),
    (['multisine', '--periods', '0'], '--periods 0'),
    (['multisine', '--period', '-1'], '--period -1'),
    (['multisine', '--seed', '-1'], '--seed -1: expected zero or more'),
    (['multisine', '--band', '0', '0'], '--band 0: expected a positive number'),
    (['multisine', '--bias', 'inf'], '--bias inf'),
    (['force', '--frequency', '0'], '--frequency 0'),
    (['force', '--rest-before', '-1'], '--rest-before -1: expected zero or more'),
    (['force', '--peaks', '3'], '--rest-before'),
    (['decay', '--time-constant', '0'], '--time-constant 0'),
    (['decay', '--duration', '-1'], '--duration -1'),
    (['steps', '--transition', '-0.1'], '--transition -0.1: expected zero or more'),
    (['steps', '--hold', 'nan'], '--hold nan'),
    (['triangle', '--node', ''], "--node '': expected a name"),
    (['triangle', '--node', 'bad name'], "--node 'bad name': expected a name"),
    (['triangle', '--node', '/a//b'], "--node '/a//b'"),
    (['triangle', '--namespace', '3d'], "--namespace '3d'"),
    (['bench', '--drive', 'charge', '--slew', '100'], '--slew: '),
])
def test_wrong_arguments_are_one_line(capfd, tmp_path, arguments, reason):
    assert reason in error_of(capfd, *arguments, '--out', tmp_path / 'set')
    assert not (tmp_path / 'set').exists()


@pytest.mark.parametrize('cell', ['nan', 'inf', ''])
def test_a_recording_with_a_command_that_is_no_number_is_not_played_again(capfd, tmp_path, cell):
    file = tmp_path / 'bench.csv'
    file.write_text('time,voltage_command\n0,0\n0.001,' + cell + '\n0.002,0\n')
    error = error_of(capfd, file, '--out', tmp_path / 'set')
    assert f'{file}: row 3: voltage_command is' in error


def test_a_wrong_name_is_told_with_the_devices_there_are(device, tmp_path, capfd):
    error = error_of(capfd, 'triangle', '--node', '/nobody', '--patience', '6', '--out', tmp_path)
    assert 'no device /nobody' in error and device in error


def test_limits_are_checked_before_the_device_moves(device, tmp_path, capfd):
    error = error_of(capfd, 'all', '--quick', '--voltage-limits', '0', '70', '--node', device,
                     '--out', tmp_path / 'set')
    assert 'triangle: 0 to 90 V exceeds the limits 0 to 70 V' in error
    assert not (tmp_path / 'set').exists()


def test_the_current_limit_takes_the_capacitance_from_the_parameter_file(device, tmp_path, capfd):
    error = error_of(capfd, 'triangle', '--current', '0.001', '--params', NOMINAL, '--node',
                     device, '--out', tmp_path / 'set')
    assert 'current limit 0.001 A' in error
    assert excite('triangle', *SHORT, '--current', '0.001', '--params', NOMINAL, '--clip',
                  '--reset', '--node', device, '--out', tmp_path / 'set') == 0
    recording = read_set(tmp_path / 'set')['triangle']
    current = np.abs(np.diff(recording.measured['charge'])) * recording.rate
    assert 0.0003 < current.max() < 0.0011


def test_a_file_in_the_way_is_not_overwritten(tmp_path, capfd):
    (tmp_path / 'triangle.csv').write_text('mine')
    error = error_of(capfd, 'triangle', '--out', tmp_path)
    assert 'triangle.csv: exists already' in error
    assert (tmp_path / 'triangle.csv').read_text() == 'mine'


def test_another_rate_is_refused_in_lockstep(device, tmp_path, capfd):
    error = error_of(capfd, 'triangle', '--rate', '500', '--node', device, '--out', tmp_path)
    assert 'steps at 1000 Hz in lockstep' in error


def test_the_namespace_may_stand_apart(device, tmp_path):
    namespace, _, name = device.rpartition('/')
    assert excite('triangle', *SHORT, '--node', name, '--namespace', namespace,
                  '--out', tmp_path) == 0


def test_help_needs_no_ros():
    code = ('import sys; from piezo_stack_sim.cli import main; main(["excite", "--help"]); '
            'print("rclpy" in sys.modules)')
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True,
                          env={**os.environ, **ENVIRONMENT})
    assert done.stdout.endswith('False\n')
    assert config_file('ae0505d16.yaml')
