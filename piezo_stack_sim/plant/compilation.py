# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Compiling both kernels before they are needed, on two cores.

Compiled code is kept on disk, so that this happens once on a machine.  A second
process compiles those parts of the general kernel that nothing else waits for;
this one loads them when it comes to where they are called.
"""

from __future__ import annotations

import subprocess
import sys

import numpy as np

from piezo_stack_sim.plant import kernel, layout
from piezo_stack_sim.plant.assembly import assemble
from piezo_stack_sim.plant.build import build_model
from piezo_stack_sim.plant.calm import calm_time
from piezo_stack_sim.plant.events import first_event
from piezo_stack_sim.plant.modes import build_mode
from piezo_stack_sim.plant.parameters import Device
from piezo_stack_sim.plant.ports import settle, switch
from piezo_stack_sim.plant.stack import Plant
from piezo_stack_sim.plant.tables import Tables


def compile_kernels() -> None:
    """Make sure that both kernels are compiled; where they are, this takes no time."""
    if _is_on_disk():
        return
    with subprocess.Popen([sys.executable, '-m', __name__], stdout=subprocess.PIPE,
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
    Plant(Device.nominal()).advance(1e-9)


def help_compiling() -> None:
    """Compile what sets up modes, say so, then the kernel of the ideal stack."""
    _, (k, _, _, real, ip, rates, opposing, reading, *rest) = _arguments()
    (tick, levels, short, _, *space) = rest
    build_mode(0, real, ip, k, rates, opposing, reading, tick, levels, short, *space)
    print('modes', flush=True)
    Plant(Device.nominal()).advance(1e-9)


def _compile_ports() -> None:
    arrays, (k, v_break, r, real, ip, _, opposing, *_) = _arguments()
    settle(arrays.s, arrays.inputs, arrays.flags, arrays.p, r, k, v_break, real, ip, opposing,
           arrays.memory)
    switch(np.zeros(layout.N_WATCHED), arrays.s, arrays.inputs, arrays.flags, arrays.p, r, k,
           v_break, real, ip, arrays.memory, 0)


def _compile_events() -> None:
    arrays, (k, _, r, real, ip, *_) = _arguments()
    now = np.zeros(layout.N_WATCHED)
    first_event(now, now, arrays.s, arrays.s, 1e-6, arrays.flags, arrays.p, r, real, ip,
                arrays.memory, k.size, True, True, False, False)
    calm_time(now, 0.0, 0.0, 1.0, 1.0, False, arrays.flags, arrays.p, r, real, ip, arrays.memory)


class _Arrays:
    """The state of a device as the kernel takes it."""

    def __init__(self, n_states: int, elements: int) -> None:
        self.s, self.p = np.zeros(n_states), np.zeros(elements)
        self.flags = np.zeros(layout.N_FLAGS, dtype=np.int64)
        self.inputs, self.memory = np.zeros(layout.N_INPUTS), np.zeros(4)


def _arguments():
    system = assemble(build_model(_with_states()))
    return _Arrays(system.rates.shape[0], system.k.size), Tables(system, [1e-3]).arguments


def _with_states() -> Device:
    """Return a device that the general kernel has to take."""
    return Device.nominal().with_effects({'creep': {'gain_per_decade': 0.01}})


def _is_on_disk() -> bool:
    """Tell whether the last part to be compiled has been kept; numba has no public word on it."""
    from pathlib import Path
    try:
        return any(Path(kernel.run._cache.cache_path).glob('kernel.run-*.nbi'))
    except AttributeError:
        return True


if __name__ == '__main__':
    help_compiling()
