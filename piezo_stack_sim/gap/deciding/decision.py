# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""From fits to a verdict: hypotheses ranked on withheld rows, pairs asked for, decided."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
import math

import numpy as np

from piezo_stack_sim.effects.registry import EFFECTS
from piezo_stack_sim.gap.cores import parallel
from piezo_stack_sim.gap.deciding.isolability import Alike
from piezo_stack_sim.gap.deciding.ranked import Ranked, Thresholds
from piezo_stack_sim.gap.deciding.score import channel_power, Judge, noise_power
from piezo_stack_sim.gap.deciding.second import (
    are_two_of_a_kind, is_beyond_form, is_relative, rivals_beside_mended, rivals_of,
    second_explains, stands_clear)
from piezo_stack_sim.gap.deciding.verdict import contenders, Cut, decide, tie_pairs, Verdict
from piezo_stack_sim.gap.fitting.candidates import Search
from piezo_stack_sim.gap.fitting.fit import Fit, Fitter
from piezo_stack_sim.gap.fitting.form import Forms
from piezo_stack_sim.gap.fitting.pairs import (
    add_pair, exchange, exchange_alike, exchange_both, explained, first_of, leading_pairs,
    merit_of, pair_of, polish_pairs, search_mended, search_partners, wake_leading)
from piezo_stack_sim.gap.measured.evidence import Evidence, of_any_colour, reweigh
from piezo_stack_sim.gap.measured.forward import simulate_set

PAIRS_SHOWN = 5  # pairs that are looked at in detail
LEADING = 3  # pairs that are asked what each of the two does alone, if they lose less than one
PLAIN_STEPS = 8  # of the first effect of a pair that counts, by all rows alike
CLEARLY = 0.01  # part of the gap by which that must remove more
NOTHING = 0.05  # excess of a channel over the power of its noise in which nothing is removable


@dataclass(frozen=True)
class Decision:
    """Hypotheses, best first, and what follows from them."""

    judge: Judge
    removable: Removable
    singles: list[Ranked]
    pairs: list[Ranked]
    ceiling: float
    structure: float
    alike: Alike
    verdict: Verdict
    cut: Cut | None = None

    @property
    def name(self) -> str:
        """Return the name of the hypothesis that was selected, '' if none was."""
        return '+'.join(sorted(self.verdict.selected, key=list(EFFECTS).index))

    def chosen(self, search: Search) -> Fit:
        """Return the fit of what was selected; the nominal one if nothing was."""
        return search.correction(self.name) if self.name else search.nominal

    def corrected(self, fitter: Fitter, search: Search, chosen: Fit) -> Decision:
        """Return the same with scores of what is selected by a better fit, kept in ``search``."""
        search.corrected[self.name] = chosen
        return replace(self, singles=_singles(fitter, search, self.judge, self.removable))


class Removable:
    """How much of the gap of a set a residual has left, all channels together."""

    def __init__(self, evidence: Evidence, base: np.ndarray) -> None:
        self.evidence = evidence
        self.noise = noise_power(evidence)
        self.base = channel_power(evidence, base)

    @property
    def loudest(self) -> float:
        """Return the largest excess of a channel as a whole over the power of its noise."""
        return max((self.base[channel] / noise - 1.0 for channel, noise in self.noise.items()),
                   default=0.0)

    def share(self, residual: np.ndarray) -> float:
        """Return S pooled over the channels, each in units of its noise."""
        now = channel_power(self.evidence, residual)
        gap = left = 0.0
        for channel, noise in self.noise.items():
            excess = self.base[channel] - noise
            if excess > NOTHING * noise:
                # The root keeps a channel with a huge gap from hiding the others.
                weight = 1.0 / math.sqrt(excess * noise)
                gap += weight * excess
                left += weight * max(now[channel] - noise, 0.0)
        return 1.0 - left / gap if gap > 0.0 else 0.0


def ceiling_of(judge: Judge, removable: Removable, nominal: np.ndarray, flexible: np.ndarray,
               thresholds: Thresholds) -> float:
    """
    Return the part of the removable gap that a flexible correction removes.

    Of a gap that is none a share tells nothing: slow noise is foretold by its neighbours, too.

    Parameters
    ----------
    judge : Judge
        Knows what is chance.
    removable : Removable
        The gap.
    nominal, flexible : ndarray, shape (N,)
        What the re-tuned nominal device leaves, and what the correction leaves of that.
    thresholds : Thresholds
        From when on a gap is one.

    """
    gap = max(removable.loudest, judge.structure(nominal))
    return removable.share(flexible) if gap > thresholds.excess else 0.0


