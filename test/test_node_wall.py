# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Claims about the device that runs by wall time: real node, real DDS, no claim about speed."""

import signal

import pytest
from ros_process import Client, nanoseconds, node_arguments, NodeProcess
from rosgraph_msgs.msg import Clock

RATE = 200.0


@pytest.fixture(scope='module')
def node():
    """One node by wall time for the whole module."""
    node = NodeProcess(*node_arguments(f'rate:={RATE}', 'command_timeout:=30.0'))
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
    """Return a client of a device just reset and running."""
    connection.call('pause', data=False)
    connection.fresh()
    return connection


def stamps(device):
    return [nanoseconds(state.header.stamp) for state in device.heard['state']]


def test_samples_come_by_themselves_with_even_stamps(device):
    device.wait_for_states(100)
    steps = [b - a for a, b in zip(stamps(device), stamps(device)[1:])]
    # A stamp is the deadline of its tick, however late the tick was.
    assert sorted(steps)[len(steps) // 2] == pytest.approx(1e9 / RATE, abs=2e4)


def test_a_command_moves_the_stack_and_stays(device):
    device.send('voltage_command', 60.0)
    device.until(lambda: device.heard['voltage'] and device.heard['voltage'][-1] == 60.0, 'it')
    device.forget()
    rows = device.wait_for_states(20)
    assert {row[3] for row in rows} == {60.0}
    assert rows[-1][0] == pytest.approx(7.4e-6, rel=0.3)


def test_not_a_number_does_not_reach_the_device(device):
    device.send('voltage_command', 20.0, float('nan'))
    device.report_with(lambda s, v: int(v['refused_not_finite']) > 0, 'the refusal')
    device.forget()  # what was on its way may be older than the report
    device.wait_for_states(10)
    assert device.rows()[-1][3] == 20.0


def test_a_pause_stands_still_and_steps_on_request(device):
    device.call('pause', data=True)
    device.listen(0.2)
    device.forget()
    device.listen(0.5)
    assert not device.heard['state']
    answer = device.call('step')
    assert answer.success
    device.wait_for_states(1)
    device.listen(0.2)
    assert len(device.heard['state']) == 1
    device.call('pause', data=False)
    device.wait_for_states(10)


def test_a_step_while_running_is_refused_with_the_mend(device):
    answer = device.call('step')
    assert not answer.success
    assert 'pause' in answer.message


def test_time_lost_by_a_stopped_process_is_caught_up_and_counted(device, node):
    _, before = device.report_with(lambda s, v: True, 'diagnostics')
    node.process.send_signal(signal.SIGSTOP)
    device.listen(1.5)
    node.process.send_signal(signal.SIGCONT)
    status, after = device.report_with(
        lambda s, v: int(v['late_ticks']) >= int(before['late_ticks']) + RATE, 'the late ticks')
    # Device time went on as the clock of the day did: nothing of it is lost.
    assert float(after['time']) - float(before['time']) == pytest.approx(
        (after['stamp'] - before['stamp']) * 1e-9, abs=2.0 / RATE)


def test_a_pause_is_not_caught_up(device):
    device.call('pause', data=True)
    _, before = device.report_with(lambda s, v: v['paused'] == 'true', 'the pause')
    device.listen(1.0)
    _, later = device.report_with(lambda s, v: True, 'the pause')
    assert later['time'] == before['time']
    device.call('pause', data=False)


def test_somebody_elses_clock_does_not_drive_the_ticks(device):
    clock = device.node.create_publisher(Clock, '/clock', 10)
    try:
        assert device.set_parameters(use_sim_time=True)[0].successful
        device.until(lambda: clock.get_subscription_count() >= 2, 'the node at /clock')
        message = Clock()
        for second in (1000, 10, 5000):  # forwards, backwards, forwards
            message.clock.sec = second
            clock.publish(message)
            device.until(
                lambda wanted=second * 10**9: stamps(device)[-1:] == [wanted], 'its stamp')
            device.forget()
        device.wait_for_states(50)
    finally:
        assert device.set_parameters(use_sim_time=False)[0].successful
        device.node.destroy_publisher(clock)
    # States with the old stamps may still be on their way when the answer arrives.
    device.until(lambda: stamps(device)[-1] > 1_600_000_000 * 10**9, 'the clock of the day')


def test_diagnostics_know_their_device(device):
    status, values = device.report_with(lambda s, v: True, 'diagnostics')
    assert status.hardware_id == 'NEC/TOKIN AE0505D16'
    assert values['drive'] == 'voltage' and values['stepping'] == 'wall'
    assert {'clamped', 'late_ticks', 'ticks_over_half_ms', 'worst_lateness'} <= set(values)
