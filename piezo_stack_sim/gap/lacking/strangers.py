# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What the library lacks but would be known if it were seen: strangers.

An effect of the library may explain most of what another makes of the outputs: a remanence what
an offset that warms up does, a lag what a clock that runs fast does.  Whoever knows no effects but
those of the library takes it for the cause.  Where a stranger leaves clearly less than the best of
these, it is none of them (gap/lacking/meeting.py).

None of them is a model: each has one or two numbers, and names a block, not a cause.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
import itertools
from typing import Any

import numpy as np
from piezo_stack_sim.gap.cores import parallel
from piezo_stack_sim.gap.fitting.blackbox import lagged
from piezo_stack_sim.gap.lacking.back_coupling import Suspect
from piezo_stack_sim.gap.lacking.course import CLOCK, HEATED, play
from piezo_stack_sim.gap.measured.apart import moved_by_charge
from piezo_stack_sim.gap.measured.evidence import Evidence, Track
from piezo_stack_sim.gap.measured.forward import residuals_of, simulate_channels, simulate_set
from piezo_stack_sim.gap.quantities import quantity, significant
from piezo_stack_sim.plant import Device
from scipy.interpolate import BSpline
from scipy.optimize import minimize_scalar

SKEWS = np.geomspace(3e-6, 5e-3, 40)  # parts by which a clock may run fast or slow
PLAYS = np.geomspace(1e-9, 4e-7, 24)  # m, half width of a play
DROOPS = np.geomspace(0.5, 3e3, 30)  # s
# s in which the stack cools, and whether it heats by friction or by resistance
HEAT = tuple(itertools.product(np.geomspace(0.03, 1.0, 6).tolist(), (1.0, 2.0)))
GROWN = 0.01  # of the ratio, by which to see what another one does
WARM = np.geomspace(0.5, 20.0, 8)  # s
OFFSET = 0.05  # V by which the command is moved to see what an offset does
ON, OFF = np.linspace(0.3, 0.95, 14), np.linspace(0.02, 0.6, 13)  # of the highest voltage
BETWEEN = np.linspace(-0.04, 0.04, 5)  # of what was best of these, then
LEAKED = 1e-9  # m/V, that leaks into the reading to see what it does
RELAYED = 1e-7  # C, that a relay lets in to see what it does
MISREAD = 0.01  # part by which a reading is another to see what that does
READ_LATE = np.geomspace(3e-5, 3e-2, 16)  # s
AVERAGED = (('displacement',), ('voltage', 'charge', 'displacement'))
FINE, PARTS = 8e-6, (8, 64)  # s, and into how many parts a row is cut of which the mean is taken
MOST = 400e3  # of them in a recording
LIKE_IT = 0.1  # squared correlation of what is wrong with what a mean of two samples would do
TELLS = 100.0  # by which the squares of a recording are less that tells how late it is
DIFFER = 0.5  # part of the largest delay by which those of recordings differ that started anyhow
WHOLLY = 0.1  # part of their gap that being late may leave of these: hysteresis leaves a third
LATEST = 0.02  # s that a recording may start late or early
SPANS, TURNS = 4, 3  # of the cubic splines by which a clock wanders, and how often they are fitted
WANDERS = 5e-4  # parts by which a clock may run fast or slow that wanders
STEADY = 0.3  # part that it may leave of what a lag leaves that is always the same
STEPS = np.unique(np.round(np.concatenate([
    np.arange(-20.0, 21.0), -np.geomspace(20.0, 400.0, 30), np.geomspace(20.0, 400.0, 30)])))

Outputs = Sequence[dict]  # channel to (n,) array, for each track


@dataclass(frozen=True)
class Stranger:
    """
    Something that the library lacks.

    ``needs`` are the channels with which it can be told, one set or another, ``sizes`` yields what
    may be chosen, ``put`` puts one on the outputs of a device.  ``any_scale`` tells that every
    multiple of what it makes of the outputs counts, ``near`` yields what lies about a size,
    ``smooth`` that a size is a number between the neighbours of which the best can be looked for,
    ``says`` says in words how much a size, taken so many times, is, ``misread`` names the channel
    that is right and only read wrong.
    """

    suspect: Suspect
    needs: Sequence[set[str]]
    sizes: Callable[[Outputs], Iterable]
    put: Callable[[Device, Evidence, Outputs, Any], Outputs]
    any_scale: bool = False
    near: Callable[[Any], Iterable] = field(default=lambda size: (size,))
    smooth: bool = False
    says: Callable[[Any, float], str] = field(default=lambda size, scale: '')
    misread: str = ''