def count(fit: Fit) -> int:
    """Return how many numbers a hypothesis chose."""
    return len(fit.free) + (0 if fit.line is None else 2 + len(fit.line.phases))


def rank(names, fitter: Fitter, search: Search, judge: Judge, removable: Removable
         ) -> list[Ranked]:
    """Return hypotheses, best first: by score."""
    ranked = _ranker(fitter, search, judge, removable)
    return sorted((ranked(name, search.correction(name)) for name in names),
                  key=lambda r: (-r.gain, r.name))


def _ranker(fitter: Fitter, search: Search, judge: Judge, removable: Removable
            ) -> Callable[[str, Fit], Ranked]:
    """Return what turns the name and fit of a hypothesis into its scores."""
    nominal = judge.score(search.nominal.residual)
    base = judge.powers(search.nominal.residual)

    def ranked(name: str, fit: Fit) -> Ranked:
        powers = judge.powers(fit.residual)
        return Ranked(
            name, judge.score(fit.residual) - nominal, removable.share(fit.residual),
            count(fit), judge.left(powers, base), float(np.max(powers)) - 1.0,
            spent=fitter.spent(fit), stuck=bool(fit.stuck),
            simpler=_simpler(name, fit, fitter.evidence))

    return ranked


def _simpler(name: str, fit: Fit, evidence: Evidence) -> str:
    """Return the hypothesis that one cannot be told from in recordings so short, '' if none."""
    longest = max(track.recording.duration for track in evidence.tracks)
    names = name.split('+')
    for i, each in enumerate(names):
        late = EFFECTS[each].before_its_time
        if late is not None and EFFECTS[each].values(fit.effects[each])[late[0]] > longest:
            others = [*names[:i], *names[i + 1:], late[1]]
            return '+'.join(sorted(others, key=list(EFFECTS).index))
    return ''


def rank_pairs(forms: Forms, search: Search, judge: Judge, removable: Removable,
               kept: Collection[str] = ()) -> list[Ranked]:
    """
    Return pairs, best first: by what the second effect explains where the first leaves it.

    Only the best are looked at, and those to be ``kept``.
    """
    pairs = rank([n for n in search.fits if '+' in n], forms.fitter, search, judge, removable)
    cells = judge.cells
    formed = dict(zip((pair.name for pair in pairs), parallel(
        lambda pair: forms.of(search.fits[pair.name]), pairs)))
    most = min(formed, key=lambda name: formed[name].nats, default='')
    pairs.sort(key=lambda r: (cells.nats(search.fits[r.name].residual), r.name))
    pairs = [pair for rank, pair in enumerate(pairs)
             if rank < PAIRS_SHOWN or pair.name in (most, *kept)]
    alone = min((cells.nats(fit.residual) for fit in search.bases.values()), default=0.0)
    excused = min(parallel(forms.nats, search.bases.values()), default=0.0)

    def asked(pair):
        form = formed[pair.name]
        second = set(pair.name.split('+')) - {first_of(forms, search, pair.name)}
        pair = replace(pair, form=excused - form.nats, wrong=max(form.shares[n] for n in second))
        if pair.name not in kept and not set(pair.name.split('+')) <= set(search.bases):
            return pair  # not among the best: nobody asked what each of the two does alone
        merit = explained(forms, search, pair.name, clear=True)
        lost = cells.nats(search.fits[pair.name].residual)
        return replace(pair, second=merit.nats, part=merit.part, clear=merit.clear,
                       clear_part=merit.clear_part, over=alone - lost)

    return parallel(asked, pairs)


def _excess(judge: Judge, search: Search, name: str) -> float:
    """Return the largest mean square over the noise that a fit leaves in a track, minus one."""
    return float(np.max(judge.powers(search.fits[name].residual))) - 1.0


def rank_mended(forms: Forms, search: Search, judge: Judge, removable: Removable
                ) -> list[Ranked]:
    """Return pairs as they leave the gap if a third effect mends the form of the first."""
    ranked, pairs = _ranker(forms.fitter, search, judge, removable), []
    for name, (first, whole) in search.mended.items():
        merit = merit_of(forms.fitter, forms.cells, first, whole)
        over = judge.cells.nats(first.residual) - judge.cells.nats(whole.residual)
        beside = ranked(pair_of(*first.effects), first)
        pairs.append(replace(ranked(name, whole), second=merit.nats, part=merit.part, over=over,
                             beside=beside))
    return sorted(pairs, key=lambda pair: (-pair.second, pair.name))


