# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Claims about the parts of the node that need no DDS."""

import math
import os
import signal
import subprocess
import sys
import time

from piezo_stack_sim.plant.parameters import Device, parameter_specs
import pytest

pytest.importorskip('rclpy')

from builtin_interfaces.msg import Time  # noqa: E402, I100
from piezo_stack_sim.node import realtime, schedule as schedules  # noqa: E402
from piezo_stack_sim.node.commands import CommandIntake, News, Tally, Watchdog  # noqa: E402
from piezo_stack_sim.node.interrupts import attach, interruptible  # noqa: E402
from piezo_stack_sim.node.messages import ClockTopic, FloatTopic, StateTopic  # noqa: E402
from piezo_stack_sim.node.parameters import descriptor, flat  # noqa: E402
from piezo_stack_sim.node.schedule import day_ahead, NEVER, Schedule, SECOND  # noqa: E402
from piezo_stack_sim.node.simulation_clock import SimulationClock  # noqa: E402
from rclpy.serialization import deserialize_message, serialize_message  # noqa: E402
from rclpy.signals import uninstall_signal_handlers  # noqa: E402
from rosgraph_msgs.msg import Clock  # noqa: E402
from sensor_msgs.msg import JointState  # noqa: E402
from std_msgs.msg import Float64, Header  # noqa: E402


class Wire:
    """Stands for a publisher and keeps what is published."""

    def __init__(self):
        self.sent = []

    def publish(self, message):
        self.sent.append(message)


def test_filled_in_messages_are_those_that_rclpy_would_send():
    wire = Wire()
    FloatTopic(wire).publish(-1.25e-6)
    assert deserialize_message(wire.sent[0], Float64) == Float64(data=-1.25e-6)
    assert wire.sent[0] == bytes(serialize_message(Float64(data=-1.25e-6)))
    StateTopic(wire, 'a joint').publish(12_000_000_034, 1e-6, -2.5, 3e3)
    expected = JointState(header=Header(stamp=Time(sec=12, nanosec=34)), name=['a joint'],
                          position=[1e-6], velocity=[-2.5], effort=[3e3])
    assert deserialize_message(wire.sent[1], JointState) == expected
    ClockTopic(wire).publish(5_000_000_006)
    assert deserialize_message(wire.sent[2], Clock) == Clock(clock=Time(sec=5, nanosec=6))


@pytest.mark.parametrize('rate', [1000.0, 333.0, 4000.0, 44100.0 / 7.0])
def test_deadlines_do_not_drift(rate):
    schedule = Schedule(rate)
    schedule.start()
    origin = schedule.deadline - round(SECOND / rate)
    for _ in range(20_000):
        schedule.advance(schedule.deadline)
    assert schedule.deadline - origin == pytest.approx(20_001 * SECOND / rate, abs=1)
    assert (schedule.late, schedule.tardy, schedule.worst) == (0, 0, 0)


class BusyClocks:
    """Both clocks of a machine on which who reads them is put aside at some readings."""

    def __init__(self, aside):
        self.now, self.aside, self.read = 5_000_000_000, aside, 0

    def monotonic_ns(self):
        self.now += 100 + self.aside.get(self.read, 0)
        self.read += 1
        return self.now

    def time_ns(self):
        return self.monotonic_ns() + 1_700_000_000_000_000_000


@pytest.mark.parametrize('aside', [{}, {0: 8_000_000}, {1: 8_000_000}, {2: 8_000_000},
                                   {1: 8_000_000, 5: 30_000_000}])
def test_two_clocks_are_read_at_once_on_a_busy_machine_too(monkeypatch, aside):
    # Else a stamp of a tick would come before that of the tick before.
    monkeypatch.setattr(schedules, 'time', BusyClocks(aside))
    assert day_ahead() == pytest.approx(1_700_000_000_000_000_000, abs=200, rel=0.0)


