# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Propagators of a device for segments of a few lengths, and the kernel that runs them."""

from __future__ import annotations

from collections.abc import Sequence
import math

import numpy as np

from piezo_stack_sim.errors import InputError
from piezo_stack_sim.plant import ideal, kernel, layout
from piezo_stack_sim.plant.assembly import System
from piezo_stack_sim.plant.lanes import padded

TICK = 6.5e-8  # s; events are met on a grid at least this fine


class Tables:
    """Propagators of one system for a few segment lengths; the general ones made when met."""

    def __init__(self, system: System, durations: Sequence[float]) -> None:
        self.system = system
        self.levels = np.array([max(0, math.ceil(math.log2(d / TICK))) for d in durations])
        self.tick = np.array([d / 2.0 ** level for d, level in zip(durations, self.levels)])
        self.ticks = (2 ** self.levels).astype(np.int64)
        self.arguments: tuple = ()
        if system.is_ideal:
            self._prepare_ideal()
        else:
            self._prepare_general(len(durations))

    def _prepare_ideal(self) -> None:
        system = self.system
        real = system.real
        voltage_driven = bool(system.ints[layout.I_DRIVE] == layout.VOLTAGE)
        clamped = bool(system.ints[layout.I_CLAMPED])
        ratio, converse, cap = real[[layout.R_T, layout.R_CONVERSE, layout.R_C]]
        modes = system.k.size + 1
        constants = (np.zeros((modes, ideal.N_CONSTANTS)),
                     np.zeros((modes, self.tick.size, int(self.levels.max()) + 1, 4)))
        ideal.mode_constants(
            system.k, ratio, converse, cap, real[layout.R_MASS], real[layout.R_STIFFNESS],
            real[layout.R_DAMPING], voltage_driven, clamped, self.tick, self.levels, *constants)
        n = system.rates.shape[0]
        base = n + 2
        columns = [0, 1, n, n + 1, base + layout.U, base + layout.FORCE, base + layout.ONE]
        row = system.reading[0, columns]
        # What follows the stack, if anything does: a slow sensor, leaked charge.
        m = n - 2
        followers: tuple = (None,) * 6
        if m:
            follow = np.ascontiguousarray(system.rates[2:, columns])
            trails = np.zeros((modes, self.tick.size, int(self.levels.max()) + 1, m, 2 + 2 * m))
            ideal.follow_propagators(
                follow, np.ascontiguousarray(system.rates[2:, 2:n]), ratio, cap,
                real[layout.R_MASS], real[layout.R_DAMPING], real[layout.R_RATE_MAX],
                voltage_driven, clamped, self.tick, self.levels, constants[0], trails,
                np.zeros((4, 2 + 2 * m, 2 + 2 * m)))
            followers = (system.reading[2, 2:n].copy(), system.reading[0, 2:n].copy(), follow,
                         trails, np.zeros(m), np.zeros(m))
        # A sub-step is short if the fastest motion turns by at most 1.3 rad in it.
        quick = 1.3 / system.omega_max
        short = np.array([min(level, max(0, math.floor(math.log2(quick / tick))))
                          for level, tick in zip(self.levels.tolist(), self.tick)])
        self._run = ideal.run
        self.arguments = (system.k, system.v_break, system.r, ratio, converse, cap,
                          voltage_driven, clamped, *constants, self.tick, self.levels, short, row,
                          *followers)

    def _prepare_general(self, n_classes: int) -> None:
        system = self.system
        n, modes = system.rates.shape[0], system.n_modes
        width = n + layout.N_INPUTS
        columns = n + int(system.ints[layout.I_INPUTS])
        if system.ints[layout.I_SMOOTH]:
            columns += layout.N_RAMPS
        tables = np.zeros((modes * n_classes * (int(self.levels.max()) + 1),
                           columns, padded(n + layout.N_AHEAD)))
        self._run = kernel.run
        self.arguments = (
            system.k, system.v_break, system.r, np.zeros((2, system.k.size)), system.real,
            system.ints, system.rates,
            system.opposing, system.reading, self.tick, self.levels,
            np.zeros((modes, n_classes), dtype=np.int64), np.zeros(modes, dtype=np.bool_), tables,
            np.zeros((modes, width, layout.N_WATCHED)), np.zeros(modes), np.zeros(modes),
            np.zeros((layout.N_MATRICES, columns, columns)),
            np.zeros((layout.N_ROWS, max(width + layout.N_RAMPS, layout.N_WATCHED))))

    def run(self, seg_class, seg_ticks, u, force, rows, reads, state, out, read) -> None:
        """Run segments; ``state`` is s, p, flags, inputs, memory, changed in place."""
        if self._run(seg_class, seg_ticks, u, force, rows, reads, *state, *self.arguments, out,
                     read):
            raise InputError('the device left the finite numbers; the command, the force or a '
                             'parameter is beyond anything a stack can follow')
