# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What lies behind the terminals, whatever the driver makes of the command.

Where the voltage was measured the model is cut there: driven by what really was
at its terminals, the rest of it answers without the driver's error, and so does
a second effect behind it, however loud the form of the first is.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace
import itertools
import math

import numpy as np
from piezo_stack_sim.effects.registry import EFFECTS
from piezo_stack_sim.gap.cores import parallel
from piezo_stack_sim.gap.deciding.decision import decide_search, Decision, judge_of
from piezo_stack_sim.gap.deciding.isolability import isolability
from piezo_stack_sim.gap.deciding.ranked import Thresholds
from piezo_stack_sim.gap.deciding.score import Judge
from piezo_stack_sim.gap.deciding.verdict import Cut, probabilities
from piezo_stack_sim.gap.fitting.candidates import Search, search_singles
from piezo_stack_sim.gap.fitting.fit import Fit, Fitter, STEPS
from piezo_stack_sim.gap.fitting.pairs import add_pair, pair_of
from piezo_stack_sim.gap.lacking.misread import is_voltage_misread
from piezo_stack_sim.gap.measured.evidence import Evidence, prepare, Track
from piezo_stack_sim.gap.measured.forward import simulate_set, spans
from piezo_stack_sim.gap.measured.voltage import MeasuredVoltage
from piezo_stack_sim.gap.measured.where import block_residuals, shares
from piezo_stack_sim.plant import Device

DRIVE = tuple(name for name, effect in EFFECTS.items() if effect.block == 'drive')
BEHIND = tuple(name for name in EFFECTS if name not in DRIVE)
UNMISTAKABLE = 0.5  # excess over the noise power that no effect need explain to be a gap
SEES = 0.4  # part of an effect that must be seen behind the terminals to deny it there
MATTERS = 0.02  # part of a gap from which it matters what is wrong at the terminals
UNTOLD = 0.5  # part of a row between two measured voltages in which a jump may lie
LEADING = 2  # effects of the drive whose numbers by the voltage alone are tried


@dataclass(frozen=True)
class Part:
    """
    What was fitted to a part of the chain, and what follows for it.

    ``chances`` says how likely each effect is, if one is the whole cause there.
    """

    search: Search
    decision: Decision
    fitter: Fitter | None = None
    chances: Mapping[str, float] = field(default_factory=dict)

    @property
    def best(self) -> Fit:
        """Return the fit of the likeliest effect."""
        return self.search.fits[max(self.chances, key=lambda name: self.chances[name])]

    @property
    def resembling(self) -> set[frozenset[str]]:
        """Return the effects that look much alike on this side, by twos."""
        tie = self.decision.verdict.tie
        return self.decision.alike.resembling.union(
            map(frozenset, itertools.combinations(tie, 2)))

    def sees(self, name: str) -> float:
        """Return how long an effect is in this part, in standard deviations of its noise."""
        return _length(self.search, name)

    def bears(self, effects: Mapping[str, dict[str, float]], nats: float) -> bool:
        """
        Tell whether there is room here for effects, of any block, with their numbers (SI).

        There is where they are what this part has anyway, and where they do not cost so many nats.
        """
        found = {each.name for each in self.decision.singles if each.gain > nats}
        here = {name: values for name, values in effects.items()
                if name in self.search.fits and name not in found}
        if not here or self.fitter is None:
            return True
        none = self.search.nominal
        cost, _ = self.fitter.retuned(self.fitter.residual_of(here, none.phi), none.phi)
        return 0.5 * (cost - none.cost) < nats

    @property
    def explained(self) -> float:
        """Return the part of the gap that this removes."""
        best = self.decision.singles[0]
        return max(best.removed, 1.0 - best.left)


