# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""From scores to words: NO_GAP, CAUSE, MULTIPLE, AMBIGUOUS, UNKNOWN, NOT_IDENTIFIABLE."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace
import math
from operator import attrgetter

import numpy as np
from piezo_stack_sim.effects.registry import EFFECTS
from piezo_stack_sim.gap.deciding.ranked import DEFAULTS, Ranked, Thresholds
from piezo_stack_sim.gap.deciding.second import (
    are_two_of_a_kind, counts, is_in_the_shade, is_mere_form, is_outshone, stands_clear,
    well_formed)
from piezo_stack_sim.gap.quantities import significant, words

# The title of a report speaks of one channel, what decides is the sum.
OF_ALL = 'of the removable gap in all channels together'


def probabilities(ranked: list[Ranked], thresholds: Thresholds = DEFAULTS,
                  classes: Collection[Collection[str]] = ()) -> np.ndarray:
    """
    Return the probabilities of hypotheses, in their order, if one of them is the whole cause.

    A score is worth less than its nats, because no library holds the true form
    of an effect: differences are divided by a learned temperature, which grows
    with what even the best leaves unexplained.  Between effects that the
    recordings cannot tell apart hardly anything but the form makes a difference.
    Of two that do equally well the one with fewer numbers is the likelier: a stop
    without a gap is a spring, so that the stop does no worse where a spring is.  And of
    look-alikes so is the one that had fewer numbers to choose from their bounds, and who has
    come to rest within them.
    """
    able = contenders(ranked, thresholds)
    scored = {r.name: r.gain if r in able else -math.inf for r in ranked}
    # What one has over a simpler one that it cannot be told from is the form of that.
    gains = np.array([min(scored[r.name], scored.get(r.simpler, math.inf)) for r in ranked])
    best = able[0]
    # What the best leaves, no hypothesis of the library has the form of.
    unknown = thresholds.form + 0.05 * (1.0 - min(max(best.removed, 0.0), 1.0))
    temperature = thresholds.temperature + unknown * max(best.gain, 0.0)
    weight = np.exp((gains - gains.max()) / temperature)
    misled = thresholds.temperature + thresholds.alike_form * max(best.gain, 0.0)
    alike = _look_alikes(able, classes, thresholds)
    group = [i for i, each in enumerate(ranked) if each.name in alike]
    # Withheld rows have their say on who chose too much; where they cannot tell, this does.
    left = gains[group] - _spent([ranked[i] for i in group])
    share = np.exp((left - left.max()) / misled)
    weight[group] = weight[group].sum() * share / share.sum()
    weight *= np.exp(-thresholds.occam * np.array([r.parameters for r in ranked]))
    weight *= _trust(ranked, thresholds)
    return weight / weight.sum()


def _trust(ranked: list[Ranked], t: Thresholds) -> np.ndarray:
    """Return by how much hypotheses are less likely that would go on where nothing real is."""
    return np.array([t.distrust if each.stuck else 1.0 for each in ranked])


def _spent(alike: list[Ranked]) -> np.ndarray:
    """
    Return what the numbers of look-alikes cost them, those of as many numbers alike, in nats.

    How wide the bounds of a number are says little of how likely it is to be anywhere between.
    """
    counts = np.array([each.parameters for each in alike])
    spent = np.array([each.spent for each in alike])
    return np.array([spent[counts == count].mean() for count in counts])


def contenders(ranked: list[Ranked], t: Thresholds = DEFAULTS) -> list[Ranked]:
    """
    Return which hypotheses may be the whole cause, best first.

    All, unless the best by score leaves more than half of the gap and another removes most of
    it: then only who removes half.  A quiet effect in many rows scores more than a loud one in
    few.  Nor can another be it where the best removes most and no other a third of that: a ringing
    of a few periods has few rows that are independent, but nothing else looks like it.
    """
    if _is_alone(ranked, t):
        return ranked[:1]
    able = [r for r in ranked if r.gain > t.detect and r.removed >= t.half]
    if ranked[0].removed >= t.half or all(r.removed < t.most for r in able):
        return ranked
    return able


def _is_alone(ranked: list[Ranked], t: Thresholds) -> bool:
    """Tell whether the best removes most of a gap, and no other anything like it."""
    best = ranked[0]
    return best.removed > t.most and best.gain > 0.0 and all(
        r.removed < t.lone * best.removed for r in ranked[1:])


