# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Whether a second effect counts beside a first, or only fills in what the form of that misses.

No library holds the true form of an effect, so that hardly any first effect leaves nothing but
noise.  What it leaves is a part of what it does, lies where it acts, and is what its relatives do.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
import math
import operator

from piezo_stack_sim.effects.registry import EFFECTS
from piezo_stack_sim.gap.deciding.ranked import Ranked, Thresholds
from piezo_stack_sim.gap.fitting.form import are_alike_in_form


def second_explains(best: Ranked, pair: Ranked, t: Thresholds,
                    kin: Collection[frozenset[str]]) -> bool:
    """Tell whether a second effect explains enough where it acts."""
    if pair.beside is not None:
        # Where it leaves hardly anything, it need not explain as much of where it acts.
        finishes = 1.0 - pair.removed <= t.finishes * (1.0 - pair.beside.removed)
        part = t.second_part if finishes else t.mended_part
        return (not are_relatives(best, pair, kin)
                and pair.part > part and pair.over > 0.5 * t.second
                and pair.second > max(t.second, t.finish_form * best.gain))
    if (t.second < pair.over < math.inf and not are_relatives(best, pair, kin)
            and 1.0 - pair.removed < t.completes * (1.0 - best.removed)):
        return True
    if _quietens(best, pair, t) and not are_relatives(best, pair, kin):
        return True
    # What the form of the first misses is a part of what it explains, but leaves little.
    finishes = best.removed < t.alone and 1.0 - pair.removed <= t.finishes * (1.0 - best.removed)
    form = t.finish_form if finishes else t.second_form
    if pair.second < max(t.second, form * best.gain) or pair.over < 0.5 * t.second:
        return False
    if are_relatives(best, pair, kin):
        # What the form of the first misses, a relative fills in: it takes more to believe in two.
        halves = (1.0 - pair.removed <= t.halves * (1.0 - best.removed)
                  and pair.left <= t.halves * best.left
                  and t.half_formed < pair.form < math.inf)
        return best.removed < t.alone and pair.part > (
            t.second_part if halves else t.relative_part)
    return pair.part > (t.finish_part if finishes else t.second_part)


def _quietens(best: Ranked, pair: Ranked, t: Thresholds) -> bool:
    """
    Tell whether a second effect explains much of what is left, and of the recording left loudest.

    A drift has hardly any rows that are independent, so that it needs no more nats: what fills
    in the form of the first does neither.
    """
    return (best.excess > t.heard and pair.excess <= t.halves * best.excess
            and pair.part > t.quiet_part
            and 0.5 * t.second < min(pair.second, pair.over) < math.inf)


def stands_clear(best: Ranked, pair: Ranked, t: Thresholds,
                 kin: Collection[frozenset[str]]) -> bool:
    """
    Tell whether a second effect explains enough where the first hardly acts.

    What the form of the first misses is no more than a part of what it does, so that it does not
    matter how much of that is left elsewhere.
    """
    return (best.name in pair.name.split('+') and best.removed > t.clear_first
            and pair.clear > t.clear and pair.clear_part > t.clear_part
            and pair.over > 0.5 * t.second and not are_relatives(best, pair, kin))


def is_beyond_form(best: Ranked, pair: Ranked, t: Thresholds,
                   kin: Collection[frozenset[str]]) -> bool:
    """
    Tell whether two explain what one could only by an error of form that hardly any form has.

    As :mod:`piezo_stack_sim.gap.fitting.form` judges it.  What a relative of the first does is an
    error of its form.
    """
    return (best.name in pair.name.split('+') and t.formed < pair.form < math.inf
            and pair.wrong < t.misformed and not are_relatives(best, pair, kin))


def well_formed(best: Ranked, pair: Ranked, t: Thresholds,
                kin: Collection[frozenset[str]]) -> bool:
    """
    Tell whether two count for their form, once they are fitted as they correct the device best.

    Two that leave more of the gap then only bend to an error of the first's form.  So do two of
    which a number comes to rest at a bound, and none of the one does.
    """
    return (is_beyond_form(best, pair, t, kin) and _loses_little(best, pair, t)
            and not _fills_in(best, pair, t) and (best.stuck or not pair.stuck))