@dataclass(frozen=True)
class Terminals:
    """
    Both sides of the terminals.

    ``before`` is the drive, by the measured voltage alone, ``behind`` the rest, driven by that.
    """

    before: Part
    behind: Part

    @property
    def tuned(self) -> np.ndarray:
        """Return the deviations (p,) of the nominal parameters behind the terminals."""
        return self.behind.search.nominal.phi

    @property
    def chances(self) -> dict[str, float]:
        """Return how likely each pair across the terminals is, by what each side tells alone."""
        return {pair_of(driver, other): one * two
                for driver, one in self.before.chances.items()
                for other, two in self.behind.chances.items()}

    @property
    def between_rows(self) -> set[str]:
        """
        Return what would come late behind a late driver, but by less than rows of voltage tell.

        Such a driver jumps between two rows, nobody has measured when: what follows it seems to
        be late by up to a part of a row.
        """
        if self.behind.fitter is None or not any(
                EFFECTS[name].is_time for name in self.before.best.effects):
            return set()
        row = min(track.recording.period for track in self.behind.fitter.evidence.tracks)
        return {name for name, fit in self.behind.search.fits.items() if EFFECTS[name].is_late
                and sum(fit.effects[name][p.name] for p in EFFECTS[name].parameters
                        if p.unit == 's') < UNTOLD * row}

    def join(self, fitter: Fitter, search: Search, thresholds: Thresholds,
             progress: Callable[[str], None]) -> Cut | None:
        """
        Return what follows for the whole chain, None if all this is too little to matter.

        Parameters
        ----------
        fitter : Fitter
            With which all effects were fitted to the whole chain.
        search : Search
            What was fitted; where two effects are found, the pair goes there.
        thresholds : Thresholds
            What was learned on the development set.
        progress : callable
            Called with a sentence at every stage.

        """
        if self.before.explained < thresholds.drive:
            # What is told at the terminals alone is no gap of what they drive.
            if _share_of_drive(fitter, search) < MATTERS:
                return None
            return Cut(known=False, misread=is_voltage_misread(fitter))
        singles = self.behind.decision.singles
        hidden = self.between_rows
        # Who sees little of an effect cannot deny it.
        supported = frozenset(each.name for each in singles if each.name not in hidden and (
            each.gain > thresholds.second
            or self.behind.sees(each.name) < SEES * _length(search, each.name)))
        removed = self.behind.explained
        resembling = frozenset(self.before.resembling | self.behind.resembling)

        def bears(effects):
            return self.behind.bears(effects, thresholds.second)

        if (not self.behind.decision.verdict.selected
                or not hidden.isdisjoint(self.behind.best.effects)
                or singles[0].gain < thresholds.second
                or removed < thresholds.explained
                or self.behind.decision.structure < thresholds.excess):
            return Cut(known=True, resembling=resembling, supported=supported, bears=bears)
        progress('fitting what both sides of the terminals told')
        second = self.behind.best
        pair = add_pair(fitter, search, {**self.before.best.effects, **second.effects}, second.phi)
        return Cut(True, pair, removed, resembling, supported, self.chances, bears)


def look_at_terminals(fitter: Fitter, search: Search, thresholds: Thresholds,
                      progress: Callable[[str], None]) -> Terminals | None:
    """
    Diagnose both sides of the terminals, each by itself.

    Parameters
    ----------
    fitter : Fitter
        With which all effects were fitted to the whole chain.
    search : Search
        What was fitted; what the voltage alone told of the drive goes there.
    thresholds : Thresholds
        What was learned on the development set.
    progress : callable
        Called with a sentence at every stage.

    Returns
    -------
    Terminals or None
        None if nothing is clearly wrong with the voltage, or nobody measured it with
        anything else.

    """
    evidence = fitter.evidence
    tracks = tuple(replace(track, measured={'voltage': track.measured['voltage']})
                   for track in evidence.tracks if _is_cut(track))
    if not tracks:
        return None
    alone = replace(evidence, tracks=tracks)
    at = np.concatenate([np.full(where.stop - where.start,
                                 channel == 'voltage' and _is_cut(evidence.tracks[i]))
                         for (i, channel), where in zip(evidence.keys, spans(evidence))])
    left = search.nominal.residual[at]
    if Judge.from_residual(alone, left, left).structure(left) < thresholds.excess:
        return None
    progress('looking at the measured voltage')
    known = {name: search.fits[name] for name in DRIVE}
    before = _diagnosed(fitter.device, alone, DRIVE, known, thresholds, progress)
    if before.explained < thresholds.drive and before.decision.structure < UNMISTAKABLE:
        return None  # it may be the sensor's noise after all
    for ranked in before.decision.singles[:LEADING]:
        found = before.search.fits[ranked.name]
        fit = fitter.fit(found.effects, search.fits[ranked.name].phi, STEPS)
        if fit.cost < search.fits[ranked.name].cost:
            search.fits[ranked.name] = fit
    progress('looking behind the measured voltage')
    driver = fitter.device_with(before.best.effects, before.best.phi)
    ideal = fitter.device.replace(effects={
        name: values for name, values in fitter.device.effects.items() if name not in DRIVE})
    behind = _cut(evidence, driver, ideal)
    return Terminals(before, _diagnosed(ideal, behind, BEHIND, {}, thresholds, progress))


