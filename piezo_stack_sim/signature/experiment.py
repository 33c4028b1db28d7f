# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""A few tests of a stack, and in which of them an effect shows most."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from piezo_stack_sim.effects.base import Effect
from piezo_stack_sim.plant import Device, Response, simulate

# Below these a change is compared with the scale itself: at rest nothing moves (V, C, m).
SCALES = {'voltage': 10.0, 'charge': 1e-5, 'displacement': 1e-6}
CHANNELS = tuple(SCALES)


@dataclass(frozen=True)
class Experiment:
    """A test: columns of shape (n,) in SI units, and how it is told and drawn."""

    name: str
    title: str
    time: np.ndarray
    command: np.ndarray
    force: np.ndarray
    cyclic: bool = False
    log_time: bool = False
    loops: str = 'triangle'  # the cyclic test that goes with it


def _wave(name, title, frequency, low, high, cycles, rows, triangle):
    phase = np.arange(cycles * rows + 1) / rows
    shape = 1.0 - np.abs(1.0 - 2.0 * (phase % 1.0)) if triangle else (
        0.5 - 0.5 * np.cos(2.0 * np.pi * phase))
    command = low + (high - low) * shape
    return Experiment(name, title, phase / frequency, command, np.zeros(command.size), True)


def _held(name, title, time, level, **more):
    return Experiment(name, title, time, np.full(time.size, level), np.zeros(time.size), **more)


def experiments() -> dict[str, Experiment]:
    """Return all tests by name."""
    decades = np.logspace(-2, 3, 101)
    rise = np.linspace(0.0, decades[0], 51)
    hold = np.concatenate([rise[:-1], decades])
    climb = np.minimum(hold / decades[0], 1.0) * 60.0
    push = np.arange(801) / 4000.0
    tests = (
        _wave('triangle', 'triangle of 10 Hz, 0 to 90 V', 10.0, 0.0, 90.0, 2, 1000, True),
        _wave('sine', 'sine of 1 kHz, 20 to 60 V', 1000.0, 20.0, 60.0, 4, 400, False),
        _held('step', 'step of 40 V', np.arange(1201) * 1e-6, 40.0, loops='sine'),
        Experiment('hold', 'rise to 60 V in 10 ms, then hold', hold, climb,
                   np.zeros(hold.size), log_time=True),
        Experiment('push', 'leads at 0 V, pushed with 0 to 200 N at 10 Hz', push,
                   np.zeros(push.size), -100.0 * (1.0 - np.cos(2.0 * np.pi * 10.0 * push))),
        _held('rest', 'at rest, 0 V', np.arange(1001) * 1e-4, 0.0),
        _held('wait', 'at rest for half an hour, 0 V', np.arange(181) * 10.0, 0.0),
    )
    return {test.name: test for test in tests}


def run(device: Device, test: Experiment) -> Response:
    """Return what a device does in a test."""
    return simulate(device, test.time, test.command, test.force, 'voltage')


def strength(test: Experiment, effect: Effect, device: Device, values: dict[str, float]
             ) -> dict[str, float]:
    """Return the largest change by channel, as a part of what the channel does without."""
    without = run(device, test)
    response = run(device.with_effects({effect.id: values}), test)
    result = {}
    for channel, scale in SCALES.items():
        plain = getattr(without, channel)
        change = np.abs(getattr(response, channel) - plain).max()
        result[channel] = float(change / max(np.ptp(plain), scale))
    return result


def telling(effect: Effect, device: Device, values: dict[str, float], test: str | None = None
            ) -> tuple[str, str]:
    """
    Return the test and the channel in which an effect shows most.

    A triangle, which everybody knows, is preferred unless another test shows five
    times as much, or the effect names a test of its own, or ``test`` is given.
    """
    wanted = test or effect.shown_in
    best, winner = -1.0, ('triangle', 'displacement')
    for name, experiment in experiments().items():
        if wanted and name != wanted:
            continue
        moved = strength(experiment, effect, device, values)
        # The displacement is what people watch: another channel must show clearly more.
        moved['displacement'] *= 1.5
        channel = max(moved, key=lambda key: moved[key])
        score = moved[channel] * (5.0 if name == 'triangle' else 1.0)
        if score > best * (1.0 + 1e-6):
            best, winner = score, (name, channel)
    return winner
