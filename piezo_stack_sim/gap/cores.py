# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Work spread over the cores: whoever has several things to do is helped by who is idle."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor, wait
import os
import threading

# The kernel releases the interpreter lock: threads share the arrays of a set.
_CORES = len(os.sched_getaffinity(0)) if hasattr(os, 'sched_getaffinity') else os.cpu_count() or 1
_DEPTH = 16  # work within work: who waits for helpers keeps a thread, if not a core
_POOL = ThreadPoolExecutor(_DEPTH * _CORES, thread_name_prefix='simulate')
_IDLE = threading.Semaphore(_CORES - 1)  # cores besides that of who asks first


def parallel(function: Callable, items: Iterable) -> list:
    """
    Call a function on items, together with every core that is idle; in order.

    What runs on one of them may ask for it again: towards the end of the larger work,
    when nothing of it is left for the others, they help with the smaller.
    """
    given = list(items)
    answers: list = [None] * len(given)
    left = iter(range(len(given)))  # all take from it; the interpreter's lock guards it

    def work() -> None:
        for i in left:
            answers[i] = function(given[i])

    def help_out() -> None:
        try:
            work()
        finally:
            _IDLE.release()

    helpers = []
    try:
        while len(helpers) < len(given) - 1 and _IDLE.acquire(blocking=False):
            helpers.append(_POOL.submit(help_out))
        work()
    finally:
        for _ in left:
            pass  # once one has failed, or the user wants no more, nobody begins another
        if helpers:
            _IDLE.release()  # who waits leaves a core to those waited for
            try:
                wait(helpers)
            finally:
                _IDLE.acquire()
    for helper in helpers:
        helper.result()
    return answers
