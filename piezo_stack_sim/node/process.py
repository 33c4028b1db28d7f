# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""The node as a process of its own, for as long as somebody needs it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
import subprocess
import sys


@contextmanager
def device_process(*ros_arguments: str) -> Iterator[subprocess.Popen]:
    """
    Run a `piezo_stack_node` for as long as the context lasts.

    Parameters
    ----------
    *ros_arguments : str
        What follows ``--ros-args``, such as ``'--params-file', 'actuator.yaml'``.

    """
    process = subprocess.Popen([sys.executable, '-m', 'piezo_stack_sim.node.main', '--ros-args',
                                *ros_arguments, '--log-level', 'warn'])
    try:
        yield process
    finally:
        process.terminate()
        try:
            process.wait(10.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
