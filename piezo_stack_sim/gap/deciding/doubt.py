# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Whether what a cause leaves speaks for another that the library lacks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from piezo_stack_sim.effects.registry import EFFECTS
from piezo_stack_sim.gap.cores import parallel
from piezo_stack_sim.gap.deciding.decision import Decision
from piezo_stack_sim.gap.deciding.ranked import Ranked, Thresholds
from piezo_stack_sim.gap.deciding.score import channel_power, Judge
from piezo_stack_sim.gap.deciding.verdict import OF_ALL, Verdict
from piezo_stack_sim.gap.fitting.candidates import Search
from piezo_stack_sim.gap.fitting.fit import Fit, Fitter
from piezo_stack_sim.gap.lacking.back_coupling import NOT_FELT, Suspect, suspect_block
from piezo_stack_sim.gap.lacking.course import (
    CLOCK, Course, REST, skewed, speaks_for_clock, suspect_play)
from piezo_stack_sim.gap.lacking.in_series import capacitor_in_series, SPRING
from piezo_stack_sim.gap.lacking.meeting import meet, meet_one, Met
from piezo_stack_sim.gap.lacking.strangers import PLAY
from piezo_stack_sim.gap.measured.forward import simulate_channels
from piezo_stack_sim.gap.measured.where import block_residuals, is_driver_loudest
from piezo_stack_sim.gap.quantities import words

_PLAY = Suspect('mechanical', 'the charge shows that the stack feels none of it: something has '
                'play')


TOLD = 0.6  # part of a gap, all tracks alike or by its power, that a stranger must explain
LEFT = 0.6  # part of what a cause leaves that one may leave who takes its place
WORTH = 0.03  # part of the gap that a cause must leave to be asked at all
STRUCTURED = 0.005  # and this, where what it leaves has structure
SPOILT = 6.0  # times the power that a channel had, or its noise, that no cause leaves it
EVEN, ALMOST = 0.5, 0.98  # chances: one is as likely as another, and what need not be said
RUBS = 'friction'  # what looks like play but for the charge: as often it is that
LIKE = 6.0  # times what it leaves that play may leave, whose form nobody knows
SURER = 10.0  # nats by which a stranger must be better than a cause


def doubted(fitter: Fitter, search: Search, decision: Decision, thresholds: Thresholds
            ) -> Decision:
    """
    Return a decision, or UNKNOWN where what its cause leaves tells of something else.

    Where something that the library lacks leaves clearly less, that is why
    (gap/lacking/strangers.py).  A clock that runs fast is late by ever more: in recordings that
    are alike long, much of that is what a lag does.  What a lag leaves of it no lag does.  A part
    that has play stops where one that rubs does, but the stack does not feel it: the charge tells.
    A capacitor in series with the stack looks like a spring beside it (gap/lacking/in_series.py).
    Without the charge what has play may look like what rubs.
    And what explains one channel by making another wrong that was right, explains nothing.

    Parameters
    ----------
    fitter : Fitter
        With which all was fitted.
    search : Search
        All fits.
    decision : Decision
        What was decided.
    thresholds : Thresholds
        What was learned on the development set.

    """
    verdict, best = decision.verdict, decision.singles[0]
    if verdict.selected and SPRING in (*verdict.selected, *verdict.tie):
        other = capacitor_in_series(
            fitter, decision.chosen(search) if SPRING in verdict.selected else search.fits[SPRING])
        if other.chance < EVEN:
            return _unknown(decision, other.suspect, thresholds, (
                f'{words(SPRING)} would explain as much, but it would be softer than such springs '
                'are, or the stack further from its file: '), 1.0 - other.chance)
        if other.chance < ALMOST:
            verdict = _less_sure(verdict, other.chance, f'{other.words}, which the library lacks, '
                                 'would explain it as well')
            decision = replace(decision, verdict=verdict)
    if verdict.selected == (RUBS,) and _may_be_play(fitter, search, decision):
        verdict = _less_sure(verdict, EVEN, 'play, which the library lacks, does much the same: '
                             'the charge would tell')
        decision = replace(decision, verdict=verdict)
    spoilt = _spoilt(search, decision)
    stranger = _stranger(fitter, search, decision, thresholds, asked=bool(spoilt))
    # What is wrong at the terminals is not explained by what lies behind.
    if stranger is not None and (
            stranger.suspect.block == 'drive' or stranger.misread == 'voltage'
            or not is_driver_loudest(_course(fitter, search.nominal)[0])):
        known = f'{_known(best)}, but ' if best.removed > 0.0 else ''
        return _unknown(decision, stranger.suspect, thresholds,
                        known if verdict.block is None else f'{verdict.reason}: ')
    if spoilt:
        causes = ' and '.join(map(words, verdict.selected))
        return _unknown(decision, Suspect('', f'{causes} would make the {spoilt} worse than it is '
                                          'without, so that it is something else'), thresholds)
    named = next((one for one in decision.singles if (one.name,) == verdict.selected), None)
    if verdict.word == 'UNKNOWN' and verdict.block is None and best.removed > thresholds.half:
        named = best
    if named is None or named.removed > thresholds.clear_first:
        return decision
    suspect: Suspect | None
    cuts, course = _course(fitter, search.nominal)
    # What a clock explains that the cause does not, or what is left beside the cause.
    if skewed(course) < REST * (1.0 - named.removed):
        suspect = CLOCK
    elif (EFFECTS[named.name].block == 'mechanical' and suspect_block(cuts) is NOT_FELT
            and not _is_felt(fitter, search, named.name)):
        suspect = None if suspect_play(course) is None else _PLAY
    else:
        suspect = speaks_for_clock(_course(fitter, search.correction(named.name))[1])
    if suspect is None:
        return decision
    return _unknown(decision, suspect, thresholds, _known(named) + (
        ', but ' if suspect is _PLAY else ', and of the rest '))


