# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The rising curve: voltage against charge from the relaxed state, out of whatever was recorded.

Where a recording begins relaxed, the curve is every row in which the charge
exceeds all that came before: loops within forget themselves (return-point
memory).  Where it does not, the branch between the two ends of the largest
loop is the same curve drawn at twice the size (Masing), whatever came before.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

ENOUGH = 40  # rows, below which a branch is no curve
ALIKE = 0.03  # of the voltage span: a first rise this near to the half branch began relaxed
SLOW = 2e-3  # s; the span of a branch divided by its slew: shorter ones show inertia
NEAR_FULL = 0.6  # of the largest span there is: curves that are worth pooling


@dataclass(frozen=True)
class Curve:
    """
    A rising curve.

    ``charge`` (n,) C and ``voltage`` (n,) V increase from near zero; ``relaxed``
    tells whether the recording began relaxed (else the curve is half a
    branch), ``proxy`` whether the charge is displacement times a guess.
    """

    name: str
    charge: np.ndarray
    voltage: np.ndarray
    relaxed: bool
    proxy: bool = False

    @property
    def span(self) -> float:
        """Largest charge (C)."""
        return float(self.charge[-1])


def rising_curves(recordings, charge_per_displacement: float) -> list[Curve]:
    """
    Return the rising curves of those recordings that are slow enough and reach far.

    Parameters
    ----------
    recordings : sequence of Recording
        After preflight.
    charge_per_displacement : float
        C/m, stands in for the charge where only displacement was measured.

    Returns
    -------
    list of Curve
        Longest first; may be empty.

    """
    curves = []
    for recording in recordings:
        curve = _curve_of(recording, charge_per_displacement)
        if curve is not None:
            curves.append(curve)
    curves.sort(key=lambda c: -c.span)
    relaxed = [c for c in curves if c.relaxed and c.span > NEAR_FULL * curves[0].span]
    return relaxed or curves[:1]


def _curve_of(recording, charge_per_displacement) -> Curve | None:
    if np.ptp(recording.external_force) > 0.0:
        return None
    if recording.drive == 'voltage':
        # The command, shifted to the rows in which it has acted, has no noise.
        voltage = np.concatenate([[0.0], recording.command[:-1]])
    elif recording.drive == 'charge' and 'voltage' in recording.measured:
        voltage = recording.measured['voltage']
    else:
        return None
    proxy = False
    if 'charge' in recording.measured:
        charge = recording.measured['charge']
    elif recording.drive == 'charge':
        charge = np.concatenate([[0.0], recording.command[:-1]])
    elif 'displacement' in recording.measured:
        charge, proxy = recording.measured['displacement'] * charge_per_displacement, True
    else:
        return None
    guide = voltage if recording.drive == 'voltage' else charge
    if not _slow(recording.time, guide) or guide.max() <= 0.0:
        return None
    first = _envelope(guide)
    half = _half_branch(voltage, charge, guide)
    relaxed = first.size >= ENOUGH and abs(guide[0]) < 0.01 * guide.max()
    if relaxed and half is not None:
        # Masing: both are the same curve if and only if the device was relaxed.
        reach = min(half[0][-1], charge[first[-1]])
        grid = np.linspace(0.05, 0.95, 40) * reach
        rise = np.interp(grid, *_monotone(charge[first], voltage[first]))
        relaxed = np.abs(rise - np.interp(grid, *half)).max() < ALIKE * rise[-1]
    if relaxed:
        q, v = _monotone(charge[first], voltage[first])
        return Curve(recording.name, q, v, True, proxy)
    if half is None:
        return None
    q, v = half
    return Curve(recording.name, q, v, False, proxy)


def _slow(time, guide) -> bool:
    speed = np.quantile(np.abs(np.diff(guide) / np.diff(time)), 0.95)
    return bool(speed > 0.0 and np.ptp(guide) / speed > SLOW)


def _envelope(guide) -> np.ndarray:
    """Return the rows in which the guiding quantity exceeds all that came before."""
    before = np.concatenate([[-np.inf], np.maximum.accumulate(guide)[:-1]])
    rows = np.flatnonzero(guide > before)
    return rows[guide[rows] >= 0.0]


def _half_branch(voltage, charge, guide):
    """Return the longest branch after a reversal of the settled loop, at half its size."""
    top = guide.max()
    bottom_after = np.minimum.accumulate(guide[::-1])[::-1]
    peaks = np.flatnonzero(guide >= top - 1e-9 * abs(top))
    best = None
    for peak in peaks[:20]:
        # Down from the highest peak: nothing older is remembered on the way.
        if peak + 1 >= guide.size:
            continue
        low = bottom_after[peak]
        end = peak + int(np.flatnonzero(guide[peak:] <= low + 1e-9 * abs(top))[0])
        rows = np.arange(peak, end + 1)
        fall = rows[guide[rows] <= np.minimum.accumulate(guide[rows])]
        if fall.size >= ENOUGH and (best is None or fall.size > best.size):
            best = fall
    if best is None:
        return None
    return _monotone(0.5 * (charge[best[0]] - charge[best]),
                     0.5 * (voltage[best[0]] - voltage[best]))


def _monotone(charge, voltage):
    order = np.argsort(charge, kind='stable')
    charge, voltage = charge[order], voltage[order]
    keep = np.concatenate([[True], np.diff(charge) > 0.0])
    return charge[keep], voltage[keep]


def thin(curves, points: int = 240):
    """
    Average rising curves over bins that are fine near zero and even further out.

    Returns
    -------
    charge, voltage, weight : ndarray, shape (m,)
        C, V and rows in each bin.

    """
    charge = np.concatenate([c.charge for c in curves])
    voltage = np.concatenate([c.voltage for c in curves])
    top = charge.max()
    edges = np.unique(np.concatenate([
        np.geomspace(2e-4, 1.0, points // 2), np.linspace(0.0, 1.0, points // 2 + 1)])) * top
    index = np.digitize(charge, edges[1:-1])
    weight = np.bincount(index, minlength=edges.size - 1).astype(float)
    full = weight > 0.0
    mean = [np.bincount(index, each, edges.size - 1)[full] / weight[full]
            for each in (charge, voltage)]
    order = np.argsort(mean[0])
    return mean[0][order], mean[1][order], weight[full][order]
