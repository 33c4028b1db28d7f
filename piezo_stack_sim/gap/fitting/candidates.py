# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Every effect of the registry as a hypothesis.

An effect is tried from several places.  One simulation at each tells, by a
linear look, which places are worth a whole fit.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
import itertools
import math
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from piezo_stack_sim.effects.registry import EFFECTS
from piezo_stack_sim.gap.cores import parallel
from piezo_stack_sim.gap.fitting.descent import WIDE
from piezo_stack_sim.gap.fitting.fit import Fit, Fitter, STEPS, TONE
from piezo_stack_sim.gap.fitting.starts import extent_of, Place, starts_of, tried_shapes
from piezo_stack_sim.gap.fitting.swings import apart, FALLEN, History
from piezo_stack_sim.gap.measured.evidence import quieter, reweigh
from piezo_stack_sim.gap.measured.forward import (
    followed, settling_time, simulate_channels, simulate_set)

LONG, COARSE = 30, 3  # places of a ladder from which every third is looked at first
PLACES = 2  # places of an effect from which a fit sets out
SWUNG_PLACES = 4  # and of one that is a history of swings, from which those are searched
OUTDONE = 0.95  # part of the cost of an effect with which its relative shows it where to start
NEAR = 0.6  # promise of a second place, against the first, that makes it worth a fit
PROMISING = 0.03  # part of the best promise that earns an effect a fit
FIELD = 9  # effects that get one in any case: a linear look underrates what is not linear
WORTH = 15.0  # fall of the cost below which nothing can come of it
FIRST_STEPS = 2  # Gauss-Newton steps after which the field is thinned
RIVAL = 0.35  # part of the best fall of the cost that earns an effect the rest of its fit
POLISHED, POLISHING = 3, 8  # effects that are fitted to the end, with so many steps more
TUNING = 6  # Gauss-Newton steps of the nominal parameters alone
ROUNDS, HELPS = 4, 2e-3  # of leading them past side valleys, and part of the cost worth one
IDLE = 0.01  # part of what an effect explains that its strength must, not what shapes it
DECISIVE = 0.5  # or else part of what is left over the noise without its strength
FELT = 0.02  # or else part of the noise, where nothing but noise is left
SETTLED = 1.2  # mean square of a residual below which there is nothing more to fit
ARRIVED = 1.05  # and below which no side valley of the parameters is left to come out of
CONTENDS = 2.0  # cost, over that of the best, up to which an effect is led out of them


@dataclass
class Probe:
    """What one effect, switched on at one place, does to the residual."""

    effect: str
    place: dict[str, float]
    direction: np.ndarray | None  # (N, k) changes of the residual, one per strength
    gain: float = 0.0  # fall of the cost that a linear look promises
    order: float = 0.0  # by which the places of an effect are ordered
    look: Place = Place({}, {})
    phi: np.ndarray | None = None  # nominal deviations that go with the place, if not those here


class Merit(NamedTuple):
    """
    What the second effect of a pair explains in the cells in which it acts.

    In nats, and as a part of what the first alone leaves there; ``clear`` of them where the first
    does less than the second, so that its form can hardly mislead, and the part there.
    """

    nats: float
    part: float
    clear: float = 0.0
    clear_part: float = 0.0

    @property
    def product(self) -> float:
        """Return how much it explains, and how completely, in one number."""
        return max(self.nats, 0.0) * max(self.part, 0.0)


