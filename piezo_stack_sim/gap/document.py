# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""A diagnosis as ``diagnosis.schema.json`` wants it: where, which, how far."""

from __future__ import annotations

from dataclasses import asdict
import math

import numpy as np

from piezo_stack_sim.effects.registry import EFFECTS
from piezo_stack_sim.gap.deciding.decision import count, Decision
from piezo_stack_sim.gap.deciding.ranked import Ranked, Thresholds
from piezo_stack_sim.gap.deciding.score import Judge
from piezo_stack_sim.gap.deciding.verdict import outscored, probabilities, Verdict
from piezo_stack_sim.gap.fitting import blackbox
from piezo_stack_sim.gap.fitting.candidates import Search
from piezo_stack_sim.gap.fitting.fit import Fit, Fitter, Free, TONE
from piezo_stack_sim.gap.lacking.along import suspect_pitch
from piezo_stack_sim.gap.lacking.answered import suspect_filter
from piezo_stack_sim.gap.lacking.back_coupling import NOT_FELT, OTHER_RATIO, suspect_block
from piezo_stack_sim.gap.lacking.bursts import suspect_bursts, suspect_jumps
from piezo_stack_sim.gap.lacking.course import (
    Course, is_plain, suspect_clock, suspect_heat, suspect_play)
from piezo_stack_sim.gap.lacking.misread import suspect_charge
from piezo_stack_sim.gap.lacking.staircase import suspect_steps
from piezo_stack_sim.gap.measured import where
from piezo_stack_sim.gap.measured.evidence import Evidence
from piezo_stack_sim.gap.measured.forward import simulate_set
from piezo_stack_sim.gap.quantities import words
from piezo_stack_sim.gap.report_parts import (
    calibration_part, cause_part, gap_part, outdone, records_part, shrinkage_part, stuck_of,
    worsened)

PAIRS_SHOWN = 5
UNNAMED = ('UNKNOWN', 'NOT_IDENTIFIABLE')  # verdicts that name no cause, but a gap


def build_document(name: str, findings, fitter: Fitter, search: Search, decision: Decision,
                   before: list[dict], after: list[dict], flexible: np.ndarray,
                   thresholds: Thresholds, behind: np.ndarray | None = None) -> dict:
    """
    Return the diagnosis as plain data.

    Parameters
    ----------
    name : str
        Of the recording set.
    findings : list of Finding
        What preflight said.
    fitter : Fitter
        Of the set.
    search : Search
        All that was fitted.
    decision : Decision
        What followed.
    before, after : list of dict
        Channel to (n,) array for each recording, from the file as given and as corrected.
    flexible : ndarray, shape (N,)
        Residual that a flexible correction leaves.
    thresholds : Thresholds
        What was learned on the development set.
    behind : ndarray, shape (p,), optional
        Deviations of the nominal parameters behind the terminals, if tuned by themselves.

    """
    evidence, judge, verdict = fitter.evidence, decision.judge, decision.verdict
    chosen = decision.chosen(search)
    place, why = _where_part(fitter, search, verdict, decision.singles, behind)
    shrinkage = shrinkage_part(evidence, fitter.base, chosen.residual, flexible,
                               blackbox.placebo_corrections(evidence, fitter.base),
                               [search.correction(ranked.name).residual
                                for ranked in (*decision.singles, *decision.pairs)])
    return {
        'schema': 'piezo_stack_sim/diagnosis/1',
        'verdict': verdict.word,
        'confidence': float(min(max(verdict.confidence, 0.0), 1.0)),
        'reason': f'{verdict.reason}; {why}' if why else verdict.reason,
        'name': name,
        'records': records_part(evidence),
        'preflight': [asdict(finding) for finding in findings],
        'gap': gap_part(evidence, before),
        'where': place,
        'isolability': {'classes': decision.alike.classes,
                        'undetectable': decision.alike.unseen},
        'calibration': calibration_part(fitter, search.nominal,
                                        chosen if verdict.selected else None),
        'causes': _causes(fitter, search, decision, thresholds),
        'selected': list(verdict.selected),
        'ambiguity_set': list(verdict.tie),
        'shrinkage': shrinkage,
        'remaining': {'gap': gap_part(evidence, after),
                      'structured': not verdict.shows_no_gap and bool(
                          judge.structure(chosen.residual) > thresholds.excess)},
        'next_experiment': None,
        'warnings': [
            *_warnings(chosen, verdict, decision.singles, thresholds, fitter.nuisance.scale_free,
                       stuck_of(chosen, search.fits.get(decision.name))),
            *((*outdone(shrinkage), *worsened(shrinkage)) if verdict.selected else ())],
        'baselines': _baselines(decision.singles, search, fitter, judge),
        'how': {'seed': blackbox.SEED, 'settings': {'seconds': None},
                'steps': _steps(evidence, search, decision)},
    }


