# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
How a stranger is met: which of those that the library lacks explains the recordings best.

Each is put on the outputs of the re-tuned device (gap/lacking/strangers.py), and the nominal
parameters are re-tuned beside it, as beside an effect of the library.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
import math

import numpy as np
from piezo_stack_sim.gap.cores import parallel
from piezo_stack_sim.gap.fitting.fit import Fit, Fitter
from piezo_stack_sim.gap.lacking.back_coupling import Suspect
from piezo_stack_sim.gap.lacking.strangers import Outputs, Stranger, STRANGERS
from piezo_stack_sim.gap.measured.forward import residuals_of, simulate_set
from piezo_stack_sim.plant import Device
from scipy.optimize import lsq_linear, minimize_scalar

AGAIN = 2  # times that the best place is re-tuned and simulated


@dataclass(frozen=True)
class Met:
    """
    A stranger where it leaves least: ``residual`` (N,) is what it leaves, over the noise.

    ``misread`` is the channel that is right and only read wrong, '' for none.
    """

    suspect: Suspect
    residual: np.ndarray
    cost: float
    misread: str = ''


def meet(fitter: Fitter, nominal: Fit) -> Met | None:
    """
    Return the stranger that explains the recordings best, or None if none may be told.

    Parameters
    ----------
    fitter : Fitter
        Of the set.
    nominal : Fit
        Of the re-tuned nominal device.

    """
    channels = set(fitter.evidence.channels)
    around = _Around(fitter, nominal)
    met = parallel(lambda stranger: _met(around, stranger), [
        stranger for stranger in STRANGERS if any(need <= channels for need in stranger.needs)])
    return min(met, key=lambda one: one.cost, default=None)


def meet_one(fitter: Fitter, nominal: Fit, stranger: Stranger) -> Met:
    """Return one stranger where it leaves least, whatever channels it takes to be told."""
    return _met(_Around(fitter, nominal), stranger)


def _met(around: _Around, stranger: Stranger) -> Met:
    """Return a stranger with the size that leaves least."""
    evidence = around.fitter.evidence
    phi, best, (device, outputs, base) = around.phi, None, around.start
    for again in range(AGAIN):
        if again:
            device, outputs, base = around.at(phi)
        left = around.cleared(around.lens(base))
        # Where it was best at first it is about best again, the parameters re-tuned beside it.
        sizes = list(stranger.sizes(outputs) if best is None else stranger.near(best))

        def ask(size):
            change = residuals_of(evidence, stranger.put(device, evidence, outputs, size)) - base
            return around.cost(left, change, stranger.any_scale)

        if best is not None and stranger.smooth:
            around_it, sign = math.log(abs(best)) + np.array([-0.5, 0.5]), math.copysign(1.0, best)
            best = sign * math.exp(minimize_scalar(
                lambda size: ask(sign * math.exp(size))[0], bounds=around_it, method='bounded').x)
            sizes = [best]
        costs = parallel(ask, sizes)
        best = sizes[int(np.argmin([cost for cost, _ in costs]))]
        scale = costs[sizes.index(best)][1]
        change = scale * (
            residuals_of(evidence, stranger.put(device, evidence, outputs, best)) - base)
        cost, new = around.tuned(base + change, phi)
        residual = base + change + around.slope @ (new - phi)
        phi = new
    much = stranger.says(best, scale)
    suspect = stranger.suspect
    return Met(replace(suspect, reason=suspect.reason + much) if much else suspect,
               residual, cost, stranger.misread)


class _Around:
    """What re-tuning the nominal parameters does, linearly, around a fit of them."""

    def __init__(self, fitter: Fitter, nominal: Fit) -> None:
        self.fitter, self.phi, self.nuisance = fitter, nominal.phi, fitter.nuisance
        self.lens = fitter.lens
        self.slope = fitter.nominal.whole if nominal.nominal is None else nominal.nominal
        self.seen = self.lens(self.slope).astype(float)
        self.precision = np.diag(self.nuisance.prior ** -2.0)
        self.square = self.seen.T @ self.seen + self.precision
        self.inverse = np.linalg.inv(self.square)
        self.start = self.at(nominal.phi)

    def at(self, phi: np.ndarray) -> tuple[Device, Outputs, np.ndarray]:
        """Return the device with its parameters so, its outputs, and its residual (N,)."""
        evidence, device = self.fitter.evidence, self.fitter.device_with({}, phi)
        outputs = simulate_set(device, [track.recording for track in evidence.tracks])
        return device, outputs, residuals_of(evidence, outputs)

    def cleared(self, seen: np.ndarray) -> np.ndarray:
        """Return changes (M,) without what the nominal parameters, bounds apart, can imitate."""
        return seen - self.seen @ (self.inverse @ (self.seen.T @ seen))

    def cost(self, left: np.ndarray, change: np.ndarray, any_scale: bool
             ) -> tuple[float, float]:
        """
        Return the cost of a change (N,) of a residual, and the multiple of it that counts.

        ``left`` (M,) is what is seen of the residual without what is re-tuned.
        """
        along = self.cleared(self.lens(change))
        scale = 1.0
        if any_scale:
            scale = -float(along @ left) / max(float(along @ along), 1e-30)
        rest = left + scale * along
        return float(rest @ rest), scale

    def tuned(self, residual: np.ndarray, phi: np.ndarray) -> tuple[float, np.ndarray]:
        """Return the cost of a residual (N,) with the parameters re-tuned in their bounds."""
        now = self.lens(residual) - self.seen @ phi
        root = np.linalg.cholesky(self.square)
        bound = self.nuisance.bound + 1e-12
        new = lsq_linear(root.T, -np.linalg.solve(root, self.seen.T @ now), (-bound, bound),
                         method='bvls').x
        rest = now + self.seen @ new
        return float(rest @ rest + new @ self.precision @ new), new