@dataclass
class Search:
    """
    All hypotheses that were fitted: a name like ``creep`` or ``creep+friction`` to its fit.

    ``bases`` are single effects as pairs are fitted: by where they explain.  ``merits`` tells of a
    pair what its second effect explains there, on the fitted rows.  ``corrected`` are pairs as
    they correct the device best, where that is another fit.  ``asked`` are the effects beside
    which a second was looked for, ``exchanged`` the pairs that were fitted for resembling another,
    by its name and what was known to resemble what, ``resembling`` what might stand in the place
    of each of its two, and from where.  ``mended`` holds, of a pair, the fit of its first effect
    with a third that only mends its form, and the fit of all three.
    """

    nominal: Fit
    fits: dict[str, Fit] = field(default_factory=dict)
    probes: dict[str, list[Probe]] = field(default_factory=dict)
    bases: dict[str, Fit] = field(default_factory=dict)
    merits: dict[str, Merit] = field(default_factory=dict)
    corrected: dict[str, Fit] = field(default_factory=dict)
    asked: set[str] = field(default_factory=set)
    exchanged: dict[tuple, list[str]] = field(default_factory=dict)
    resembling: dict[tuple, dict[str, dict[str, dict[str, float]]]] = field(default_factory=dict)
    mended: dict[str, tuple[Fit, Fit]] = field(default_factory=dict)

    @property
    def best(self) -> Fit:
        """Return the fit with the lowest cost."""
        return min(self.fits.values(), key=lambda fit: fit.cost)

    @property
    def leading(self) -> str:
        """Return the effect that leaves least by itself."""
        return min((name for name in self.fits if '+' not in name),
                   key=lambda name: self.fits[name].cost, default='')

    def correction(self, name: str) -> Fit:
        """Return the fit of a hypothesis that corrects the device."""
        return self.corrected.get(name, self.fits[name])


def search_singles(fitter: Fitter, progress: Callable[[str], None],
                   names: Collection[str] = tuple(EFFECTS),
                   known: Mapping[str, Fit] = MappingProxyType({})) -> Search:
    """
    Fit the nominal device alone, then with every effect by itself, the best to the end.

    Parameters
    ----------
    fitter : Fitter
        Where to fit.
    progress : callable
        Called with a sentence at every stage.
    names : collection of str
        The effects.
    known : mapping of str to Fit
        Fits of some of them elsewhere: more places to start from.

    Returns
    -------
    Search

    """
    search = Search(tune(fitter))
    nominal = search.nominal
    extent = extent_of(fitter.evidence, fitter.base)
    places = {name: [Place({}, {})] if name == TONE else starts_of(EFFECTS[name], extent)
              for name in names}
    shown: list[dict[str, np.ndarray]] = []
    if any(EFFECTS[name].answer for name in names):
        shown = simulate_set(fitter.device_with({}, nominal.phi),
                             [track.recording for track in fitter.evidence.tracks])

    def probe(job):
        name, place = job
        return _probe(fitter, name, place, nominal, shown)

    progress('looking at every effect')
    search.probes.update({name: [] for name in names})
    for probe_ in parallel(probe, [(name, place) for name in names for place in places[name]]):
        search.probes[probe_.effect].append(probe_)
    for name, probes in search.probes.items():
        if EFFECTS[name].swings:
            probes += _led(fitter, name, _distinct(probes)[:SWUNG_PLACES], nominal)
        probes.sort(key=lambda p: -p.order)
        search.fits[name] = _untouched(name, nominal)
    best = max(p.gain for probes in search.probes.values() for p in probes)
    order = sorted(search.probes, key=lambda name: -max(p.gain for p in search.probes[name]))
    first = [(name, p.place, nominal.phi if p.phi is None else p.phi)
             for i, name in enumerate(order)
             for p in _promising(search.probes[name], PROMISING * best if i >= FIELD else 0.0)]
    progress('fitting every effect')
    _race(fitter, search, first, FIRST_STEPS)
    fall = max(nominal.cost - fit.cost for fit in search.fits.values())
    rivals = [(name, fit.effects[name], fit.phi) for name, fit in search.fits.items()
              if nominal.cost - fit.cost > max(RIVAL * fall, WORTH)]
    rivals += [(name, fit.effects[name], nominal.phi) for name, fit in known.items()]
    rivals += _from_relatives(search)
    rivals += _disappointed(search)
    _race(fitter, search, rivals, STEPS)
    polish(fitter, search, sorted(search.fits, key=lambda n: search.fits[n].cost)[:POLISHED])
    return search


def times_of(names: Collection[str]) -> dict[str, str]:
    """Return those of some effects that are one time, like a delay, with the parameter's name."""
    return {name: EFFECTS[name].parameters[0].name for name in names
            if EFFECTS[name].is_time}


