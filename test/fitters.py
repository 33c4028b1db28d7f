# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Fitters for tests: a nominal device beside recordings of a unit that differs from it."""

from piezo_stack_sim.gap.cores import parallel
from piezo_stack_sim.gap.fitting.fit import Fitter
from piezo_stack_sim.gap.measured.evidence import prepare
from piezo_stack_sim.gap.measured.forward import simulate_set
from piezo_stack_sim.plant import simulate

NOISE = {'charge': 2e-9, 'displacement': 1e-9}


def fitter_of(device, unit, recorded, random, noises=NOISE):
    """Return what fits recordings of a unit with white noise, the device as its file."""
    recordings = []
    for programme in recorded:
        answer = simulate(unit, programme.time, programme.command, programme.external_force)
        recordings.append(programme.replace(measured={
            name: getattr(answer, name) + noise * random.standard_normal(len(programme))
            for name, noise in noises.items()}))
    fitter = Fitter(device, prepare(recordings, simulate_set(device, recordings)))
    fitter.prepare(parallel)
    return fitter
