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
from piezo_stack_sim.gap.measured.evidence import Evidence
from piezo_stack_sim.gap.measured.forward import spans
from piezo_stack_sim.plant import Device
from scipy import signal

#: Noise of the charge, as what it moves, against that of the displacement, up to which it is told.
QUIET = 1.0
RINGS = 4096  # averaged rows in which a resonance rings off


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
    b, a = _path(device, period)
    return signal.lfilter(b, a, charge, axis=0)


def noise_moved(device: Device, period: float, factor: int = 1) -> float:
    """
    Return the noise of what the charge moves by that of the charge (m/C), both of averaged rows.

    White noise shakes a resonance; what is slow moves the end as any charge does.
    """
    impulse = np.zeros(RINGS * factor)
    impulse[0] = 1.0
    answer = np.convolve(signal.lfilter(*_path(device, period), impulse), np.full(factor, 1.0))
    return max(float(np.linalg.norm(answer)) / math.sqrt(factor), gain_per_charge(device))


def _path(device: Device, period: float) -> tuple[np.ndarray, np.ndarray]:
    """
    Return the path from charge to displacement as a filter of rows, (3,) and (3,).

    For a charge that moves evenly between two rows: the bilinear rule would warp what is fast.
    """
    actuator, load = device.actuator, device.load
    ratio, cap = actuator.transformer_ratio, actuator.linear_capacitance
    mass, damping = actuator.mass + load.mass, actuator.damping + load.damping
    stiffness = actuator.stiffness + load.stiffness + ratio ** 2 / cap
    b, a, _ = signal.cont2discrete(
        ([ratio / cap / mass], [1.0, damping / mass, stiffness / mass]), period, 'foh')
    return np.ravel(b), np.ravel(a)


@dataclass(frozen=True)
class _Both:
    """
    A track with both: where they lie in a residual, the noise of each (C, m), the path.

    ``gain`` (m/C) is what the noise of the charge moves.
    """

    charge: slice
    displacement: slice
    charge_noise: float
    displacement_noise: float
    path: tuple[np.ndarray, np.ndarray]
    gain: float


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
        self.tracks: list[_Both] = []
        if evidence.device is None:
            return
        where = dict(zip(evidence.keys, spans(evidence)))
        for i, track in enumerate(evidence.tracks):
            if not {'charge', 'displacement'} <= set(track.measured):
                continue
            charge, displacement = track.sigma['charge'], track.sigma['displacement']
            period = track.recording.period * track.factor
            gain = noise_moved(evidence.device, period)
            if gain * charge < QUIET * displacement:
                self.tracks.append(_Both(
                    where[i, 'charge'], where[i, 'displacement'], charge, displacement,
                    _path(evidence.device, period), gain))

    def __call__(self, values: np.ndarray) -> np.ndarray:
        """Return weighted residuals or changes of them, (N,) or (N, k), taken apart."""
        if not self.tracks:
            return values
        result = np.array(values, dtype=float)
        for both in self.tracks:
            moved = signal.lfilter(*both.path, both.charge_noise * result[both.charge], axis=0)
            noise = math.hypot(both.displacement_noise, both.gain * both.charge_noise)
            result[both.displacement] = (
                both.displacement_noise * result[both.displacement] - moved) / noise
        return result
