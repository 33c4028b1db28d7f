# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
How good a hypothesis is: its prediction of rows that its fit never saw.

Residuals of a simulation are correlated in time, so a recording of thousands
of rows holds only a few dozen independent ones.  A track counts with that
number: L = -1/2 sum n_eff log(Q + d), with Q the mean square of the weighted
residual over the withheld rows of a (track, channel).  No library holds the
true form of an effect, so that a small part d of the gap may stay without
speaking against a hypothesis.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
import math

import numpy as np

from piezo_stack_sim.gap.fitting.lens import Cells
from piezo_stack_sim.gap.measured.evidence import Evidence, STRETCHES, Track
from piezo_stack_sim.gap.measured.forward import spans
from piezo_stack_sim.gap.measured.noise import integrated_correlation


SURE = 4.5  # standard deviations from which an excess is no chance: dozens of tracks are looked at
NOISE_ERROR = 0.1  # part by which the power of the noise may be estimated wrong
CHANCES = 10.0  # rows at least that noise of any colour has by itself, however slow a gap is
LOUD = 0.15  # excess over the noise power from which a track has something left
FORM = 0.02  # part of a gap's power by which the true form of its cause may differ


@dataclass(frozen=True)
class Judge:
    """Scores residual vectors of one set with one count of independent rows."""

    evidence: Evidence
    weights: np.ndarray  # independent withheld rows per (track, channel)
    forgiven: np.ndarray  # mean square of the difference in form, per (track, channel)
    seen: bool = False  # judge by the rows of the fit instead, for comparison

    @classmethod
    def from_residual(cls, evidence: Evidence, residual: np.ndarray,
                      nominal: np.ndarray) -> Judge:
        """Count independent rows from the residual of the best hypothesis at hand."""
        weights, forgiven = [], []
        for (i, _), where in zip(evidence.keys, spans(evidence)):
            withheld = ~evidence.tracks[i].fitted
            tau = integrated_correlation(residual[where])
            weights.append(max(withheld.sum() / tau, 3.0))
            gap = float(np.mean(nominal[where][withheld] ** 2)) - 1.0
            forgiven.append(FORM * max(gap, 0.0))
        return cls(evidence, np.array(weights), np.array(forgiven))

    def powers(self, residual: np.ndarray) -> np.ndarray:
        """Return Q of every (track, channel): 1 is nothing but noise."""
        return np.array([
            float(np.mean(residual[where][self.evidence.tracks[i].fitted == self.seen] ** 2))
            for (i, _), where in zip(self.evidence.keys, spans(self.evidence))])

    def structure(self, residual: np.ndarray) -> float:
        """
        Return the largest excess over the noise power that is not chance, 0 if none is.

        What all recordings of a sensor have in excess may be its noise: the estimate is
        not better known than that.
        """
        excess = self.powers(residual) - 1.0
        sure = excess > SURE * np.sqrt(2.0 / np.maximum(self.weights, CHANCES))
        channels = np.array([channel for _, channel in self.evidence.keys])
        for channel in np.unique(channels):
            alike = channels == channel
            if np.count_nonzero(alike) > 1:
                excess[alike] -= np.clip(excess[alike].min(), 0.0, NOISE_ERROR)
        return float(np.max(np.where(sure, excess, 0.0), initial=0.0))

    def score(self, residual: np.ndarray) -> float:
        """Return the log score of a residual vector; greater is better."""
        # A small floor: below the noise there is nothing to win.
        power = np.maximum(self.powers(residual), 0.3) + self.forgiven
        return -0.5 * float(np.sum(self.weights * np.log(power)))

    def left(self, powers: np.ndarray, reference: np.ndarray) -> float:
        """
        Return which part of what a reference leaves beyond the noise is still left, 0 to 1.

        The mean over tracks, each with the weight of what the reference leaves
        there in nats: a huge gap in one does not hide the others.
        """
        excess = np.maximum(reference - 1.0, 0.0)
        nats = self.weights * np.log1p(excess) * (excess > LOUD)
        if not nats.any():
            return 1.0
        ratio = np.clip((powers - 1.0) / np.maximum(excess, 1e-9), 0.0, 2.0)
        return float(np.sum(nats * ratio) / np.sum(nats))

    @cached_property
    def cells(self) -> Cells:
        """Return the rows that are judged by, in cells of time and frequency."""
        return Cells(self.evidence, fitted=self.seen)

    def difference(self, residual: np.ndarray, reference: np.ndarray) -> tuple[float, float]:
        """Return by how much a residual scores better than a reference, and its error."""
        parts = []
        for k, ((i, _), where) in enumerate(zip(self.evidence.keys, spans(self.evidence))):
            withheld = ~self.evidence.tracks[i].fitted
            new, old = residual[where][withheld] ** 2, reference[where][withheld] ** 2
            # What the logarithm of each mean changes by with its rows.
            each = [square / (max(float(np.mean(square)), 0.3) + self.forgiven[k])
                    for square in (old, new)]
            pieces = np.array_split(each[0] - each[1], max(2, STRETCHES // 2))
            parts.append(0.5 * self.weights[k] / new.size * np.array([p.sum() for p in pieces]))
        total = np.sum(parts, axis=0)
        error = float(np.std(total, ddof=1) * math.sqrt(total.size))
        return self.score(residual) - self.score(reference), error


def without_zero(track: Track, channel: str, weighted: np.ndarray) -> np.ndarray:
    """
    Return weighted residuals (m,) as errors in SI units, without what an unknown zero hides.

    That of charge and displacement is the first row; that of the voltage is none of a sensor.
    """
    if channel == 'voltage':
        return track.errors(channel, weighted)
    return track.sigma[channel] * (weighted - weighted.mean())


def channel_power(evidence: Evidence, residual: np.ndarray, fitted: bool | None = False,
                  centred: bool = False) -> dict[str, float]:
    """
    Return the mean square residual of every channel in SI units squared.

    ``fitted`` False takes the withheld rows, True the fitted ones, None all.
    ``centred`` leaves out the mean of each track where the zero of a sensor hides it.
    """
    totals: dict[str, list[float]] = {}
    for (i, channel), where in zip(evidence.keys, spans(evidence)):
        track = evidence.tracks[i]
        rows = slice(None) if fitted is None else track.fitted == fitted
        error = (without_zero(track, channel, residual[where]) if centred
                 else residual[where] * track.sigma[channel])
        square = error[rows] ** 2
        entry = totals.setdefault(channel, [0.0, 0.0])
        # Averaged rows stand for as many as they hold; their noise is that of the average.
        entry[0] += float(np.sum(square))
        entry[1] += square.size
    return {channel: total / count for channel, (total, count) in totals.items() if count}


def noise_power(evidence: Evidence) -> dict[str, float]:
    """Return the power of the noise in the averaged rows, pooled as :func:`channel_power`."""
    totals: dict[str, list[float]] = {}
    for i, channel in evidence.keys:
        track = evidence.tracks[i]
        count = int((~track.fitted).sum())
        entry = totals.setdefault(channel, [0.0, 0.0])
        entry[0] += count * track.sigma[channel] ** 2
        entry[1] += count
    return {channel: total / count for channel, (total, count) in totals.items() if count}