def test_late_ticks_are_all_found_and_counted():
    schedule = Schedule(1000.0)
    schedule.start()
    first = schedule.deadline
    assert schedule.backlog(first - 1) == 0
    assert schedule.backlog(first) == 1
    now = first + 10 * SECOND // 1000 + 5  # ten periods late
    assert schedule.backlog(now) == 11
    for _ in range(11):
        schedule.advance(now)
    assert schedule.backlog(now) == 0
    assert (schedule.ticks, schedule.late, schedule.tardy) == (11, 10, 10)
    assert schedule.worst == now - first
    bulk = Schedule(1000.0)
    bulk.start()
    now = bulk.deadline + 10 * SECOND // 1000 + 5
    bulk.advance(now, bulk.backlog(now))
    assert (bulk.ticks, bulk.late, bulk.tardy) == (11, 10, 10)


def test_a_stopped_schedule_has_no_deadline():
    schedule = Schedule(1000.0)
    schedule.start()
    schedule.stop()
    assert schedule.deadline == NEVER


def test_a_refused_command_leaves_the_last_one():
    intake = CommandIntake('voltage', (0.0, 150.0))
    assert intake.command is None
    assert intake.take_command('voltage', 12.0)
    assert not intake.take_command('voltage', math.nan)
    assert not intake.take_command('charge', 1e-6)
    assert intake.command == 12.0
    assert intake.tally.counts == {
        'refused_not_finite': 1, 'refused_inactive_port': 1, 'clamped': 0}


def test_absurd_forces_are_clamped_and_infinite_ones_refused():
    intake = CommandIntake('open', (0.0, 150.0))
    assert intake.take_force(-1e300)
    assert intake.force == -1e6
    assert not intake.take_force(-math.inf)
    assert intake.force == -1e6


def test_the_watchdog_counts_device_time_from_the_first_command():
    watchdog = Watchdog(0.01, 1000.0)
    assert not watchdog.check(10_000)
    watchdog.feed(10_000)
    assert not watchdog.check(10_009)
    assert watchdog.check(10_010) and watchdog.expired
    assert not watchdog.check(10_011)  # said once
    watchdog.feed(10_011)
    assert not watchdog.expired
    watchdog.set_timeout(0.0)
    assert not watchdog.check(10**9)


def test_a_log_tells_each_kind_once_with_its_count():
    lines, tally = [], Tally()
    news = News(tally, lines.append)
    tally.note('clamped', 'a')
    for _ in range(5):
        tally.note('refused_not_finite', 'b')
    assert news.tell() == lines == ['b (5 times)', 'a']
    assert news.tell() == []
    tally.note('clamped', 'c')
    assert news.tell() == ['c']


def test_the_common_clock_is_that_of_the_slowest_device():
    wire, clock = Wire(), SimulationClock()
    clock.join('a', ClockTopic(wire))
    assert clock.has_topic
    clock.join('b', None)
    for device, time_ns in (('a', 10), ('a', 20), ('b', 15), ('b', 30), ('a', 30)):
        clock.set_time(device, time_ns)
    heard = [deserialize_message(sent, Clock).clock.nanosec for sent in wire.sent]
    assert heard == [0, 15, 20, 30]


@pytest.mark.parametrize('name', parameter_specs())
def test_every_parameter_has_a_description_and_its_value_lies_in_its_range(name):
    spec, value = parameter_specs()[name], flat(Device.nominal())[name]
    described = descriptor(spec)
    assert described.description
    assert described.additional_constraints
    assert described.read_only == spec.read_only
    for bounds in described.floating_point_range:
        assert bounds.from_value <= value <= bounds.to_value


def test_the_waker_pushes_a_loop_that_oversleeps():
    woken = []
    waker = realtime.Waker(lambda: woken.append(time.monotonic()), lambda: 3600.0)
    end = time.monotonic() + 30.0
    while not woken and time.monotonic() < end:
        time.sleep(0.01)
    waker.stop()
    assert woken


def test_real_time_rights_are_granted_or_refused_in_one_line():
    for trouble in (realtime.lock_memory(),):
        assert trouble is None or '\n' not in trouble


