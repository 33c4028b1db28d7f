# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Claims about the device behind ROS topics in lockstep: real node, real DDS."""

import math

from piezo_stack_sim.plant import Device, Plant
import pytest
from ros_process import Client, nanoseconds, node_arguments, NodeProcess

PERIOD_NS = 1_000_000
COMMANDS = [45.0 * (1.0 - math.cos(0.12 * k)) for k in range(300)]


@pytest.fixture(scope='module')
def node():
    """One node in lockstep for the whole module."""
    node = NodeProcess(*node_arguments('stepping:=lockstep'))
    yield node
    status, output = node.end()
    assert status == 0, output


@pytest.fixture(scope='module')
def connection(node):
    """One client for the whole module."""
    client = Client()
    client.connect()
    yield client
    client.close()


@pytest.fixture
def device(connection):
    """Return a client of a device just reset, voltage driven."""
    results = connection.set_parameters(drive='voltage', command_timeout=0.0)
    assert all(result.successful for result in results)
    connection.call('pause', data=False)
    connection.fresh()
    return connection


def offline(commands, drive='voltage', forces=None):
    """Return what the plant without ROS does with the same commands."""
    plant = Plant(Device.nominal(), drive=drive)
    forces = forces or [0.0] * len(commands)
    samples = [plant.advance(u, f) for u, f in zip(commands, forces)]
    return [(s.displacement, s.velocity, s.charge, s.voltage, s.force) for s in samples]


def test_each_command_advances_one_period_and_equals_the_plant_to_the_bit(device):
    device.send('voltage_command', *COMMANDS)
    assert device.wait_for_states(len(COMMANDS)) == offline(COMMANDS)


def test_the_same_commands_give_the_same_outputs_at_another_pace(device):
    device.send('voltage_command', *COMMANDS[:100])
    at_once = device.wait_for_states(100)
    device.fresh()
    for k, command in enumerate(COMMANDS[:100]):
        device.send('voltage_command', command)
        device.wait_for_states(k + 1)
    assert device.rows() == at_once


def test_scalar_topics_and_state_tell_the_same(device):
    device.send('voltage_command', *COMMANDS[:20])
    device.wait_for_states(20)
    states = device.heard['state']
    assert [s.position[0] for s in states] == device.heard['displacement']
    assert [s.effort[0] for s in states] == device.heard['force']
    assert {tuple(s.name) for s in states} == {('stack',)}


def test_stamps_are_device_time_and_the_clock_follows_each_of_them(device):
    device.send('voltage_command', *COMMANDS[:50])
    device.wait_for_states(50)
    expected = [(k + 1) * PERIOD_NS for k in range(50)]
    assert [nanoseconds(s.header.stamp) for s in device.heard['state']] == expected
    device.until(lambda: len(device.heard['clock']) >= 50, 'the clock')
    assert device.heard['clock'] == expected


def test_step_advances_with_the_command_held(device):
    device.send('voltage_command', 30.0)
    device.wait_for_states(1)
    answer = device.call('step')
    assert answer.success and answer.message == 'time 0.002 s'
    assert device.wait_for_states(2) == offline([30.0, 30.0])


def test_in_a_pause_commands_wait_for_a_step(device):
    device.call('pause', data=True)
    device.send('voltage_command', 10.0, 20.0, 30.0)
    device.listen(0.3)
    assert not device.heard['state']
    assert device.call('step').success
    assert device.wait_for_states(1) == offline([30.0])


def test_reset_returns_time_and_state_to_the_start(device):
    device.send('voltage_command', *COMMANDS[:30])
    first = device.wait_for_states(30)
    device.fresh()
    device.send('voltage_command', *COMMANDS[:30])
    assert device.wait_for_states(30) == first
    assert nanoseconds(device.heard['state'][0].header.stamp) == PERIOD_NS


def test_not_a_number_is_refused_and_counted(device):
    before = int(device.report_with(lambda *_: True, 'diagnostics')[1]['refused_not_finite'])
    device.send('voltage_command', 10.0, math.nan, math.inf, -math.inf, 20.0)
    device.send('external_force', math.nan)
    assert device.wait_for_states(2) == offline([10.0, 20.0])
    status, values = device.report_with(
        lambda s, v: int(v['refused_not_finite']) == before + 4, 'the count of refusals')
    assert values['time'] == '0.002'


def test_refusals_are_logged_once_a_second_at_most(device, node):
    before = node.output.count('refused: not finite')
    device.send('voltage_command', *[math.nan] * 500)
    device.report_with(lambda s, v: 'not finite' in s.message, 'the warning')
    device.listen(1.5)
    assert 1 <= node.output.count('refused: not finite') - before <= 3


def test_commands_out_of_range_are_clamped_and_counted(device):
    before = int(device.report_with(lambda *_: True, 'diagnostics')[1]['clamped'])
    device.send('voltage_command', -20.0, 80.0, 151.0)
    assert device.wait_for_states(3) == offline([0.0, 80.0, 150.0])
    device.report_with(lambda s, v: int(v['clamped']) == before + 2, 'the count of clamps')


def test_a_command_on_the_inactive_port_is_refused_and_counted(device):
    before = int(device.report_with(lambda *_: True, 'd')[1]['refused_inactive_port'])
    device.send('charge_command', 1e-5)
    status, values = device.report_with(
        lambda s, v: int(v['refused_inactive_port']) == before + 1, 'the count')
    assert not device.heard['state']