def _by_all_rows(fitter: Fitter, search: Search, judge: Judge, removable: Removable,
                 pair: Ranked, first: str) -> Ranked:
    """
    Fit the first effect of a pair to all rows alike, if that leaves clearly less of the gap.

    The second stays as it was found where it shows: it would be bent to fill in what the form of
    the first misses.
    """
    if pair.name not in search.corrected:
        weighed = search.fits[pair.name]
        second = [name for name in pair.name.split('+') if name != first]
        plain = fitter.fit(weighed.effects, weighed.phi, PLAIN_STEPS, kept=second)
        better = removable.share(plain.residual) > pair.removed + CLEARLY
        search.corrected[pair.name] = plain if better else weighed
    again, = rank([pair.name], fitter, search, judge, removable)
    return replace(again, second=pair.second, part=pair.part, over=pair.over, clear=pair.clear,
                   clear_part=pair.clear_part, form=pair.form, wrong=pair.wrong)


def judge_of(fitter: Fitter, search: Search) -> Judge:
    """Return who judges what was fitted: the best effect tells how many rows are independent."""
    best = search.fits[search.leading]
    return Judge.from_residual(fitter.evidence, best.residual, search.nominal.residual)


def search_pairs(fitter: Fitter, search: Search, judge: Judge, thresholds: Thresholds,
                 progress: Callable[[str], None], alike: Alike, cut: Cut | None = None) -> None:
    """Fit second effects beside the best, where these leave something that they could explain."""
    names = [name for name in EFFECTS if cut is None or cut.allows(name)]
    removable = Removable(judge.evidence, search.nominal.residual)
    singles = _singles(fitter, search, judge, removable)
    best = singles[0]
    if best.excess <= thresholds.leftover:
        return
    # A quiet effect in many rows may come first, with nothing beside it; or two that need each
    # other come to nothing alone.
    loudest = max(singles, key=lambda single: single.removed)
    bases = [best if best.gain > thresholds.detect else loudest,
             contenders(singles, thresholds)[0]]
    if (best.removed < thresholds.alone
            or 1.0 - loudest.removed < thresholds.halves * (1.0 - best.removed)):
        bases.append(loudest)
    if best.removed < thresholds.half:
        # Where no one explains most of it, the best may have found its place for the other.
        bases.append(next((single for single in singles[1:] if frozenset(
            (best.name, single.name)) not in alike.resembling), best))
    for base in bases:
        if (base.name not in search.asked and max(base.gain, base.removed) > 0.0
                and not _hushed(fitter, search, judge, best, thresholds)):
            search_partners(fitter, search, base.name, progress, names)
    if best.removed < thresholds.certain and not _hushed(fitter, search, judge, best, thresholds):
        exchange(fitter, search, progress, names)
    if search.bases:
        polish_pairs(fitter, search)
        wake_leading(fitter, search)

    def ask_alone(most: int, part: float) -> None:
        # What leaves hardly anything, or least, is asked what each of the two does alone.
        least = leading_pairs(fitter, search, most)
        for name in [name for name in search.fits if '+' in name]:
            left = 1.0 - removable.share(search.fits[name].residual)
            if (not set(name.split('+')) <= set(search.bases)
                    and (name in least or left < part * (1.0 - loudest.removed))):
                add_pair(fitter, search, search.fits[name].effects, search.fits[name].phi)

    ask_alone(LEADING, thresholds.finishes)
    search_mended(fitter, search, progress, names)
    forms = Forms(fitter, judge.cells)
    for name in leading_pairs(fitter, search, 1):
        # A relative of who is certain only fills in its form: of that, another would do the same.
        # Nor does what resembles two of which the second explains next to nothing explain more.
        if ((best.removed < thresholds.certain or not is_relative(best.name, name, alike.kin))
                and explained(forms, search, name).nats > 0.5 * thresholds.second):
            exchange_alike(fitter, search, name, alike.resembling, progress)
            # One of these may leave least.  Where no one explains most, all are asked that leave
            # far less: it takes two, whatever leads.
            ask_alone(1, 0.0 if best.removed >= thresholds.half else thresholds.halves)


def _hushed(fitter: Fitter, search: Search, judge: Judge, best: Ranked, t: Thresholds) -> bool:
    """
    Tell whether a pair leaves next to nothing of the recording that the best leaves loudest.

    Others may do as well, but then they resemble its two, which is asked later.
    """
    most = max(t.excess, t.hushes * best.excess)
    quiet = {name for name, fit in search.fits.items()
             if '+' in name and judge.structure(fit.residual) < most}
    # Which one leads takes simulations.
    return bool(quiet) and not quiet.isdisjoint(leading_pairs(fitter, search, 1))


