# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Second effects, found where the first has been explained.

No library holds the true form of an effect, and what the form of the first
misses is mostly louder than a second effect.  A pair is therefore fitted in
cells of time and frequency (:mod:`piezo_stack_sim.gap.fitting.lens`), each weighed by
what errors of form are granted there (:mod:`piezo_stack_sim.gap.fitting.form`), and
weighed anew as the fit goes on.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import replace

import numpy as np

from piezo_stack_sim.effects.registry import EFFECTS
from piezo_stack_sim.gap.cores import parallel
from piezo_stack_sim.gap.fitting.candidates import (
    clipped, is_idle, Merit, Probe, probe_tone, RIVAL, Search, shared, times_of, WORTH)
from piezo_stack_sim.gap.fitting.fit import Fit, Fitter, TONE
from piezo_stack_sim.gap.fitting.form import are_alike_in_form, Forms
from piezo_stack_sim.gap.fitting.lens import Cells
from piezo_stack_sim.gap.fitting.swings import FALLEN, History
from piezo_stack_sim.gap.fitting.woken import has_late, woken
from piezo_stack_sim.gap.quantities import words

PARTNERS = 5  # second effects that get a fit
PLAIN_PARTNERS = 2  # and those that promise most by plain rows
EXCHANGED, PLAIN_EXCHANGED = 3, 1  # the same beside the second effect of the best pair
BOTH_EXCHANGED = 2  # and where both of a pair are exchanged, beside every new first one
MENDED = 3  # and beside a first whose form another mends
SLACK = 0.1  # part by which the promises of places of an effect may differ and count as alike
FIRST_STEPS = 6  # Gauss-Newton steps of all of them
LOUD = 0.25  # part of what the first leaves by plain rows that one fitted to the end may leave
SETTLED, NEAR = 5, 0.08  # pairs that are led on, if they gain this part of what the best does
LEADING = 2  # pairs that are fitted to the end, by what they lose and by merit
PLAIN_STEPS = 4  # of these, to all rows alike
ALONE_STEPS = 2  # and of each of two without the other
WEIGHED_STEPS = 6  # of a fit in cells, before they are weighed anew
FIRST_WEIGHINGS, WEIGHINGS = 2, 3  # how often they are, at first and in the end
ARRIVED, RELATIVE = 2.0, 2e-3  # nats, and part of them, by which it must get better to go on
HOPEFUL_NATS, HOPEFUL_PART = 20.0, 0.2  # merit from which a pair is worth another look
ACTS = 0.3  # power of what an effect does, against what is left, from which it acts
CLEAR = 1.0  # power of what the first does, against that, up to which it is clear of it


