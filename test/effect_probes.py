# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Test signals for effects, and how to switch one on."""

import math

import numpy as np
from piezo_stack_sim.effects.registry import EFFECTS
from piezo_stack_sim.plant import Device, simulate

IDEAL = Device.nominal()
CHANNELS = ('voltage', 'charge', 'displacement')
ALL = {name: effect.typical() for name, effect in EFFECTS.items()}


def device(name, **values):
    """Return the nominal device with one effect at typical values, some of them changed."""
    return IDEAL.with_effects({name: {**EFFECTS[name].typical(), **values}})


def only(name, **values):
    """Return the nominal device with one effect, what is not given at its neutral value."""
    return IDEAL.with_effects({name: values})


def triangle(frequency, peak, cycles, rows):
    """Return time (s) and voltage (V) of a triangle from zero, with ``rows`` rows a cycle."""
    time = np.arange(cycles * rows + 1) / (frequency * rows)
    phase = (np.arange(time.size) % rows) / rows
    return time, peak * np.where(phase < 0.5, 2.0 * phase, 2.0 - 2.0 * phase)


def sine(frequency, low, high, cycles, rows):
    """Return time (s) and voltage (V) of a sine that starts at its low."""
    time = np.arange(cycles * rows + 1) / (frequency * rows)
    wave = 0.5 - 0.5 * np.cos(2.0 * np.pi * frequency * time)
    return time, low + (high - low) * wave


def mixed(rows=4000, period=2e-5):
    """Return time, voltage and force of a probe in which every effect shows itself."""
    time = np.arange(rows) * period
    span = rows * period
    phase = (time / span * 4.0) % 1.0
    voltage = 90.0 * np.where(phase < 0.5, 2.0 * phase, 2.0 - 2.0 * phase)
    voltage[rows // 2:] = 0.5 * voltage[rows // 2:] + 10.0 * np.sin(
        2.0 * np.pi * 800.0 * time[rows // 2:])
    voltage[3 * rows // 4:] = 60.0
    force = -40.0 * (1.0 - np.cos(2.0 * np.pi * 3.0 * time / span))
    return time, voltage, force


def rise_time(target):
    """Return when a 90 V step has led the displacement to 90 % of where it ends (s)."""
    time = np.arange(2000) * 2e-6
    x = simulate(target, time, np.full(time.size, 90.0)).displacement
    after = int(np.argmax(x >= 0.9 * x[-1]))
    part = (0.9 * x[-1] - x[after - 1]) / (x[after] - x[after - 1])
    return float(time[after - 1] + part * 2e-6)


def fundamental(time, values, frequency, cycles=2):
    """Return the complex amplitude at a frequency over the last whole cycles."""
    rows = round(cycles / frequency / (time[1] - time[0]))
    t, v = time[-rows:], values[-rows:]
    return 2.0 * np.mean(v * np.exp(-2j * math.pi * frequency * t))


def lags(target, frequency, low=20.0, high=60.0, rows=400, cycles=6):
    """Return gain and lag (degrees) of voltage, charge and displacement over the one before."""
    time, command = sine(frequency, low, high, cycles, rows)
    response = simulate(target, time, command)
    # A row is sampled just before its command takes effect: the command before it rules there.
    chain = [np.concatenate([command[:1], command[:-1]]), response.voltage, response.charge,
             response.displacement]
    tones = [fundamental(time, values, frequency) for values in chain]
    return [(abs(b / a), -math.degrees(np.angle(b / a))) for a, b in zip(tones, tones[1:])]


def stroke(target, peak=90.0):
    """Return the stroke in the last cycle of a slow triangle, in metres."""
    time, voltage = triangle(1.0, peak, 3, 2000)
    return float(np.ptp(simulate(target, time, voltage).displacement[4000:]))


def at(time, values, moment):
    """Return a value at a moment."""
    return float(np.interp(moment, time, values))


def ringing(target, force=-1.0):
    """Return the natural frequency (Hz) with leads open after a small push."""
    time = np.arange(8192) * 2e-6
    push = np.where(time > 0.0, force, 0.0)
    x = simulate(target, time, np.zeros(time.size), push, drive='open').displacement
    tone = np.abs(np.fft.rfft((x - x[-1]) * np.exp(-time / 4e-3), 1 << 17))
    return float(np.fft.rfftfreq(1 << 17, 2e-6)[1 + np.argmax(tone[1:])])
