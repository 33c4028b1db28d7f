# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Whether what a cause leaves speaks for another that the library lacks."""

from __future__ import annotations

from dataclasses import replace

from piezo_stack_sim.effects.registry import EFFECTS
from piezo_stack_sim.gap.back_coupling import NOT_FELT, Suspect, suspect_block
from piezo_stack_sim.gap.candidates import Search
from piezo_stack_sim.gap.cores import parallel
from piezo_stack_sim.gap.course import (
    CLOCK, Course, REST, skewed, speaks_for_clock, suspect_play)
from piezo_stack_sim.gap.decision import Decision
from piezo_stack_sim.gap.fit import Fit, Fitter
from piezo_stack_sim.gap.forward import simulate_channels
from piezo_stack_sim.gap.quantities import words
from piezo_stack_sim.gap.ranked import Thresholds
from piezo_stack_sim.gap.verdict import Verdict
from piezo_stack_sim.gap.where import block_residuals

_PLAY = Suspect('mechanical', 'the charge shows that the stack feels none of it: something has '
                'play')


def doubted(fitter: Fitter, search: Search, decision: Decision, thresholds: Thresholds
            ) -> Decision:
    """
    Return a decision, or UNKNOWN where what its cause leaves tells of something else.

    A clock that runs fast is late by ever more: in recordings that are alike long, much of that
    is what a lag does.  What a lag leaves of it no lag does.  A part that has play stops where
    one that rubs does, but the stack does not feel it: the charge tells.

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
    elif EFFECTS[named.name].block == 'mechanical' and suspect_block(cuts) is NOT_FELT:
        suspect = None if suspect_play(course) is None else _PLAY
    else:
        suspect = speaks_for_clock(_course(fitter, search.correction(named.name))[1])
    if suspect is None:
        return decision
    sure = thresholds.unknown
    return replace(decision, verdict=Verdict(
        'UNKNOWN', (), (), f'{words(named.name)} removes {100.0 * named.removed:.0f} % of the '
        f'removable gap, {"but" if suspect is _PLAY else "and of the rest"} {suspect.reason}',
        sure, 1.0 - sure, suspect.block))


def _course(fitter: Fitter, fit: Fit) -> tuple[list[dict], Course | None]:
    """Return what is wrong beside a fit, and what that of the displacement may depend on."""
    evidence = fitter.evidence
    after = parallel(lambda pair: simulate_channels(*pair), zip(
        fitter.devices_of(fit), [track.recording for track in evidence.tracks]))
    cuts = block_residuals(fitter.device_with(fit.effects, fit.phi), evidence, after)
    return cuts, Course.of(evidence, after, cuts)