def search_partners(fitter: Fitter, search: Search, base: str,
                    progress: Callable[[str], None], names: Collection[str] = tuple(EFFECTS),
                    pair: Fit | None = None) -> None:
    """
    Fit pairs of ``base`` and every other effect of ``names`` that promises something.

    What the form of ``base`` misses is mostly louder than a second effect: cells of time and
    frequency in which ``base`` does much count for little.  ``pair`` is a pair with it, if there
    is one: it may know a better place for it.
    """
    progress(f'fitting pairs with {words(base)}')
    forms = Forms(fitter, Cells(fitter.evidence, fitted=True))
    if has_late(base) and base == search.leading:
        search.fits[base] = woken(fitter, search.fits[base])
    fit = _settled(forms, search.fits[base])
    if pair is not None:
        other = _alone(forms, base, pair)
        fit = other if forms.better(other, fit) else fit
    if forms.better(fit, search.bases.get(base)):
        search.bases[base] = fit
    fit = search.bases[base]
    search.asked.add(base)
    weighed = fitter.through(forms.lens(fit, hoped=True))
    partners, plain = (PARTNERS, PLAIN_PARTNERS) if pair is None else (EXCHANGED, PLAIN_EXCHANGED)
    # What is loud everywhere counts for little when weighed: some are chosen by plain rows.
    others = [name for name in names if name != base]
    by_rows = _promises(fitter, search, others, fit)
    loud = dict(by_rows[:plain])
    places = {name: (fit, place) for name, place in by_rows}
    # And one from where plain rows lead: where the weighed do, the nominal parameters may seem to
    # do as much.
    led = search.fits[base]
    if fitter.cost(led.residual, led.phi) < fitter.cost(fit.residual, fit.phi):
        for name, place in _promises(fitter, search, others, led)[:1]:
            if name not in loud:
                loud[name], places[name] = place, (led, place)
    chosen = {**loud, **dict(_promises(weighed, search, others, fit)[:partners])}
    without, plainly = (each.cost(fit.residual, fit.phi) for each in (weighed, fitter))
    aside = replace(fit, view=None)  # through the lens of the weighed

    def whole(place):
        name, values = place
        if EFFECTS[name].swings:
            history = History(name, values, lambda values: weighed.cost_beside(
                weighed.residual_of({**fit.effects, name: values}, fit.phi, fit), aside))
            led = history.first()
            if led.cost < FALLEN * weighed.cost_beside(fit.residual, aside):
                led = history.others(led)
            values = led.place
        pair = weighed.fit({**fit.effects, name: values}, fit.phi, FIRST_STEPS, beside=fit)
        left = plainly
        if (name in loud or pair.cost > without) and name != TONE:
            # From a place that looked good by its weighed rows it may not have found its way.
            start, place = places[name]
            rows = fitter.fit({**start.effects, name: place}, start.phi, PLAIN_STEPS)
            left = rows.cost
            rows = weighed.fit(rows.effects, rows.phi, FIRST_STEPS, beside=rows)
            pair = min(pair, rows, key=forms.nats)
        return pair_of(base, name), pair, left

    def acting(pair):
        return merit_of(fitter, forms.cells, fit, pair)

    def settled(name):
        return name, _settled(forms, fitted[name], FIRST_WEIGHINGS)

    found = [(name, pair, left) for name, pair, left in parallel(whole, chosen.items())
             if not any(is_idle(weighed, pair, other) for other in pair.effects if other != base)]
    fitted = {name: pair for name, pair, _ in found}
    merits = dict(zip(fitted, parallel(acting, fitted.values())))
    lost = forms.nats(fit)
    gains = dict(zip(fitted, parallel(lambda pair: lost - forms.nats(pair), fitted.values())))
    best = _leading(gains, SETTLED, NEAR)
    best += [name for name in _leading({name: merits[name].product for name in fitted}, LEADING)
             if name not in best]
    # What mends the form of the first explains more cells than what is loud in a few.
    best += [name for name, _, left in found if left < LOUD * plainly and name not in best]
    for name, pair in parallel(settled, best):
        if forms.better(pair, search.fits.get(name)):
            search.fits[name] = pair
            search.merits[name] = acting(pair)


def _leading(gains: dict[str, float], most: int, near: float = RIVAL) -> list[str]:
    """Return the names that gain most: the best, and those that come near it."""
    names = sorted(gains, key=lambda name: -gains[name])[:most]
    return [name for name in names if gains[name] >= near * gains[names[0]] > 0.0]


def _settled(forms: Forms, fit: Fit, weighings: int = WEIGHINGS) -> Fit:
    """Return a fit that was led to where it loses the fewest nats: weighed anew, fitted anew."""
    lost = forms.nats(fit)
    for _ in range(weighings):
        new = forms.fitter.through(forms.lens(fit)).fit(
            fit.effects, fit.phi, WEIGHED_STEPS, beside=fit)
        before, lost = lost, forms.nats(new)
        if lost >= before:
            break
        fit = new
        if lost > before - max(ARRIVED, RELATIVE * lost):
            break
    return fit


def _alone(forms: Forms, base: str, pair: Fit) -> Fit:
    """
    Return a fit of one effect of a pair without the other.

    From where the pair has it, where the other hardly matters: what is loud would lead a fit to
    all rows alike away, and the pair would seem to explain what one alone does there.
    """
    without = forms.fitter.fit({base: pair.effects[base]}, pair.phi, 0)
    led = forms.fitter.fit(without.effects, pair.phi, ALONE_STEPS)
    return _settled(forms, led if forms.better(led, without) else without, FIRST_WEIGHINGS)