def _share_of_drive(fitter: Fitter, search: Search) -> float:
    """Return the part of the power of the gap that lies before the terminals."""
    evidence, tuned = fitter.evidence, fitter.device_with({}, search.nominal.phi)
    cuts = block_residuals(tuned, evidence, simulate_set(
        tuned, [track.recording for track in evidence.tracks]))
    fractions, _ = shares(cuts, None, evidence.channels)
    return fractions.get('drive', 0.0) if any(fractions.values()) else 1.0


def _diagnosed(device: Device, evidence: Evidence, names: Collection[str],
               known: dict[str, Fit], thresholds: Thresholds, progress: Callable[[str], None]
               ) -> Part:
    """Return what some effects explain of a part of the chain; ``known`` are places to start."""
    fitter = Fitter(device, evidence)
    fitter.prepare(parallel)
    search = search_singles(fitter, progress, names, known)
    decision = decide_search(fitter, search, judge_of(fitter, search), 0.0,
                             isolability(fitter, search), thresholds, progress)
    chances = probabilities(decision.singles, thresholds, decision.alike.groups)
    return Part(search, decision, fitter, {
        each.name: float(chance) for each, chance in zip(decision.singles, chances)})


def _length(search: Search, name: str) -> float:
    """Return how long an effect is, in standard deviations, where it was looked at."""
    return max((float(np.linalg.norm(probe.direction, axis=0).max())
                for probe in search.probes[name] if probe.direction is not None), default=0.0)


def _is_cut(track: Track) -> bool:
    return track.recording.drive == 'voltage' and len(track.measured) > 1 and (
        'voltage' in track.measured)


def _cut(evidence: Evidence, driver: Device, ideal: Device) -> Evidence:
    """Return the evidence of what lies behind the terminals, driven by their voltage."""
    kept = [track for track in evidence.tracks
            if _is_cut(track) or track.recording.drive in ('open', 'shorted')]

    def one(track):
        return MeasuredVoltage.of(track, driver) if _is_cut(track) else None

    voltages = parallel(one, kept)
    # The clock that comes late now and then is the same in all of them.
    late = max((voltage.jitter for voltage in voltages if voltage is not None), default=0.0)
    recordings = [track.recording if voltage is None else voltage.as_command()
                  for track, voltage in zip(kept, voltages)]
    simulated = simulate_set(ideal, recordings)
    answers = parallel(lambda voltage: voltage and voltage.answer_of(ideal), voltages)

    def evened(job):
        recording, steps, answer = job
        # What steps as long as a row make of it was not measured: every fit is spared it.
        return recording if answer is None else recording.replace(measured={
            channel: values - answer[channel] + steps[channel]
            for channel, values in recording.measured.items()})

    new = prepare([evened(job) for job in zip(recordings, simulated, answers)], simulated, ideal)

    def weighed(job):
        track, voltage, answer = job
        if voltage is None:
            return track
        # What may be wrong between the rows counts as noise.
        strayed = voltage.strayed(ideal, answer, late)
        return replace(track, sigma={
            channel: math.hypot(sigma, float(np.std(track.average(strayed[channel]))))
            for channel, sigma in track.sigma.items()})

    return replace(new, tracks=tuple(parallel(weighed, zip(new.tracks, voltages, answers))))
