# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""A question to a service, asked until there is an answer."""

from __future__ import annotations

from collections.abc import Callable
import time
from typing import Any

from rclpy.task import Future

RETRY = 3.0  # s without an answer until a question is asked again


def ask(request: Callable[[], Future], wait: Callable[[Callable[[], bool]], None]) -> Any:
    """
    Ask until there is an answer, and return it.

    An answer is lost when the device has not yet found the client's end that
    takes it, so nothing may be asked this way that must not be asked twice.

    Parameters
    ----------
    request : callable
        Sends the question; returns its future.
    wait : callable
        Takes messages until the condition that it is given holds, and raises
        what its caller wants if it never does.

    """
    futures: list[Future] = []
    again = 0.0

    def answered() -> bool:
        nonlocal again
        if time.monotonic() > again:
            futures.append(request())
            again = time.monotonic() + RETRY
        return any(future.done() for future in futures)

    try:
        wait(answered)
        return next(future.result() for future in futures if future.done())
    finally:
        for future in futures:
            future.cancel()  # without effect on one that is done
