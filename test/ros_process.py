# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""A real node in its own process, and a client of it: what the node's tests share."""

import atexit
import os
from pathlib import Path
import signal
import subprocess
import sys
import threading
import time

import pytest

rclpy = pytest.importorskip('rclpy')

from diagnostic_msgs.msg import DiagnosticArray  # noqa: E402, I100
from piezo_stack_sim.node.asking import ask  # noqa: E402, I100
from piezo_stack_sim.plant.compilation import compile_kernels  # noqa: E402, I100
from piezo_stack_sim.resources import config_file  # noqa: E402, I100
from rclpy.executors import SingleThreadedExecutor  # noqa: E402, I100
from rclpy.parameter_client import AsyncParameterClient  # noqa: E402, I100
from rosgraph_msgs.msg import Clock  # noqa: E402, I100
from sensor_msgs.msg import JointState  # noqa: E402, I100
from std_msgs.msg import Float64  # noqa: E402, I100
from std_srvs.srv import SetBool, Trigger  # noqa: E402, I100

NOMINAL = str(config_file('ae0505d16.yaml'))
PATIENCE = 60.0  # s; a test on a busy machine waits that long for something that must come
FIRST_START = 300.0  # s; where the kernels have to be compiled first
# Tests that run at the same time, here or elsewhere on this host, must not hear each other.
DOMAIN = 1 + os.getpid() % 100
os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
os.environ['ROS_DOMAIN_ID'] = str(DOMAIN)
ENVIRONMENT = {**os.environ, 'PYTHONUNBUFFERED': '1', 'PYTHONPATH': os.pathsep.join(
    [str(Path(__file__).resolve().parent.parent), *filter(None, [os.environ.get('PYTHONPATH')])])}
SPACE = f'/test_{os.getpid()}'
OUTPUTS = ('displacement', 'charge', 'force', 'voltage')


