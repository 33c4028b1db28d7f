# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The test programmes of a recording set: what is commanded, and which force is applied.

The standard ones are those of the withheld rounds; `draw` varies rates, amplitudes and speeds.

"""

from dataclasses import dataclass, replace

import numpy as np

from piezo_stack_sim.challenge.device import Programme

NAMES = ('triangle', 'decay', 'steps', 'multisine', 'force')


@dataclass(frozen=True)
class Plan:
    """Rates (Hz), amplitudes (V, N) and speeds (Hz, s) of the five recordings."""

    triangle_rate: float = 10e3
    triangle_frequency: float = 10.0
    triangle_peaks: tuple = (30.0, 60.0, 90.0)
    decay_rate: float = 20e3
    decay_frequency: float = 100.0
    decay_bias: float = 45.0
    decay_amplitude: float = 40.0
    steps_rate: float = 1e3
    steps_hold: float = 6.0
    steps_levels: tuple = (0.0, 60.0, 20.0, 80.0, 10.0)
    multisine_rate: float = 50e3
    multisine_bias: float = 40.0
    multisine_top: float = 5000.0
    multisine_amplitude: float = 2.3  # V rms
    force_rate: float = 10e3
    force_frequency: float = 10.0
    force_bias: float = 40.0
    force_peak: float = 120.0
    phases: int = 1  # seed of the multisine's phases
    names: tuple = NAMES


def rows(rate, duration):
    """Return row times (n,) in s."""
    return np.arange(int(round(rate * duration))) / rate


def smooth(t, start, length):
    """Return a half cosine from 0 to 1."""
    return 0.5 - 0.5 * np.cos(np.pi * np.clip((t - start) / length, 0.0, 1.0))


def triangle(plan):
    """Return two periods at each peak voltage."""
    t = rows(plan.triangle_rate, 2 * len(plan.triangle_peaks) / plan.triangle_frequency)
    per_period = int(round(plan.triangle_rate / plan.triangle_frequency))
    row = np.arange(t.size)
    peak = np.asarray(plan.triangle_peaks)[row // (2 * per_period)]
    return t, peak * (1.0 - np.abs(2.0 * (row % per_period) / per_period - 1.0)), 0.0 * t


def decay(plan):
    """Return a sine about a bias that dies away, faded in at the beginning."""
    period = 1.0 / plan.decay_frequency
    t = rows(plan.decay_rate, 30 * period)
    swing = np.exp(-t / (8 * period)) * np.sin(2.0 * np.pi * plan.decay_frequency * t)
    return t, smooth(t, 0.0, 2 * period) * (plan.decay_bias + plan.decay_amplitude * swing), 0 * t


def steps(plan):
    """Return levels held for seconds, with smooth ramps of 0.2 s between them."""
    t = rows(plan.steps_rate, plan.steps_hold * len(plan.steps_levels))
    u = np.full_like(t, plan.steps_levels[0])
    for i in range(1, len(plan.steps_levels)):
        change = plan.steps_levels[i] - plan.steps_levels[i - 1]
        u += change * smooth(t, i * plan.steps_hold, 0.2)
    return t, u, 0.0 * t


def multisine(plan):
    """Return fifty tones, evenly spread over log frequency, that repeat every 0.1 s."""
    t = rows(plan.multisine_rate, 0.3)
    tones = np.unique(np.round(np.geomspace(20.0, plan.multisine_top, 60), -1))
    phases = np.random.default_rng(plan.phases).uniform(0.0, 2.0 * np.pi, tones.size)
    swing = np.cos(2.0 * np.pi * np.outer(t, tones) + phases).sum(axis=1)
    swing *= plan.multisine_amplitude * np.sqrt(2.0 / tones.size)
    return t, smooth(t, 0.0, 0.02) * (plan.multisine_bias + swing), 0.0 * t


def force(plan):
    """Return a pushing force at constant voltage."""
    period = 1.0 / plan.force_frequency
    t = rows(plan.force_rate, 0.1 + 4 * period)
    push = -0.5 * plan.force_peak * (1.0 - np.cos(2.0 * np.pi * (t - 0.1) / period))
    return t, plan.force_bias * np.clip(t / 0.02, 0.0, 1.0), np.where(t > 0.1, push, 0.0)


MAKERS = {'triangle': triangle, 'decay': decay, 'steps': steps, 'multisine': multisine,
          'force': force}


def programmes(plan):
    """Return the recordings of a plan as a tuple of Programme."""
    return tuple(Programme(name, *MAKERS[name](plan)) for name in plan.names)


def draw(random, needed=()):
    """
    Return a random plan.

    Parameters
    ----------
    random : numpy.random.Generator
        Source of the random numbers.
    needed : tuple of str
        Recordings that must not be left out.

    """
    plan = Plan(phases=int(random.integers(1 << 30)))
    if random.random() < 0.5:
        top = random.uniform(45.0, 98.0)
        scale = random.uniform(0.6, 1.1)
        plan = replace(
            plan,
            triangle_rate=float(random.choice([5e3, 10e3, 20e3])),
            triangle_frequency=float(random.choice([5.0, 10.0, 20.0])),
            triangle_peaks=tuple(round(top * part) for part in (0.35, 0.65, 1.0)),
            decay_rate=float(random.choice([10e3, 20e3])),
            decay_frequency=float(random.choice([50.0, 100.0, 200.0])),
            decay_bias=round(random.uniform(35.0, 50.0), 1),
            decay_amplitude=round(random.uniform(15.0, 35.0), 1),
            steps_rate=float(random.choice([500.0, 1e3])),
            steps_hold=float(random.choice([4.0, 6.0])),
            steps_levels=(0.0, *(round(scale * level) for level in
                                 random.permutation([60.0, 20.0, 80.0, 10.0]))),
            multisine_rate=float(random.choice([25e3, 50e3])),
            multisine_bias=round(random.uniform(20.0, 60.0)),
            multisine_top=float(random.choice([2000.0, 3500.0, 5000.0])),
            multisine_amplitude=round(random.uniform(0.8, 3.0), 2),
            force_rate=float(random.choice([5e3, 10e3])),
            force_frequency=float(random.choice([5.0, 10.0, 20.0])),
            force_bias=round(random.uniform(10.0, 60.0)),
            force_peak=round(random.uniform(50.0, 200.0)),
        )
    dropped = [name for name in ('force', 'multisine', 'steps', 'decay')
               if name not in needed and random.random() < 0.08]
    return replace(plan, names=tuple(name for name in NAMES if name not in dropped[:2]))
