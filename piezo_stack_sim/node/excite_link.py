# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""The tester's end of the topics of a device, real or virtual: what it has, sends and hears."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from itertools import count
import time
from typing import Any, NamedTuple

from piezo_stack_sim.errors import InputError
from piezo_stack_sim.node.asking import ask
from piezo_stack_sim.node.loop import make_executor
from rcl_interfaces.msg import ParameterType
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64
from std_srvs.srv import SetBool, Trigger

_VALUES = {ParameterType.PARAMETER_DOUBLE: 'double_value',
           ParameterType.PARAMETER_STRING: 'string_value',
           ParameterType.PARAMETER_DOUBLE_ARRAY: 'double_array_value'}
SCALARS = ('voltage', 'charge', 'displacement')
_QOS = QoSProfile(depth=1000)  # nothing may be lost, whatever arrives at once
_PARAMETER_PATIENCE = 5.0  # s; a device without parameters is a real one


class Heard(NamedTuple):
    """One value of a topic: its number among all that arrived, stamp and arrival (s), itself."""

    number: int
    stamp: float
    arrived: float
    value: float


class Link:
    """
    A connection to the device that is called `device`.

    Parameters
    ----------
    device : str
        Name of its node, with namespace.
    drive : str
        ``voltage``, ``charge``, ``open`` or ``shorted``.
    patience : float
        Seconds without an answer until the device counts as absent.

    Attributes
    ----------
    lockstep : bool
        Whether each command advances the device by one period.
    rate : float or None
        Hz, as far as the device tells.
    epoch : int
        What stamps are counted from, in seconds of the device's clock.
    heard : dict of str to deque of Heard
        What arrived, oldest first, by channel; ``tick`` is the topic whose
        messages count the ticks.

    Raises
    ------
    InputError
        If there is no such device.

    """

    def __init__(self, device: str, drive: str, patience: float = 10.0) -> None:
        self.device = device if device.startswith('/') else f'/{device}'
        self.patience = patience
        self._numbers = count()
        self._clients: dict[str, Any] = {}
        self._sent = self._passed = 0  # commands, while what passes is counted
        self._guarded = False  # whether everybody's commands are counted
        self._node = Node(f'excite_{time.time_ns() % 1_000_000}')
        self._executor = make_executor()
        self._executor.add_node(self._node)
        try:
            self._connect(drive)
        except BaseException:
            self.close()
            raise

    def _connect(self, drive: str) -> None:
        self._force = self._node.create_publisher(Float64, f'{self.device}/external_force', _QOS)
        self._command = None
        if drive in ('voltage', 'charge'):
            self._command = self._node.create_publisher(
                Float64, f'{self.device}/{drive}_command', _QOS)
        needed = self._command or self._force
        self.wait(lambda: needed.get_subscription_count() > 0, lambda: (
            f'no device {self.device}: nobody listens to {needed.topic_name}'
            f'{self._others(needed.topic_name)}'))
        self._message = Float64()
        self._parameters = AsyncParameterClient(self._node, self.device)
        values = self._read_parameters('rate', 'stepping', 'drive', 'actuator.voltage_range')
        self.rate, stepping, self.drive, self.voltage_range = values
        self.lockstep = stepping == 'lockstep'
        self.epoch = 0
        self._epoch_known = self.lockstep  # time begins at zero there
        self._listen()

    def _others(self, topic: str) -> str:
        """Return the devices that there are, for a message."""
        ending = topic[len(self.device):]
        found = sorted(name[:-len(ending)] for name, _ in self._node.get_topic_names_and_types()
                       if name.endswith(ending) and self._node.count_subscribers(name)
                       and name != topic)
        if not found:
            return '; start one with piezo_stack_node, or check ROS_DOMAIN_ID'
        return f'; choose with --node: {", ".join(found)}'

    def _read_parameters(self, *names: str) -> list[Any]:
        """Return parameters, None for what the device does not have."""
        try:
            self.wait(self._parameters.services_are_ready, '',
                      min(self.patience, _PARAMETER_PATIENCE))
        except InputError:
            return [None] * len(names)
        values = []
        for name in names:  # one by one: a node may answer nothing when one is unknown
            answer = self._ask(lambda: self._parameters.get_parameters([name]), name)
            value = answer.values[0] if answer.values else None
            field = _VALUES.get(value.type) if value is not None else None
            values.append(getattr(value, field) if field else None)
        return values

    def _listen(self) -> None:
        """Subscribe to what the device publishes."""
        topics = {'state': JointState, **{name: Float64 for name in SCALARS}}

        def published():
            return [name for name in topics
                    if self._node.count_publishers(f'{self.device}/{name}')]

        self.wait(published, f'{self.device} publishes none of {", ".join(topics)}')
        settled = time.monotonic() + 0.5
        self.wait(lambda: len(published()) == len(topics) or time.monotonic() > settled, '')
        names = published()
        self._ticker = names[0]  # the stamped state, if there is one
        # The state holds the displacement; one channel needs no two sources.
        names = [n for n in names if n != 'displacement' or self._ticker != 'state']
        self.heard: dict[str, deque[Heard]] = {
            name: deque() for name in ('tick', *(n for n in names if n != self._ticker))}
        for name in names:
            self._node.create_subscription(
                topics[name], f'{self.device}/{name}', self._taker(name), _QOS)

    def _taker(self, name: str) -> Callable:
        heard = self.heard['tick' if name == self._ticker else name]

        # No message info: the executor on events fails on the sequence numbers of Fast DDS.
        def take_scalar(message):
            now = time.monotonic()
            heard.append(Heard(next(self._numbers), now, now, message.data))

        def take_state(message):
            stamp = message.header.stamp
            if not self._epoch_known:
                # Seconds since 1970 leave a float a resolution of a quarter of a microsecond.
                self.epoch, self._epoch_known = stamp.sec, True
            heard.append(Heard(next(self._numbers), stamp.sec - self.epoch + 1e-9 * stamp.nanosec,
                               time.monotonic(), message.position[0]))

        return take_state if name == 'state' else take_scalar

    @property
    def channels(self) -> tuple[str, ...]:
        """Return what a recording of this device can hold: voltage, charge, displacement."""
        return tuple(name for name in SCALARS if self.source(name))

    def source(self, channel: str) -> str:
        """Return the key of `heard` that holds a channel; '' when it is not published."""
        if channel in self.heard:
            return channel
        ticker = 'displacement' if self._ticker == 'state' else self._ticker
        return 'tick' if channel == ticker else ''

    # -- waiting -----------------------------------------------------------------

    def spin(self, timeout: float) -> None:
        """Take one message, or wait for it until a timeout (s)."""
        self._executor.spin_once(timeout)

    def wait(self, done: Callable[[], Any], complaint: str | Callable[[], str],
             patience: float | None = None) -> None:
        """Take messages until a condition holds; InputError with the complaint if it does not."""
        end = time.monotonic() + (self.patience if patience is None else patience)
        while not done():
            if time.monotonic() > end:
                raise InputError(complaint() if callable(complaint) else complaint)
            self.spin(0.02)

    def _ask(self, request: Callable[[], Any], what: str) -> Any:
        return ask(request, lambda done: self.wait(
            done, f'{self.device} does not answer: {what}'))

    def settle(self, enough: Callable[[], Any] = lambda: False, pause: float = 0.05) -> bool:
        """
        Take what arrives until there is a pause (s), or enough has arrived.

        Returns whether there was one: with a stranger who goes on there is none, ever.
        """
        end = time.monotonic() + self.patience
        quiet = time.monotonic() + pause
        known = -1
        while not enough() and time.monotonic() < min(quiet, end):
            size = sum(map(len, self.heard.values()))
            if size != known:
                known, quiet = size, time.monotonic() + pause
            self.spin(0.01)
        return not enough() and time.monotonic() >= quiet

    def drain(self, pause: float = 0.05) -> bool:
        """Forget what has arrived, and what arrives until there is a pause (s), if there is."""
        still = self.settle(pause=pause)
        for heard in self.heard.values():
            heard.clear()
        return still

    # -- talking -----------------------------------------------------------------

    def send(self, command: float | None, force: float | None) -> None:
        """Send a force (N) and then a command (V or C); None sends nothing."""
        # The force first: it acts from the tick that the command brings.
        if force is not None:
            self._message.data = float(force)
            self._force.publish(self._message)
        if command is not None and self._command is not None:
            self._message.data = float(command)
            self._command.publish(self._message)
            self._sent += 1

    def guard(self) -> None:
        """Begin to count the commands of everybody, also of who joins later."""
        if self._command is None or self._guarded:
            return
        self._guarded = True
        command = self._command
        listeners = command.get_subscription_count()

        def count(message):
            self._passed += 1

        # Raw: only their number matters, and a programme by wall time has no time to lose.
        self._node.create_subscription(Float64, command.topic_name, count, _QOS, raw=True)
        matched = time.monotonic() + 0.5
        self.wait(lambda: command.get_subscription_count() > listeners
                  or time.monotonic() > matched, '')
        self._sent = self._passed = 0

    def require_alone(self, awaited: bool = False) -> None:
        """
        Refuse to go on once somebody else has commanded the device.

        What was sent before this call, but is still unread, is ``awaited`` on request.
        """
        if not self._guarded or self._command is None:
            return
        topic = self._command.topic_name
        if awaited and self._rivals(topic):
            last = time.monotonic() + 0.5
            self.wait(lambda: self._passed > self._sent or time.monotonic() > last, '')
        # What was sent here counts before it passes: more can pass only if others send, too.
        if self._passed > self._sent:
            names = ', '.join(self._rivals(topic)) or 'somebody'
            raise InputError(f'{self.device}: {names} commands it, too, the recording is wrong; '
                             f'stop what sends to {topic}')

    def _rivals(self, topic: str) -> list[str]:
        """Return the names of other nodes that could send to a topic."""
        return sorted({f'{info.node_namespace.rstrip("/")}/{info.node_name}' for info in
                       self._node.get_publishers_info_by_topic(topic)
                       if info.node_name != self._node.get_name()})

    def require_force(self) -> None:
        """Refuse to go on if nobody listens to the external force."""
        self.wait(lambda: self._force.get_subscription_count() > 0,
                  f'{self.device} has no force source: nobody listens to '
                  f'{self._force.topic_name}; leave out the programme force')

    def set_drive(self, drive: str) -> None:
        """Switch a virtual device to a drive; a real one is taken to be wired for it."""
        if self.drive in (None, drive):
            return
        result = self._ask(lambda: self._parameters.set_parameters(
            [Parameter('drive', value=drive)]), 'drive').results[0]
        if not result.successful:
            raise InputError(f'{self.device}: drive {drive} refused: {result.reason}')
        self.drive = drive

    def call(self, service: str, **fields) -> None:
        """Call reset, step or pause."""
        kind = SetBool if service == 'pause' else Trigger
        client = self._clients.get(service)
        if client is None:
            client = self._node.create_client(kind, f'{self.device}/{service}')
            self._clients[service] = client
        self.wait(client.service_is_ready, f'{self.device} has no service {service}')
        answer = self._ask(lambda: client.call_async(kind.Request(**fields)), service)
        if not answer.success:
            raise InputError(f'{self.device}: {service} refused: {answer.message}')

    def close(self) -> None:
        """Leave the ROS graph."""
        self._executor.shutdown()
        self._node.destroy_node()