def _promises(fitter: Fitter, search: Search, names: Collection[str], fit: Fit
              ) -> list[tuple[str, dict[str, float]]]:
    """Return second effects with a place to start, those first that promise most."""
    fit = replace(fit, view=None)  # through the lens of this fitter
    fitter.view(fit)  # once, before all cores ask for it

    def best(name):
        places = [_promise(fitter, fit, probe) for probe in search.probes[name]]
        most = max(gain for gain, _, _ in places)
        # Of places that promise alike, the one from which it is not far.
        alike = [place for place in places if place[0] >= most - SLACK * abs(most)]
        return most, name, min(alike, key=lambda place: place[1])[2]

    promises = sorted(parallel(best, names), key=lambda promise: -promise[0])
    return [(name, place) for _, name, place in promises]


def exchange(fitter: Fitter, search: Search, progress: Callable[[str], None],
             names: Collection[str]) -> None:
    """Keep the second effect of the best pair, and look for another first one beside it."""
    best = max(_hopeful(search), key=lambda name: search.merits[name].product, default='')
    for other in filter(None, best.split('+')):
        if other not in search.asked:
            search_partners(fitter, search, other, progress, names, search.fits[best])


def polish_pairs(fitter: Fitter, search: Search) -> None:
    """Fit the best pairs to all they leave, loud or not: it may lead out of a side valley."""
    forms = Forms(fitter, Cells(fitter.evidence, fitted=True))

    def whole(name):
        fit = search.fits[name]
        return name, _settled(forms, fitter.fit(fit.effects, fit.phi, PLAIN_STEPS))

    def alone(job):
        base, pair = job
        return base, _alone(forms, base, search.fits[pair])

    lost = min(map(forms.nats, search.bases.values()))
    best = _leading({name: lost - forms.nats(fit) for name, fit in search.fits.items()
                     if '+' in name}, LEADING)
    best += [name for name in _leading({name: search.merits[name].product
                                        for name in _hopeful(search)}, 1) if name not in best]
    for name, pair in parallel(whole, best):
        if forms.better(pair, search.fits[name]):
            search.fits[name] = pair
    # Each of two is asked whether it does alone: it may have been stuck where the pair is not.
    jobs = {base: name for name in reversed(best) for base in name.split('+')}
    for base, fit in parallel(alone, jobs.items()):
        if forms.better(fit, search.bases.get(base)):
            search.bases[base] = fit

    def again(base):
        return base, fitter.fit(search.bases[base].effects, search.bases[base].phi, PLAIN_STEPS)

    # And some were never found alone.
    for base, fit in parallel(again, jobs):
        if fit.cost < search.fits[base].cost:
            search.fits[base] = fit


def wake_leading(fitter: Fitter, search: Search) -> None:
    """Free what mends the form of the leading effect, alone and in the best pair if in it."""
    base = search.leading
    if base not in search.asked or not has_late(base):
        return
    fit = woken(fitter, search.fits[base])
    if fit is search.fits[base]:
        return
    search.fits[base] = fit
    forms = Forms(fitter, Cells(fitter.evidence, fitted=True))
    fit = _settled(forms, fit)
    if forms.better(fit, search.bases.get(base)):
        search.bases[base] = fit
    for name in leading_pairs(fitter, search, 1):
        if base in name.split('+'):
            pair = search.fits[name]
            pair = fitter.fit({**pair.effects, base: search.fits[base].effects[base]}, pair.phi,
                              PLAIN_STEPS)
            pair = _settled(forms, woken(fitter, pair))
            if forms.better(pair, search.fits[name]):
                search.fits[name] = pair