def outscored(verdict: Verdict, singles: list[Ranked], t: Thresholds = DEFAULTS
              ) -> str | None:
    """
    Return who predicts more rows than the one cause named, but removes too little to be it.

    Parameters
    ----------
    verdict : Verdict
        What was decided.
    singles : list of Ranked
        Single effects, the best score first.
    t : Thresholds, optional
        The limits it was decided with.

    Returns
    -------
    str or None
        Its id: perhaps a second cause.

    """
    alone = len(verdict.selected) == 1
    return singles[0].name if alone and singles[0] not in contenders(singles, t) else None


def _look_alikes(ranked: list[Ranked], classes: Collection[Collection[str]], t: Thresholds
                 ) -> set[str]:
    """Return those who look like the best and leave about as little, the best included."""
    alike = {name for group in classes if ranked[0].name in group for name in group}
    return {ranked[0].name} | {each.name for each in ranked
                               if each.name in alike and _as_good(each, ranked[0], t)}


@dataclass(frozen=True)
class Cut:
    """
    What cutting the model at its terminals tells, where the voltage there is wrong.

    ``known`` tells whether an effect of the drive explains the voltage, ``misread`` whether what
    it drives does not follow it, so that it was measured wrong, ``pair`` is the name of that with
    what clearly acts behind the terminals ('' for nothing), ``removed`` the part of the gap behind
    them that this removes, ``resembling`` are effects that look much alike on one side, by twos,
    ``supported`` are effects behind the terminals that explain anything there,
    or of which hardly anything is seen there, ``chances`` how likely such pairs are, by what each
    side tells alone.  ``bears`` tells of effects with their numbers (SI) whether what was measured
    behind the terminals has room for them.
    """

    known: bool
    pair: str = ''
    removed: float = 0.0
    resembling: frozenset[frozenset[str]] = frozenset()
    supported: frozenset[str] = frozenset()
    chances: Mapping[str, float] = field(default_factory=dict)
    bears: Callable[[Mapping[str, dict[str, float]]], bool] = field(
        default=lambda effects: True, compare=False, repr=False)
    misread: bool = False

    def allows(self, effect: str) -> bool:
        """Tell whether a second effect could explain anything on its side of the terminals."""
        return EFFECTS[effect].block == 'drive' or effect in self.supported


@dataclass(frozen=True)
class Verdict:
    """
    The answer.

    ``selected`` are the effects switched on, the stronger first, ``tie`` those that
    cannot be told apart (of two causes: what may be exchanged for what), ``confidence`` the
    probability that the verdict is right, ``single`` that one effect of the library is the whole
    cause, ``block`` where it is known to be, whatever it is, ``pairs`` the probabilities of the
    pairs that tie.
    """

    word: str
    selected: tuple[str, ...]
    tie: tuple[str, ...]
    reason: str
    confidence: float
    single: float
    block: str | None = None
    pairs: Mapping[str, float] = field(default_factory=dict)

    @property
    def shows_no_gap(self) -> bool:
        """Whether no gap was seen, for there is none or because nothing was asked."""
        return self.word == 'NO_GAP' or self.word == 'NOT_IDENTIFIABLE' and not self.tie


