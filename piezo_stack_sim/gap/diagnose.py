# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The diagnosis from recordings to ``diagnosis.json``: where, which, how far, what next.

One pass in the order in which a reader reads it: simulate the parameter file as
given, estimate the noise, re-tune the nominal parameters within their
uncertainty, try every effect, then pairs, judge on withheld rows, decide.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
import math
import time

import numpy as np

from piezo_stack_sim.effects.registry import EFFECTS
from piezo_stack_sim.gap import blackbox, where
from piezo_stack_sim.gap.ablation import ablations
from piezo_stack_sim.gap.arbitrary import sized
from piezo_stack_sim.gap.candidates import (
    polish, Search, search_partners, search_singles)
from piezo_stack_sim.gap.evidence import Evidence, prepare
from piezo_stack_sim.gap.fit import Fit, Fitter, TONE
from piezo_stack_sim.gap.forward import parallel, simulate_channels, simulate_set, spans
from piezo_stack_sim.gap.isolability import isolability
from piezo_stack_sim.gap.report_parts import (
    calibration_part, cause_part, gap_part, records_part, shrinkage_part)
from piezo_stack_sim.gap.score import channel_power, Judge, noise_power
from piezo_stack_sim.gap.starts import extent_of
from piezo_stack_sim.gap.verdict import decide, DEFAULTS, probabilities, Ranked, Thresholds
from piezo_stack_sim.plant import Device
from piezo_stack_sim.recording.preflight import preflight
from piezo_stack_sim.recording.recording import RecordingSet

POLISHED = 3  # single effects that are fitted to the end before they are judged
BASES = 2  # single effects from which pairs are tried
RIVAL = 0.7  # part of the best gain from which a second one is tried


@dataclass(frozen=True)
class Diagnosis:
    """
    What a diagnosis found.

    Attributes
    ----------
    document : dict
        In the form of ``diagnosis.json`` (DESIGN.md).
    device : Device
        The nominal device re-tuned, with the selected effects on.
    devices : dict of str to Device
        The same for each recording by name: what is new every time differs.
    seconds : float
        How long it took.
    scores : dict
        Powers of every hypothesis: what learning the thresholds needs.

    """

    document: dict
    device: Device
    devices: dict[str, Device]
    seconds: float
    scores: dict


def _silent(message: str) -> None:
    """Say nothing."""


