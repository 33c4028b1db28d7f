# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Test programmes: commands that make a stack show what it is.

Each function returns a `Recording` with commands and nothing measured, ready for the plant, for a
real device or for a peer in a benchmark. The defaults suit the AE0505D16 of the paper.

"""

import numpy as np

from piezo_stack_sim.errors import InputError
from piezo_stack_sim.recording.recording import Recording


def triangle(peaks=(30.0, 60.0, 90.0), frequency=10.0, cycles=2, rate=10e3):
    """
    Return triangles from zero, as in the paper's Fig. 10: loops, their growth, what remains.

    Parameters
    ----------
    peaks : sequence of float
        V; each is reached `cycles` times before the next.
    frequency : float
        Hz.
    cycles : int
        Cycles of each peak.
    rate : float
        Rows per second (Hz).

    Returns
    -------
    Recording

    """
    rows = _whole(rate / frequency, 'rate / frequency')
    turn = np.arange(rows) / rows
    shape = np.minimum(2.0 * turn, 2.0 - 2.0 * turn)  # exact zeros: no ripple where it starts
    command = np.concatenate([peak * np.tile(shape, cycles) for peak in peaks])
    return _recording('triangle', rate, command)


def decay(bias=45.0, amplitude=40.0, frequency=100.0, time_constant=0.08, ramp=0.02,
          duration=0.3, rate=20e3):
    """
    Return a decaying sine about a bias, as in the paper's Fig. 12: loops within loops.

    Parameters
    ----------
    bias, amplitude : float
        V.
    frequency : float
        Hz.
    time_constant : float
        Of the decay (s).
    ramp : float
        Time in which everything is faded in (s).
    duration : float
        s.
    rate : float
        Hz.

    Returns
    -------
    Recording

    """
    time = _times(duration, rate)
    sine = amplitude * np.exp(-time / time_constant) * np.sin(2.0 * np.pi * frequency * time)
    return _recording('decay', rate, _fade(time, ramp) * (bias + sine))


def steps(levels=(0.0, 60.0, 20.0, 80.0, 10.0), hold=6.0, transition=0.2, rate=1000.0):
    """
    Return smooth steps with long holds: creep and drift.

    Parameters
    ----------
    levels : sequence of float
        V; the first is where it starts.
    hold : float
        From step to step (s).
    transition : float
        Duration of each step (s), half a cosine: short ones ring (limits, fast steps); 0 steps
        at once.
    rate : float
        Hz.

    Returns
    -------
    Recording

    """
    time = _times(hold * len(levels), rate)
    command = np.full(time.size, float(levels[0]))
    for i in range(1, len(levels)):
        # Half a row early, for neither times nor holds are exact.
        done = (np.clip((time - i * hold) / transition, 0.0, 1.0) if transition
                else time > i * hold - 0.5 / rate)
        command += (levels[i] - levels[i - 1]) * 0.5 * (1.0 - np.cos(np.pi * done))
    return _recording('steps', rate, command)


def multisine(bias=40.0, peak=6.0, band=(20.0, 5000.0), lines=60, period=0.1, periods=3,
              ramp=0.02, rate=50e3, seed=2):
    """
    Return a repeated multisine about a bias: frequency responses, noise apart from distortion.

    Parameters
    ----------
    bias, peak : float
        V; ``peak`` is the largest deviation from the bias.
    band : (float, float)
        Lowest and highest line (Hz).
    lines : int
        Lines of equal size, evenly spread over the logarithm of the band, at whole multiples of
        ``1 / period``; where they would coincide there is one.
    period : float
        s.
    periods : int
        How often the period is repeated; the first holds the fading in.
    ramp : float
        Time in which everything is faded in (s).
    rate : float
        Hz.
    seed : int
        Seed of the phases.

    Returns
    -------
    Recording

    """
    rows = _whole(rate * period, 'rate * period')
    wanted = np.geomspace(*band, lines)
    cycles = np.unique(np.rint(wanted * period))
    if cycles[0] < 1.0 or cycles[-1] >= rows / 2:
        raise InputError(f'multisine: band {band[0]:g} to {band[1]:g} Hz: expected lines between '
                         f'{1.0 / period:g} and {rate / 2.0:g} Hz')
    phases = np.random.Generator(np.random.PCG64(seed)).uniform(0.0, 2.0 * np.pi, cycles.size)
    turn = 2.0 * np.pi * np.arange(rows) / rows
    wave = np.cos(np.outer(turn, cycles) + phases).sum(axis=1)
    wave *= peak / np.abs(wave).max()
    time = _times(period * periods, rate)
    return _recording('multisine', rate, _fade(time, ramp) * (bias + np.tile(wave, periods)))


def force(bias=40.0, squeeze=120.0, frequency=10.0, cycles=4, ramp=0.02, rest=0.1, rate=10e3):
    """
    Return a squeezing force at a held voltage: the mechanical port, as in the paper's Fig. 13.

    Parameters
    ----------
    bias : float
        V.
    squeeze : float
        Largest force (N); it goes from zero to ``-squeeze`` and back.
    frequency : float
        Hz.
    cycles : int
        Cycles of the force.
    ramp : float
        Time in which the voltage rises (s).
    rest : float
        Time before the force begins (s).
    rate : float
        Hz.

    Returns
    -------
    Recording

    """
    time = _times(rest + cycles / frequency, rate)
    turn = 2.0 * np.pi * frequency * (time - rest)
    push = np.where(time >= rest, -0.5 * squeeze * (1.0 - np.cos(turn)), 0.0)
    return _recording('force', rate, _fade(time, ramp) * bias, push)


#: The five programmes of a full test, by name.
PROGRAMMES = {made.__name__: made for made in (triangle, decay, steps, multisine, force)}


def _times(duration, rate):
    return np.arange(_whole(duration * rate, 'duration * rate')) / rate


def _fade(time, ramp):
    return np.minimum(time / ramp, 1.0) if ramp > 0.0 else np.ones(time.size)


def _whole(number, what):
    whole = round(number)
    if whole < 2 or abs(number - whole) > 1e-6 * whole:
        raise InputError(f'{what} = {number:g}: expected a whole number of rows, at least 2')
    return whole


def _recording(name, rate, command, external_force=None):
    return Recording(name, np.arange(command.size) / rate, 'voltage', command, external_force)
