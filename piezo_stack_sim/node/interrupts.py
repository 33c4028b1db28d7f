# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What Ctrl-C and SIGTERM do to a process that talks ROS.

Until an executor has nodes they raise `Interrupted`, which ends even a long
start at once.  From then on they shut the ROS context down and raise nothing: inside
a callback of the events executor, which is C++, an exception from nowhere aborts the
process.  So does a context that goes away while that executor takes its nodes in,
which is why ROS gets to hear of signals only after that.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
import signal
import sys
import threading
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rclpy.executors import Executor
    from rclpy.node import Node

_SIGNALS = (signal.SIGINT, signal.SIGTERM)
_REGISTRATION = 0.01  # s; nothing waits that long unless there is nothing to take in
_AGAIN = 0.02  # s, until an exception that was lost on its way is raised anew


class Interrupted(KeyboardInterrupt):
    """
    A signal came.

    Not `KeyboardInterrupt` itself: where that leaves an ``exec`` of text, as dataclasses have
    while they are imported, Python ends with status -2, whoever catches it.

    """


class _Answer:
    """The handler: an exception at first, a note once there is an executor."""

    def __init__(self) -> None:
        self.deferred = False
        self.came = False
        self.others = sys.unraisablehook

    def __call__(self, number, frame) -> None:
        self.came = True
        if not self.deferred:
            raise Interrupted

    def unraisable(self, lost) -> None:
        """Stand in for ``sys.unraisablehook``: C code that calls Python drops what is raised."""
        if not issubclass(lost.exc_type, Interrupted):
            self.others(lost)
        elif not self.deferred:
            signal.setitimer(signal.ITIMER_REAL, _AGAIN)


@contextmanager
def interruptible() -> Iterator[None]:
    """
    Answer signals as this module says, with ROS initialised inside and without its handlers.

    Outside the main thread, where signals do not arrive, nothing changes.

    Raises
    ------
    Interrupted
        If a signal came before there was an executor.

    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    answer = _Answer()
    sys.unraisablehook = answer.unraisable
    before = {number: signal.signal(number, answer) for number in (*_SIGNALS, signal.SIGALRM)}
    try:
        yield
    except Exception:
        # Modules written in C make another error of it when it comes while they are loaded.
        if answer.came and not answer.deferred:
            raise Interrupted from None
        raise
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        for number, handler in before.items():
            signal.signal(number, handler)
        sys.unraisablehook = answer.others


def attach(executor: Executor, nodes: Sequence[Node]) -> None:
    """
    Give nodes to an executor; from then on a signal shuts ROS down.

    Raises
    ------
    Interrupted
        If a signal came meanwhile.

    """
    from rclpy.signals import install_signal_handlers
    answer = signal.getsignal(signal.SIGINT)
    if isinstance(answer, _Answer):
        answer.deferred = True
    for node in nodes:
        executor.add_node(node)
    executor.spin_once(_REGISTRATION)
    if isinstance(answer, _Answer):
        install_signal_handlers()
        if answer.came:
            executor.shutdown()
            raise Interrupted
