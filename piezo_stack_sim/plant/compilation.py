# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Compiling both kernels before they are needed.

Compiled code is kept on disk, so that this happens once on a machine.  Whoever
needs both at once has a second process compile those parts of the general kernel
that nothing else waits for, and loads them where they are called.  A device as in
the paper starts with the ideal kernel, which is small, and has the general one
compiled while it runs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import os
from pathlib import Path
import subprocess
import sys
import threading

import numpy as np

from piezo_stack_sim.plant import kernel, layout
from piezo_stack_sim.plant.assembly import assemble
from piezo_stack_sim.plant.build import build_model
from piezo_stack_sim.plant.calm import calm_time
from piezo_stack_sim.plant.events import first_event
from piezo_stack_sim.plant.modes import build_mode
from piezo_stack_sim.plant.parameters import Device
from piezo_stack_sim.plant.ports import grow, settle, switch
from piezo_stack_sim.plant.stack import Plant
from piezo_stack_sim.plant.tables import Tables


def compile_needed(device: Device) -> None:
    """Make sure that what this device needs is compiled: both kernels, or the ideal one alone."""
    if is_bare(device):
        Plant(device).advance(1e-9)
    else:
        compile_kernels()


def is_bare(device: Device) -> bool:
    """Tell whether a device is no more than the ideal stack, the kernel of which is small."""
    system = assemble(build_model(device))
    return system.is_ideal and len(system.state_names) == 2


class LateKernel:
    """
    The general kernel, compiled by a process of low priority while the ideal one is in use.

    Parameters
    ----------
    loaded : callable
        Called in another thread as soon as the kernel is ready for use there.
    failed : callable
        Called there with the exit status instead if it was not compiled.

    """

    def __init__(self, loaded: Callable[[], object], failed: Callable[[int], object]) -> None:
        self._loaded, self._failed, self._stopped = loaded, failed, False
        self._helper = subprocess.Popen([sys.executable, '-m', __name__, 'all'],
                                        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        self._waiting = threading.Thread(target=self._wait, daemon=True)
        self._waiting.start()

    def _wait(self) -> None:
        status = self._helper.wait()
        if self._stopped:
            return
        if status == 0:
            self._loaded()
        else:
            self._failed(status)

    def stop(self) -> None:
        """End the compilation; what is compiled by then stays on disk."""
        self._stopped = True
        self._helper.kill()
        self._waiting.join()


def compile_kernels() -> None:
    """Make sure that both kernels are compiled; where they are, this takes no time."""
    if is_compiled():
        return
    with _one_at_a_time():
        if not is_compiled():
            _compile_both()


@contextmanager
def _one_at_a_time() -> Iterator[None]:
    """Let who needs the same code wait for it: each of several would take as long as one."""
    try:
        import fcntl
        # Beside the code: where others may write, one of them could have put a link.
        lock = open(Path(kernel.run._cache.cache_path) / 'compiling.lock', 'a')
    except (ImportError, AttributeError, OSError):
        yield  # twice the work, and the same code
        return
    with lock:  # whoever dies lets go of it
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def _compile_both() -> None:
    with subprocess.Popen([sys.executable, '-m', __name__, 'modes'], stdout=subprocess.PIPE,
                          stderr=subprocess.DEVNULL) as helper:
        try:
            _compile_ports()
            _compile_events()
            assert helper.stdout is not None
            helper.stdout.readline()  # the modes are on disk, or the helper has ended
            Plant(_with_states()).advance(1e-9)
            helper.wait()
        finally:
            helper.kill()
    _compile_ideal()


def compile_all_beside() -> None:
    """Compile both kernels, one after the other, and let others have most of the cores."""
    if hasattr(os, 'sched_setscheduler'):
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))  # its parent may be real-time
    os.nice(5)
    _compile_ideal()
    Plant(_with_states()).advance(1e-9)


def help_compiling() -> None:
    """Compile what sets up modes, say so, then the kernel of the ideal stack."""
    _, (k, _, _, _, real, ip, rates, opposing, reading, *rest) = _arguments()
    (tick, levels, short, _, *space) = rest
    build_mode(0, real, ip, k, rates, opposing, reading, tick, levels, short, *space)
    print('modes', flush=True)
    _compile_ideal()


def _compile_ideal() -> None:
    """Compile the kernel of the ideal stack, alone and with something that follows it."""
    for effects in {}, {'sensor_lag': {'time_constant': 1e-3}}:
        Plant(Device.nominal().with_effects(effects)).advance(1e-9)


def _compile_ports() -> None:
    arrays, (k, v_break, r, limits, real, ip, _, opposing, *_) = _arguments()
    settle(arrays.s, arrays.inputs, arrays.flags, arrays.p, r, k, v_break, real, ip, opposing,
           arrays.memory)
    grow(arrays.flags, arrays.p, r, v_break, limits, real, arrays.memory)
    switch(np.zeros(layout.N_WATCHED), arrays.s, arrays.inputs, arrays.flags, arrays.p, r, k,
           v_break, real, ip, arrays.memory, 0)


def _compile_events() -> None:
    arrays, (k, _, r, _, real, ip, *_) = _arguments()
    now = np.zeros(layout.N_WATCHED)
    first_event(now, now, arrays.s, arrays.s, 1e-6, arrays.flags, arrays.p, r, real, ip,
                arrays.memory, k.size, True, True, False, False)
    calm_time(now, 0.0, 0.0, 1.0, 1.0, False, arrays.flags, arrays.p, r, real, ip, arrays.memory)


class _Arrays:
    """The state of a device as the kernel takes it."""

    def __init__(self, n_states: int, elements: int) -> None:
        self.s, self.p = np.zeros(n_states), np.zeros(elements)
        self.flags = np.zeros(layout.N_FLAGS, dtype=np.int64)
        self.inputs = np.zeros(layout.N_INPUTS)
        self.memory = np.zeros(layout.N_MEMORY)


def _arguments():
    system = assemble(build_model(_with_states()))
    return _Arrays(system.rates.shape[0], system.k.size), Tables(system, [1e-3]).arguments


def _with_states() -> Device:
    """Return a device that the general kernel has to take."""
    return Device.nominal().with_effects({'creep': {'gain_per_decade': 0.01}})


def is_compiled() -> bool:
    """Tell whether both kernels are compiled, here or on disk."""
    try:  # the last part to be compiled; numba has no public word on whether it has been kept
        return bool(kernel.run.signatures or kernel.run._cache._cache_file._load_index())
    except Exception:  # whatever is wrong there, numba meets it when it is needed
        return True


if __name__ == '__main__':
    {'modes': help_compiling, 'all': compile_all_beside}[sys.argv[1]]()