def _where_part(fitter: Fitter, search: Search, verdict: Verdict, singles: list[Ranked],
                behind: np.ndarray | None) -> tuple[dict, str]:
    """Return where the gap is, with the model cut at its ports, and what else tells the block."""
    evidence = fitter.evidence
    tuned = fitter.device_with({}, search.nominal.phi)
    simulated = simulate_set(tuned, [track.recording for track in evidence.tracks])
    cuts = where.block_residuals(
        tuned, evidence, simulated, None if behind is None else fitter.device_with({}, behind))
    suspect = None
    if verdict.word in UNNAMED and verdict.block is None and not verdict.shows_no_gap:
        course, felt = Course.of(evidence, simulated, cuts), suspect_block(cuts)
        suspect = (suspect_steps(tuned, evidence, cuts) or suspect_clock(course)
                   or suspect_filter(evidence, simulated, cuts)
                   or suspect_pitch(course, felt is NOT_FELT)
                   or suspect_bursts(evidence.tracks, cuts, course)
                   or suspect_jumps(cuts, course)
                   or felt)
        if suspect is NOT_FELT:
            suspect = suspect_play(course) or suspect
        elif suspect is OTHER_RATIO and is_plain(course):
            suspect = None  # a reading that the voltage leaks into does the same
        else:
            suspect = suspect or suspect_heat(course, cuts) or suspect_charge(fitter, cuts)
    last = where.last_cut(verdict.selected, singles[0].name, evidence.channels)
    if suspect and suspect.block in where.spanned_last(evidence.channels):
        last = suspect.block
    elif verdict.block in where.BEHIND_CHARGE:
        last = verdict.block
    fractions, blocks = where.shares(cuts, last, evidence.channels)
    records, channels = where.by_record(evidence, fitter.base)
    block = verdict.block or _block(verdict, fractions, singles)
    if suspect and block == 'drive' != suspect.block:
        suspect = None  # what comes first explains what follows
    if verdict.word in UNNAMED and not (suspect or verdict.block) and (
            'spans' in blocks.get(block, {})):
        blocks[block]['note'] = 'nothing measured points to this block rather than its neighbours'
    return {
        'block': suspect.block if suspect else block, 'shares': fractions,
        'blocks': blocks, 'channels': channels, 'bands': where.by_band(evidence, fitter.base),
        'regimes': where.by_regime(evidence, fitter.base),
        'records': records}, suspect.reason if suspect else ''


def _causes(fitter: Fitter, search: Search, decision: Decision, thresholds: Thresholds
            ) -> list[dict]:
    """Return every effect and the best pairs, the likeliest first."""
    verdict, nominal = decision.verdict, search.nominal
    chance = verdict.single * probabilities(
        decision.singles, thresholds, decision.alike.groups)
    shown = [pair for rank, pair in enumerate(decision.pairs)
             if rank < PAIRS_SHOWN or pair.name in verdict.pairs]
    ranked = [*zip(decision.singles, chance.tolist()),
              *((pair, verdict.pairs.get(pair.name, 0.0)) for pair in shown)]
    return [cause_part(each, search.correction(each.name), chance, decision.judge, nominal, fitter,
                       search.fits[each.name])
            for each, chance in sorted(ranked, key=lambda row: -row[1])]


def _block(verdict, fractions: dict, singles: list[Ranked]) -> str | None:
    if verdict.shows_no_gap:
        return None
    if verdict.selected:  # of several, the one with most of the gap
        return max((EFFECTS[name].block for name in verdict.selected),
                   key=lambda block: fractions.get(block, 0.0))
    if fractions and max(fractions.values()) > 0.0:
        return max(fractions, key=lambda block: fractions[block])
    return EFFECTS[singles[0].name].block


def _baselines(singles, search: Search, fitter: Fitter, judge: Judge) -> dict:
    """Return what simpler ways of deciding would have answered, for the benchmark."""
    n = fitter.rows.size
    names = [r.name for r in singles]
    lowest = min(names, key=lambda name: search.fits[name].cost)
    bic = min(names, key=lambda name: search.fits[name].cost
              + count(search.fits[name]) * math.log(n))
    fall = search.nominal.cost - search.fits[bic].cost
    bic_gap = fall > count(search.fits[bic]) * math.log(n)
    white = float(np.max(judge.powers(search.nominal.residual))) > 1.1
    return {
        'lowest_error': {'verdict': 'CAUSE', 'effect': lowest},
        'bic': {'verdict': 'CAUSE' if bic_gap else 'NO_GAP', 'effect': bic if bic_gap else None},
        'whiteness': {'verdict': 'CAUSE' if white else 'NO_GAP',
                      'effect': lowest if white else None},
    }


def _warnings(fit: Fit, verdict: Verdict, singles: list[Ranked], thresholds: Thresholds,
              scale_free: bool, stuck: list[Free]) -> list[str]:
    notes = []
    if scale_free and 'sensor_gain' not in verdict.selected:
        notes.append('sensor_gain in corrected.yaml is the scale of a displacement in units of '
                     'its own, and no cause')
    second = outscored(verdict, singles, thresholds)
    if second is not None:
        notes.append(f'perhaps a second cause: {words(second)} predicts more rows, but removes '
                     'less')
    if fit.line is not None and fit.line.is_unsteady:
        notes.append(f'the phase of {TONE} is another in every recording: a corrected device '
                     'swings as much, but not in step with the real one')
    for free in stuck:
        value = fit.effects[free.effect][free.parameter.name]
        notes.append(f'{free.effect}.{free.parameter.name} is stuck at its bound '
                     f'({value:.4g} {free.parameter.unit}): distrust it')
    return notes


def _steps(evidence: Evidence, search: Search, decision: Decision) -> list[str]:
    simulations = search.nominal.simulations + sum(f.simulations for f in search.fits.values())
    return [
        'preflight of the recordings',
        'simulation of the parameter file as given; noise from differences and repeats',
        'nominal parameters re-tuned within relative_uncertainty',
        f'{len([n for n in search.fits if "+" not in n])} effects and '
        f'{len([n for n in search.fits if "+" in n])} pairs fitted by simulation error on '
        f'alternating stretches ({simulations} simulations of the set)',
        *(() if decision.cut is None else (
            'the drive fitted to the measured voltage alone, the rest driven by that voltage',)),
        'hypotheses judged on the stretches that were withheld',
    ]