def decide(singles: list[Ranked], pairs: list[Ranked], ceiling: float, structure: float,
           classes: Collection[Collection[str]], thresholds: Thresholds = DEFAULTS,
           kin: Collection[frozenset[str]] = (), cut: Cut | None = None) -> Verdict:
    """
    Say what the scores mean.

    Parameters
    ----------
    singles, pairs : list of Ranked
        Best first; ``pairs`` may be empty.
    ceiling : float
        Part of the removable gap that a flexible correction removes.
    structure : float
        Largest mean square over the noise, minus one, that the re-tuned nominal
        device leaves in a track.
    classes : collection of collections of str
        Effects that these recordings cannot tell apart but by their form.
    thresholds : Thresholds
        What was learned on the development set.
    kin : collection of frozenset of str
        Pairs of effects that resemble each other.
    cut : Cut, optional
        What a look at both sides of the terminals told.

    """
    t = thresholds
    best = singles[0]
    explained = max(best.removed, 1.0 - best.left)

    def whole(pair: Ranked) -> bool:
        return (pair.gain > t.detect and (pair.removed >= t.half or pair.excess < t.excess)
                and max(explained, pair.removed, 1.0 - pair.left) >= t.explained)

    def two(pair: Ranked, why: str) -> Verdict:
        sure = pair.odds(t.two)
        return Verdict('MULTIPLE', _by_rank(pair, singles, t), (), why, sure, 1.0 - sure,
                       pairs={pair.name: sure})

    if cut is not None:
        if cut.misread:
            return Verdict('UNKNOWN', (), (), 'the voltage at the terminals is wrong, and what '
                           'it drives does not follow it: it was measured wrong', t.unknown,
                           1.0 - t.unknown, 'sensor')
        if not cut.known:
            return Verdict('UNKNOWN', (), (), 'no effect of the drive explains what is wrong with '
                           'the voltage at the terminals', t.unknown, 1.0 - t.unknown, 'drive')
        for pair in pairs:
            enough = t.hint if cut.removed >= t.behind else t.second
            if pair.name == cut.pair and pair.second > enough and pair.gain > t.detect:
                return two(pair, _why_behind(cut))
        pairs = [pair for pair in pairs if all(map(cut.allows, pair.name.split('+')))]
    for pair in filter(whole, pairs):
        if is_in_the_shade(best, pair, pairs, t, kin):
            continue
        if counts(best, pair, t, kin):
            return two(pair, _why_two(best, pair))
        if stands_clear(best, pair, t, kin):
            return two(pair, _why_clear(best, pair))
    formed = max((pair for pair in pairs if pair.form < math.inf),
                 key=lambda pair: pair.form, default=None)
    if (formed is not None and whole(formed) and well_formed(best, formed, t, kin)
            and not is_outshone(best, formed, pairs, t, kin)):
        return two(formed, _why_formed(best, formed))
    for pair in filter(whole, pairs):
        if are_two_of_a_kind(best, pair, t, kin) and not is_mere_form(best, pair, pairs):
            return two(pair, _why_two(best, pair))
    alone = _is_alone(singles, t)
    singles = contenders(singles, t)
    chance = probabilities(singles, t, classes)
    best = singles[0]
    explained = max(best.removed, 1.0 - best.left)
    # Small, but not chance: it hardly stands out, or leaves nothing that does.
    clear = best.gain > t.sure and min(structure, best.excess) < t.excess
    hidden = clear and best.removed < t.trace
    poor = best.removed < t.half and not hidden
    # What a few dozen features predict of withheld rows, the right effect does, too.
    poor |= (structure > t.excess and best.removed < t.clear_first and not hidden
             and 1.0 - ceiling < t.flexible * (1.0 - best.removed))
    # A drift has hardly any rows that are independent, but may be all that is wrong.
    obvious = structure > t.excess and best.gain > 0.0 and (
        alone or best.removed > t.clear_first)
    weak = not clear and not obvious and (best.gain < t.detect + 2.0 * best.parameters
                                          or explained < t.explained)
    # A little more than the noise in one recording, of which nothing that was commanded or
    # simulated tells any part, is no structure either.
    quiet = structure < (t.excess if max(ceiling, best.removed) > t.trace else t.unforetold)
    if quiet and not clear and (poor or weak) and ceiling < t.predicted:
        return Verdict('NO_GAP', (), (), 'what is left after re-tuning the nominal '
                       'parameters within their uncertainty is noise', t.nothing,
                       1.0 - t.nothing)
    if poor or weak or best.odds(t.one, hidden) < t.believed:
        known = (f'the best effect, {words(best.name)}, removes {_percent(best.removed)} '
                 f'{OF_ALL}' if best.gain > 0.0 else 'no effect removes any of it')
        left = ('no recording stands out of the noise' if structure < t.excess else
                f'structure of {significant(1.0 + structure)} times the noise power is left')
        return Verdict('UNKNOWN', (), (), f'{left}; {known}, a flexible correction '
                       f'{_percent(ceiling)}', *_how_unknown(best, structure, t))
    tie = tie_of(singles, chance, classes, t)
    named = next(r for r in singles if r.name == tie[0])
    sure = named.odds(t.one, hidden)
    among = sure * float(sum(c for r, c in zip(singles, chance) if r.name in tie))
    if len(tie) >= t.too_many:
        return Verdict('NOT_IDENTIFIABLE', (), tie, f'{len(tie)} effects explain the gap about '
                       'equally well with these channels', among, sure)
    if len(tie) > 1:
        return Verdict('AMBIGUOUS', (named.name,), tie, 'these recordings do not decide between '
                       f'{len(tie)} effects', t.left_open * among, sure)
    does = (f'removes {_percent(named.removed)} {OF_ALL}' if explained >= t.explained
            else 'explains what hardly stands out of the noise')
    return Verdict('CAUSE', (named.name,), (named.name,), f'{words(named.name)} {does} and '
                   'nothing else in the library comes close', among, sure)