class NodeProcess:
    """`piezo_stack_node` with these arguments; its output is kept, compiled code in `cache`."""

    def __init__(self, *arguments, wait=True, cache=None):
        if cache is None:
            compile_kernels()  # or it would refuse effects until it has done so itself
        self.process = subprocess.Popen(
            [sys.executable, '-m', 'piezo_stack_sim.node.main', *arguments],
            env=ENVIRONMENT | ({'NUMBA_CACHE_DIR': str(cache)} if cache else {}),
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        atexit.register(self.process.kill)  # whatever becomes of the test
        self.lines = []
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        if wait:
            self.wait_for('ready')

    def _read(self):
        for line in self.process.stdout:
            self.lines.append(line.rstrip('\n'))

    @property
    def output(self):
        """Everything it has printed."""
        return '\n'.join(self.lines)

    def wait_for(self, text, count=1):
        """Wait until it has printed a text."""
        until(lambda: self.output.count(text) >= count or self.process.poll() is not None,
              f'"{text}" from the node', FIRST_START)
        assert self.output.count(text) >= count, self.output

    def end(self, signum=signal.SIGTERM):
        """Stop it; return its exit status and output."""
        if self.process.poll() is None:
            self.process.send_signal(signum)
        try:
            status = self.process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            self.process.kill()
            raise
        self._reader.join(PATIENCE)
        return status, self.output


def node_arguments(*parameters, file=NOMINAL, namespace=SPACE, name='stack'):
    """Return the arguments of one device under test."""
    arguments = ['--ros-args', '-r', f'__ns:={namespace}', '-r', f'__node:={name}']
    if file:
        arguments += ['--params-file', str(file)]
    for parameter in parameters:
        arguments += ['-p', parameter]
    return arguments


def until(condition, what, patience=PATIENCE, pause=0.01):
    """Wait for a condition, and say what did not come."""
    end = time.monotonic() + patience
    while not condition():
        assert time.monotonic() < end, f'waited {patience} s for {what}'
        time.sleep(pause)


class Client:
    """A ROS node that commands a device and keeps everything it hears of it."""

    def __init__(self, device=f'{SPACE}/stack'):
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=DOMAIN)
        self.device = device
        self.node = rclpy.create_node('client', namespace=SPACE, context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.heard = {name: [] for name in (*OUTPUTS, 'state', 'clock')}
        self.reports = []
        for name in OUTPUTS:
            self._listen(Float64, f'{device}/{name}', self.heard[name], lambda m: m.data)
        self._listen(JointState, f'{device}/state', self.heard['state'], lambda m: m)
        self._listen(Clock, '/clock', self.heard['clock'], lambda m: nanoseconds(m.clock))
        self.node.create_subscription(DiagnosticArray, '/diagnostics', self._on_report, 100)
        self.inputs = {
            name: self.node.create_publisher(Float64, f'{device}/{name}', 1000)
            for name in ('voltage_command', 'charge_command', 'external_force')}
        self._services = {
            name: self.node.create_client(kind, f'{device}/{name}')
            for name, kind in (('reset', Trigger), ('step', Trigger), ('pause', SetBool))}
        self._parameters = AsyncParameterClient(self.node, device)

    def _listen(self, kind, topic, heard, value):
        self.node.create_subscription(kind, topic, lambda m: heard.append(value(m)), 1000)

    def _on_report(self, message):
        for status in message.status:
            if status.name.startswith(f'{self.device}:'):
                values = {v.key: v.value for v in status.values}
                values['stamp'] = nanoseconds(message.header.stamp)
                self.reports.append((status, values))

    def close(self):
        """Leave the ROS graph."""
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)

    def until(self, condition, what, patience=PATIENCE):
        """Listen until a condition holds."""
        end = time.monotonic() + patience
        while not condition():
            assert time.monotonic() < end, f'waited {patience} s for {what}'
            self.executor.spin_once(timeout_sec=0.05)

    def listen(self, duration):
        """Listen for a while."""
        end = time.monotonic() + duration
        while time.monotonic() < end:
            self.executor.spin_once(timeout_sec=0.02)

    def _answer(self, request, what):
        return ask(request, lambda done: self.until(done, what))

    def call(self, service, **fields):
        """Call reset, step or pause; return the response."""
        client = self._services[service]
        self.until(client.service_is_ready, f'service {service}')
        request = client.srv_type.Request(**fields)
        return self._answer(lambda: client.call_async(request), f'the answer of {service}')

    def set_parameters(self, **values):
        """Set parameters, `a__b` for `a.b`; return the results."""
        self.until(self._parameters.services_are_ready, 'parameter services')
        parameters = [rclpy.parameter.Parameter(name.replace('__', '.'), value=value)
                      for name, value in values.items()]
        return self._answer(
            lambda: self._parameters.set_parameters(parameters), 'set').results

    def describe(self, *names):
        """Return the descriptors of parameters."""
        self.until(self._parameters.services_are_ready, 'parameter services')
        return self._answer(
            lambda: self._parameters.describe_parameters(list(names)), 'descriptors').descriptors

    def send(self, topic, *values):
        """Publish values, one after the other, without waiting."""
        for value in values:
            self.inputs[topic].publish(Float64(data=float(value)))

    def forget(self):
        """Forget what was heard so far."""
        for heard in self.heard.values():
            heard.clear()

    def connect(self):
        """Wait until every topic is connected both ways, then reset the device and forget."""
        self.until(lambda: all(p.get_subscription_count() for p in self.inputs.values()),
                   'the inputs of the device')
        self.call('pause', data=True)

        def answered():
            self.call('step')
            self.listen(0.02)
            return all(self.heard[name] for name in (*OUTPUTS, 'state'))

        self.until(answered, 'all outputs of the device')
        self.call('pause', data=False)
        self.fresh()

    def fresh(self):
        """Reset the device, forget what was heard."""
        assert self.call('reset').success
        self.listen(0.1)
        self.forget()

    def wait_for_states(self, count):
        """Wait until so many samples are complete; return them as rows of SI numbers."""
        self.until(lambda: all(len(self.heard[n]) >= count for n in (*OUTPUTS, 'state')),
                   f'{count} samples, have {len(self.heard["state"])}')
        return self.rows()

    def rows(self):
        """Return (displacement, velocity, charge, voltage, force) of each sample heard."""
        return [(s.position[0], s.velocity[0], q, v, s.effort[0]) for s, q, v in zip(
            self.heard['state'], self.heard['charge'], self.heard['voltage'])]

    def report_with(self, condition, what):
        """Wait for a diagnostics report that a condition holds for; return it."""
        self.reports.clear()
        self.until(lambda: any(condition(*r) for r in self.reports), what)
        return next(r for r in self.reports if condition(*r))


def nanoseconds(stamp):
    """Return a builtin_interfaces/Time as one number (ns)."""
    return stamp.sec * 1_000_000_000 + stamp.nanosec