def leading_pairs(fitter: Fitter, search: Search, most: int) -> list[str]:
    """Return the pairs that lose the fewest nats, and fewer than any one effect."""
    pairs = [name for name in search.fits if '+' in name]
    if not pairs:
        return []
    forms = Forms(fitter, Cells(fitter.evidence, fitted=True))
    lost = min(map(forms.nats, search.bases.values()))
    gains = {name: lost - forms.nats(search.fits[name]) for name in pairs}
    best = sorted(gains, key=lambda name: -gains[name])[:most]
    return [name for name in best if gains[name] > HOPEFUL_NATS]


def _hopeful(search: Search) -> list[str]:
    """Return the pairs whose second effect explains enough to be worth another look."""
    return [name for name, merit in search.merits.items()
            if merit.nats > HOPEFUL_NATS and merit.part > HOPEFUL_PART]


def add_pair(fitter: Fitter, search: Search, start: dict[str, dict[str, float]], phi: np.ndarray
             ) -> str:
    """
    Fit a pair that was found elsewhere, and each of the two without the other.

    Parameters
    ----------
    fitter : Fitter
        With which all was fitted.
    search : Search
        Where the pair goes.
    start : dict
        The two effects with their numbers (SI).
    phi : ndarray, shape (p,)
        Deviations of the nominal parameters that go with them.

    Returns
    -------
    str
        The name of the pair.

    """
    forms = Forms(fitter, Cells(fitter.evidence, fitted=True))
    pair = _settled(forms, fitter.fit(start, phi, PLAIN_STEPS))
    name = pair_of(*start)
    search.fits[name] = pair if forms.better(pair, search.fits.get(name)) else search.fits[name]
    for base in start:
        fit = _alone(forms, base, search.fits[name])
        if forms.better(fit, search.bases.get(base)):
            search.bases[base] = fit
    search.merits[name] = explained(forms, search, name)
    return name


def exchange_alike(fitter: Fitter, search: Search, name: str, alike: Collection[frozenset[str]],
                   progress: Callable[[str], None]) -> list[str]:
    """
    Fit what a pair would be with one of the two exchanged for what resembles it.

    One that has come to rest at a bound, where nothing real is, may stand for what its form is
    like, too.

    Parameters
    ----------
    fitter : Fitter
        With which all was fitted.
    search : Search
        Where the pair is, and where the others go.
    name : str
        The pair.
    alike : collection of frozenset of str
        Effects that resemble each other, by twos.
    progress : callable
        Called with a sentence at every stage.

    Returns
    -------
    list of str
        The names of the pairs that were asked.

    """
    asked = name, frozenset(alike)
    if asked in search.exchanged:
        return search.exchanged[asked]
    progress(f'looking for what resembles {words(name)}')
    known = search.fits[name]
    forms = Forms(fitter, Cells(fitter.evidence, fitted=True))
    _ask_alone(forms, search, known)  # beside one of them each of the others is judged
    starts = {}
    for out, found in _resembling(fitter, search, name, alike).items():
        kept, = set(name.split('+')) - {out}
        for other, place in found.items():
            place = {**place, **clipped(known.effects[out], shared(other, out))}
            pair = pair_of(kept, other)
            starts[pair] = search.fits.get(pair), [
                {kept: known.effects[kept], other: values}
                for values in (place, *_found_alone(search, other))]

    def whole(pair):
        start, others = starts[pair]
        if start is None:
            effects = min(others, key=lambda there: fitter.retuned(
                fitter.residual_of(there, known.phi), known.phi)[0])
            start = replace(known, effects=effects)
        return pair, _settled(forms, fitter.fit(start.effects, start.phi, PLAIN_STEPS))

    # What resembles another pair, too, has been led to its end.
    settled = {pair for pairs in search.exchanged.values() for pair in pairs}
    for pair, fit in parallel(whole, [pair for pair in starts if pair not in settled]):
        if forms.better(fit, search.fits.get(pair)):
            search.fits[pair] = fit
    search.exchanged[asked] = list(starts)
    return search.exchanged[asked]


