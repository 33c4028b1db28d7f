# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A hypothesis fitted by simulation error: effects on top of the re-tuned nominal device.

What is free of an effect is walked in a scale of its own; the nominal
parameters move along with it, within their uncertainty.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from copy import copy
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
import math
from typing import NamedTuple

import numpy as np
from piezo_stack_sim.effects.base import Parameter
from piezo_stack_sim.effects.registry import EFFECTS
from piezo_stack_sim.errors import InputError
from piezo_stack_sim.gap.fitting.descent import descend, Landscape, NUDGE, Slope, sum_of_squares
from piezo_stack_sim.gap.fitting.lens import Lens, plain
from piezo_stack_sim.gap.fitting.nominal import Nuisance
from piezo_stack_sim.gap.fitting.tone import find_frequency, in_step, Line, Tone
from piezo_stack_sim.gap.measured.arbitrary import is_arbitrary
from piezo_stack_sim.gap.measured.evidence import Evidence
from piezo_stack_sim.gap.measured.forward import fitted_rows, residuals, simulate_channels, spans
from piezo_stack_sim.plant import Device

STEPS = 6
TONE = next(name for name, effect in EFFECTS.items() if effect.each_time)
STUCK = 1e-3  # part of its range from its bound at which a number of an effect counts as stuck
REMEMBERED = 64e6  # bytes of residuals that are kept: fits set out from where others ended
FEW = 4  # residuals in which a line was looked for that are remembered: each is asked again
FINE = 0.05  # unit of the walk of what mends a form
AT_BOUND = 0.97  # part of its bound from which a nominal parameter counts as stuck there
ALIKE = 1e-10  # part of its square by which a derivative is kept from being just like another


@dataclass(frozen=True)
class Free:
    """One parameter of an effect that is being fitted, walked in a scale of its own."""

    effect: str
    parameter: Parameter
    unit_step: float

    def to_value(self, walk: float) -> float:
        """Return the value (SI) at a place of the walk."""
        if self.parameter.scale == 'log':
            return math.exp(walk)
        return walk * self.unit_step

    def to_walk(self, value: float) -> float:
        """Return the place of the walk for a value (SI)."""
        if self.parameter.scale == 'log':
            return math.log(value)
        return value / self.unit_step

    @property
    def limits(self) -> tuple[float, float]:
        """Return the bounds of the walk."""
        return self.to_walk(self.parameter.lower), self.to_walk(self.parameter.upper)

    def stuck(self, value: float) -> str | None:
        """
        Return the bound, 'lower' or 'upper', at which a value (SI) came to rest, if any.

        What may be absent and is, like one of several losses or the joint of a payload that is
        held firmly, is not stuck, nor is an element that is about to slip.
        """
        if self.parameter.late:
            return None
        low, high = self.limits
        absent = self.parameter.neutral == self.parameter.lower
        if not absent and (value <= self.parameter.lower
                           or self.to_walk(value) - low < STUCK * (high - low)):
            return 'lower'
        absent = self.parameter.neutral > self.parameter.upper
        close = high - self.to_walk(value) < STUCK * (high - low)
        return 'upper' if close and not absent else None


def free_parameters(effect: str, start: dict[str, float]) -> list[Free]:
    """
    Return what can be fitted of an effect: parameters with a finite place to start from.

    What mends its form is free once it is off its neutral value (:func:`woken`).  Of swings that
    were made before this says all, and they stay.
    """
    free = []
    late = {p.name for p in EFFECTS[effect].parameters
            if p.late and start.get(p.name, p.start) != p.neutral}
    for parameter in EFFECTS[effect].parameters:
        if parameter.late != (parameter.name in late) or (
                late and EFFECTS[effect].swings and not parameter.late):
            continue
        value = start.get(parameter.name, parameter.start)
        if not math.isfinite(value) or parameter.lower == parameter.upper:
            continue
        if parameter.scale == 'log' and value <= 0.0:
            continue
        step = abs(parameter.typical) if math.isfinite(parameter.typical) else 1.0
        # Where elements slip earlier or later no derivative leads far: short steps.
        free.append(Free(effect, parameter, step or (FINE if parameter.late else 1.0)))
    return free


def _told(name: str, effects: Collection[str]) -> dict[str, str]:
    """Return what another of some effects tells in the place of one, with that other."""
    return {parameter: other for other, parameters in EFFECTS[name].told_by.items()
            if other in effects for parameter in parameters}


