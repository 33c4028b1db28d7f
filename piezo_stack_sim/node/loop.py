# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""The main loop: messages as they come, ticks at their deadlines, house-keeping in between."""

from __future__ import annotations

import sys
import time

from piezo_stack_sim.node import realtime
from piezo_stack_sim.node.actuator_node import ActuatorNode
from piezo_stack_sim.node.schedule import NEVER, SECOND
from rclpy.executors import ExternalShutdownException

SLACK = SECOND // 100  # ns; house-keeping does not wait longer than this for a tick


def make_executor(name: str = 'auto'):
    """
    Return the executor: the one on events where rclpy has it, else the one on wait sets.

    ROS timers are not used with either: the loop waits for a message until the next deadline,
    which spares a thread, and the executor on wait sets does not rebuild its set for a timer.

    """
    if name != 'single':
        try:
            from rclpy.experimental import EventsExecutor
            return EventsExecutor()
        except ImportError:
            if name == 'events':
                raise
    from rclpy.executors import SingleThreadedExecutor
    return SingleThreadedExecutor()


class Loop:
    """
    Runs the nodes of an executor in this thread until the ROS context is shut down.

    A tick that is due goes before messages that wait; when ticks alone fill the
    time, messages still get a turn between two of them.

    """

    def __init__(self, nodes: list[ActuatorNode], executor, status: bool = False) -> None:
        self._nodes = nodes
        self._executor = executor
        self._status = status
        self._shown = False
        self._wake = NEVER

    def run(self) -> None:
        """Run until the context is shut down, as rclpy does on SIGTERM."""
        waker = realtime.Waker(self._executor.wake, self._overdue)
        try:
            self._run()
        except ExternalShutdownException:
            pass
        except RuntimeError:  # what publishing raises when the signal comes in a tick
            if self._nodes[0].context.ok():
                raise
        finally:
            waker.stop()

    def _overdue(self) -> float:
        return (time.monotonic_ns() - self._wake) / SECOND

    def _run(self) -> None:
        nodes, spin_once, clock = self._nodes, self._executor.spin_once, time.monotonic_ns
        schedules = [node.schedule for node in nodes]
        origin = clock()
        for node in nodes:
            node.start(origin)  # ticks of several devices coincide: one waking serves them all
        house = origin + SECOND
        turn = 0
        while True:
            wake = NEVER
            for schedule in schedules:
                if schedule.deadline < wake:
                    wake = schedule.deadline
            if house < wake - SLACK:
                wake = house
            now = clock()
            if now < wake:
                self._wake = wake
                spin_once((wake - now) / SECOND)
                continue
            for node in nodes:
                if node.schedule.deadline <= now:
                    node.tick()
            # Right after a tick, when the next one is as far away as it gets.
            if now >= house:
                house = self._keep_house(now, house, turn)
                turn += 1
            elif clock() >= wake + SECOND // 1000:
                spin_once(0.0)  # far behind: let one message in

    def _keep_house(self, now: int, due: int, turn: int) -> int:
        """Serve one node a time, so that house-keeping of many never adds up in one tick."""
        node = self._nodes[turn % len(self._nodes)]
        node.keep_house()
        if node is self._nodes[-1]:
            realtime.collect()
            if self._status:
                self._show()
        return max(due, now - SECOND) + SECOND // len(self._nodes)

    def _show(self) -> None:
        lines = '\n'.join(node.status() for node in self._nodes)
        if sys.stderr.isatty():  # over the lines of a second ago
            back = f'\033[{len(self._nodes)}F\033[J' if self._shown else ''
            self._shown = True
            lines = back + lines
        sys.stderr.write(f'{lines}\n')
        sys.stderr.flush()