def _from_relatives(search: Search) -> list[tuple[str, dict[str, float], np.ndarray]]:
    """
    Return places for effects from where a relative fares better.

    A delay and a lag do much the same, but between none and the right one there may be a hill.  A
    current limit of a driver is hardly seen as long as its output resistance is far off.
    """
    times = times_of(search.fits)
    best = min(times, key=lambda name: search.fits[name].cost, default='')
    places = [(name, {**shape, times[name]: search.fits[best].effects[best][times[best]]},
               search.fits[best].phi)
              for name in times if _outdoes(search, best, name)
              for shape in tried_shapes(EFFECTS[name])]
    for name, other in itertools.permutations(search.fits, 2):
        bounds = shared(name, other) if _outdoes(search, other, name) else {}
        if bounds:
            known = clipped(search.fits[other].effects[other], bounds)
            places += [(name, {**probe.place, **known}, search.fits[other].phi)
                       for probe in _distinct(search.probes[name])[:PLACES]]
    return places


def _disappointed(search: Search) -> list[tuple[str, dict[str, float], np.ndarray]]:
    """
    Return places for effects that promised more than any has kept, and kept hardly any of it.

    Where elements slip earlier or later a line misleads, and so do nominal parameters that have
    stood in for them: they set out from nothing at the file's.
    """
    kept = {name: search.nominal.cost - fit.cost for name, fit in search.fits.items()}
    best = max(kept.values())
    places = []
    for name, probes in search.probes.items():
        probe = max(probes, key=lambda probe: probe.gain)
        if (probe.look.strengths and probe.gain > best
                and kept[name] < RIVAL * best):
            places.append((name, {**probe.look.shape, **dict.fromkeys(probe.look.strengths, 0.0)},
                           np.zeros_like(search.nominal.phi)))
    return places


def _outdoes(search: Search, other: str, name: str) -> bool:
    return search.fits[other].cost < OUTDONE * search.fits[name].cost


def clipped(values: Mapping[str, float], bounds: Mapping[str, tuple[float, float]]
            ) -> dict[str, float]:
    """Return those values that have bounds, within them."""
    return {key: min(max(values[key], low), high) for key, (low, high) in bounds.items()}


def shared(name: str, other: str) -> dict[str, tuple[float, float]]:
    """Return what shapes an effect and another of its block has, too, by name, with its bounds."""
    if EFFECTS[name].block != EFFECTS[other].block:
        return {}
    theirs = {p.name for p in EFFECTS[other].parameters}
    return {p.name: (p.lower, p.upper) for p in EFFECTS[name].parameters
            if p.name in theirs and not p.magnitude}


def _distinct(probes: list[Probe]) -> list[Probe]:
    """Return places, ordered, without those that promise what others did."""
    ordered = sorted(probes, key=lambda p: -p.order)
    return [p for i, p in enumerate(ordered) if p.direction is not None
            and not any(math.isclose(p.order, other.order) for other in ordered[:i])]


def _promising(probes: list[Probe], least: float) -> list[Probe]:
    """Return the places of an effect, ordered, from which it is worth a fit."""
    least = max(WORTH, NEAR * max(p.gain for p in probes), least)
    distinct: dict[float, Probe] = {}  # what the recordings do not tell apart promises the same
    for probe in probes:
        if probe.gain >= least:
            distinct.setdefault(probe.gain, probe)
    return list(distinct.values())[:PLACES]


def is_idle(fitter: Fitter, fit: Fit, name: str) -> bool:
    """
    Tell whether an effect stands for another: it does as well with its strength at an end.

    Without any strength another is in its place: the resistance of a driver whose current never
    comes to its limit is one.  Or it has become another: a stop without a gap is a spring.
    """
    effect = EFFECTS[name]
    strong = [p for p in effect.parameters if p.magnitude]
    if len(strong) == len(effect.parameters) or all(math.isfinite(p.neutral) for p in strong):
        return False  # nothing is left of it without
    neutral = {p.name: min(max(p.neutral, p.lower), p.upper) for p in strong}
    ends = [neutral]
    if effect.becomes:
        ends.append({p.name: p.lower if neutral[p.name] == p.upper else p.upper for p in strong})
    others = {other: values for other, values in fit.effects.items() if other != name}
    without = fitter.cost(fitter.residual_of(others, fit.phi, fit), fit.phi)

    def at(end):
        there = {**fit.effects, name: {**fit.effects[name], **end}}
        return fitter.residual_of(there, fit.phi, fit)

    weak = min(map(at, ends), key=lambda residual: fitter.cost(residual, fit.phi))
    fall = fitter.cost(weak, fit.phi) - fit.cost
    left, noise = float(np.sum(fit.residual[fitter.rows] ** 2)), fitter.rows.size
    least = IDLE * (without - fit.cost)
    if left < ARRIVED * noise:
        # An error of form is no part of what is left, so that less will do.
        least = min(least, FELT * noise)
    elif not effect.becomes:
        # What shapes it may do a hundred times as much, and yet leave most of what is left.
        weaker = float(np.sum(weak[fitter.rows] ** 2))
        if weaker - left > DECISIVE * (weaker - noise):
            least = 0.0
    return fall < max(WORTH, least)


