# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""A client of a device under test: it commands, listens, asks, and judges what it hears."""

from __future__ import annotations

from collections.abc import Callable
import math
import struct
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from piezo_stack_sim.errors import InputError
from piezo_stack_sim.node.asking import ask
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64
from std_srvs.srv import SetBool, Trigger

PATIENCE = 60.0  # s without an answer until the device counts as dead
COMMANDS = ('voltage_command', 'charge_command', 'external_force')
_DOUBLE = struct.Struct('<d')
_BODY = 4  # bytes before the number of a serialised Float64


class Heard:
    """The newest value of a scalar topic, how many came, and whether all were finite."""

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Forget what came."""
        self.count = 0
        self.last = math.nan
        self.finite = True
        self.kept: list[float] = []
        self.keep = False

    def take(self, encoded: bytes) -> None:
        """Take a serialised Float64."""
        value = _DOUBLE.unpack_from(encoded, _BODY)[0]
        self.count += 1
        self.last = value
        if self.keep:
            self.kept.append(value)
        if not math.isfinite(value):
            self.finite = False


class Probe:
    """
    A ROS node in a context of its own, so that several are several clients.

    Parameters
    ----------
    device : str
        Full name of the node under test.
    name : str
        Name of this client.
    topics : tuple of str
        Scalar outputs that it listens to.

    Attributes
    ----------
    heard : dict of str to Heard
        By topic.
    reports : list of tuple
        Diagnostics since `forget`: level, message, values by key, stamp (s).

    """

    def __init__(self, device: str, name: str = 'probe',
                 topics: tuple[str, ...] = ('displacement', 'charge', 'voltage')) -> None:
        self.device = device
        self.context = rclpy.Context()
        rclpy.init(context=self.context, signal_handler_options=SignalHandlerOptions.NO)
        self.node = rclpy.create_node(name, namespace='/soak', context=self.context)
        self._executor = self._make_executor()
        self._executor.add_node(self.node)
        qos = QoSProfile(depth=2000)
        self.heard = {topic: Heard() for topic in topics}
        for topic, heard in self.heard.items():
            self.node.create_subscription(Float64, f'{device}/{topic}', heard.take, qos, raw=True)
        self.stamps: list[float] = []
        self._stamped = False
        self.reports: list[tuple[int, str, dict[str, str], float]] = []
        self.node.create_subscription(DiagnosticArray, '/diagnostics', self._on_report, 10)
        self._inputs = {name: self.node.create_publisher(Float64, f'{device}/{name}', qos)
                        for name in COMMANDS}
        self._services: dict[str, Any] = {
            name: self.node.create_client(kind, f'{device}/{name}')
            for name, kind in (('reset', Trigger), ('step', Trigger), ('pause', SetBool))}
        self._parameters = AsyncParameterClient(self.node, device)
        self._frame = bytearray(serialize_message(Float64()))

    def _make_executor(self):
        try:
            from rclpy.experimental import EventsExecutor
            return EventsExecutor(context=self.context)
        except ImportError:
            return SingleThreadedExecutor(context=self.context)

    def _on_report(self, message: DiagnosticArray) -> None:
        stamp = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
        for status in message.status:
            if status.name.startswith(f'{self.device}:'):
                self.reports.append((ord(status.level), status.message,
                                     {v.key: v.value for v in status.values}, stamp))

    def listen_to_stamps(self) -> None:
        """Keep the stamps (s) of the stamped state from here on."""
        def note(message):
            self.stamps.append(message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec)
        self.node.create_subscription(JointState, f'{self.device}/state', note, 1000)
        self._stamped = True

    def close(self) -> None:
        """Leave the ROS graph."""
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)

    # -- waiting -----------------------------------------------------------------

    def spin(self, timeout: float = 0.0) -> None:
        """Handle one message, waiting so long (s) for it."""
        self._executor.spin_once(timeout)

    def wait(self, condition: Callable[[], object], what: str, patience: float = PATIENCE) -> None:
        """
        Listen until a condition holds.

        Raises
        ------
        InputError
            If it never does: the device is dead.

        """
        end = time.monotonic() + patience
        while not condition():
            if time.monotonic() > end:
                raise InputError(f'waited {patience:g} s for {what}')
            self.spin(0.05)

    def listen(self, duration: float) -> None:
        """Listen for a while (s)."""
        end = time.monotonic() + duration
        while (left := end - time.monotonic()) > 0.0:
            self.spin(min(left, 0.05))

    # -- commanding ----------------------------------------------------------------

    def connect(self) -> None:
        """Wait until inputs, outputs and services are found."""
        self.wait(lambda: all(p.get_subscription_count() for p in self._inputs.values())
                  and all(s.service_is_ready() for s in self._services.values())
                  and all(self.node.count_publishers(f'{self.device}/{t}') for t in self.heard)
                  and self._parameters.services_are_ready(), f'{self.device} to appear')

    def introduce(self) -> None:
        """Call everything once: the first answer to a client that is new may get lost."""
        for service in ('step', 'reset'):
            self.call(service)
        self.call('pause', data=False)
        self.set_parameters(command_timeout=0.0)

    def step_until_heard(self) -> None:
        """Step the device until its samples arrive: the graph shows a link before it works."""
        self.call('pause', data=True)
        while not (all(heard.count for heard in self.heard.values())
                   and (self.stamps or not self._stamped)):
            self.call('step')
            self.listen(0.02)
        self.call('pause', data=False)

    def send(self, topic: str, value: float) -> None:
        """Publish a number, already serialised: nothing is faster in Python."""
        _DOUBLE.pack_into(self._frame, _BODY, value)
        self._inputs[topic].publish(bytes(self._frame))

    def ask(self, service: str, **fields):
        """Call reset, step or pause without waiting; return the future."""
        client = self._services[service]
        return client.call_async(client.srv_type.Request(**fields))

    def call(self, service: str, **fields):
        """Call reset, step or pause; return the answer."""
        return self._answer(lambda: self.ask(service, **fields), service)

    def ask_parameters(self, values: dict):
        """Ask for parameters without waiting; return the future."""
        return self._parameters.set_parameters(
            [Parameter(name, value=value) for name, value in values.items()])

    def set_parameters(self, **values) -> list:
        """Set parameters, `a__b` for `a.b`; return the results."""
        values = {name.replace('__', '.'): value for name, value in values.items()}
        return self._answer(lambda: self.ask_parameters(values), 'parameters').results

    def _answer(self, request: Callable, what: str):
        return ask(request, lambda done: self.wait(done, f'an answer: {what}'))

    # -- judging -------------------------------------------------------------------

    def fresh(self) -> None:
        """Reset the device and forget what was heard."""
        self.call('pause', data=False)
        self.call('reset')
        self.listen(0.1)
        self.forget()

    def forget(self) -> None:
        """Forget what was heard."""
        for topic in self.heard:
            self.heard[topic].clear()
        self.stamps.clear()
        self.reports.clear()

    def report(self, condition: Callable[[str, dict[str, str]], object] = lambda *_: True,
               what: str = 'diagnostics', patience: float = PATIENCE):
        """Wait for diagnostics whose message and values meet a condition; return them."""
        self.reports.clear()
        found: list = []

        def met() -> bool:
            found[:] = [r for r in self.reports if condition(r[1], r[2])]
            return bool(found)

        self.wait(met, what, patience)
        return found[-1]

    def told(self, condition: Callable[[str, dict[str, str]], object],
             patience: float = 30.0) -> bool:
        """Return whether diagnostics that meet a condition come in time."""
        try:
            self.report(condition, patience=patience)
        except InputError:
            return False
        return True

    @property
    def finite(self) -> bool:
        """Whether everything heard so far was a finite number."""
        return all(heard.finite for heard in self.heard.values())
