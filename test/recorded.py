# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Recordings for tests: what a stack without memory answers, with the noise of its sensors."""

from types import SimpleNamespace

import numpy as np
from piezo_stack_sim.errors import InputError
from piezo_stack_sim.recording import preflight, Recording, RecordingSet
from piezo_stack_sim.recording.statics import Statics
import pytest

NOISE = {'voltage': 5e-3, 'charge': 5e-9, 'displacement': 2e-9}
# The AE0505D16 of Tables 1 and 2, as far as preflight looks at it.
DEVICE = SimpleNamespace(
    actuator=SimpleNamespace(
        stiffness=6e6, transformer_ratio=10.0, linear_capacitance=1.2e-6,
        maxwell_stiffness=(2e6, 6e5, 3e5, 2.6e5, 6e4, 1e5, 5e4, 3e4, 1e5, 5e5),
        maxwell_break_voltage=(0.2, 0.3, 0.3, 2.6, 0.9, 2.0, 1.5, 1.2, 7.0, 80.0),
        voltage_range=(0.0, 150.0)),
    load=SimpleNamespace(stiffness=0.0, clamped=False))


def triangle(rows, height, turns=3):
    """Return a triangle from zero to `height` and back, shape (rows,)."""
    return height * (1.0 - np.abs(1.0 - 2.0 * (np.linspace(0.0, turns, rows) % 1.0)))


def answered(command, force=None, rate=10e3, drive='voltage', name='triangle', seed=0, noise=1.0):
    """Return a Recording of what the device answers to the row before, zeroed where it begins."""
    command = np.asarray(command, dtype=float)
    inputs = (np.concatenate((values[:1], values[:-1]))
              for values in (command, np.zeros(command.size) if force is None else force))
    answer = Statics(DEVICE).answer(drive, *inputs)
    random = np.random.default_rng(seed)
    measured = {
        each: values + noise * NOISE[each] * random.standard_normal(command.size)
        for each, values in answer.items()
    }
    return Recording(name, np.arange(command.size) / rate, drive, command, force,
                     measured=measured, source=f'{name}.csv',
                     rows=np.arange(2, command.size + 2))


def slow(rows=3000, height=90.0, **settings):
    """Return the recording of three slow triangles."""
    return answered(triangle(rows, height), **settings)


def pushed(rows=3000, height=40.0, force=-100.0, **settings):
    """Return a recording with a ramp to a bias and then a force that comes and goes."""
    ramp = np.minimum(np.arange(rows) / (0.1 * rows), 1.0) * height
    push = force / 2.0 * (1.0 - np.cos(2.0 * np.pi * np.arange(rows) / (0.3 * rows)))
    settings = {'name': 'force', **settings}
    return answered(ramp, np.where(np.arange(rows) < 0.1 * rows, 0.0, push), **settings)


def set_of(*recordings):
    """Return a set."""
    return RecordingSet('device', recordings, 'device')


def with_channel(recording, channel, values):
    """Return the recording with other values of a measured channel."""
    return recording.replace(measured={**recording.measured, channel: values})


def checked(*recordings, device=DEVICE, **options):
    """Return the recordings that pass, and the findings as text."""
    result, findings = preflight(set_of(*recordings), device, **options)
    return result.recordings, [str(each) for each in findings]


def mended(recording, *others, device=DEVICE):
    """Return the first recording after preflight and the only finding about it."""
    passed, findings = checked(recording, *others, device=device)
    assert len(findings) == 1, findings
    return passed[0], findings[0]


def refusal(recording, device=DEVICE):
    """Return the one refusal of a recording."""
    with pytest.raises(InputError) as error:
        preflight(set_of(recording), device)
    assert str(error.value).startswith('refused: triangle.csv')
    return str(error.value)


def same(one, other):
    """Return whether two recordings have equal columns up to rounding."""
    return all(np.allclose(one.columns()[name], values, rtol=1e-12, atol=1e-15)
               for name, values in other.columns().items())