def _resembling(fitter: Fitter, search: Search, name: str, alike: Collection[frozenset[str]]
                ) -> dict[str, dict[str, dict[str, float]]]:
    """Return what might stand in the place of each of two beside the other, and from where."""
    asked = name, frozenset(alike)
    if asked in search.resembling:
        return search.resembling[asked]
    known = search.fits[name]
    stuck = {free.effect for free in known.stuck}

    def beside(out):
        kept, = set(name.split('+')) - {out}
        without = fitter.fit({kept: known.effects[kept]}, known.phi, ALONE_STEPS)
        others = [other for other in search.probes if other not in name.split('+') and (
            frozenset((out, other)) in alike or shared(other, out)
            or out in stuck and are_alike_in_form(out, other))]
        return out, dict(_promises(fitter, search, others, without)[:EXCHANGED])

    search.resembling[asked] = dict(parallel(beside, name.split('+')))
    return search.resembling[asked]


def exchange_both(fitter: Fitter, search: Search, name: str, alike: Collection[frozenset[str]],
                  progress: Callable[[str], None]) -> list[str]:
    """
    Fit what resembles both of a pair at once: each may stand for another as the other does.

    Parameters
    ----------
    fitter : Fitter
        With which all was fitted.
    search : Search
        Where the pair is, and where the others go.
    name : str
        The pair.
    alike : collection of frozenset of str
        Effects that resemble each other, by twos.
    progress : callable
        Called with a sentence at every stage.

    Returns
    -------
    list of str
        The names of the pairs that were asked.

    """
    progress(f'looking for what resembles both of {words(name)}')
    known = search.fits[name]
    forms = Forms(fitter, Cells(fitter.evidence, fitted=True))
    firsts, seconds = _resembling(fitter, search, name, alike).values()

    def started(first):
        one, place = first
        alone = fitter.fit({one: place}, known.phi, ALONE_STEPS)
        others = [other for other in seconds
                  if other != one and pair_of(one, other) not in search.fits]
        promised = _promises(fitter, search, others, alone)[:BOTH_EXCHANGED]
        return [fitter.fit({**alone.effects, other: there}, alone.phi, PLAIN_STEPS)
                for other, there in promised]

    found = {pair_of(*fit.effects): fit for fits in parallel(started, firsts.items())
             for fit in fits}
    best = sorted(found, key=lambda pair: forms.nats(found[pair]))[:LEADING]
    for pair, fit in parallel(lambda pair: (pair, _settled(forms, found[pair])), best):
        search.fits[pair] = fit
        _ask_alone(forms, search, fit)
    return best


def _found_alone(search: Search, name: str) -> list[dict[str, float]]:
    """Return where an effect was found as the only one, if it explains anything so."""
    fit = search.fits[name]
    return [fit.effects[name]] if search.nominal.cost - fit.cost > WORTH else []


def search_mended(fitter: Fitter, search: Search, progress: Callable[[str], None],
                  names: Collection[str]) -> None:
    """
    Look for a second effect beside a first whose form another mends.

    The time that a sensor or a driver takes is hardly ever a pure lag or a pure delay.  Where two
    of these explain it better than one, what they leave shows a second effect that the form of
    one had hidden.
    """
    forms = Forms(fitter, Cells(fitter.evidence, fitted=True))
    mended = {name: forms.nats(search.fits[name]) for name in _hopeful(search)
              if set(name.split('+')) & search.asked and len(times_of(name.split('+'))) == 2}
    if not mended:
        return
    form = min(mended, key=lambda name: mended[name])
    first = min(form.split('+'), key=lambda name: search.fits[name].cost)
    progress(f'looking past the form of {words(first)}')
    fit = _settled(forms, search.fits[form])
    weighed = fitter.through(forms.lens(fit))
    others = [name for name in names
              if name not in times_of(EFFECTS) and name in search.probes]
    chosen = {**dict(_promises(fitter, search, others, fit)[:PLAIN_PARTNERS]),
              **dict(_promises(weighed, search, others, fit)[:MENDED])}

    def whole(place):
        name, values = place
        return name, weighed.fit({**fit.effects, name: values}, fit.phi, FIRST_STEPS, beside=fit)

    def settled(name):
        triple = _settled(forms, fitted[name], FIRST_WEIGHINGS)
        effects = {each: triple.effects[each] for each in (first, name)}
        pair = _settled(forms, fitter.fit(effects, triple.phi, PLAIN_STEPS))
        return pair_of(first, name), triple, pair

    fitted = {name: triple for name, triple in parallel(whole, chosen.items())
              if not is_idle(weighed, triple, name)}
    without = weighed.cost(fit.residual, fit.phi)
    best = _leading({name: without - triple.cost for name, triple in fitted.items()}, LEADING)
    for name, triple, pair in parallel(settled, best):
        search.mended[name] = fit, triple
        if forms.better(pair, search.fits.get(name)):
            search.fits[name] = pair
        _ask_alone(forms, search, pair)
        search.merits[name] = explained(forms, search, name)