def _since(track: Track) -> np.ndarray:
    return track.recording.time - track.recording.time[0]


def _either(sizes: np.ndarray) -> np.ndarray:
    return np.concatenate([-sizes[::-1], sizes])


def _skewed(device, evidence, outputs, skew):
    def one(track, answer):
        time = _since(track)
        return {**answer, 'displacement': np.interp(
            time * (1.0 - skew), time, answer['displacement'])}

    return list(map(one, evidence.tracks, outputs))


def _wandering(device, evidence, outputs, parts):
    # A clock starts with the recording; late all the time by the same is a delay, or a lag.
    def late(track, moved, basis):
        time, sizes = _since(track), np.zeros(basis.shape[1])
        prior = np.eye(sizes.size) * (parts * time[-1]) ** -2.0
        for _ in range(TURNS):
            now = np.interp(time - basis @ sizes, time, moved)
            speed = np.gradient(now, track.recording.period)
            wrong = track.weighted('displacement', now)
            # A reading that is late by more is what it was, less by the way done in the meantime.
            slope = np.column_stack([track.weighted('displacement', now - speed * each) - wrong
                                     for each in basis.T])[track.fitted]
            sizes = np.linalg.solve(slope.T @ slope + prior, slope.T @ (
                slope @ sizes - wrong[track.fitted]))
        now = np.interp(time - basis @ sizes, time, moved)
        wrong = track.weighted('displacement', now)
        return now, float(wrong @ wrong) - wrong.size

    def one(track, answer):
        if 'displacement' not in track.measured:
            return answer, 0.0, 0.0
        time, moved = _since(track), answer['displacement']
        knots = np.concatenate([np.zeros(3), np.linspace(0.0, time[-1], SPANS + 1),
                                np.full(3, time[-1])])
        now, left = late(track, moved, BSpline.design_matrix(time, knots, 3).toarray()[:, 1:])
        return ({**answer, 'displacement': now}, left,
                late(track, moved, np.ones((time.size, 1)))[1])

    found = parallel(lambda pair: one(*pair), zip(evidence.tracks, outputs))
    left, steadily = np.sum([each[1:] for each in found], axis=0)
    return [each[0] for each in found] if left < STEADY * steadily else outputs


def _each_late(device, evidence, outputs, most):
    # Each recording by what fits it best: nothing of the device differs between them.
    def one(track, answer):
        if 'displacement' not in track.measured:
            return 0.0, 0.0, 0.0
        time = _since(track)

        def left(late):
            wrong = track.weighted('displacement', np.interp(
                time - late, time, answer['displacement']))
            return float(wrong @ wrong)

        grid = track.recording.period * STEPS
        grid = grid[np.abs(grid) <= most]
        best = grid[int(np.argmin([left(late) for late in grid]))]
        late = float(minimize_scalar(left, bounds=(
            best - track.recording.period, best + track.recording.period), method='bounded').x)
        noise = track.measured['displacement'].size
        return late, left(0.0) - noise, left(late) - noise

    found = parallel(lambda pair: one(*pair), zip(evidence.tracks, outputs))
    told, before, after = np.array([one for one in found if one[1] - one[2] > TELLS] or [
        (0.0, 0.0, 0.0)]).T
    if (len(told) < 2 or np.ptp(told) < DIFFER * np.abs(told).max()
            or after.sum() > WHOLLY * before.sum()):
        return outputs  # a delay, of the form of which another does not make as many
    return [{**answer, 'displacement': np.interp(
        _since(track) - late, _since(track), answer['displacement'])}
            for track, answer, (late, *_) in zip(evidence.tracks, outputs, found)]