def tune(fitter: Fitter) -> Fit:
    """Fit the nominal parameters alone, past side valleys that single break voltages make."""
    return _past_valleys(fitter, fitter.fit({}, steps=4), TUNING)


def _past_valleys(fitter: Fitter, fit: Fit, steps: int) -> Fit:
    """Return a fit led on by derivatives over wide and narrow steps, as long as that helps."""
    for _ in range(ROUNDS):
        wide = fitter.fit(fit.effects, fit.phi, steps, anew=True, nudge=WIDE)
        new = fitter.fit(wide.effects, wide.phi, steps, anew=True)
        fall, fit = fit.cost - new.cost, min(fit, new, key=lambda fit: fit.cost)
        if fall < HELPS * fit.cost:
            break
    return fit


def tune_as_best(fitter: Fitter, search: Search, near: float = np.inf) -> bool:
    """
    Ask whether what the best found for the nominal parameters does without the effect.

    Not if at first it leaves ``near`` times what is known to do.

    Returns
    -------
    bool
        Whether it does more than was known.

    """
    best = search.best
    known = search.nominal.cost
    if known - best.cost < WORTH or near < np.inf and (
            fitter.fit({}, best.phi, 0).cost > near * known):
        return False
    alone = fitter.fit({}, best.phi, TUNING, anew=True)
    if alone.cost < search.nominal.cost:
        search.nominal = alone
        for name, fit in search.fits.items():
            if fit.cost > alone.cost:
                search.fits[name] = _untouched(name, alone)
    return known - search.nominal.cost > WORTH


def _race(fitter: Fitter, search: Search, runners, steps: int) -> None:
    """Fit effects from given places; keep what is better than before."""
    def whole(runner):
        name, place, phi = runner
        return name, fitter.fit({name: place}, phi, steps)

    for name, fit in parallel(whole, runners):
        if fit.cost < search.fits[name].cost:
            search.fits[name] = fit


def drop_idle(fitter: Fitter, search: Search) -> None:
    """Forget the fits in which an effect stands for another (:func:`is_idle`)."""
    for name, fit in search.fits.items():
        if search.nominal.cost - fit.cost > WORTH and is_idle(fitter, fit, name):
            search.fits[name] = _untouched(name, search.nominal)


def _untouched(name: str, nominal: Fit) -> Fit:
    """Return the fit of an effect, or of two, that promise nothing: neutral."""
    neutral = {each: {p.name: p.neutral for p in EFFECTS[each].parameters}
               for each in name.split('+')}
    return replace(nominal, effects=neutral, view=None, simulations=0)


def polish(fitter: Fitter, search: Search, best: list[str]) -> None:
    """Fit hypotheses to the end: a screening fit stops where it is clear enough."""
    worth = [name for name in best if search.nominal.cost - search.fits[name].cost > WORTH]

    def whole(name):
        fit = search.fits[name]
        fit = fitter.fit(fit.effects, fit.phi, POLISHING)
        near = fit.cost < CONTENDS * search.fits[worth[0]].cost
        if near and np.mean(fit.residual[fitter.rows] ** 2) > ARRIVED:
            # Far from the nominal device its derivative there misleads, as it does in a valley.
            fit = _past_valleys(fitter, fit, POLISHING)
        return name, fit

    for name, fit in parallel(whole, worth):
        if fit.cost <= search.fits[name].cost:
            search.fits[name] = fit
    drop_idle(fitter, search)
    tune_as_best(fitter, search)


