# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""One device under test: what it is, what is hidden in it, and its noise-free response."""

from dataclasses import dataclass, field, replace

import numpy as np

from piezo_stack_sim.challenge.drive import Drive, output, segments
from piezo_stack_sim.challenge.guide import AT_FIRST
from piezo_stack_sim.challenge.integrator import LAGGED, RING, run, STATES, TERMINAL
from piezo_stack_sim.challenge.memory import RESOLUTION
from piezo_stack_sim.challenge.mount import mount_of
from piezo_stack_sim.challenge.sensing import measure, Sensing
from piezo_stack_sim.challenge.stack import Stack

STEP = 2e-6  # s; the 24 kHz resonance gets twenty steps a period, good for a nanometre
OF_BODY = 0.5  # of the step with a payload: its joint rings at up to 65 kHz
COARSE = 1e-3  # s, in holds
KEEP = 4e-6  # s, spacing of the trace from which the sensors read
SLOW = 0.01  # s, between two voltages of a history
SETTLED = 5  # of these, after strain has faded


@dataclass(frozen=True)
class Unit:
    """A device: driver, stack and instruments, and the voltages that it saw before."""

    drive: Drive = field(default_factory=Drive)
    stack: Stack = field(default_factory=Stack)
    sensing: Sensing = field(default_factory=Sensing)
    history: tuple = ()  # V, turning points of a slow voltage before the recording
    faded: tuple = ()  # part of each element's strain that has relaxed since

    def change(self, drive=None, stack=None, sensing=None, history=None, faded=None):
        """Return the device with some fields of its parts changed."""
        return Unit(
            replace(self.drive, **(drive or {})),
            self.stack._replace(**(stack or {})),
            replace(self.sensing, **(sensing or {})),
            self.history if history is None else tuple(history),
            self.faded if faded is None else tuple(faded),
        )


@dataclass(frozen=True)
class Programme:
    """What is done to the device in one recording: rows of command (V) and force (N)."""

    name: str
    time: np.ndarray
    command: np.ndarray
    force: np.ndarray


def branches(stack):
    """Return shares and times (s) of the branches of a stack's mount."""
    return mount_of(stack.mount_first, stack.mount_second)


def rest(unit):
    """
    Return the state after the device's history, at rest under a command of zero.

    The driver is on before the recording begins, so its offset has already been followed.

    """
    state = np.zeros(STATES + unit.stack.K.size)
    first = float(output(unit.drive, 0.0, 0.0))
    path = [0.0]
    for turn in (*unit.history, first):
        steps = max(1, int(np.ceil(abs(turn - path[-1]) / 0.25)))
        path.extend(np.linspace(path[-1], turn, steps + 1)[1:])
    path = np.array(path)
    if np.any(path != 0.0):
        # Slow, and without memory of time: a history is long past.
        still = unit.stack._replace(creep_per_decade=0.0, mount_stiffness=0.0, rate_gain=0.0,
                                    current_limit=np.inf, heating_gain=0.0)

        def lead(voltages):
            times = SLOW * np.arange(voltages.size + 1)
            run(still, *branches(still), state, times, voltages, np.zeros(voltages.size), STEP,
                SLOW, 1.0, True, RESOLUTION)

        lead(path)
        if unit.faded:
            state[STATES:] *= 1.0 - np.array(unit.faded)
            lead(np.full(SETTLED, path[-1]))
    state[LAGGED] = state[RING] = state[TERMINAL] = first
    state[STATES - 1] = AT_FIRST
    return state


def respond(unit, programme, index=0, step=STEP, resolution=RESOLUTION):
    """
    Return the noise-free channels (dict of (n,) arrays, SI) of a device under a programme.

    Displacement and charge are zeroed at the first row.

    """
    if unit.stack.body_mass > 0.0:
        step = step * OF_BODY
    state = rest(unit)
    edges, sources, forces = segments(unit.drive, programme.time, programme.command,
                                      programme.force)
    trace = run(unit.stack, *branches(unit.stack), state, edges, sources, forces, step, COARSE,
                KEEP, False, resolution)
    channels = measure(unit.sensing, trace, programme.time, index)
    for name in ('displacement', 'charge'):
        channels[name] = channels[name] - channels[name][0]
    return channels
