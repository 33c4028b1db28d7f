# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Whether what a cause leaves speaks for another that the library lacks."""

from __future__ import annotations

from dataclasses import replace

from piezo_stack_sim.gap.candidates import Search
from piezo_stack_sim.gap.cores import parallel
from piezo_stack_sim.gap.course import CLOCK, Course, REST, skewed, speaks_for_clock
from piezo_stack_sim.gap.decision import Decision
from piezo_stack_sim.gap.fit import Fit, Fitter
from piezo_stack_sim.gap.forward import simulate_channels
from piezo_stack_sim.gap.quantities import words
from piezo_stack_sim.gap.ranked import Thresholds
from piezo_stack_sim.gap.verdict import Verdict
from piezo_stack_sim.gap.where import block_residuals


def doubted(fitter: Fitter, search: Search, decision: Decision, thresholds: Thresholds
            ) -> Decision:
    """
    Return a decision, or UNKNOWN where what its cause leaves tells of something else.

    A clock that runs fast is late by ever more: in recordings that are alike long, much of that
    is what a lag does.  What a lag leaves of it no lag does.

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
    # What a clock explains that the cause does not, or what is left beside the cause.
    late = skewed(_course(fitter, search.nominal)) < REST * (1.0 - named.removed)
    suspect = CLOCK if late else speaks_for_clock(
        _course(fitter, search.correction(named.name)))
    if suspect is None:
        return decision
    sure = thresholds.unknown
    return replace(decision, verdict=Verdict(
        'UNKNOWN', (), (), f'{words(named.name)} removes {100.0 * named.removed:.0f} % of the '
        f'removable gap, and of the rest {suspect.reason}', sure, 1.0 - sure, suspect.block))


def _course(fitter: Fitter, fit: Fit) -> Course | None:
    """Return what is wrong with the displacement beside a fit, and what it may depend on."""
    evidence = fitter.evidence
    after = parallel(lambda pair: simulate_channels(*pair), zip(
        fitter.devices_of(fit), [track.recording for track in evidence.tracks]))
    cuts = block_residuals(fitter.device_with(fit.effects, fit.phi), evidence, after)
    return Course.of(evidence, after, cuts)