def weigh_anew(fitter: Fitter, search: Search) -> tuple[Fitter, Search]:
    """
    Let the best hypothesis tell the noise, and weigh everything by that.

    Returns
    -------
    fitter, search
        The same objects if the noise was estimated well without.

    """
    best = search.best
    old = fitter.evidence
    new = quieter(old, parallel(
        lambda pair: simulate_channels(*pair),
        zip(fitter.devices_of(best), [track.recording for track in old.tracks])))
    if new is old:
        return fitter, search
    turn = reweigh(old, new)
    other = fitter.reweighed(new, turn)

    nominal = {id(fitter.nominal.whole): other.nominal.whole}

    def turned(fit: Fit) -> Fit:
        residual = turn(fit.residual)
        if fit.nominal is not None and id(fit.nominal) not in nominal:
            nominal[id(fit.nominal)] = turn(fit.nominal)
        return replace(fit, residual=residual, cost=other.cost(residual, fit.phi), view=None,
                       slope=None if fit.slope is None else turn(fit.slope),
                       nominal=None if fit.nominal is None else nominal[id(fit.nominal)])

    return other, Search(
        turned(search.nominal), {name: turned(fit) for name, fit in search.fits.items()},
        {name: [replace(probe, direction=None if probe.direction is None
                        else turn(probe.direction)) for probe in probes]
         for name, probes in search.probes.items()})


def _probe(fitter: Fitter, name: str, place: Place, nominal: Fit,
           shown: Sequence[dict[str, np.ndarray]]) -> Probe:
    if name == TONE:
        return probe_tone(fitter, {}, nominal)
    # The nominal parameters may have stood in for what is not merely scaled: it is looked at
    # where the file has them, and they may answer.
    filed = np.zeros_like(nominal.phi)
    phi, before = (nominal.phi, nominal.residual) if place.strengths else (filed, fitter.base)
    follows = EFFECTS[name].answer if place.strengths else None
    settles = settling_time(fitter.device)
    moved = [fitter.residual_of({name: values}, phi) if follows is None
             else before + followed(fitter.evidence, shown, follows(**values), settles)
             for values in place.looks]
    directions = np.column_stack([m - before for m in moved])
    if not np.isfinite(directions).all() or np.abs(directions).max() > 1e9:
        return Probe(name, place.looks[0], None)
    now = fitter.cost(nominal.residual, nominal.phi)
    gain, factors = fitter.linear_gain(
        directions, nominal, lambda factors: place.within(EFFECTS[name], factors))
    directions = directions.astype(np.float32)
    if not place.strengths:
        cost, phi = fitter.retuned(moved[0], filed)
        return Probe(name, place.shape, directions, max(gain, now - cost), now - cost, place, phi)
    cost, tuned, look = min(((*fitter.retuned(m, phi), look) for m, look in zip(
        moved, place.looks)), key=lambda tried: tried[0])
    promise = max(gain, now - cost)
    # Where it fits as it stands, a line from no effect at all tells nothing better; nor does one
    # to within the time between two rows, where what swings comes round.
    if gain > now - cost and not place.dense:
        return Probe(name, place.at(EFFECTS[name], factors), directions, promise, promise, place)
    return Probe(name, look, directions, promise, promise, place, tuned)


def _led(fitter: Fitter, name: str, probes: list[Probe], nominal: Fit) -> list[Probe]:
    """Return better places near those of an effect that is a history of swings."""
    filed = np.zeros_like(nominal.phi)
    now = fitter.cost(nominal.residual, nominal.phi)

    def retuned(place):
        return fitter.retuned(fitter.residual_of({name: place}, filed), filed)

    def history(place):
        return History(name, place, lambda place: retuned(place)[0])

    def whole(led):
        if SETTLED * fitter.rows.size < led.cost < FALLEN * now:
            led = history(led.place).others(led)
        promise = now - led.cost
        return Probe(name, led.place, None, promise, promise, Place(led.place, {}),
                     retuned(led.place)[1])

    # From several places the first often comes to one, from which all are searched once.
    return parallel(whole, apart(parallel(lambda p: history(p.place).first(), probes)))


def probe_tone(fitter: Fitter, others: dict, fit: Fit) -> Probe:
    found = fitter.find_tone(others, fit.phi)
    if found is None:
        return Probe(TONE, {}, None)
    line, left = found
    place = {'frequency': line.frequency, 'displacement': float(line.amplitudes[0])}
    gain = fitter.cost(fit.residual, fit.phi) - fitter.cost(left, fit.phi)
    return Probe(TONE, place, (left - fit.residual).astype(np.float32)[:, None],
                 gain, gain)