def are_two_of_a_kind(best: Ranked, pair: Ranked, t: Thresholds,
                      kin: Collection[frozenset[str]]) -> bool:
    """
    Tell whether two that resemble each other are both needed.

    A relative fills in what the form of the first misses, but not to the noise where that is
    loud, nor to a hundredth where that is far from it, nor most of what is left where the first
    hardly acts.  Of one that is known to be just what that form misses it takes all of this, and
    a first that leaves more than forms miss.  What explains nearly all
    that stood out of the noise, and leaves no more than that, or hardly anything of the gap,
    needs fewer nats; what leaves a twentieth of the gap, and is far more than an error of form,
    need not reach the noise.  Nor does what explains more than half of what is left, in many
    nats, by the very form it has.
    """
    one, other = pair.name.split('+')
    if not (t.second < pair.over < math.inf and t.excused < pair.form < math.inf
            and pair.wrong < t.misformed and are_relatives(best, pair, kin)):
        return False
    if are_alike_in_form(one, other):
        return _is_more_than_form(best, pair, t) or _shows_elsewhere(best, pair, t)
    if EFFECTS[one].is_late and EFFECTS[other].is_late:
        # A filter of two poles is a lag with a delay, whichever way one looks at it: only what
        # comes late in a channel that the first does not reach is another.
        return _is_clear_of_relative(pair, t) and pair.form > t.formed
    finishes = 1.0 - pair.removed <= t.finishes * (1.0 - best.removed)
    if (pair.excess < t.tenth * best.excess and (pair.excess < t.heard or finishes)
            and pair.part > t.nearly_all and min(pair.second, 0.5 * pair.over) > t.second):
        return True
    if (pair.part > t.mended_part and min(pair.second, pair.over) > t.formed
            and pair.wrong < t.unmistaken
            and 1.0 - pair.removed < t.halves * (1.0 - best.removed)):
        return True
    if pair.form < t.formed:
        return False
    if (1.0 - pair.removed < t.twentieth * (1.0 - best.removed) and pair.part > t.quiet_part
            and pair.form > t.far * t.formed and pair.over > t.far * t.formed / 2.0):
        return True
    quiet = pair.excess < t.excess or (
        pair.excess < t.hushes * best.excess and pair.part > t.relative_part)
    silences = (best.excess > t.heard and quiet
                and 1.0 - pair.removed < t.completes * (1.0 - best.removed))
    return silences or _is_clear_of_relative(pair, t)


def _is_more_than_form(best: Ranked, pair: Ranked, t: Thresholds) -> bool:
    """
    Tell whether a second that fills in what the form of the first misses is needed all the same.

    Where the first leaves more than forms miss, and with the second hardly anything is left: of
    the gap, of the recording left loudest, where the first hardly acts, and of its own form.
    """
    return (best.name in pair.name.split('+') and best.removed < t.formless
            and 1.0 - pair.removed < t.completes * (1.0 - best.removed)
            and pair.excess < t.twentieth * best.excess and pair.part > t.nearly_all
            and pair.form > t.formed and pair.wrong < t.unmistaken
            and _is_clear_of_relative(pair, t))


def _shows_elsewhere(best: Ranked, pair: Ranked, t: Thresholds) -> bool:
    """
    Tell whether what fills in the form of the first explains much where that hardly acts, too.

    What a form misses is a part of what it does: it shows nowhere else.
    """
    return (best.name in pair.name.split('+') and min(pair.second, pair.over) > t.formed
            and pair.form > t.formed and pair.clear > t.relative_clear
            and pair.clear_part > t.clear_part)


def _is_clear_of_relative(pair: Ranked, t: Thresholds) -> bool:
    """Tell whether a second explains most of what is left where a relative hardly acts."""
    return pair.clear > t.relative_clear and pair.clear_part > t.relative_clear_part


