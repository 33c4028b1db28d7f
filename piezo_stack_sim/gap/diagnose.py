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
from dataclasses import dataclass, replace
import time

import numpy as np
from piezo_stack_sim.gap.cores import parallel
from piezo_stack_sim.gap.deciding.ablation import ablations
from piezo_stack_sim.gap.deciding.decision import (
    ceiling_of, decide_search, judge_of, Removable, search_pairs)
from piezo_stack_sim.gap.deciding.doubt import doubted
from piezo_stack_sim.gap.deciding.isolability import isolability
from piezo_stack_sim.gap.deciding.ranked import DEFAULTS, Thresholds
from piezo_stack_sim.gap.deciding.terminals import look_at_terminals
from piezo_stack_sim.gap.deciding.verdict import Verdict
from piezo_stack_sim.gap.document import build_document
from piezo_stack_sim.gap.fitting import blackbox
from piezo_stack_sim.gap.fitting.candidates import search_singles, tune_as_best, weigh_anew
from piezo_stack_sim.gap.fitting.fit import Fitter
from piezo_stack_sim.gap.measured.evidence import Evidence, noisier, prepare, reweigh
from piezo_stack_sim.gap.measured.forward import simulate_channels, simulate_set
from piezo_stack_sim.gap.measured.given import simulate_given
from piezo_stack_sim.plant import Device
from piezo_stack_sim.recording.finding import renewed
from piezo_stack_sim.recording.preflight import preflight
from piezo_stack_sim.recording.recording import RecordingSet


SIDE_VALLEY = 3.0  # cost of what may lead out of one, over that in it


@dataclass(frozen=True)
class Diagnosis:
    """
    What a diagnosis found.

    Attributes
    ----------
    document : dict
        In the form of ``diagnosis.json`` (``diagnosis.schema.json``).
    device : Device
        The nominal device re-tuned, with the selected effects on.
    devices : dict of str to Device
        The same for each recording by name: what is new every time differs.
    seconds : float
        How long it took.

    """

    document: dict
    device: Device
    devices: dict[str, Device]
    seconds: float


def _asks_nothing(evidence: Evidence, simulated) -> bool:
    """Tell whether nothing that was measured should have moved beyond its noise."""
    return all(float(np.ptp(answer[channel])) <= track.zero[channel]
               for track, answer in zip(evidence.tracks, simulated)
               for channel in track.channels)


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
    checked, before, more = simulate_given(checked, device)
    findings = renewed(findings, more)
    evidence = prepare(checked.recordings, before, device)
    progress('re-tuning the nominal parameters')
    fitter = Fitter(device, evidence)
    fitter.prepare(parallel)
    tuned = fitter.fit({})
    # Without the calibration error more of what is left is noise: weigh anew.
    first, evidence = evidence, prepare(checked.recordings, simulate_set(
        fitter.device_with({}, tuned.phi), checked.recordings), device)
    fitter = fitter.reweighed(evidence, reweigh(first, evidence))
    search = search_singles(fitter, progress)
    # A slow answer to every command had passed for noise unless something explains it now.
    fitter, search = weigh_anew(fitter, search)
    evidence = fitter.evidence
    terminals = look_at_terminals(fitter, search, thresholds, progress)
    judge = judge_of(fitter, search)
    alike = isolability(fitter, search)
    cut = None
    if terminals is not None:
        cut = terminals.join(fitter, search, thresholds, progress)
    # What lies behind the terminals may be what the driver's form misses, and no second cause.
    told = cut is not None and cut.removed >= thresholds.behind and (
        search.merits[cut.pair].nats > thresholds.hint)
    if cut is None or cut.known and not told:
        search_pairs(fitter, search, judge, thresholds, progress, alike, cut)
    # Beside a second effect one may have found its way out of a side valley of the parameters.
    if tune_as_best(fitter, search, near=SIDE_VALLEY):
        judge = judge_of(fitter, search)
    progress('asking what a flexible correction could explain')
    flexible = blackbox.flexible_correction(evidence, before, search.nominal.residual)
    nominal = search.nominal.residual
    ceiling = ceiling_of(judge, Removable(evidence, nominal), nominal, flexible, thresholds)
    decision = decide_search(fitter, search, judge, ceiling, alike, thresholds, progress, cut)
    decision = doubted(fitter, search, decision, thresholds)
    if decision.verdict.word == 'NO_GAP' and _asks_nothing(evidence, before):
        decision = replace(decision, verdict=Verdict(
            'NOT_IDENTIFIABLE', (), (), 'the inputs move nothing beyond the noise in any '
            'recording, so that no gap could show: play a programme that moves the device',
            thresholds.nothing, 1.0 - thresholds.nothing))
    verdict, chosen = decision.verdict, decision.chosen(search)
    better = fitter.in_step(chosen, parallel)
    if better is not chosen:
        decision, chosen = decision.corrected(fitter, search, better), better
    progress('writing it up')
    devices = [device.rounded() for device in fitter.devices_of(chosen)]
    after = parallel(lambda pair: simulate_channels(*pair), zip(devices, checked.recordings))
    findings = findings + noisier(evidence)
    result = build_document(recordings.name, findings, fitter, search, decision, before, after,
                            flexible, thresholds, terminals and terminals.tuned)
    if ablate:
        result['baselines'] |= ablations(search, fitter, judge, verdict, lambda other, by: (
            decide_search(fitter, other, by, ceiling, alike, thresholds, _silent, cut).verdict))
    if len(verdict.tie) > 1:
        from piezo_stack_sim.gap.deciding.experiment import next_experiment
        progress('looking for the experiment that decides')
        result['next_experiment'] = next_experiment(
            fitter, evidence,
            {name: search.correction(name) for name in verdict.pairs or verdict.tie})
    elif verdict.word == 'NOT_IDENTIFIABLE':
        from piezo_stack_sim.gap.deciding.experiment import first_experiment
        progress('looking for the experiment that asks most')
        result['next_experiment'] = first_experiment(
            fitter, evidence, search.nominal.phi)
    if traces:
        from piezo_stack_sim.gap.traces import build_traces
        result['traces'] = build_traces(
            checked.recordings, before, after if verdict.selected else None,
            {c: evidence.noise_rms(c) for c in evidence.channels})
    return Diagnosis(result, fitter.device_with(chosen.effects, chosen.phi).rounded(),
                     {r.name: d for r, d in zip(checked.recordings, devices)},
                     time.perf_counter() - started)