def diagnose_set(recordings: RecordingSet, device: Device, progress: Callable = _silent,
                 thresholds: Thresholds = DEFAULTS, traces: bool = True,
                 ablate: bool = False) -> Diagnosis:
    """
    Diagnose one recording set.

    Parameters
    ----------
    recordings : RecordingSet
        As read; preflight is part of the diagnosis.
    device : Device
        The nominal device, with the effects that are known already.
    progress : callable
        Called with a sentence at every stage.
    thresholds : Thresholds
        What was learned on the development set.
    traces : bool
        Whether to add the thinned signals that the report draws.
    ablate : bool
        Whether to add what the answer would be without parts of the method.

    Returns
    -------
    Diagnosis

    Raises
    ------
    InputError
        If preflight refuses everything.

    """
    started = time.perf_counter()
    progress('checking the recordings')
    checked, findings = preflight(recordings, device)
    progress('simulating the parameter file as given')
    before = simulate_set(device, checked.recordings)
    checked = checked.replace(recordings=sized(checked.recordings, before))
    evidence = prepare(checked.recordings, before)
    progress('re-tuning the nominal parameters')
    fitter = Fitter(device, evidence)
    fitter.prepare(parallel)
    tuned = fitter.fit({})
    # Without the calibration error more of what is left is noise: weigh anew.
    evidence = prepare(checked.recordings, simulate_set(
        fitter.device_with({}, tuned.phi), checked.recordings))
    fitter = Fitter(device, evidence)
    fitter.prepare(parallel)
    extent = extent_of(evidence, fitter.base, spans(evidence))
    search = search_singles(fitter, extent, progress)
    polish(fitter, search, sorted(search.fits, key=lambda n: search.fits[n].cost)[:POLISHED])
    names = [name for name in search.fits if '+' not in name]
    judge = Judge.from_residual(
        evidence, min((search.fits[n] for n in names), key=lambda f: f.cost).residual,
        search.nominal.residual)
    # What re-tuning removes is calibration, not a cause.
    removable = _Removable(evidence, search.nominal.residual)
    singles = _rank(names, search, judge, removable)
    progress('asking what a flexible correction could explain')
    flexible = blackbox.flexible_correction(evidence, before, search.nominal.residual)
    ceiling = removable.share(flexible)
    pairs: list[Ranked] = []
    left = float(np.max(judge.powers(search.fits[singles[0].name].residual))) - 1.0
    if singles[0].gain > thresholds.detect and left > thresholds.leftover:
        for ranked in singles[:BASES]:
            if ranked.gain > RIVAL * singles[0].gain:
                search_partners(fitter, extent, search, ranked.name, progress)
        together = [n for n in search.fits if '+' in n]
        pairs = _rank(together, search, judge, removable, search.fits[singles[0].name])
    classes, unseen, kin = isolability(fitter, search)
    structure = judge.structure(search.nominal.residual)
    verdict = decide(singles, pairs, ceiling, structure, classes, thresholds, kin)
    chosen = _chosen(verdict.selected, search)

    def decide_by(other: Search, by: Judge):
        measure = _Removable(evidence, other.nominal.residual)
        ranked = _rank([n for n in other.fits if '+' not in n], other, by, measure)
        two = _rank([n for n in other.fits if '+' in n], other, by, measure,
                    other.fits[ranked[0].name])
        return decide(ranked, two, ceiling, by.structure(other.nominal.residual), classes,
                      thresholds, kin)

    progress('writing it up')
    devices = fitter.devices_of(chosen)
    after = parallel(lambda pair: simulate_channels(*pair), zip(devices, checked.recordings))
    behind = next((EFFECTS[n].block for n in (*verdict.selected, *(r.name for r in singles[:1]))
                   if EFFECTS[n].block in where.BEHIND_CHARGE), None)
    tuned_device = fitter.device_with({}, search.nominal.phi)
    cuts = where.block_residuals(tuned_device, evidence,
                                 simulate_set(tuned_device, checked.recordings))
    fractions, blocks = where.shares(cuts, behind, 'charge' in evidence.channels)
    records, channels = where.by_record(evidence, fitter.base)
    chance = verdict.single * probabilities(singles, thresholds)
    result = {
        'schema': 'piezo_stack_sim/diagnosis/1',
        'verdict': verdict.word,
        'confidence': float(min(max(verdict.confidence, 0.0), 1.0)),
        'reason': verdict.reason,
        'name': recordings.name,
        'records': records_part(evidence),
        'preflight': findings_part(findings),
        'gap': gap_part(evidence, before),
        'where': {
            'block': _block(verdict, fractions, singles), 'shares': fractions, 'blocks': blocks,
            'channels': channels, 'bands': where.by_band(evidence, fitter.base),
            'regimes': where.by_regime(evidence, fitter.base), 'records': records},
        'isolability': {'classes': classes, 'undetectable': unseen},
        'calibration': calibration_part(fitter, search.nominal),
        'causes': [cause_part(ranked, search.fits[ranked.name], float(p), judge, search.nominal,
                              fitter)
                   for ranked, p in zip(singles, chance)]
        + [cause_part(ranked, search.fits[ranked.name], _pair_chance(verdict, ranked), judge,
                      search.nominal, fitter) for ranked in pairs[:5]],
        'selected': list(verdict.selected),
        'ambiguity_set': list(verdict.tie),
        'shrinkage': shrinkage_part(evidence, fitter.base, chosen.residual, flexible,
                                    blackbox.placebo_corrections(evidence, fitter.base)),
        'remaining': {'gap': gap_part(evidence, after),
                      'structured': judge.structure(chosen.residual) > thresholds.excess},
        'next_experiment': None,
        'warnings': _warnings(chosen, verdict),
        'baselines': {**_baselines(singles, search, fitter, judge),
                      **(ablations(search, fitter, judge, verdict, decide_by) if ablate else {})},
        'how': {'seed': blackbox.SEED, 'settings': {'seconds': None},
                'steps': _steps(evidence, search)},
    }
    if len(verdict.tie) > 1:
        from piezo_stack_sim.gap.experiment import next_experiment
        progress('looking for the experiment that decides')
        result['next_experiment'] = next_experiment(
            fitter, evidence, {name: search.fits[name] for name in verdict.tie})
    if traces:
        from piezo_stack_sim.gap.traces import build_traces
        result['traces'] = build_traces(
            checked.recordings, before, after if verdict.selected else None,
            {c: evidence.noise_rms(c) for c in evidence.channels})
    scores = {
        'weights': judge.weights.tolist(), 'forgiven': judge.forgiven.tolist(),
        'nominal': judge.powers(search.nominal.residual).tolist(), 'ceiling': ceiling,
        'structure': structure, 'classes': classes, 'kin': sorted(map(sorted, kin)),
        'fits': {name: [judge.powers(fit.residual).tolist(), removable.share(fit.residual),
                        _count(fit), fit.cost] for name, fit in search.fits.items()}}
    return Diagnosis(result, fitter.device_with(chosen.effects, chosen.phi),
                     {r.name: d for r, d in zip(checked.recordings, devices)},
                     time.perf_counter() - started, scores)


def _count(fit: Fit) -> int:
    """Return how many numbers a hypothesis chose."""
    return len(fit.free) + (0 if fit.line is None else 2 + len(fit.line.phases))