def _row_means(device, evidence, outputs, averaged):
    # Cheaply at first, by straight lines between the samples: it must look at all like that.
    base = residuals_of(evidence, outputs)
    change = residuals_of(evidence, [
        {channel: np.append(values[0], 0.5 * (values[1:] + values[:-1]))
         if channel in averaged else values for channel, values in answer.items()}
        for answer in outputs]) - base
    if float(base @ change) ** 2 < LIKE_IT * float(base @ base) * float(change @ change):
        return outputs

    def one(track, answer):
        recording = track.recording
        count = int(np.clip(min(recording.period / FINE, MOST / len(recording)), *PARTS))
        time = np.arange(count * len(recording)) * (recording.period / count)
        parts = replace(recording, time=time, rows=None, measured={},
                        command=np.repeat(recording.command, count),
                        external_force=np.repeat(recording.external_force, count))
        whole = simulate_channels(device, parts)
        # Of the row that ends with the sample, by the trapezoidal rule.
        means = {channel: np.append(values[0], np.add.reduceat(
            0.5 * (values[1:] + values[:-1]), np.arange(0, values.size - 1, count))[:-1] / count)
            for channel, values in whole.items()}
        return {channel: means[channel] if channel in averaged else values
                for channel, values in answer.items()}

    return parallel(lambda pair: one(*pair), zip(evidence.tracks, outputs))


def _with_play(device, evidence, outputs, half):
    return [{**answer, 'displacement': play(answer['displacement'], half)} for answer in outputs]


def _leaking(device, evidence, outputs, size):
    return [{**answer, 'displacement': answer['displacement'] + LEAKED * answer['voltage']}
            for answer in outputs]


def _drooping(device, evidence, outputs, constant):
    def one(track, answer):
        charge = answer['charge'] - answer['charge'][0]
        return {**answer, 'charge': charge - lagged(charge, constant / track.recording.period)}

    return list(map(one, evidence.tracks, outputs))


def _warming(device, evidence, outputs, constant):
    return simulate_set(device, [replace(track.recording, command=track.recording.command
                                         + OFFSET * -np.expm1(-_since(track) / constant))
                                 for track in evidence.tracks])


def _relays(outputs):
    top = max(float(answer['voltage'].max()) for answer in outputs)
    return ((on * top, off * top) for on in ON for off in OFF if off < on)


def _relays_near(limits):
    on, off = limits
    return ((on * (1.0 + more), off + on * less) for more in BETWEEN for less in BETWEEN)


def _relayed(device, evidence, outputs, limits):
    def one(track, answer):
        charge = RELAYED * _relay(answer['voltage'], *limits)
        return {**answer, 'charge': answer['charge'] + charge,
                'displacement': answer['displacement'] + moved_by_charge(
                    device, charge, track.recording.period)}

    return list(map(one, evidence.tracks, outputs))


def _relay(voltage: np.ndarray, on: float, off: float) -> np.ndarray:
    """Return 1 where a relay is on and 0 where it is not, (n,): off until it is first on."""
    switched = np.where(voltage >= on, 1, np.where(voltage <= off, -1, 0))
    last = np.maximum.accumulate(np.where(switched != 0, np.arange(voltage.size), -1))
    return np.where(last >= 0, switched[last] > 0, False).astype(float)


def _heated(device, evidence, outputs, cause):
    constant, power = cause
    actuator = device.actuator
    warmer = simulate_set(
        device.replace(actuator=actuator.replace(
            transformer_ratio=(1.0 + GROWN) * actuator.transformer_ratio)),
        [track.recording for track in evidence.tracks])

    def warmth(track, answer):
        period = track.recording.period
        return lagged(np.abs(np.gradient(answer['charge'], period)) ** power, constant / period)

    warm = list(map(warmth, evidence.tracks, outputs))
    most = max(float(each.max()) for each in warm) or 1.0
    return [{channel: values + each / most * (other[channel] - values)
             for channel, values in answer.items()}
            for each, answer, other in zip(warm, outputs, warmer)]