def test_a_state_that_leaves_the_finite_numbers_is_taken_back():
    import rclpy
    import ros_process  # noqa: F401  keeps the node to this host
    from piezo_stack_sim.errors import InputError
    from piezo_stack_sim.node.actuator_node import ActuatorNode

    rclpy.init(args=['--ros-args', '-p', 'stepping:=lockstep'])
    node = ActuatorNode(SimulationClock())
    try:
        node.intake.take_command('voltage', 50.0)
        for _ in range(10):
            node._step()
        node.keep_house()
        good = node.last_sample

        def fail(*_):
            raise InputError('the device left the finite numbers')

        node.plant.advance = fail
        node._step()
        assert node.last_sample == good
        assert node.intake.command is None
        assert node._findings().values['recovered_states'] == 1
        # The state of a second ago is no good either: it is left, and a new command is heard.
        node._active = (30.0, 0.0)
        node.intake.take_command('voltage', 20.0)
        node._advance(1)
        assert node.intake.command == 20.0
        assert node.last_sample.displacement == 0.0
        del node.plant.advance
        for _ in range(10):
            node._step()
        assert node.last_sample.voltage == pytest.approx(20.0)
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


class InterruptedExecutor:
    """Stands for an executor during whose registration of a node a signal comes."""

    def __init__(self, number):
        self.number = number
        self.done = []

    def add_node(self, node):
        self.done.append(node)

    def spin_once(self, timeout):
        os.kill(os.getpid(), self.number)
        self.done.append('taken in')

    def shutdown(self):
        self.done.append('shut down')


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_waits_until_the_executor_has_taken_its_nodes_in(number):
    executor, before = InterruptedExecutor(number), signal.getsignal(number)
    try:
        with interruptible():
            with pytest.raises(KeyboardInterrupt):
                attach(executor, ['node'])
            with pytest.raises(KeyboardInterrupt), interruptible():
                os.kill(os.getpid(), number)  # before there is an executor: at once
                time.sleep(1.0)
    finally:
        uninstall_signal_handlers()
    assert executor.done == ['node', 'taken in', 'shut down']
    assert signal.getsignal(number) == before


STOPPED_IN_TEXT = """
import os, signal
from piezo_stack_sim.node.interrupts import interruptible
try:
    with interruptible():
        exec('os.kill(os.getpid(), signal.SIGTERM); [None for _ in range(1000)]')
        print('went on')
except KeyboardInterrupt:
    print('stopped')
"""


def test_a_signal_while_text_is_executed_leaves_the_exit_status_alone():
    """Python ends with -2 after a plain KeyboardInterrupt there; dataclasses are made that way."""
    done = subprocess.run([sys.executable, '-c', STOPPED_IN_TEXT], capture_output=True, text=True,
                          env=os.environ | {'PYTHONPATH': os.pathsep.join(filter(None, sys.path))})
    assert (done.stdout, done.returncode) == ('stopped\n', 0), done.stderr


STOPPED_IN_CALLBACK = """
import ctypes, gc, os, signal, time, weakref
from piezo_stack_sim.node.interrupts import interruptible

def stop(*_):
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(0.1)

class Collected:
    pass

for how in range(2):
    try:
        with interruptible():
            if how == 0:
                ctypes.CFUNCTYPE(None)(stop)()
            else:
                gone = Collected()
                reference = weakref.ref(gone, stop)
                del gone
            time.sleep(10.0)
            print('went on')
    except KeyboardInterrupt:
        print('stopped')
"""


def test_a_signal_while_c_code_calls_python_is_not_lost_and_not_printed():
    """LLVM asks numba's cache for objects that way; Python drops what is raised in there."""
    done = subprocess.run([sys.executable, '-c', STOPPED_IN_CALLBACK], capture_output=True,
                          text=True,
                          env=os.environ | {'PYTHONPATH': os.pathsep.join(filter(None, sys.path))})
    assert (done.stdout, done.stderr, done.returncode) == ('stopped\nstopped\n', '', 0)
