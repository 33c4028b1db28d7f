# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Test programmes: commands that make a stack show what it is.

Each function returns a `Recording` with commands and nothing measured, ready for the plant, for a
real device or for a peer in a benchmark. The defaults suit the AE0505D16 of the paper.

"""

import math

import numpy as np

from piezo_stack_sim.errors import InputError
from piezo_stack_sim.recording.recording import Recording

MOST_ROWS = 10**8  # nobody waits for more, and no memory holds them
# What the settings must be beside finite.
_POSITIVE = ('frequency', 'time_constant', 'duration', 'hold', 'period', 'rate', 'band')
_NOT_NEGATIVE = ('transition', 'ramp', 'rest', 'seed')
_COUNTS = ('cycles', 'periods', 'lines')


def check_settings(where, label=str, **settings):
    """
    Refuse settings with which no programme can be made.

    Parameters
    ----------
    where : str
        Put before the name of the setting.
    label : callable
        Turns the name of a setting into the one that its owner knows.
    settings : dict
        Numbers, or sequences of them.

    Raises
    ------
    InputError
        The first that is not finite, not positive, no list, ...

    """
    for name, values in settings.items():
        values = np.atleast_1d(np.asarray(values, dtype=float))
        if not values.size:
            raise InputError(f'{where}{label(name)}: expected at least one number')
        for value in values:
            if not math.isfinite(value):
                wanted = 'a finite number'
            elif name in _POSITIVE and value <= 0.0:
                wanted = 'a positive number'
            elif name in _NOT_NEGATIVE and value < 0.0:
                wanted = 'zero or more'
            elif name in _COUNTS and not 1.0 <= value <= MOST_ROWS:
                wanted = f'a whole number from 1 to {MOST_ROWS:g}'
            else:
                continue
            raise InputError(f'{where}{label(name)} {value:g}: expected {wanted}')


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
    check_settings('triangle: ', peaks=peaks, frequency=frequency, cycles=cycles, rate=rate)
    rows = _whole(rate / frequency, 'rate / frequency')
    _whole(float(rows) * cycles * len(peaks), 'rows of all cycles')
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
    check_settings('decay: ', bias=bias, amplitude=amplitude, frequency=frequency, ramp=ramp,
                   time_constant=time_constant, duration=duration, rate=rate)
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
    check_settings('steps: ', levels=levels, hold=hold, transition=transition, rate=rate)
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
    check_settings('multisine: ', bias=bias, peak=peak, band=band, lines=lines, period=period,
                   periods=periods, ramp=ramp, rate=rate, seed=seed)
    rows = _whole(rate * period, 'rate * period')
    if lines > rows:
        raise InputError(f'multisine: lines {lines}: expected at most one for each of the {rows} '
                         'rows of a period')
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
    check_settings('force: ', bias=bias, squeeze=squeeze, frequency=frequency, cycles=cycles,
                   ramp=ramp, rest=rest, rate=rate)
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
    if not number <= MOST_ROWS:
        raise InputError(f'{what} = {number:g}: expected at most {MOST_ROWS:g} rows')
    whole = round(number)
    if whole < 2 or abs(number - whole) > 1e-6 * whole:
        raise InputError(f'{what} = {number:g}: expected a whole number of rows, at least 2')
    return whole


def _recording(name, rate, command, external_force=None):
    return Recording(name, np.arange(command.size) / rate, 'voltage', command, external_force)
