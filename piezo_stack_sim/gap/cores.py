# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Work spread over the cores, whoever asks: what runs on one of them already stays there."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
import os
import threading

# The kernel releases the interpreter lock: threads share the arrays of a set.
_CORES = len(os.sched_getaffinity(0)) if hasattr(os, 'sched_getaffinity') else os.cpu_count()
_HERE = threading.local()


def _enter() -> None:
    """Mark this thread as one of the pool: were it to wait for the others, all might wait."""
    _HERE.busy = True


_POOL = ThreadPoolExecutor(_CORES, thread_name_prefix='simulate', initializer=_enter)


def parallel(function: Callable, items: Iterable) -> list:
    """Call a function on items over all cores, or on this one if it is one of them; in order."""
    spread = map if getattr(_HERE, 'busy', False) else _POOL.map
    return list(spread(function, items))