def _told_once(effects: dict[str, dict[str, float]]) -> dict[str, dict[str, float]]:
    """
    Return effects of which none tells what another does.

    Both numbers together are walked by one: on its own, each would be led by the other.
    """
    effects = {name: dict(values) for name, values in effects.items()}
    for name, values in effects.items():
        for key, other in _told(name, effects).items():
            ours, theirs = (next(p for p in EFFECTS[each].parameters if p.name == key)
                            for each in (name, other))
            # The larger counts where both are, as in the plant.
            most = max(values.get(key, ours.start), effects[other].get(key, theirs.start))
            effects[other][key] = min(max(most, theirs.lower), theirs.upper)
            values[key] = ours.neutral
    return effects


class View(NamedTuple):
    """
    What a linear look at a fit needs.

    ``slope`` (M, n) and ``nominal`` (M, p) are its free directions as a lens shows them,
    ``inverse`` (n + p, n + p) of their square with the prior, ``left`` (M,) what they leave
    of the residual.
    """

    slope: np.ndarray
    nominal: np.ndarray
    inverse: np.ndarray
    left: np.ndarray

    def cleared(self, seen: np.ndarray) -> np.ndarray:
        """Return (M,) or (M, k) changes without what the free directions can imitate."""
        n = self.slope.shape[1]
        best = self.inverse @ np.concatenate([self.slope.T @ seen, self.nominal.T @ seen])
        return seen - self.slope @ best[:n] - self.nominal @ best[n:]


@dataclass
class Fit:
    """
    A fitted hypothesis.

    ``effects`` and ``phi`` are the best numbers, ``residual`` (N,) the weighted
    residual of all rows there, ``cost`` the sum of squares over the fitted rows
    plus the prior.  ``slope`` (N, n) is the derivative of the residual with respect
    to what is ``free``, ``nominal`` (N, p) that with respect to ``phi``: many fits
    share one.
    """

    effects: dict[str, dict[str, float]]
    phi: np.ndarray
    residual: np.ndarray
    cost: float
    free: list[Free] = field(default_factory=list)
    walk: np.ndarray = field(default_factory=lambda: np.empty(0))
    slope: np.ndarray | None = None
    nominal: np.ndarray | None = None
    simulations: int = 0
    view: View | None = None
    line: Line | None = None

    @property
    def stuck(self) -> list[Free]:
        """Return what came to rest at its bound."""
        return [free for free in self.free
                if free.stuck(self.effects[free.effect][free.parameter.name])]

    def derivative(self, free: Free) -> np.ndarray | None:
        """Return the derivative of the residual with respect to a number, (N,), if known."""
        if self.slope is None or free not in self.free:
            return None
        column = self.slope[:, self.free.index(free)]
        return column if np.isfinite(column).all() else None