def is_mere_form(best: Ranked, pair: Ranked, pairs: Collection[Ranked]) -> bool:
    """Tell whether what the form of the first is known to miss explains more than a second."""
    return best.name in pair.name.split('+') and any(
        best.name in other.name.split('+') and are_alike_in_form(*other.name.split('+'))
        and other.second > pair.second and other.removed >= pair.removed for other in pairs)


def counts(best: Ranked, pair: Ranked, t: Thresholds, kin: Collection[frozenset[str]]) -> bool:
    """Tell whether a second effect is needed: where it acts, and all in all."""
    if (_takes_its_place(best, pair, t, kin) or _fills_in(best, pair, t)
            or _bends_to_a_bound(best, pair, t)):
        return False
    # Else it fills in some cells what the form of the first misses, and no more.
    first = pair.beside or best
    # What takes nearly all of the loudest, and most of what is left where it acts, no form does.
    takes = (first.excess > t.heard and pair.excess < t.tenth * first.excess
             and pair.part > t.mended_part)
    return (pair.form > (0.0 if takes else t.excused) and second_explains(best, pair, t, kin)
            and _loses_little(best, pair, t) and (
                pair.left <= t.still * first.left
                or 1.0 - pair.removed <= t.stays * (1.0 - first.removed)
                or first.excess > t.heard and pair.excess <= t.halves * first.excess))


def _fills_in(best: Ranked, pair: Ranked, t: Thresholds) -> bool:
    """
    Tell whether a second shows only where the first acts, and leaves the loudest louder still.

    It is bent to a part of what the form of the first misses, and to nothing else: where the
    first hardly acts it does not explain most of the little there is.
    """
    return (pair.beside is None and best.name in pair.name.split('+') and pair.clear < t.clear
            and pair.clear_part <= t.clear_part and pair.excess > max(best.excess, t.heard))


def _bends_to_a_bound(best: Ranked, pair: Ranked, t: Thresholds) -> bool:
    """
    Tell whether a number of two comes to rest at a bound, and none of the first alone.

    What drives it there is an error of form, unless most of what is left where the first hardly
    acts is explained.
    """
    return (pair.stuck and not (pair.beside or best).stuck
            and pair.clear_part <= t.clear_part)


def _takes_its_place(best: Ranked, pair: Ranked, t: Thresholds, kin: Collection[frozenset[str]]
                     ) -> bool:
    """
    Tell whether two stand for one that explains nearly all: a relative, and what mends its form.

    Unless they silence the recording that the one leaves loudest.
    """
    names = pair.name.split('+')
    return (best.name not in names and best.removed > t.alone
            and pair.excess >= t.halves * best.excess
            and any(frozenset((best.name, name)) in kin for name in names))


def rivals_of(name: str, best: Ranked, pairs: Collection[Ranked], t: Thresholds,
              kin: Collection[frozenset[str]]) -> list[Ranked]:
    """
    Return the pairs that a believed pair may stand for, itself among them.

    Each must be believed in for itself: else one that is not would be named for leaving as little.
    Where the second shows only where the first hardly acts, so must that of the others.  Only one
    that differs by what resembles one of the two, and does as well by all rows or better by all
    that counts for it, is left open by whatever rule that was believed in.
    """
    def rules(pair):
        return {rule for rule in (counts, stands_clear, well_formed, are_two_of_a_kind)
                if rule(best, pair, t, kin)}

    def is_twin(pair):
        return (pair.over < math.inf
                and frozenset(set(name.split('+')) ^ set(pair.name.split('+'))) in kin
                and pair.gain > chosen.gain - t.temperature
                and (1.0 - pair.removed <= t.loses * (1.0 - chosen.removed)
                     or all(map(operator.gt, worth(pair), worth(chosen)))))

    def worth(pair):
        return pair.over, pair.second, pair.part, pair.form, pair.gain, -pair.left

    known = {pair: rules(pair) for pair in pairs}
    chosen, by = next((pair, rules) for pair, rules in known.items() if pair.name == name)
    able = {stands_clear} if by == {stands_clear} else {
        counts, stands_clear, well_formed, are_two_of_a_kind}
    return [pair for pair, rules in known.items()
            if pair is chosen or rules & able or is_twin(pair)]