def test_charge_beyond_the_identified_range_warns_until_reset(device):
    device.send('voltage_command', 60.0, 150.0, 150.0)
    device.wait_for_states(3)
    status, values = device.report_with(lambda s, v: v['charge_out_of_range'] == 'true', 'warning')
    assert status.level == status.WARN
    assert 'identified range' in status.message
    device.fresh()
    status, values = device.report_with(lambda s, v: v['charge_out_of_range'] == 'false', 'calm')
    assert 'identified range' not in status.message


@pytest.mark.parametrize('drive', ['charge', 'open', 'voltage'])
def test_switching_the_drive_makes_no_jump(device, drive):
    device.send('voltage_command', *COMMANDS[:40])
    before = device.wait_for_states(40)[-1]
    assert device.set_parameters(drive=drive)[0].successful
    device.call('step')
    after = device.wait_for_states(41)[-1]
    assert after[0] == pytest.approx(before[0], rel=1e-6)
    assert after[2] == pytest.approx(before[2], rel=1e-6)


def test_charge_drive_follows_the_charge_command(device):
    charges = [1e-6 * k for k in range(1, 61)]
    assert device.set_parameters(drive='charge')[0].successful
    device.send('charge_command', *charges)
    rows = device.wait_for_states(60)
    assert [row[2] for row in rows] == pytest.approx(charges, rel=1e-9)
    assert rows == offline(charges, 'charge')


def test_with_open_leads_the_force_steps_and_shows_the_open_stiffness(device):
    assert device.set_parameters(drive='open')[0].successful
    device.send('external_force', *[-200.0] * 20)
    assert device.wait_for_states(20)[-1][0] == pytest.approx(-2.23881e-6, rel=1e-4)


def test_the_force_acts_with_the_command_that_follows_it(device):
    forces = [-50.0 * k for k in range(20)]
    for k, (command, force) in enumerate(zip(COMMANDS, forces)):
        device.send('external_force', force)
        device.listen(0.05)
        device.send('voltage_command', command)
        device.wait_for_states(k + 1)
    assert device.rows() == offline(COMMANDS[:20], forces=forces)


def test_without_commands_the_last_one_is_held_and_reported(device, node):
    assert device.set_parameters(command_timeout=0.005)[0].successful
    device.send('voltage_command', 40.0)
    for _ in range(10):
        device.call('step')
    assert device.wait_for_states(11) == offline([40.0] * 11)
    device.report_with(lambda s, v: v['command_timed_out'] == 'true', 'the watchdog')
    node.wait_for('the last one is held')
    device.send('voltage_command', 41.0)
    device.report_with(lambda s, v: v['command_timed_out'] == 'false', 'calm')


@pytest.mark.parametrize('name, value, reason', [
    ('drive', 'charged', 'did you mean charge?'),
    ('command_timeout', -1.0, 'command_timeout'),
    ('actuator__mass', 0.005, 'read-only'),
    ('rate', 500.0, 'read-only'),
    ('noise__charge', 5.0, 'noise.charge'),
    ('drive', 5, 'type'),
    ('effects__creep__gain_per_decade', 0.01, 'read-only'),
])
def test_a_rejected_parameter_says_why(device, name, value, reason):
    result = device.set_parameters(**{name: value})[0]
    assert not result.successful
    assert reason in result.reason


def test_every_parameter_is_described_with_its_unit_and_range(device):
    mass, timeout, drive, stiffness = device.describe(
        'actuator.mass', 'command_timeout', 'drive', 'actuator.maxwell_stiffness')
    assert mass.description.endswith('kg') and mass.read_only
    assert 0.0 < mass.floating_point_range[0].from_value < 0.00375
    assert timeout.description.endswith(', s') and not timeout.read_only
    assert timeout.floating_point_range[0].from_value == 0.0
    assert 'voltage, charge, open, shorted' in drive.additional_constraints
    assert stiffness.description.endswith('V/C')


def test_noise_can_be_switched_on_while_running(device):
    device.send('voltage_command', *[20.0] * 30)
    quiet = {row[0] for row in device.wait_for_states(30)[-10:]}
    assert device.set_parameters(noise__displacement=2e-9)[0].successful
    device.send('voltage_command', *[20.0] * 30)
    noisy = {row[0] for row in device.wait_for_states(60)[-10:]}
    assert device.set_parameters(noise__displacement=0.0)[0].successful
    assert len(noisy) == 10 > len(quiet)


def test_an_effect_can_be_switched_on_while_running(device):
    device.send('voltage_command', *[50.0] * 20)
    ideal = device.wait_for_states(20)[-1][0]
    assert device.set_parameters(effects__sensor_gain__gain_error=0.1)[0].successful
    device.send('voltage_command', 50.0)
    assert device.wait_for_states(21)[-1][0] == pytest.approx(1.1 * ideal, rel=1e-3)
    # Its neutral value switches it off again, even where that is infinite.
    assert device.set_parameters(effects__sensor_gain__gain_error=0.0)[0].successful
    assert device.set_parameters(effects__leakage__resistance=math.inf)[0].successful
    device.send('voltage_command', 50.0)
    assert device.wait_for_states(22)[-1][0] == pytest.approx(ideal, rel=1e-3)