def _how_unknown(best: Ranked, structure: float, t: Thresholds) -> tuple[float, float]:
    """Return how sure it is that the library lacks it, and that one effect of it is the cause."""
    if best.removed > t.half_known or structure < t.faint:
        return t.doubtful, t.doubtful_single
    return t.unknown, 1.0 - t.unknown


def _by_rank(pair: Ranked, singles: list[Ranked], t: Thresholds) -> tuple[str, ...]:
    """Return the two effects of a pair, the stronger first."""
    able = contenders(singles, t)
    order = able + [single for single in singles if single not in able]
    ranks = {single.name: rank for rank, single in enumerate(order)}
    return tuple(sorted(pair.name.split('+'), key=lambda name: ranks.get(name, len(ranks))))


def _why_behind(cut: Cut) -> str:
    """Return why two effects are believed in that lie on two sides of the terminals."""
    first, second = sorted(cut.pair.split('+'), key=lambda name: EFFECTS[name].block != 'drive')
    reason = (f'{words(first)} is what is wrong with the voltage at the terminals; driven by the '
              f'measured voltage the rest has a gap, too, of which {words(second)} removes '
              f'{_percent(cut.removed)}')
    return reason


def _why_two(best: Ranked, pair: Ranked) -> str:
    """Return why two effects are believed in."""
    if pair.beside is not None:
        mended = pair.beside.name.split('+')
        first, second = sorted(pair.name.split('+'), key=lambda name: name not in mended)
        mends, = set(mended) - {first}
        return (f'{words(best.name)} removes {_percent(best.removed)} {OF_ALL}; of '
                f'what {words(first)} leaves together with {words(mends)}, which only mends its '
                f'form, {words(second)} explains {_percent(pair.part)} where it acts')
    first, second = sorted(pair.name.split('+'), key=lambda name: name != best.name)
    if first != best.name:
        return (f'{words(best.name)} removes {_percent(best.removed)} {OF_ALL}, '
                f'{words(first)} with {words(second)} {_percent(pair.removed)}; of what either '
                f'leaves where the other acts, that explains {_percent(pair.part)}')
    removes = (f'{words(first)} removes {_percent(best.removed)} {OF_ALL}, with '
               f'{words(second)} {_percent(pair.removed)}; ')
    if pair.part < DEFAULTS.finish_part:  # believed for how little is left, wherever it acts
        left = (1.0 - pair.removed) / max(1.0 - best.removed, 1e-9)
        return f'{removes}of what the first leaves the two leave {_percent(left)}'
    return (f'{removes}of what the first leaves where the second acts, that explains '
            f'{_percent(pair.part)}')


def _why_clear(best: Ranked, pair: Ranked) -> str:
    """Return why a second effect is believed in, however much the form of the first leaves."""
    second, = set(pair.name.split('+')) - {best.name}
    return (f'{words(best.name)} removes {_percent(best.removed)} {OF_ALL}; of what '
            f'it leaves where it does less than {words(second)}, that explains '
            f'{_percent(pair.clear_part)}')


def _why_formed(best: Ranked, pair: Ranked) -> str:
    """Return why a second effect is believed in that the form of the first could not mend."""
    second, = set(pair.name.split('+')) - {best.name}
    return (f'{words(best.name)} removes {_percent(best.removed)} {OF_ALL}, with '
            f'{words(second)} {_percent(pair.removed)}; what the first leaves is not what an '
            'error of its form would be')