class _Removable:
    """How much of the gap of a set a residual has left, all channels together."""

    def __init__(self, evidence: Evidence, base: np.ndarray) -> None:
        self.evidence = evidence
        self.noise = noise_power(evidence)
        self.base = channel_power(evidence, base)

    def share(self, residual: np.ndarray) -> float:
        """Return S pooled over the channels, each in units of its noise."""
        now = channel_power(self.evidence, residual)
        gap = left = 0.0
        for channel, noise in self.noise.items():
            excess = self.base[channel] - noise
            if excess > 0.05 * noise:
                # The root keeps a channel with a huge gap from hiding the others.
                weight = 1.0 / math.sqrt(excess * noise)
                gap += weight * excess
                left += weight * max(now[channel] - noise, 0.0)
        return 1.0 - left / gap if gap > 0.0 else 0.0


def _rank(names, search: Search, judge: Judge, removable: _Removable,
          reference: Fit | None = None) -> list[Ranked]:
    """Return hypotheses, best first: singles by score, pairs by what they leave of a single."""
    nominal = judge.score(search.nominal.residual)
    strict = judge.strict(judge.powers(search.nominal.residual))
    base = judge.powers((reference or search.nominal).residual)
    ranked = []
    for name in names:
        fit = search.fits[name]
        powers = judge.powers(fit.residual)
        ranked.append(Ranked(
            name, judge.score(fit.residual) - nominal, removable.share(fit.residual),
            _count(fit), judge.strict(powers) - strict, judge.left(powers, base),
            float(np.max(powers)) - 1.0))
    if reference is None:
        return sorted(ranked, key=lambda r: (-r.gain, r.name))
    return sorted(ranked, key=lambda r: (-r.strict, r.name))


def _chosen(selected: tuple[str, ...], search: Search) -> Fit:
    if not selected:
        return search.nominal
    name = '+'.join(sorted(selected, key=list(EFFECTS).index))
    return search.fits[name]


def _pair_chance(verdict, ranked: Ranked) -> float:
    chosen = verdict.word == 'MULTIPLE' and set(ranked.name.split('+')) == set(verdict.selected)
    return verdict.confidence if chosen else 0.0


def _block(verdict, fractions: dict, singles: list[Ranked]) -> str | None:
    if verdict.word == 'NO_GAP':
        return None
    if verdict.selected:
        return EFFECTS[verdict.selected[0]].block
    if fractions and max(fractions.values()) > 0.0:
        return max(fractions, key=lambda block: fractions[block])
    return EFFECTS[singles[0].name].block


def _baselines(singles, search: Search, fitter: Fitter, judge: Judge) -> dict:
    """Return what simpler ways of deciding would have answered, for the benchmark."""
    n = fitter.rows.size
    names = [r.name for r in singles]
    lowest = min(names, key=lambda name: search.fits[name].cost)
    bic = min(names, key=lambda name: search.fits[name].cost
              + _count(search.fits[name]) * math.log(n))
    fall = search.nominal.cost - search.fits[bic].cost
    bic_gap = fall > _count(search.fits[bic]) * math.log(n)
    white = float(np.max(judge.powers(search.nominal.residual))) > 1.1
    return {
        'lowest_error': {'verdict': 'CAUSE', 'effect': lowest},
        'bic': {'verdict': 'CAUSE' if bic_gap else 'NO_GAP', 'effect': bic if bic_gap else None},
        'whiteness': {'verdict': 'CAUSE' if white else 'NO_GAP',
                      'effect': lowest if white else None},
    }


def _warnings(fit: Fit, verdict) -> list[str]:
    notes = []
    if fit.line is not None and len(fit.line.phases) > 1:
        notes.append(f'the phase of {TONE} is another in every recording: a corrected device '
                     'swings as much, but not in step with the real one')
    for free in fit.free:
        value = fit.effects[free.effect][free.parameter.name]
        span = free.limits[1] - free.limits[0]
        place = free.to_walk(value)
        if min(place - free.limits[0], free.limits[1] - place) < 1e-3 * span:
            notes.append(f'{free.effect}.{free.parameter.name} is stuck at its bound '
                         f'({value:.4g} {free.parameter.unit}): distrust it')
    return notes


def findings_part(findings) -> list[dict]:
    """Return preflight's findings as plain rows."""
    from dataclasses import asdict
    return [asdict(finding) for finding in findings]


def _steps(evidence: Evidence, search: Search) -> list[str]:
    simulations = search.nominal.simulations + sum(f.simulations for f in search.fits.values())
    return [
        'preflight of the recordings',
        'simulation of the parameter file as given; noise from differences and repeats',
        'nominal parameters re-tuned within relative_uncertainty',
        f'{len([n for n in search.fits if "+" not in n])} effects and '
        f'{len([n for n in search.fits if "+" in n])} pairs fitted by simulation error on '
        f'alternating stretches ({simulations} simulations of the set)',
        'hypotheses judged on the stretches that were withheld',
    ]