def _misread(channel, needs, gain, lag):
    """Yield what makes a reading wrong of a channel that is right."""
    def reading(evidence, outputs, read):
        return [{**answer, channel: read(track, answer[channel])}
                for track, answer in zip(evidence.tracks, outputs)]

    def by_a_factor(device, evidence, outputs, size):
        return reading(evidence, outputs, lambda track, values: (1.0 + MISREAD) * values)

    def behind_a_lag(device, evidence, outputs, constant):
        return reading(evidence, outputs, lambda track, values: lagged(
            values, constant / track.recording.period))

    def late(device, evidence, outputs, seconds):
        return reading(evidence, outputs, lambda track, values: np.interp(
            _since(track) - seconds, _since(track), values))

    def part(size, scale):
        much = significant(abs(100.0 * MISREAD * scale), 2)
        return f'; it reads about {much} % too {"much" if scale > 0.0 else "little"}'

    def time(size, scale):
        return f' of about {quantity(size, "s", 2)}'

    def shift(size, scale):
        return f' {"late" if size > 0.0 else "early"} by about {quantity(abs(size), "s", 2)}'

    yield Stranger(Suspect('sensor', f'the {channel} is wrong by a factor, {gain}'), needs,
                   lambda outputs: (1.0,), by_a_factor, True, says=part, misread=channel)
    yield Stranger(Suspect('sensor', f'the {channel} is late, {lag}'), needs,
                   lambda outputs: READ_LATE, behind_a_lag, smooth=True, says=time,
                   misread=channel)
    yield Stranger(Suspect('sensor', f'the {channel} is not sampled when all else is: it comes'),
                   needs, lambda outputs: _either(READ_LATE), late, smooth=True, says=shift,
                   misread=channel)


_MOVED = {'displacement'}
_BOTH = {'charge', 'displacement'}
_DRIVEN = {'voltage', 'displacement'}
_TERMINALS = {'voltage', 'charge'}

PLAY = Stranger(Suspect('mechanical', 'the displacement is wrong as if something had play, which '
                        'the stack does not feel'), [_BOTH], lambda outputs: PLAYS, _with_play)
STRANGERS = (
    Stranger(CLOCK, [_MOVED], lambda outputs: _either(SKEWS), _skewed),
    PLAY,
    Stranger(Suspect('sensor', 'the displacement is wrong as if the terminal voltage leaked into '
                     'its reading'), [_MOVED], lambda outputs: (1.0,), _leaking, True),
    Stranger(Suspect('sensor', 'the charge is wrong as if its amplifier forgot it in time'),
             [{'charge'}], lambda outputs: DROOPS, _drooping),
    *_misread('charge', [_BOTH], 'of which the displacement knows nothing: its amplifier has '
              'another gain, or the stack a capacitance far from that of the file',
              'of which the displacement knows nothing: its amplifier has a lag'),
    *_misread('voltage', [_TERMINALS, _DRIVEN], 'of which nothing that it drives knows: its '
              'divider has another ratio',
              'of which nothing that it drives knows: its probe has a lag'),
    # A drift of the place is another explanation where nothing else is known.
    Stranger(Suspect('drive', 'all is wrong as if an offset of the driver warmed up'),
             [_BOTH, _DRIVEN], lambda outputs: WARM, _warming, True),
    Stranger(Suspect('electrical', 'charge and displacement are wrong as if the polarisation '
                     'jumped at one voltage, and back at another'), [_MOVED], _relays, _relayed,
             True, _relays_near),
    Stranger(Suspect('sensor', 'each reading is wrong as if it were the mean over its row, not a '
                     'sample: let the recorder take samples, or read more often'), [_MOVED],
             lambda outputs: AVERAGED, _row_means),
    Stranger(Suspect('sensor', 'the displacement is late by another time in every recording: '
                     'its clock is not that of the command'),
             [_MOVED], lambda outputs: (LATEST,), _each_late),
    Stranger(Suspect('sensor', 'the displacement comes late by a time that wanders: it was read '
                     'by a clock of its own'), [_MOVED], lambda outputs: (WANDERS,), _wandering),
    Stranger(HEATED, [_BOTH, _DRIVEN], lambda outputs: HEAT, _heated, True),
)
