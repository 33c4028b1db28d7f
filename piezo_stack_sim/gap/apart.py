# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What charge moves, and what moves beside it.

Behind the charge at its electrodes a stack is linear (Eqs. 11, 14 and 15 of the paper): what is
wrong before it, be it the driver or the ceramic, makes a displacement wrong by what the wrong
charge moves.  The displacement less that has none of it, however wrong the form of the effect is
that should explain it, and shows what lies behind.
"""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np
from piezo_stack_sim.gap.evidence import Evidence
from piezo_stack_sim.gap.forward import spans
from piezo_stack_sim.plant import Device
from scipy import signal

#: Noise of the charge, as what it moves, against that of the displacement, up to which it is told.
QUIET = 1.0


def gain_per_charge(device: Device) -> float:
    """Return the static displacement per charge at the electrodes (m/C)."""
    actuator = device.actuator
    ratio, stiffness = actuator.transformer_ratio, actuator.stiffness + device.load.stiffness
    return ratio / (ratio ** 2 + stiffness * actuator.linear_capacitance)


def moved_by_charge(device: Device, charge: np.ndarray, period: float) -> np.ndarray:
    """
    Return how far a charge moves the end: Eqs. 11, 14 and 15.

    Parameters
    ----------
    device : Device
        What moves.
    charge : ndarray, shape (n,) or (n, k)
        Charge (C) in rows that follow each other.
    period : float
        Of the rows (s).

    Returns
    -------
    ndarray, shape as given
        Displacement (m).

    """
    actuator, load = device.actuator, device.load
    ratio, cap = actuator.transformer_ratio, actuator.linear_capacitance
    mass, damping = actuator.mass + load.mass, actuator.damping + load.damping
    stiffness = actuator.stiffness + load.stiffness + ratio ** 2 / cap
    b, a, _ = signal.cont2discrete(
        ([ratio / cap / mass], [1.0, damping / mass, stiffness / mass]), period, 'bilinear')
    return signal.lfilter(np.ravel(b), np.ravel(a), charge, axis=0)


@dataclass(frozen=True)
class _Follows:
    """A track with both: where they lie in a residual, and the noise of each (C, m)."""

    charge: slice
    displacement: slice
    period: float
    per_charge: float
    per_displacement: float


class Apart:
    """
    Takes what the charge moves off the displacement, in residuals of all tracks.

    Only where the noise of the charge leaves enough to be seen.

    Parameters
    ----------
    evidence : Evidence
        What residuals belong to, with the device that they are about; without one nothing is
        taken off.

    """

    def __init__(self, evidence: Evidence) -> None:
        self.device = evidence.device
        where = dict(zip(evidence.keys, spans(evidence)))
        self.tracks = [] if self.device is None else [
            _Follows(where[i, 'charge'], where[i, 'displacement'],
                     track.recording.period * track.factor,
                     track.sigma['charge'], track.sigma['displacement'])
            for i, track in enumerate(evidence.tracks)
            if {'charge', 'displacement'} <= set(track.measured)
            and gain_per_charge(self.device) * track.sigma['charge']
            < QUIET * track.sigma['displacement']]

    def __call__(self, values: np.ndarray) -> np.ndarray:
        """Return weighted residuals or changes of them, (N,) or (N, k), taken apart."""
        if self.device is None or not self.tracks:
            return values
        result = np.array(values, dtype=float)
        gain = gain_per_charge(self.device)
        for track in self.tracks:
            moved = moved_by_charge(
                self.device, track.per_charge * result[track.charge], track.period)
            result[track.displacement] = (
                track.per_displacement * result[track.displacement] - moved
            ) / math.hypot(track.per_displacement, gain * track.per_charge)
        return result