def _may_be_play(fitter: Fitter, search: Search, decision: Decision) -> bool:
    """Tell whether play does about as well as what rubs, and no charge tells the two apart."""
    if 'charge' in fitter.evidence.channels:
        return False
    played, rubbed = (1.0 - decision.removable.share(residual) for residual in (
        meet_one(fitter, search.nominal, PLAY).residual, decision.chosen(search).residual))
    return played < min(1.0 - TOLD, LIKE * rubbed)


def _less_sure(verdict: Verdict, chance: float, why: str) -> Verdict:
    """Return a verdict that is right with this chance only, if it would be right else."""
    return replace(verdict, confidence=verdict.confidence * chance,
                   single=verdict.single * chance,
                   pairs={name: chance * sure for name, sure in verdict.pairs.items()},
                   reason=f'{verdict.reason}; {why}')


def _is_felt(fitter: Fitter, search: Search, name: str) -> bool:
    """
    Tell whether a cause explains some of the charge, by itself and not by what is re-tuned.

    What the stack does not feel leaves the charge alone, so that a force there makes it worse.
    """
    fit = search.fits[name]
    told, *others = (
        channel_power(fitter.evidence, residual).get('charge', 0.0) for residual in (
            fit.residual, search.nominal.residual, fitter.residual_of({}, fit.phi, fit)))
    return told < min(others)


def _known(best: Ranked) -> str:
    """Return how much of the gap what the library has removes."""
    return f'{words(best.name)} removes {100.0 * best.removed:.0f} % {OF_ALL}'


def _stranger(fitter: Fitter, search: Search, decision: Decision, thresholds: Thresholds,
              asked: bool) -> Met | None:
    """
    Return what the library lacks and leaves clearly less than all of it, or None.

    It is ``asked`` for, or wherever a cause leaves much, or two may undo each other.
    """
    verdict, judge, removable = decision.verdict, decision.judge, decision.removable
    if verdict.word == 'NO_GAP':
        return None
    nominal = search.nominal.residual

    def explained(judge: Judge, residual: np.ndarray) -> float:
        left = judge.left(judge.powers(residual), judge.powers(nominal))
        return max(removable.share(residual), 1.0 - left)

    known = decision.chosen(search).residual if verdict.selected else nominal
    structured, found = judge.structure(known) > thresholds.excess, []
    if structured and SPRING in search.fits and SPRING not in verdict.selected:
        other = capacitor_in_series(fitter, search.fits[SPRING])
        found.append(Met(other.suspect, other.residual, other.cost))
    if asked or len(verdict.selected) > 1 or 1.0 - explained(judge, known) > (
            STRUCTURED if structured else WORTH):
        found += filter(None, [meet(fitter, search.nominal)])
    met = min(found, key=lambda one: one.cost, default=None)
    if met is None or verdict.block not in (None, met.suspect.block):
        return None
    judge = Judge.from_residual(fitter.evidence, met.residual, nominal)
    left = 1.0 - explained(judge, met.residual)
    if left > 1.0 - TOLD or left > LEFT * (1.0 - explained(judge, known)) or (
            judge.score(met.residual) < judge.score(known) + SURER):
        return None
    return met


def _spoilt(search: Search, decision: Decision) -> str:
    """Return the channel that what was selected makes much worse, '' if none."""
    if not decision.verdict.selected:
        return ''
    removable = decision.removable
    after = channel_power(removable.evidence, decision.chosen(search).residual)
    times = {channel: power / max(removable.base[channel], removable.noise[channel])
             for channel, power in after.items()}
    worst = max(times, key=lambda channel: times[channel])
    return worst if times[worst] > SPOILT else ''


def _unknown(decision: Decision, suspect: Suspect, thresholds: Thresholds, beside: str = '',
             chance: float = 1.0) -> Decision:
    """
    Return the decision that something else is to blame than the library has.

    ``chance`` is that of what is suspected, where the library has something as good.
    """
    sure = chance * thresholds.unknown
    return replace(decision, verdict=Verdict(
        'UNKNOWN', (), (), beside + suspect.reason, sure, 1.0 - sure, suspect.block or None))


def _course(fitter: Fitter, fit: Fit) -> tuple[list[dict], Course | None]:
    """Return what is wrong beside a fit, and what that of the displacement may depend on."""
    evidence = fitter.evidence
    after = parallel(lambda pair: simulate_channels(*pair), zip(
        fitter.devices_of(fit), [track.recording for track in evidence.tracks]))
    cuts = block_residuals(fitter.device_with(fit.effects, fit.phi), evidence, after)
    return cuts, Course.of(evidence, after, cuts)
