# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Whether what a cause leaves speaks for another that the library lacks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from piezo_stack_sim.gap.course import Course, speaks_for_clock
from piezo_stack_sim.gap.decision import Decision
from piezo_stack_sim.gap.fit import Fitter
from piezo_stack_sim.gap.quantities import words
from piezo_stack_sim.gap.verdict import Thresholds, Verdict
from piezo_stack_sim.gap.where import block_residuals
from piezo_stack_sim.plant import Device


def doubted(fitter: Fitter, decision: Decision, corrected: Device, after: Sequence[dict],
            thresholds: Thresholds) -> Decision:
    """
    Return a decision, or UNKNOWN where what its cause leaves tells of something else.

    A clock that runs fast is late by ever more: in recordings that are alike long, much of that
    is what a lag does.  What a lag leaves of it no lag does.

    Parameters
    ----------
    fitter : Fitter
        With which all was fitted.
    decision : Decision
        What was decided.
    corrected : Device
        The nominal device with the cause.
    after : sequence of dict
        Channel to (n,) array for each recording, from that.
    thresholds : Thresholds
        What was learned on the development set.

    """
    verdict, singles = decision.verdict, decision.singles
    named = next((one for one in singles if (one.name,) == verdict.selected), None)
    if named is None or named.removed > thresholds.clear_first:
        return decision
    cuts = block_residuals(corrected, fitter.evidence, after)
    suspect = speaks_for_clock(Course.of(fitter.evidence, after, cuts))
    if suspect is None:
        return decision
    sure = thresholds.unknown
    return replace(decision, verdict=Verdict(
        'UNKNOWN', (), (), f'{words(named.name)} removes {100.0 * named.removed:.0f} % of the '
        f'removable gap, and of the rest {suspect.reason}', sure, 1.0 - sure, suspect.block))