def tie_pairs(verdict: Verdict, pairs: list[Ranked], singles: list[Ranked],
              thresholds: Thresholds = DEFAULTS, cut: Cut | None = None,
              classes: Collection[Collection[str]] = ()) -> Verdict:
    """
    Return the verdict of two causes with the pairs that explain the gap as well.

    Parameters
    ----------
    verdict : Verdict
        MULTIPLE, of one pair.
    pairs, singles : list of Ranked
        Those that were looked at, that pair among them.
    thresholds : Thresholds, optional
        What was learned on the development set.
    cut : Cut, optional
        What a look at both sides of the terminals told.
    classes : collection of collections of str, optional
        Effects that these recordings cannot tell apart but by their form.

    """
    t = thresholds
    chosen = next(pair for pair in pairs if set(pair.name.split('+')) == set(verdict.selected))
    most = t.alike * (1.0 - chosen.removed) + 0.01
    able = [chosen, *(pair for pair in pairs if pair.over < math.inf
                      and 1.0 - pair.removed < most and pair is not chosen)]
    # What leaves a recording loud is none of two where others like it leave all of them quiet.
    quiet = [pair for pair in able if pair.excess < t.heard]
    if quiet and t.tenth * chosen.excess > t.heard:
        weight = _weights(quiet, t)
    elif cut is not None and cut.pair == chosen.name and cut.removed >= t.behind:
        # Driven by the measured voltage no form of a driver misleads.
        weight = {pair: cut.chances.get(pair.name, 0.0) for pair in able}
    else:
        weight = _weights(able, t)
    likeliest = sorted(weight, key=lambda pair: -weight[pair])
    tied = [pair for pair in likeliest if weight[pair] >= t.as_likely * weight[likeliest[0]]
            or _exchanges_alike(pair, likeliest[0], classes, t)]
    total = sum(weight[pair] for pair in tied)
    common = set.intersection(*(set(pair.name.split('+')) for pair in tied))
    reason = verdict.reason if tied[0] is chosen else _why_two(singles[0], tied[0])
    if len(tied) > 1:
        others = ' or '.join(words(pair.name) for pair in tied[1:])
        reason += f'; these recordings do not tell it from {others}'
    return replace(
        verdict, selected=_by_rank(tied[0], singles, t),
        tie=tuple(dict.fromkeys(name for pair in tied for name in pair.name.split('+')
                                if name not in common)),
        reason=reason,
        pairs={pair.name: verdict.confidence * weight[pair] / total for pair in tied})


def _exchanges_alike(pair: Ranked, best: Ranked, classes: Collection[Collection[str]],
                     t: Thresholds) -> bool:
    """Tell whether a pair has a look-alike in the place of one of two, and leaves as little."""
    names, others = set(best.name.split('+')), set(pair.name.split('+'))
    exchanged = names ^ others
    return (len(exchanged) == 2 and any(exchanged <= set(group) for group in classes)
            and _as_good(pair, best, t))


def _as_good(one: Ranked, best: Ranked, t: Thresholds) -> bool:
    """Tell whether a look-alike leaves about as little as the best."""
    most = min(t.alike * (1.0 - best.removed), 1.0 - t.as_good * best.removed) + 0.01
    return 1.0 - one.removed < most


def _weights(pairs: list[Ranked], t: Thresholds) -> dict[Ranked, float]:
    """Return how likely pairs are against each other: by where they act, and by all rows."""
    known = {pair.name: pair for pair in pairs}

    def scores(of: Callable[[Ranked], float]) -> list[float]:
        # What one has over a simpler one that it cannot be told from is the form of that.
        return [min(of(pair), of(known.get(pair.simpler, pair))) - pair.spent for pair in pairs]

    over, gain = (np.array(scores(attrgetter(score))) for score in ('over', 'gain'))
    # Where none is better than one effect alone, some cells of the first drown the second.
    there = t.temperature + t.alike_pair * over.max() if over.max() > 0.0 else math.inf
    rows = t.temperature + t.alike_form * max(gain.max(), 0.0)
    weight = np.exp((over - over.max()) / there + (gain - gain.max()) / rows
                    - t.occam * np.array([pair.parameters for pair in pairs]))
    weight *= _trust(pairs, t)
    return dict(zip(pairs, weight.tolist()))


def _percent(part: float) -> str:
    percent = 100.0 * min(max(part, 0.0), 1.0)
    # Where two leave a hundredth of what one does, both would round to all of it.
    return f'{percent:.2f} %' if 99.5 <= percent < 99.995 else f'{percent:.0f} %'


def tie_of(singles, chance, classes, t: Thresholds) -> tuple[str, ...]:
    """Return the effects that cannot be told from the best, the likeliest first."""
    tie, covered = [], 0.0
    likeliest = sorted(zip(singles, chance), key=lambda row: -row[1])
    for ranked, probability in likeliest:
        if covered < t.cover or probability > t.together * likeliest[0][1]:
            if probability > 0.002:
                tie.append(ranked.name)
                covered += probability
    alike = _look_alikes(singles, classes, t)
    return (*tie, *(r.name for r in singles if r.name in alike and r.name not in tie))
