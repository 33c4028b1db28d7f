# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What the answer would have been without one part of the method, for the benchmark.

The fits are the same, only the decision is taken again: on the rows that were
fitted, or as if residuals were not correlated in time, or with the block taken
from the best effect instead of from the cuts.  Without calibration the leading
effects are fitted again with the nominal parameters held.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from piezo_stack_sim.effects.registry import EFFECTS
from piezo_stack_sim.gap.deciding.decision import judge_of
from piezo_stack_sim.gap.deciding.score import Judge
from piezo_stack_sim.gap.deciding.verdict import Verdict
from piezo_stack_sim.gap.fitting.candidates import Search
from piezo_stack_sim.gap.fitting.fit import Fitter

LEADING = 4  # effects that are fitted again without calibration
STEPS = 3


def ablations(search: Search, fitter: Fitter, judge: Judge, decided: Verdict,
              decide_by: Callable[[Search, Judge], Verdict]) -> dict:
    """
    Return the answers without a part each, in the form of baselines.

    ``decide_by(search, judge)`` ranks and decides; ``decided`` is the full answer.
    """
    white = np.array([float((~judge.evidence.tracks[i].fitted).sum())
                      for i, _ in judge.evidence.keys])
    best = max((n for n in search.fits if '+' not in n),
               key=lambda n: judge.score(search.fits[n].residual))
    return {
        'no_withheld': _plain(decide_by(search, replace(judge, seen=True))),
        'no_correlation': _plain(decide_by(search, replace(judge, weights=white))),
        'no_calibration': _plain(decide_by(*_held(search, fitter))),
        'no_cutting': {**_plain(decided), 'block': (
            None if decided.word == 'NO_GAP' else EFFECTS[best].block)},
    }


def _plain(verdict: Verdict) -> dict:
    return {'verdict': verdict.word, 'effect': '+'.join(verdict.selected) or None}


def _held(search: Search, fitter: Fitter) -> tuple[Search, Judge]:
    """Return a search whose fits hold the nominal parameters, and its judge."""
    nominal = fitter.fit({}, steps=0)
    falls = {}
    for name, probes in search.probes.items():
        for probe in probes:
            if probe.direction is not None:
                along = probe.direction[fitter.rows].astype(float)
                length = np.maximum(np.sum(along ** 2, axis=0), 1e-9)
                fall = float(np.max((nominal.residual[fitter.rows] @ along) ** 2 / length))
                if fall > falls.get(name, (0.0,))[0]:
                    falls[name] = (fall, probe.place)
    held = Search(nominal)
    for name in search.probes:
        held.fits[name] = replace(nominal, effects={name: {}}, view=None)
    for name in sorted(falls, key=lambda n: -falls[n][0])[:LEADING]:
        held.fits[name] = fitter.fit({name: falls[name][1]}, steps=STEPS, held=True)
    return held, judge_of(fitter, held)
