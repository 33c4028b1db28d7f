# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""A controller's end of the topics: send a command, get the sample that follows."""

from __future__ import annotations

from collections.abc import Callable
import subprocess
import time
from typing import Any, cast

from piezo_stack_sim.errors import InputError
from piezo_stack_sim.node.asking import ask
from piezo_stack_sim.node.interrupts import attach, interruptible
from rcl_interfaces.msg import ParameterType
import rclpy
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64
from std_srvs.srv import SetBool, Trigger

PATIENCE = 20.0  # s without an answer until the device counts as absent
# s that a device may take to start where it has to be compiled first, beside other work
FIRST_START = 300.0
_VALUES = {ParameterType.PARAMETER_DOUBLE: 'double_value',
           ParameterType.PARAMETER_STRING: 'string_value'}


class StackClient:
    """
    The connection of a controller to a device.

    It works with a device in lockstep, where each command brings the next
    sample, and with one that runs by wall time, where samples come by
    themselves and a command acts from the next one on.

    Parameters
    ----------
    device : str
        Name of the node.
    drive : str
        What the controller commands: ``voltage`` (V) or ``charge`` (C). The
        device is switched to it.
    process : subprocess.Popen, optional
        The device's process, where it has just been started: it may take its
        time to appear.

    Raises
    ------
    InputError
        If there is no such device.

    """

    def __init__(self, device: str, drive: str,
                 process: subprocess.Popen | None = None) -> None:
        from piezo_stack_sim.node.loop import make_executor
        self._device = device
        self._node = Node(f'{drive}_controller')
        self._executor = make_executor()
        attach(self._executor, [self._node])
        self._state: Any = None  # the newest JointState
        self._start = 0.0  # stamp of sample 0, s
        self._node.create_subscription(JointState, f'{device}/state', self._on_state, 10)
        self._command = self._node.create_publisher(Float64, f'{device}/{drive}_command', 1000)
        self._message = Float64()
        self._parameters = AsyncParameterClient(self._node, device)
        self._wait(self._parameters.services_are_ready, f'no device {device}: start one with '
                   'piezo_stack_node, name it with --device, or add --start', process)
        self.rate: float = self._parameter('rate')
        self.lockstep = self._parameter('stepping') == 'lockstep'
        # By wall time a command acts from the tick after it, and shows at the one after that.
        self.delay = 1 if self.lockstep else 2
        self._set('drive', drive)
        self._connect()

    # -- waiting -----------------------------------------------------------------

    def _wait(self, done: Callable[[], bool], complaint: str,
              process: subprocess.Popen | None = None) -> None:
        end = time.monotonic() + (FIRST_START if process else PATIENCE)
        while not done():
            if time.monotonic() > end or (process and process.poll() is not None):
                raise InputError(complaint)
            self._executor.spin_once(0.05)

    def _ask(self, request: Callable[[], Future], what: str):
        return ask(request, lambda done: self._wait(
            done, f'{self._device} does not answer: {what}'))

    def _parameter(self, name: str):
        value = self._ask(lambda: self._parameters.get_parameters([name]), name).values[0]
        if value.type not in _VALUES:
            raise InputError(f'{self._device} has no parameter {name}: is it a piezo_stack_node?')
        return getattr(value, _VALUES[value.type])

    def _set(self, name: str, value) -> None:
        result = self._ask(lambda: self._parameters.set_parameters(
            [Parameter(name, value=value)]), name).results[0]
        if not result.successful:
            raise InputError(f'{self._device}: {name} = {value} refused: {result.reason}')

    def _call(self, kind, service: str, **fields) -> None:
        client = self._node.create_client(kind, f'{self._device}/{service}')
        self._wait(client.service_is_ready, f'{self._device} has no service {service}')
        self._ask(lambda: client.call_async(kind.Request(**fields)), service)
        self._node.destroy_client(client)

    def _connect(self) -> None:
        """Make sure that samples arrive, whatever state the device is in."""
        self._wait(lambda: self._command.get_subscription_count() > 0,
                   f'{self._device} does not listen to {self._command.topic_name}')
        self._call(SetBool, 'pause', data=False)
        end = time.monotonic() + PATIENCE
        while self._state is None:
            if time.monotonic() > end:
                raise InputError(f'{self._device} sends no samples')
            if self.lockstep:
                self._call(Trigger, 'step')
            self._executor.spin_once(0.05)

    # -- control -----------------------------------------------------------------

    def _on_state(self, message: JointState) -> None:
        self._state = message

    def _stamp(self) -> float:
        stamp = self._state.header.stamp
        return stamp.sec + 1e-9 * stamp.nanosec

    def reset(self) -> None:
        """Bring the device to its initial state; from here on samples are counted."""
        self._call(Trigger, 'reset')
        self._executor.spin_once(0.05)
        self._state = None
        self._start = 0.0
        if not self.lockstep:
            self._wait(lambda: self._state is not None, f'{self._device} sends no samples')
            self._start = self._stamp()

    def exchange(self, command: float) -> tuple[int, float]:
        """
        Send a command (V or C) and wait for a sample.

        Returns
        -------
        int
            Number of the sample since the reset; by wall time some may be missed.
        float
            Displacement (m).

        Raises
        ------
        InputError
            If no sample comes.

        """
        self._state = None
        self._message.data = command
        self._command.publish(self._message)
        spin_once = self._executor.spin_once
        end = time.monotonic() + PATIENCE
        while self._state is None:
            spin_once(PATIENCE)
            if self._state is None and time.monotonic() > end:
                raise InputError(f'{self._device} sends no samples')
        if not self.lockstep:
            newest: JointState | None = None
            while newest is not self._state:  # a controller that was late answers the newest
                newest = self._state
                spin_once(0.0)
        state = cast(JointState, self._state)
        return round((self._stamp() - self._start) * self.rate), state.position[0]

    def stream(self, commands: list[float]) -> float:
        """
        Send many commands to a device in lockstep at once; return the time of it all (s).

        Raises
        ------
        InputError
            If the samples do not come.

        """
        self.reset()
        last = len(commands) / self.rate
        began = time.monotonic()
        for command in commands:
            self._message.data = command
            self._command.publish(self._message)
        self._wait(lambda: self._state and self._stamp() > last - 0.5 / self.rate,
                   f'{self._device} sends no samples')
        return time.monotonic() - began

    def close(self) -> None:
        """Leave the ROS graph."""
        self._executor.shutdown()
        self._node.destroy_node()


def in_ros(arguments: list[str] | None, task: Callable[[], None]) -> None:
    """
    Run a task with ROS initialised.

    Raises
    ------
    KeyboardInterrupt
        If ROS was shut down meanwhile, by Ctrl-C or SIGTERM.

    """
    with interruptible():
        rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
        try:
            task()
        except Exception:  # of many kinds, depending on what ROS was needed for
            if rclpy.ok():
                raise
            raise KeyboardInterrupt from None
        finally:
            rclpy.try_shutdown()