def _ask_alone(forms: Forms, search: Search, pair: Fit) -> None:
    """Fit each of two effects alone, if nobody has."""
    missing = [base for base in pair.effects if base not in search.bases]
    search.bases.update(zip(missing, parallel(
        lambda base: _alone(forms, base, pair), missing)))


def first_of(forms: Forms, search: Search, name: str) -> str:
    """Return which effect of a pair explains more alone, as far as that was asked; '' if not."""
    return min((base for base in search.bases if base in name.split('+')),
               key=lambda base: forms.nats(search.bases[base]), default='')


def explained(forms: Forms, search: Search, name: str, clear: bool = False) -> Merit:
    """
    Return how much of what the first effect leaves a second explains, where it acts.

    Parameters
    ----------
    forms : Forms
        Judges, by the rows to judge by.
    search : Search
        Where the pair is.
    name : str
        The pair.
    clear : bool
        Whether to ask as well where the first hardly acts, which takes a simulation.

    Returns
    -------
    Merit

    """
    base = first_of(forms, search, name)
    return merit_of(forms.fitter, forms.cells, search.bases[base], search.fits[name], clear)


def merit_of(fitter: Fitter, cells: Cells, alone: Fit, whole: Fit, clear: bool = False
             ) -> Merit:
    """Return what one more effect explains of what ``alone`` leaves where that effect acts."""
    kept = {name: whole.effects[name] for name in alone.effects}
    without = fitter.residual_of(kept, whole.phi, whole)
    after = cells.powers(cells.spectrum(whole.residual))
    acts = cells.powers(cells.spectrum(without - whole.residual))
    there = (acts > ACTS * after) & (acts > 1.0)
    before = np.log(cells.powers(cells.spectrum(alone.residual)))

    def explained(rows):
        nats = 0.5 * float(np.sum(before[rows] - np.log(after[rows])))
        return nats, nats / max(0.5 * float(np.sum(before[rows])), 1e-9)

    if not clear:
        return Merit(*explained(there))
    others = {name: values for name, values in whole.effects.items() if name not in alone.effects}
    first = cells.powers(cells.spectrum(
        fitter.residual_of(others, whole.phi, whole) - whole.residual))
    return Merit(*explained(there), *explained(there & (first < CLEAR * acts)))


def pair_of(one: str, other: str) -> str:
    """Return the name of a pair, in the order of the registry."""
    return '+'.join(sorted((one, other), key=list(EFFECTS).index))


def _promise(fitter: Fitter, fit: Fit, probe: Probe) -> tuple[float, float, dict[str, float]]:
    """Return what a second effect promises beside a fit, how far off it is, where to start it."""
    if probe.effect == TONE:
        probe = probe_tone(fitter, fit.effects, fit)
        return probe.gain, 0.0, probe.place
    if probe.direction is None:
        return 0.0, 0.0, probe.place
    # How an effect moves the outputs hardly depends on the other being on: no new simulation.
    effect = EFFECTS[probe.effect]
    gain, factors = fitter.linear_gain(
        probe.direction, fit, lambda factors: probe.look.within(effect, factors))
    if probe.look.strengths:
        return gain, 0.0, probe.look.at(effect, factors)
    return gain, abs(float(np.log(max(np.abs(factors).max(), 1e-12)))), probe.place
