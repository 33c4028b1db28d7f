# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Where to start the fit of an effect: a few places that suit the recordings.

Derived from the parameters of an effect alone (unit, neutral value, scale, and
``tries`` where it names its own), so that a new effect needs nothing here.
"""

from __future__ import annotations

from dataclasses import dataclass
import itertools
import math

import numpy as np

from piezo_stack_sim.effects.base import Effect, Parameter
from piezo_stack_sim.gap.measured.evidence import Evidence
from piezo_stack_sim.gap.measured.forward import spans

MOST = 80  # places from which an effect is looked at
STRENGTHS = (0.05, 0.4, 1.5)  # of a typical strength, for an effect with one number
STRENGTH = 0.3  # for one with several
LADDER = tuple(200.0 * 1.06 ** i for i in range(66))  # Hz: a sharp resonance is seen from close by
PERIODS = (0.4, 1.0, 2.5)  # of the time between two rows, for a lag
PARTS = tuple(i / 12.0 for i in range(1, 13))  # and for what is nothing but one time


@dataclass(frozen=True)
class Extent:
    """How far the recordings reach, as scales for what to try (SI units)."""

    voltage: tuple[float, float]
    displacement: float
    current: float
    period: float
    duration: float
    frequencies: tuple[float, ...]
    lags: tuple[float, ...]


def extent_of(evidence: Evidence, residual: np.ndarray) -> Extent:
    """Measure how far recordings reach, where a residual peaks, how late the measured comes."""
    commands = [t.recording.command for t in evidence.tracks if t.recording.drive == 'voltage']
    voltage = ((min(float(c.min()) for c in commands), max(float(c.max()) for c in commands))
               if commands else (0.0, 1.0))
    displacement = max((float(np.ptp(t.measured['displacement'])) for t in evidence.tracks
                        if 'displacement' in t.measured), default=1e-5)
    current = 0.0
    simulated = _simulated(evidence, residual)
    for i, track in enumerate(evidence.tracks):
        if 'charge' in track.measured:
            # As simulated: the noise of a fast recording looks like a large current.
            rate = np.abs(np.diff(simulated[i, 'charge'])) / (track.recording.period
                                                              * track.factor)
            current = max(current, float(np.quantile(rate, 0.999)))
        elif track.recording.drive == 'voltage':
            rate = np.abs(np.diff(track.recording.command)) / track.recording.period
            current = max(current, 1.3e-6 * float(np.quantile(rate, 0.99)))
    return Extent(voltage, displacement, current or 0.1,
                  min(t.recording.period for t in evidence.tracks),
                  max(t.recording.duration for t in evidence.tracks),
                  _peaks(evidence, residual), _lags(evidence, simulated))


def _simulated(evidence, residual) -> dict[tuple[int, str], np.ndarray]:
    """Return what was simulated (m,), SI units, by (track, channel)."""
    return {(i, channel): evidence.tracks[i].measured[channel]
            - evidence.tracks[i].errors(channel, residual[where])
            for (i, channel), where in zip(evidence.keys, spans(evidence))}


def _lags(evidence, simulated) -> tuple[float, ...]:
    """Return by how much (s) the measured channels come late, as those tell that gain most."""
    found = []
    for (i, channel), expected in simulated.items():
        track = evidence.tracks[i]
        measured, expected = np.diff(track.measured[channel]), np.diff(expected)
        size = 2 * measured.size
        alike = np.fft.irfft(np.fft.rfft(measured, size) * np.conj(
            np.fft.rfft(expected, size)), size)[:measured.size // 2]
        late = int(np.argmax(alike))
        gain = (alike[late] - alike[0]) / track.sigma[channel] ** 2
        found.append((float(gain), late * track.recording.period * track.factor))
    found.sort(reverse=True)
    return tuple(dict.fromkeys(lag for gain, lag in found[:2] if gain > 0.0))


def _peaks(evidence, residual) -> tuple[float, ...]:
    """Return the frequencies (Hz) at which the residual of the displacement stands out most."""
    found = []
    for (i, channel), where in zip(evidence.keys, spans(evidence)):
        if channel != 'displacement':
            continue
        track = evidence.tracks[i]
        series = residual[where] - residual[where].mean()
        dt = track.recording.period * track.factor
        power = np.abs(np.fft.rfft(series * np.hanning(series.size))) ** 2
        frequency = np.fft.rfftfreq(series.size, dt)
        power[frequency < 4.0 / (dt * series.size)] = 0.0
        smooth = np.convolve(power, np.ones(31) / 31.0, 'same') + 1e-12
        best = np.argmax(power / smooth ** 0.5)
        found.append((float(power[best] / series.size), float(frequency[best])))
    found.sort(reverse=True)
    return tuple(dict.fromkeys(f for _, f in found[:3] if f > 0.0))


@dataclass(frozen=True)
class Place:
    """
    Where to look at an effect: what shapes it, and what to switch on by itself in turn.

    ``dense`` ones are only where to start: all together they could do anything.
    """

    shape: dict[str, float]
    strengths: dict[str, float]
    dense: bool = False

    @property
    def looks(self) -> list[dict[str, float]]:
        """Return the parameter values (SI) to simulate, one per strength."""
        if not self.strengths:
            return [self.shape]
        return [{**self.shape, name: value} for name, value in self.strengths.items()]

    def at(self, effect: Effect, factors: np.ndarray) -> dict[str, float]:
        """Return the values with the strengths multiplied by (k,) factors, within bounds."""
        allowed = self.within(effect, factors)
        return {**self.shape, **{name: float(factor) * value for factor, (name, value) in zip(
            allowed, self.strengths.items())}}

    def within(self, effect: Effect, factors: np.ndarray) -> np.ndarray:
        """Return the factors (k,) that bounds allow, of the strengths or of all of the place."""
        if not self.strengths:
            return factors
        bounds = {p.name: (p.lower, p.upper) for p in effect.parameters}
        return np.array([np.clip(factor * value, *bounds[name]) / value
                         for factor, (name, value) in zip(factors, self.strengths.items())])


def starts_of(effect: Effect, extent: Extent) -> list[Place]:
    """
    Return the places from which to look at an effect.

    What shapes an effect is tried in combination; what makes it strong is
    switched on weakly, for a linear look from there tells the rest.
    """
    strong = [p for p in effect.parameters if _is_linear(p) and _strength(p) and not p.late]
    shapes = [[(p.name, value) for value in _choices(p, extent)]
              for p in effect.parameters if not _is_linear(p) and not p.late]
    own = any(p.tries for p in effect.parameters)
    parts: tuple[float, ...] = STRENGTHS if len(strong) == 1 and (
        own or all(len(s) == 1 for s in shapes)) else (STRENGTH,)
    places = [Place(dict(shape), {p.name: part * _strength(p) for p in strong})
              for part in (parts if strong else (1.0,)) for shape in itertools.product(*shapes)]
    times = [p for p in strong if p.unit == 's']
    alone = [(p.name, lag) for p in times for lag in extent.lags]
    if times and len(strong) > 1:
        # A lag shorter than the time between two rows changes hardly any of them, so that no
        # line from none leads to it: each strength is tried by itself, at several sizes.
        alone += [(p.name, part * _strength(p)) for p in strong for part in STRENGTHS]
        alone += [(p.name, part * extent.period) for p in times for part in PERIODS]
    if effect.is_time:
        # Within the time between two rows the stack swings, and so does what a delay does.
        places += [Place(shape, {p.name: part * extent.period}, dense=True)
                   for shape in tried_shapes(effect) for p in times for part in PARTS]
    places += [Place(shape, {name: value}) for shape in tried_shapes(effect)
               for name, value in alone]
    if len(places) > MOST and not own:
        # Keep an even choice of the product.
        pick = np.unique(np.linspace(0, len(places) - 1, MOST).round().astype(int))
        places = [places[i] for i in pick]
    return places


def tried_shapes(effect: Effect) -> list[dict[str, float]]:
    """Return what may shape an effect, as it names it: combinations of its ``tries``."""
    named = [p for p in effect.parameters if p.tries and not p.magnitude and not p.late]
    return [dict(zip((p.name for p in named), values))
            for values in itertools.product(*(p.tries for p in named))]


def _is_linear(parameter: Parameter) -> bool:
    """Tell whether a parameter is a strength that can be scaled down to nothing."""
    return (parameter.magnitude and parameter.scale == 'linear'
            and math.isfinite(parameter.neutral) and not parameter.tries)


def _strength(parameter: Parameter) -> float:
    """Return a typical strength; 0 if there is none: such a part is not tried by itself."""
    return parameter.typical or (0.01 if parameter.unit == '1' else 0.0)


def _choices(parameter: Parameter, extent: Extent) -> list[float]:
    low, high = parameter.lower, parameter.upper

    def inside(values):
        kept = [v for v in values if low <= v <= high]
        return kept or [min(max(parameter.typical, low), high)]

    if parameter.tries:
        return inside(parameter.tries)
    unit = parameter.unit
    if unit == 'Hz':
        return inside([*extent.frequencies[:2], *LADDER])
    if math.isinf(parameter.neutral):
        if unit == 'V':
            edge = extent.voltage[1] if parameter.neutral > 0 else extent.voltage[0]
            span = extent.voltage[1] - extent.voltage[0]
            inward = -1.0 if parameter.neutral > 0 else 1.0
            # One end may be met and the other not.
            return [parameter.neutral, *inside([edge + inward * part * span
                                                for part in (0.03, 0.15)])
                    ] if parameter.magnitude else [parameter.neutral]
        if unit == 'm':
            return inside([part * extent.displacement for part in (0.95, 0.8, 0.5)])
        if unit == 'A':
            return inside([part * extent.current for part in (0.8, 0.3, 0.1)])
        return inside([parameter.typical * 10.0 ** k for k in (-1.5, -0.5, 0.5, 1.5, 2.5)])
    if unit == 's':
        return inside([part * extent.duration for part in (0.1, 0.5)])
    return inside([parameter.start])
