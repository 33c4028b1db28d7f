# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
How wrong the form of a hypothesis must be for what it leaves, and how likely that is.

No library holds the true form of an effect.  What the form of one misses is a
part of what the effect does: it is found at the times and in the octaves in
which the effect acts, hardly elsewhere, and is a few per cent of it.  What a
hypothesis leaves in a cell of time and octave is therefore compared with

    s = 1 + sum_e (share_e)^2 a_e

with 1 the power of the noise, a_e that of what effect e does there, and share_e
the relative error of its form, which is fitted, but never thought smaller than a
few per cent.  The cells are judged by a Student distribution about s: an error of form
is not spread evenly.  A discrepancy model in the sense of Kennedy and O'Hagan,
*Bayesian calibration of computer models*, J. R. Stat. Soc. B 63 (2001), with
a variance that the effect itself sets.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from piezo_stack_sim.effects.registry import EFFECTS
from piezo_stack_sim.gap.fitting.fit import Fit, Fitter
from piezo_stack_sim.gap.fitting.lens import Cells, Lens, weighed

LEAST = 0.02  # share by which the form of any effect is wrong
SHARES = LEAST * 50.0 ** np.linspace(0.0, 1.0, 12)  # up to all of it
DEAR = 30.0  # nats that a share of one costs: forms are wrong by a few per cent, not by half
LEAK = 0.1  # part of what an effect does in a block of time that its form misses in any octave
NEXT = 0.1  # part of that in the blocks beside it
COUNTED = 8  # coefficients of a cell that count as independent
TAIL = 4.0  # degrees of freedom: how unevenly an error of form is spread
ROUNDS = 3  # of the search for the shares, one effect after the other
HOPED = 0.03  # share that is granted before it is known what else there is


def are_alike_in_form(one: str, other: str) -> bool:
    """Tell whether one of two effects is known to resemble what the form of the other leaves."""
    return one in EFFECTS[other].form_like or other in EFFECTS[one].form_like


@dataclass(frozen=True)
class Form:
    """
    What a fit leaves, judged.

    ``nats`` are lost against noise alone, ``shares`` the relative error of the form of each
    effect, ``weight`` what a fit should multiply the coefficients of every cell by, ``hoped`` the
    same if no form were worse than usual.
    """

    nats: float
    shares: dict[str, float]
    weight: np.ndarray
    hoped: np.ndarray


class Forms:
    """Judges the fits of one fitter in some cells, and remembers."""

    def __init__(self, fitter: Fitter, cells: Cells) -> None:
        self.fitter = fitter
        self.cells = cells
        self._sizes = cells.sizes()
        self._count = np.concatenate([
            np.broadcast_to(0.5 * np.minimum(size, COUNTED), (len(rows), size.size)).ravel()
            for size, rows in zip(self._sizes, cells.blocks)])
        self._known: dict[int, tuple[Fit, Form]] = {}

    def of(self, fit: Fit) -> Form:
        """Return what a fit leaves, judged."""
        known = self._known.get(id(fit))
        if known is None:
            known = self._known[id(fit)] = fit, self._judged(fit)  # the fit stays: so does its id
        return known[1]

    def nats(self, fit: Fit) -> float:
        """Return what a fit loses against noise alone."""
        return self.of(fit).nats

    def lens(self, fit: Fit, hoped: bool = False) -> Lens:
        """
        Return the lens that shows what a fit does not excuse by the error of its form.

        ``hoped``: as if its form were no worse than usual.  What it must be for what is left is
        too much as long as something else is wrong, and would hide that.
        """
        form = self.of(fit)
        return weighed(self.cells, self.cells.over(self._blocks(
            form.hoped if hoped else form.weight)))

    def better(self, fit: Fit, known: Fit | None) -> bool:
        """Tell whether a fit loses less than a known one, if there is one."""
        return known is None or self.nats(fit) < self.nats(known)

    def _judged(self, fit: Fit) -> Form:
        left = self._flat(self.cells.of(self.cells.spectrum(fit.residual)))
        left = np.maximum(left, 1.0)
        names = list(fit.effects)
        does = [self._flat(self._leaking(self._does(fit, name))) for name in names]

        def lost(shares):
            power = 1.0 + sum((s * s * a for s, a in zip(shares, does)), np.zeros_like(left))
            cells = np.log(power) + (1.0 + TAIL) * np.log(
                (TAIL + left / power) / (TAIL + 1.0))
            return float(self._count @ cells) + DEAR * sum(shares), power

        shares = [LEAST] * len(names)
        nats, power = lost(shares)
        for _ in range(ROUNDS):
            before = nats
            for i in range(len(names)):
                for share in SHARES:
                    other = [*shares[:i], float(share), *shares[i + 1:]]
                    now, there = lost(other)
                    if now < nats:
                        nats, power, shares = now, there, other
            if before - nats < 0.1 or len(names) < 2:
                break
        return Form(nats, dict(zip(names, shares)),
                    np.sqrt((1.0 + TAIL) / (TAIL * power + left)),
                    1.0 / np.sqrt(lost([HOPED] * len(names))[1]))

    def _does(self, fit: Fit, name: str) -> np.ndarray:
        """Return what an effect of a fit does to the residual, (N,)."""
        others = {other: values for other, values in fit.effects.items() if other != name}
        return self.fitter.residual_of(others, fit.phi, fit) - fit.residual

    def _leaking(self, done: np.ndarray) -> list[np.ndarray]:
        """Return the power of an effect (N,) in cells, (blocks, octaves), spread about."""
        result = []
        for power, size in zip(self.cells.of(self.cells.spectrum(done)), self._sizes):
            power = power + LEAK * (power @ size / size.sum())[:, None]
            beside = np.zeros_like(power)
            beside[1:] = power[:-1]
            beside[:-1] = np.maximum(beside[:-1], power[1:])
            result.append(np.maximum(power, NEXT * beside))
        return result

    @staticmethod
    def _flat(cells: list[np.ndarray]) -> np.ndarray:
        return np.concatenate([each.ravel() for each in cells])

    def _blocks(self, flat: np.ndarray) -> list[np.ndarray]:
        result, start = [], 0
        for size, rows in zip(self._sizes, self.cells.blocks):
            end = start + len(rows) * size.size
            result.append(flat[start:end].reshape(len(rows), size.size))
            start = end
        return result