class Fitter:
    """Fits hypotheses about one set of recordings to one nominal device."""

    def __init__(self, device: Device, evidence: Evidence) -> None:
        self.device = device
        self.evidence = evidence
        self.nuisance = Nuisance(device, is_arbitrary([t.recording for t in evidence.tracks]))
        self.rows = np.flatnonzero(fitted_rows(evidence))
        self.lens = plain(self.rows)
        self.base = residuals(device, evidence)
        self._simulated = lru_cache(max(int(REMEMBERED / self.base.nbytes), 1))(
            partial(_simulate, device, self.nuisance, evidence))
        # Of its parts and not of itself: in a circle with its cache it would outlive its use.
        simulated, rows = self._simulated, self.rows
        self._frequency = lru_cache(FEW)(lambda effects, phi: find_frequency(
            evidence, simulated(effects, phi), rows))

    def device_with(self, effects: dict, phi: np.ndarray) -> Device:
        """Return the nominal device, re-tuned and with effects on."""
        return _tuned(self.device, self.nuisance, effects, phi)

    def devices_of(self, fit: Fit) -> list[Device]:
        """Return the fitted device for each recording: what is new each time differs."""
        devices = []
        for i in range(len(self.evidence.tracks)):
            effects = {name: dict(values) for name, values in fit.effects.items()}
            if fit.line is not None:
                effects[TONE].update(fit.line.values(i))
            devices.append(self.device_with(effects, fit.phi))
        return devices

    def in_step(self, fit: Fit, parallel: Callable) -> Fit:
        """Return a fit with its line as single rows tell it, not averaged ones; itself if none."""
        if fit.line is None:
            return fit

        def simulated(given):
            return parallel(lambda pair: simulate_channels(*pair), zip(
                self.devices_of(given), [track.recording for track in self.evidence.tracks]))

        others = {name: values for name, values in fit.effects.items() if name != TONE}
        line = in_step(fit.line, self.evidence,
                       simulated(replace(fit, effects=others, line=None)))
        fit = replace(fit, effects={**others, TONE: {**fit.effects[TONE], **line.values()}},
                      line=line)
        shown = simulated(fit)
        return replace(fit, view=None, residual=np.concatenate([
            self.evidence.tracks[i].weighted(channel, shown[i][channel])
            for i, channel in self.evidence.keys]))

    def prepare(self, parallel) -> None:
        """Take the derivative with respect to the nominal parameters, over all cores."""
        zero = np.zeros(len(self.nuisance.names))

        def column(i):
            phi = zero.copy()
            phi[i] = NUDGE
            return (residuals(self.device_with({}, phi), self.evidence) - self.base) / NUDGE

        self.nominal = Slope.of(np.column_stack(parallel(column, range(zero.size))), self.lens)

    def reweighed(self, evidence: Evidence, turn: Callable[[np.ndarray], np.ndarray]) -> Fitter:
        """Return the same for other noise; ``turn`` is what turns weighted residuals into it."""
        other = Fitter(self.device, evidence)
        other.nominal = Slope.of(turn(self.nominal.whole), other.lens)
        return other

    def through(self, lens: Lens) -> Fitter:
        """Return the same that looks at residuals through another lens."""
        other = copy(self)
        other.lens = lens
        other.nominal = Slope.of(self.nominal.whole, lens)
        return other

    def residual_of(self, effects: dict, phi: np.ndarray, line: Fit | None = None) -> np.ndarray:
        """
        Return the weighted residual (N,) of the re-tuned device with effects on.

        A line is matched to a residual and not simulated: if one is among the effects, ``line``
        is the fit in which it was, and it is taken off as it was there.
        """
        values = {name: EFFECTS[name].values(given) for name, given in effects.items()}
        residual = self._residual(values, [], np.empty(0), phi)
        if TONE not in effects or line is None or line.line is None:
            return residual
        without = {name: given for name, given in line.effects.items() if name != TONE}
        return residual - (self.residual_of(without, line.phi) - line.residual)

    def find_tone(self, effects: dict, phi: np.ndarray) -> tuple[Line, np.ndarray] | None:
        """Return the line in what other effects leave, and the residual (N,) without it."""
        others = {name: EFFECTS[name].values(given) for name, given in effects.items()
                  if name != TONE}
        frequency = self._frequency(_frozen(others), tuple(phi))
        return None if frequency is None else Tone(self.evidence, frequency).match(
            self._residual(others, [], np.empty(0), phi))

    def linear_gain(self, directions: np.ndarray, fit: Fit,
                    within: Callable[[np.ndarray], np.ndarray] = lambda factors: factors
                    ) -> tuple[float, np.ndarray]:
        """
        Return by how much the cost would fall along directions of the residual, and how far.

        Everything that ``fit`` was free to choose may move with them.

        Parameters
        ----------
        directions : ndarray, shape (N, k)
            Changes of the residual.
        fit : Fit
            Where to start.
        within : callable, optional
            Turns multiples of the directions (k,) into those that bounds allow: what only
            the other way would gain, gains nothing.

        Returns
        -------
        gain : float
            Fall of the sum of squares.
        factors : ndarray, shape (k,)
            Multiples of the directions that bring it.

        """
        clear = self.cleared(directions, fit)
        square = clear.T @ clear
        length = np.diag(square)
        if not np.any(length > 1e-9):
            return 0.0, np.zeros(length.size)
        scale = 1.0 / np.sqrt(np.maximum(length, 1e-9))
        alike = square * np.outer(scale, scale) + 1e-6 * np.eye(length.size)
        along = scale * (clear.T @ self.view(fit).left)
        best = np.linalg.solve(alike, along)
        factors = within(-scale * best)
        if not np.allclose(factors, -scale * best):
            ends = np.full(best.size, np.inf)
            factors = -scale * _bounded(alike, along, -within(ends) / scale,
                                        -within(-ends) / scale)
        missed = best + factors / scale
        return float(along @ best - missed @ alike @ missed), factors

    def retuned(self, residual: np.ndarray, phi: np.ndarray) -> tuple[float, np.ndarray]:
        """
        Return what a linear look promises of re-tuning the nominal parameters.

        Parameters
        ----------
        residual : ndarray, shape (N,)
            Weighted residual of a device.
        phi : ndarray, shape (p,)
            Its nominal deviations.

        Returns
        -------
        cost : float
            Sum of squares over the fitted rows plus that of the prior.
        phi : ndarray, shape (p,)
            The deviations that bring it, within bounds.

        """
        now = self.lens(residual) - self.nominal.seen @ phi
        precision = np.diag(self.nuisance.prior ** -2.0)
        new = -np.linalg.solve(self.nominal.square + precision, self.nominal.seen.T @ now)
        new = np.clip(new, -self.nuisance.bound, self.nuisance.bound)
        return sum_of_squares(now + self.nominal.seen @ new, new / self.nuisance.prior), new

    def cost_beside(self, residual: np.ndarray, fit: Fit) -> float:
        """Return the cost of a residual (N,) if what a fit is free to choose follows linearly."""
        return sum_of_squares(self.view(fit).cleared(self.lens(residual)))

    def cleared(self, directions: np.ndarray, fit: Fit) -> np.ndarray:
        """
        Return directions of the residual without what a fit was free to imitate.

        Parameters
        ----------
        directions : ndarray, shape (N, k)
            Changes of the residual.
        fit : Fit
            Whose parameters are free.

        Returns
        -------
        ndarray, shape (M, k)
            As the lens shows them.

        """
        return self.view(fit).cleared(self.lens(directions).astype(float))

    def view(self, fit: Fit) -> View:
        """Return what a linear look at a fit needs: free directions and what they leave."""
        if fit.view is None:
            seen = (self.nominal.seen if fit.nominal is None or fit.nominal is self.nominal.whole
                    else self.lens(fit.nominal))
            slope = np.empty((len(seen), 0)) if fit.slope is None else self.lens(fit.slope)
            # What has come to its bound can take no more of a gap.
            free = np.abs(fit.phi) <= AT_BOUND * self.nuisance.bound
            seen = seen if free.all() else seen * free
            cross = slope.T @ seen
            square = np.block([[slope.T @ slope, cross], [cross.T, seen.T @ seen]])
            precision = np.concatenate([np.full(len(cross), 1e-6), self.nuisance.prior ** -2.0])
            view = View(slope, seen, _inverse(square + np.diag(precision)), np.empty(0))
            fit.view = view._replace(left=view.cleared(self.lens(fit.residual)))
        return fit.view

    def spent(self, fit: Fit) -> float:
        """
        Return the nats that it costs a hypothesis to be free to choose its numbers.

        By how much the rows narrow them down, together, within their bounds: Occam's factor by
        Laplace's method (MacKay 2003, section 28.1).  What the rows do not tell, or the
        nominal parameters do as well, costs nothing.
        """
        if fit.slope is None or not fit.free or not np.isfinite(fit.slope).all():
            return 0.0
        n = len(fit.free)
        widths = np.array([high - low for low, high in (free.limits for free in fit.free)])
        told = np.linalg.inv(self.view(replace(fit, view=None)).inverse[:n, :n])
        within = np.eye(n) + told * np.outer(widths, widths)
        return 0.5 * float(np.linalg.slogdet(within)[1])

    def cost(self, residual: np.ndarray, phi: np.ndarray) -> float:
        """Return the sum of squares over the fitted rows plus that of the prior."""
        return sum_of_squares(self.lens(residual), phi / self.nuisance.prior)

    def fit(self, effects: dict[str, dict[str, float]], phi: np.ndarray | None = None,
            steps: int = STEPS, anew: bool = False, held: bool = False,
            beside: Fit | None = None, kept: Collection[str] = (), nudge: float = NUDGE) -> Fit:
        """
        Fit effects, starting from the values given, and the nominal parameters.

        Parameters
        ----------
        effects : dict
            Effect id to parameter values (SI) to start from.
        phi : ndarray, optional
            Deviations of the nominal parameters to start from.
        steps : int
            The most Gauss-Newton steps.
        anew : bool
            Whether to take the derivative with respect to the nominal parameters
            again where the fit starts, with the effects on.
        held : bool
            Whether the nominal parameters stay where they are.
        beside : Fit, optional
            A fit of some of the effects, whose derivatives are borrowed at first.
        kept : collection of str
            Effects whose numbers stay as given.
        nudge : float
            Relative change of the nominal parameters from which their derivative is
            taken, if anew.

        Returns
        -------
        Fit

        """
        phi = np.zeros(len(self.nuisance.names)) if phi is None else phi.copy()
        tone = None
        if TONE in effects:
            tone = Tone(self.evidence, effects[TONE].get('frequency', 0.0))
        effects = _told_once(effects)
        free = [f for name, values in effects.items() if name != TONE and name not in kept
                for f in free_parameters(name, values)
                if f.parameter.name not in _told(name, effects)]
        effects = {name: EFFECTS[name].values(values) for name, values in effects.items()}
        lower = np.array([f.limits[0] for f in free])
        upper = np.array([f.limits[1] for f in free])
        walk = np.array([f.to_walk(effects[f.effect][f.parameter.name]) for f in free])
        room = np.zeros(phi.size) if held else self.nuisance.bound
        landscape = Landscape(
            lambda walk, phi: self._residual(effects, free, walk, phi, tone), self.lens,
            lower, upper, room, self.nuisance.prior, nudge)
        known = [] if beside is None else [beside.derivative(f) for f in free]
        end = descend(landscape, np.clip(walk, lower, upper), phi,
                      None if anew else self.nominal, steps, known)
        values, line = self._values(effects, free, end.walk), None
        if tone is not None:
            line, _ = tone.match(self._residual(effects, free, end.walk, end.phi))
            values[TONE].update(line.values())
        return Fit(values, end.phi, end.residual, end.cost, free, end.walk, end.effect,
                   end.nominal, end.simulations, line=line)

    def _values(self, effects, free, walk) -> dict[str, dict[str, float]]:
        values = {name: dict(given) for name, given in effects.items()}
        for f, place in zip(free, walk):
            value = f.to_value(float(place))
            values[f.effect][f.parameter.name] = min(max(value, f.parameter.lower),
                                                     f.parameter.upper)
        return values

    def _residual(self, effects, free, walk, phi, tone: Tone | None = None) -> np.ndarray:
        values = self._values(effects, free, walk)
        values.pop(TONE, None)  # matched to what the others leave, in each recording anew
        residual = self._simulated(_frozen(values), tuple(phi))
        return residual if tone is None else tone.match(residual)[1]