def rivals_beside_mended(name: str, best: Ranked, pairs: list[Ranked], hidden: list[Ranked],
                         t: Thresholds, kin: Collection[frozenset[str]]) -> list[Ranked]:
    """
    Return the pairs that one may stand for whose second shows beside a mended first only.

    Others that leave the first as it was are hidden by its form, too: they count by what they do
    beside the mended one, against what this does there, if they would be believed in for that.
    """
    chosen = next(pair for pair in pairs if pair.name == name)
    seen = next(pair for pair in hidden if pair.name == name)
    first, = set(name.split('+')) & set((seen.beside or best).name.split('+'))
    moved = [replace(pair, over=chosen.over + pair.over - seen.over,
                     gain=chosen.gain + pair.gain - seen.gain,
                     removed=chosen.removed + pair.removed - seen.removed,
                     parameters=chosen.parameters + pair.parameters - seen.parameters,
                     spent=chosen.spent + pair.spent - seen.spent)
             for pair in hidden if pair is not seen and counts(best, pair, t, kin)]
    return [chosen, *moved, *(pair for pair in pairs if first not in pair.name.split('+'))]


def _loses_little(best: Ranked, pair: Ranked, t: Thresholds) -> bool:
    """
    Tell whether two remove as much as one, or the second shows where the first hardly acts.

    Else they bend to what the form of the first misses where that is quiet, in many rows.
    """
    return (1.0 - pair.removed <= t.loses * (1.0 - best.removed)
            or pair.clear > t.clear and pair.clear_part > t.clear_part)


def are_relatives(best: Ranked, pair: Ranked, kin: Collection[frozenset[str]]) -> bool:
    """
    Tell whether a pair is of effects that resemble each other, or the form of the first.

    Beside a first whose form another mends, whether the second resembles either, or their form.
    """
    names = frozenset(pair.name.split('+'))
    if pair.beside is not None:
        mended = frozenset(pair.beside.name.split('+'))
        return any(frozenset((first, second)) in kin or second in EFFECTS[first].form_like
                   for first in mended for second in names - mended)
    return is_relative(best.name, pair.name, kin)


def is_relative(first: str, pair: str, kin: Collection[frozenset[str]]) -> bool:
    """Tell whether the two of a pair resemble each other, or one the form of a first."""
    names = frozenset(pair.split('+'))
    if first not in names and all(frozenset((first, name)) in kin for name in names):
        return True  # together they only mend the form of what resembles both
    return names in kin or first in names and not names.isdisjoint(EFFECTS[first].form_like)


def is_in_the_shade(best: Ranked, pair: Ranked, pairs: list[Ranked], t: Thresholds,
                    kin: Collection[frozenset[str]]) -> bool:
    """
    Tell whether a relative of the first explains more than the second of a pair, and is none.

    That one only fills in what the form of the first misses: so does this, unless together with
    the first it leaves far less, all in all or of the recording left loudest.  The same where
    another mends that form, and where the relative explains about as much and leaves less.
    """
    def outshines(other):
        return other.second > pair.second or (
            other.second > t.nearly * pair.second and other.gain > pair.gain
            and other.removed > pair.removed)

    def leaves_far_less(other):
        return pair.left <= t.shade * other.left or pair.excess < t.halves * other.excess

    if pair.beside is not None:
        return any(other.beside is not None and other.second > pair.second
                   and are_relatives(best, other, kin) and not leaves_far_less(other)
                   for other in pairs)
    return best.name in pair.name.split('+') and any(
        best.name in other.name.split('+') and are_relatives(best, other, kin)
        and outshines(other) and not counts(best, other, t, kin) and not leaves_far_less(other)
        for other in pairs if other is not pair)


def is_outshone(best: Ranked, pair: Ranked, pairs: list[Ranked], t: Thresholds,
                kin: Collection[frozenset[str]]) -> bool:
    """Tell whether a relative of the first does about as much for its form, and leaves less."""
    return any(best.name in other.name.split('+') and are_relatives(best, other, kin)
               and t.nearly * pair.form < other.form < math.inf
               and other.gain > pair.gain and other.removed > pair.removed for other in pairs)