def _without_colour(fitter: Fitter, search: Search, judge: Judge) -> float:
    """Return the structure that is left without what may be the colour of the noise."""
    evidence = fitter.evidence
    simulated = simulate_set(fitter.device_with({}, search.nominal.phi),
                             [track.recording for track in evidence.tracks])
    louder = of_any_colour(evidence, simulated)
    return replace(judge, evidence=louder).structure(
        reweigh(evidence, louder)(search.nominal.residual))


def _singles(fitter: Fitter, search: Search, judge: Judge, removable: Removable
             ) -> list[Ranked]:
    return rank([n for n in search.fits if '+' not in n], fitter, search, judge, removable)


def decide_search(fitter: Fitter, search: Search, judge: Judge, ceiling: float, alike: Alike,
                  thresholds: Thresholds, progress: Callable[[str], None],
                  cut: Cut | None = None) -> Decision:
    """
    Rank all that was fitted, and decide.

    Parameters
    ----------
    fitter : Fitter
        With which all was fitted.
    search : Search
        All fits.
    judge : Judge
        Scores them.
    ceiling : float
        Part of the removable gap that a flexible correction removes.
    alike : Alike
        What the recordings cannot tell apart.
    thresholds : Thresholds
        What was learned on the development set.
    progress : callable
        Called with a sentence at every stage.
    cut : Cut, optional
        What a look at both sides of the terminals told.

    """
    # What re-tuning removes is calibration, not a cause.
    removable = Removable(judge.evidence, search.nominal.residual)
    singles = _singles(fitter, search, judge, removable)
    best = singles[0]
    forms = Forms(fitter, judge.cells)

    def ranked(kept: Collection[str]) -> list[Ranked]:
        def corrected(pair):
            if best.name in pair.name.split('+') and (
                    second_explains(best, pair, thresholds, alike.kin) or pair.name in kept
                    or is_beyond_form(best, pair, thresholds, alike.kin)
                    or stands_clear(best, pair, thresholds, alike.kin)
                    or are_two_of_a_kind(best, pair, thresholds, alike.kin)):
                return _by_all_rows(fitter, search, judge, removable, pair, best.name)
            return pair

        return parallel(corrected, borne(rank_pairs(forms, search, judge, removable, kept)))

    def borne(pairs: list[Ranked]) -> list[Ranked]:
        # What is driven by the measured voltage may tell that a second is not there at all.
        return [pair for pair in pairs if cut is None or pair.name == cut.pair
                or cut.bears(search.fits[pair.name].effects)]

    pairs = ranked([cut.pair] if cut else [])
    structure = judge.structure(search.nominal.residual)
    hidden = borne(rank_mended(forms, search, judge, removable))
    verdict = decide(singles, [*pairs, *hidden], ceiling, structure, alike.groups, thresholds,
                     alike.kin, cut)
    if (verdict.word == 'UNKNOWN' and cut is None and best.removed < thresholds.half
            and structure > thresholds.excess
            and _without_colour(fitter, search, judge) < thresholds.excess):
        verdict = Verdict('NO_GAP', (), (), 'what is left after re-tuning the nominal parameters '
                          'within their uncertainty is noise, the colour of which shows where '
                          'rows are averaged', thresholds.nothing, 1.0 - thresholds.nothing)
    if verdict.word == 'MULTIPLE':
        name = pair_of(*verdict.selected)
        resembling = alike.resembling.union(cut.resembling if cut else ())
        asked = exchange_alike(fitter, search, name, resembling, progress)
        # Both may stand for another, each as long as the other does.
        best_pair = min((name, *asked), key=lambda each: forms.nats(search.fits[each]))
        if best_pair != name and _excess(judge, search, best_pair) > thresholds.heard:
            more = exchange_alike(fitter, search, best_pair, resembling, progress)
            asked = list(dict.fromkeys((*asked, *(each for each in more if each != name))))
            best_pair = min((name, *asked), key=lambda each: forms.nats(search.fits[each]))
        if _excess(judge, search, best_pair) > thresholds.heard:
            asked = [*asked, *exchange_both(fitter, search, best_pair, resembling, progress)]
        pairs = ranked([name, *asked])
        rivals = pairs
        if any(pair.name == name for pair in hidden):
            # What only mends the form of the first explains more than a second that it hid.
            rivals = rivals_beside_mended(
                name, best, [pair for pair in pairs if pair.name in (name, *asked)], hidden,
                thresholds, alike.kin)
        elif cut is None or name != cut.pair:
            rivals = rivals_of(name, best, pairs, thresholds, alike.kin)
        verdict = tie_pairs(verdict, rivals, singles, thresholds, cut, alike.groups)
    return Decision(judge, removable, singles, pairs, ceiling, structure, alike, verdict, cut)
