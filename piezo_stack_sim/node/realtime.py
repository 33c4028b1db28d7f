# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the operating system can do for punctual ticks; all of it optional."""

from __future__ import annotations

import ctypes
import gc
import os
import threading
import time
from typing import Callable

from piezo_stack_sim.errors import InputError

_MCL_CURRENT, _MCL_FUTURE = 1, 2
_PR_SET_TIMERSLACK = 29


def quiet_collector() -> None:
    """
    Take the garbage collector out of the ticks.

    What exists now is never looked at again, and what comes is collected only
    when `collect` is called.

    """
    gc.collect()
    gc.freeze()
    gc.disable()


def collect() -> None:
    """Collect garbage now; with the start-up's objects frozen this takes well under 1 ms."""
    gc.collect()


def sharpen_timers() -> None:
    """Ask Linux not to delay this thread's wake-ups by the usual 50 us; needs no permission."""
    try:
        ctypes.CDLL(None).prctl(_PR_SET_TIMERSLACK, 1, 0, 0, 0)
    except (AttributeError, OSError):  # another operating system
        pass


def set_priority(priority: int) -> str | None:
    """
    Run this thread under ``SCHED_FIFO``.

    Returns
    -------
    str or None
        Why it was not possible and what to do, in one line.

    Raises
    ------
    InputError
        If there is no such priority.

    """
    if not hasattr(os, 'sched_setscheduler'):
        return 'real-time priority: this operating system has none; running without'
    low, high = (limit(os.SCHED_FIFO) for limit in (os.sched_get_priority_min,
                                                    os.sched_get_priority_max))
    if not low <= priority <= high:
        raise InputError(f'--realtime-priority {priority}: expected {low} to {high}')
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except PermissionError:
        return (f'real-time priority {priority} not permitted, running without: add '
                f'"@realtime - rtprio {priority}" to /etc/security/limits.conf, join that group '
                'and log in again, or grant CAP_SYS_NICE')
    except OSError as error:
        return f'real-time priority {priority} refused ({error.strerror}), running without'
    return None


def lock_memory() -> str | None:
    """
    Keep the process's memory from being swapped out.

    Returns
    -------
    str or None
        Why it was not possible and what to do, in one line.

    """
    try:
        libc = ctypes.CDLL(None, use_errno=True)
        failed = libc.mlockall(_MCL_CURRENT | _MCL_FUTURE)
    except (AttributeError, OSError):
        return 'memory locking: this operating system has none; running without'
    if failed:
        reason = os.strerror(ctypes.get_errno())
        return (f'memory locking not permitted ({reason}), running without: add '
                '"@realtime - memlock unlimited" to /etc/security/limits.conf, join that group '
                'and log in again, or grant CAP_IPC_LOCK')
    return None


class Waker:
    """
    Wakes the main loop when it oversleeps.

    The C++ library of some rclpy builds waits on the clock of the day; when that
    is set back, a wait of a millisecond lasts as long as the clock was set back.
    This thread waits on the steady clock and gives the executor a push.

    """

    PATIENCE = 0.1  # s

    def __init__(self, wake: Callable[[], object], overdue: Callable[[], float]) -> None:
        self._wake = wake
        self._overdue = overdue
        self._stopped = False
        self._thread = threading.Thread(target=self._run, daemon=True, name='waker')
        self._thread.start()

    def _run(self) -> None:
        while not self._stopped:
            time.sleep(self.PATIENCE)
            if self._overdue() > self.PATIENCE and not self._stopped:
                self._wake()

    def stop(self) -> None:
        """Let the thread end."""
        self._stopped = True
        self._thread.join(timeout=1.0)
