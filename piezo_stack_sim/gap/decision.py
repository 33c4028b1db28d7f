# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""From fits to a verdict: hypotheses ranked on withheld rows, pairs asked for, decided."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
import math

import numpy as np

from piezo_stack_sim.effects.registry import EFFECTS
from piezo_stack_sim.gap.candidates import Search, search_partners
from piezo_stack_sim.gap.evidence import Evidence
from piezo_stack_sim.gap.fit import Fit, Fitter
from piezo_stack_sim.gap.isolability import Alike
from piezo_stack_sim.gap.score import channel_power, Judge, noise_power
from piezo_stack_sim.gap.starts import Extent
from piezo_stack_sim.gap.verdict import decide, Ranked, Thresholds, Verdict

BASES = 2  # single effects from which pairs are tried
RIVAL = 0.7  # part of the best gain from which a second one is tried


@dataclass(frozen=True)
class Decision:
    """Hypotheses, best first, and what follows from them."""

    judge: Judge
    removable: Removable
    singles: list[Ranked]
    pairs: list[Ranked]
    ceiling: float
    structure: float
    alike: Alike
    verdict: Verdict

    def chosen(self, search: Search) -> Fit:
        """Return the fit of what was selected; the nominal one if nothing was."""
        if not self.verdict.selected:
            return search.nominal
        return search.fits['+'.join(sorted(self.verdict.selected, key=list(EFFECTS).index))]


class Removable:
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


def count(fit: Fit) -> int:
    """Return how many numbers a hypothesis chose."""
    return len(fit.free) + (0 if fit.line is None else 2 + len(fit.line.phases))


def rank(names, search: Search, judge: Judge, removable: Removable,
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
            count(fit), judge.strict(powers) - strict, judge.left(powers, base),
            float(np.max(powers)) - 1.0))
    if reference is None:
        return sorted(ranked, key=lambda r: (-r.gain, r.name))
    return sorted(ranked, key=lambda r: (-r.strict, r.name))


def search_pairs(fitter: Fitter, extent: Extent, search: Search, judge: Judge,
                 thresholds: Thresholds, progress: Callable[[str], None]) -> None:
    """Fit second effects beside the best, where these leave something that they could explain."""
    singles = _singles(search, judge, Removable(judge.evidence, search.nominal.residual))
    if singles[0].gain > thresholds.detect and singles[0].excess > thresholds.leftover:
        for ranked in singles[:BASES]:
            if ranked.gain > RIVAL * singles[0].gain:
                search_partners(fitter, extent, search, ranked.name, progress)


def _singles(search: Search, judge: Judge, removable: Removable) -> list[Ranked]:
    return rank([n for n in search.fits if '+' not in n], search, judge, removable)


def decide_search(search: Search, judge: Judge, ceiling: float, alike: Alike,
                  thresholds: Thresholds) -> Decision:
    """
    Rank all that was fitted, and decide.

    Parameters
    ----------
    search : Search
        All fits.
    judge : Judge
        Scores them.
    ceiling : float
        Part of the removable gap that a flexible correction removes.
    alike : Alike
        What the recordings cannot tell apart.
    thresholds : Thresholds
        What was learned on the development set.

    """
    # What re-tuning removes is calibration, not a cause.
    removable = Removable(judge.evidence, search.nominal.residual)
    singles = _singles(search, judge, removable)
    pairs = rank([n for n in search.fits if '+' in n], search, judge, removable,
                 search.fits[singles[0].name])
    structure = judge.structure(search.nominal.residual)
    verdict = decide(singles, pairs, ceiling, structure, alike.classes, thresholds, alike.kin)
    return Decision(judge, removable, singles, pairs, ceiling, structure, alike, verdict)