def _bounded(square: np.ndarray, along: np.ndarray, lower: np.ndarray, upper: np.ndarray
             ) -> np.ndarray:
    """
    Return the least squares (k,) of normal equations within bounds (k,).

    Where two directions are much alike, one that is merely cut off at its bound leaves the other
    where it makes everything worse.
    """
    from scipy.optimize import lsq_linear
    root = np.linalg.cholesky(square)
    # The solver refuses a lower bound that is the upper one.
    room = np.where(upper > lower, 0.0, 1e-12)
    return lsq_linear(root.T, np.linalg.solve(root, along), (lower - room, upper + room),
                      method='bvls').x


def _inverse(square: np.ndarray) -> np.ndarray:
    """Return the inverse of a square of derivatives (n, n), of which two may be alike."""
    # In units of their lengths: they differ by many orders.
    scale = 1.0 / np.sqrt(np.diag(square))
    alike = square * np.outer(scale, scale) + ALIKE * np.eye(scale.size)
    return np.linalg.inv(alike) * np.outer(scale, scale)


def _frozen(effects: dict[str, dict[str, float]]) -> tuple:
    """Return effects and their numbers as what a cache can look up."""
    return tuple((name, tuple(given.items())) for name, given in effects.items())


def _tuned(device: Device, nuisance: Nuisance, effects: dict, phi: np.ndarray) -> Device:
    device = nuisance.apply(device, phi)
    return device.with_effects(effects) if effects else device


def _simulate(device: Device, nuisance: Nuisance, evidence: Evidence, effects: tuple, phi: tuple
              ) -> np.ndarray:
    values = {name: dict(given) for name, given in effects}
    try:
        residual = residuals(_tuned(device, nuisance, values, np.array(phi)), evidence)
    except InputError:
        # Numbers that no device can have: infinitely bad, but not the end of the search.
        residual = np.full(spans(evidence)[-1].stop, 1e6)
    residual.flags.writeable = False
    return residual
