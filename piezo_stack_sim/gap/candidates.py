"""
Every effect of the registry as a hypothesis; pairs greedily after that.

An effect is tried from several places.  One simulation at each tells, by a
linear look, which places are worth a whole fit.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from piezo_stack_sim.effects.registry import EFFECTS
from piezo_stack_sim.gap.fit import Fit, Fitter, STEPS
from piezo_stack_sim.gap.forward import parallel
from piezo_stack_sim.gap.starts import Extent, starts_of

WHOLE_FITS = 2  # places of an effect from which a whole fit is made
PROMISING = 0.1  # part of the best promise that earns an effect a whole fit
WORTH = 15.0  # fall of the cost below which nothing can come of it
SHORT = 1  # Gauss-Newton steps for the others
PARTNERS = 5  # second effects that get a whole fit
PAIR_STEPS = 4
POLISHING = 8


@dataclass
class Probe:
    """What one effect, switched on at one place, does to the residual."""

    effect: str
    place: dict[str, float]
    direction: np.ndarray | None  # (N,) change of the residual
    gain: float = 0.0  # fall of the cost that a linear look promises


@dataclass
class Search:
    """All hypotheses that were fitted: a name like ``creep`` or ``creep+friction`` to its fit."""

    nominal: Fit
    fits: dict[str, Fit] = field(default_factory=dict)
    probes: dict[str, list[Probe]] = field(default_factory=dict)


def search_singles(fitter: Fitter, extent: Extent, progress: Callable[[str], None]) -> Search:
    """Fit the nominal device alone, then with every effect by itself."""
    search = Search(fitter.fit({}, steps=4))
    nominal = search.nominal
    jobs = [(name, place) for name, effect in EFFECTS.items()
            for place in starts_of(effect, extent)]

    def probe(job):
        name, place = job
        return _probe(fitter, name, place, {}, nominal)

    progress('looking at every effect')
    for probe_ in parallel(probe, jobs):
        search.probes.setdefault(probe_.effect, []).append(probe_)
    best = max(p.gain for probes in search.probes.values() for p in probes)
    wholes = []
    for name, probes in search.probes.items():
        probes.sort(key=lambda p: -p.gain)
        promising = [p for p in probes[:WHOLE_FITS]
                     if p.gain >= max(PROMISING * best, 0.8 * probes[0].gain, WORTH)]
        wholes += [(name, p.place, STEPS) for p in promising]
        if not promising:
            wholes.append((name, probes[0].place, SHORT))

    def whole(job):
        name, place, steps = job
        return name, fitter.fit({name: place}, nominal.phi, steps)

    progress('fitting every effect')
    for name, fit in parallel(whole, wholes):
        if name not in search.fits or fit.cost < search.fits[name].cost:
            search.fits[name] = fit
    return search


def polish(fitter: Fitter, search: Search, count: int) -> None:
    """Fit the best hypotheses to the end: a screening fit stops where it is clear enough."""
    best = sorted(search.fits, key=lambda name: search.fits[name].cost)[:count]
    worth = [name for name in best if search.nominal.cost - search.fits[name].cost > WORTH]

    def whole(name):
        fit = search.fits[name]
        return name, fitter.fit(fit.effects, fit.phi, POLISHING)

    for name, fit in parallel(whole, worth):
        if fit.cost <= search.fits[name].cost:
            search.fits[name] = fit


def search_partners(fitter: Fitter, extent: Extent, search: Search, base: str,
                    progress: Callable[[str], None]) -> None:
    """Fit pairs of ``base`` and every other effect that promises something."""
    fit = search.fits[base]
    used = base.split('+')
    # How an effect moves the outputs hardly depends on the other being on: no new simulation.
    promises: list[tuple[float, Probe]] = []
    for name, probes in search.probes.items():
        seen = [(fitter.linear_gain(p.direction, fit), p) for p in probes
                if p.direction is not None]
        if name not in used and seen:
            promises.append(max(seen, key=lambda pair: pair[0]))
    promises.sort(key=lambda pair: -pair[0])
    ranked = [probe for gain, probe in promises[:PARTNERS] if gain > 0.02 * promises[0][0]]

    def whole(probe):
        effects = {**fit.effects, probe.effect: probe.place}
        return '+'.join(sorted([*used, probe.effect], key=list(EFFECTS).index)), fitter.fit(
            effects, fit.phi, steps=PAIR_STEPS)

    progress(f'fitting pairs with {base}')
    for name, pair in parallel(whole, ranked):
        if name not in search.fits or pair.cost < search.fits[name].cost:
            search.fits[name] = pair


def _probe(fitter: Fitter, name: str, place: dict[str, float], others: dict, fit: Fit) -> Probe:
    moved = fitter.residual_of({**others, name: place}, fit.phi)
    direction = moved - fit.residual
    if not np.isfinite(direction).all() or np.abs(direction).max() > 1e5:
        return Probe(name, place, None)
    gain = fitter.linear_gain(direction, fit)
    full_step = fitter.cost(fit.residual, fit.phi) - fitter.cost(moved, fit.phi)
    return Probe(name, place, direction.astype(np.float32), max(gain, full_step))
