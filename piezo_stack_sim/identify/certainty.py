# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""How well recordings determine each parameter, and which recording would do better."""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np

from piezo_stack_sim.gap.measured.noise import integrated_correlation
from piezo_stack_sim.identify.refine import cost_of, descend, Fit, LOOSE
from piezo_stack_sim.identify.tracks import blocks

CONFIDENCE = 1.959964  # standard deviations, 95 %
# Slipping makes the cost rough: a fit ends in a small dent near the minimum. Repeats
# (`identify.repeats`) show estimates that scatter by up to so much more than a smooth cost says.
ROUGH = 1.5
WIDE = 0.05  # half width of an interval, relative, above which a parameter is not determined
ANY = 1.0  # half width from which an interval says no more than that it may be anything
UNKNOWN = 20.0  # half width of what is anything
FOLLOWING = 8  # steps in which all else follows
ROWS_OF_A_PERIOD = 3  # of the resonance, at the least, in the fastest recording
MOTION = ('mass', 'damping')
SPLIT_NAMES = ('stiffness', 'linear_capacitance', 'transformer_ratio')


@dataclass(frozen=True)
class Estimate:
    """
    A parameter with its 95 % interval (SI units).

    ``determined`` tells whether these recordings fix it, ``advice`` which
    recording would, empty if they do; ``kept`` that it is still the number that
    the identification started from.
    """

    name: str
    value: float
    low: float
    high: float
    determined: bool
    advice: str = ''
    kept: bool = False

    @property
    def half_width(self) -> float:
        """Half the width of the interval, relative."""
        return 0.5 * math.log(self.high / self.low)


def estimates(fit: Fit, kept=()) -> list[Estimate]:
    """
    Return every parameter with its interval.

    The covariance is that of weighted least squares with residuals that are
    correlated in time: each channel of each recording counts as many rows as
    its misfit has independent ones.  What the vector says outright
    (`Layout.shown`) is tried by a step of `WIDE` in which all else follows: where
    recordings are blind, differences of simulations are the error of these, and
    look like a slope.

    Parameters
    ----------
    fit : Fit
        The joint fit.
    kept : collection of str
        Names of `MOTION` that were held at the number that the fit started from.

    Returns
    -------
    list of Estimate
        In the order of `Layout.named`.

    """
    layout, jacobian = fit.layout, fit.jacobian
    belief = np.eye(fit.vector.size) / LOOSE ** 2
    square, spread = belief.copy(), belief.copy()
    for track, channel, rows in blocks(fit.tracks):
        part = jacobian[rows].T @ jacobian[rows]
        used = track.used[channel]
        square += part
        spread += part * integrated_correlation(fit.residual[rows][used])
    scale = np.sqrt(np.diag(square))
    inverse = np.linalg.inv(square / np.outer(scale, scale)) / np.outer(scale, scale)
    to_named = layout.derivative(fit.vector)
    covariance = to_named @ inverse @ spread @ inverse @ to_named.T
    named = layout.named(fit.vector)
    widths = dict(zip(named, ROUGH * CONFIDENCE * np.sqrt(np.maximum(np.diag(covariance), 0.0))))
    for name, place in layout.shown:
        if widths[name] <= WIDE:
            follows = inverse[place] / inverse[place, place]  # at the least cost, by the slopes
            widths[name] *= _blindness(fit, place, follows)
    load = layout.device.load
    frequency = math.sqrt((named['k + T^2/C'] + load.stiffness)
                          / (named['mass'] + load.mass)) / (2.0 * math.pi)
    if frequency > max(track.recording.rate for track in fit.tracks) / ROWS_OF_A_PERIOD:
        # What is seen of so fast a motion hangs on what happens between the rows.
        widths.update(dict.fromkeys(MOTION, UNKNOWN))
    widths.update(dict.fromkeys(kept, UNKNOWN))
    fixed = {name for name, width in widths.items() if width <= WIDE}
    pushed = any(np.ptp(t.recording.external_force) > 0.0 for t in fit.tracks)
    charged = any('charge' in t.measured or t.recording.drive == 'charge' for t in fit.tracks)
    result = []
    for name, value in named.items():
        width = min(float(widths[name]), UNKNOWN)
        advice = '' if name in fixed else _advice(
            name, fixed, layout, pushed, charged, frequency)
        result.append(Estimate(name, value, value * math.exp(-width), value * math.exp(width),
                               name in fixed, advice, name in kept))
    return result


def _blindness(fit: Fit, place: int, follows: np.ndarray) -> float:
    """
    Return how much less the cost rises with an entry of the vector than its slope says; >= 1.

    ``follows`` (p,) is the direction in which all else follows.
    """
    slope = WIDE * (fit.jacobian @ follows)
    others = np.delete(np.arange(fit.vector.size), place)
    near = np.zeros(follows.size)  # what is not seen at all would follow anywhere
    for _, shown in fit.layout.shown:
        near[shown] = follows[shown]

    def rise(step):
        moved = descend(fit.layout, fit.vector + step * near, fit.tracks, others, FOLLOWING,
                        fit.start, loose=LOOSE)
        return cost_of(fit.layout, moved, fit.tracks) - here

    here, told = float(fit.residual @ fit.residual), float(slope @ slope)
    seen = rise(WIDE)
    if seen < told:  # to one side all else may not have followed far enough
        seen = min(seen, rise(-WIDE))
    return max(math.sqrt(told / max(seen, 1e-9 * here)), 1.0)


def unseen(certain: list[Estimate]) -> list[str]:
    """Return what of mass and damping may be anything: the fit invented it."""
    return [e.name for e in certain if e.name in MOTION and not e.kept and e.half_width >= ANY]


def _advice(name, fixed, layout, pushed, charged, frequency) -> str:
    beyond = ('a recording at higher voltage, in which the last element slips: until then every '
              'split of k + T^2/C and of 1/C + maxwell_stiffness[-1] predicts the same')
    longer = 'more recordings in which the last element slips, or less noise'
    force = 'a recording of a known external force at a fixed voltage or with open leads'
    if not charged:
        force += ', with the charge measured'
    if name in MOTION:
        return (f'a multisine or quick steps with energy near the resonance (about '
                f'{_hertz(frequency)}), at {ROWS_OF_A_PERIOD} rows or more to its period')
    if name in ('T/C', 'k + T^2/C'):
        return force
    last = layout.n - 1
    is_last = name in (f'maxwell_stiffness[{last}]', f'maxwell_break_voltage[{last}]')
    if name in SPLIT_NAMES or is_last or name.startswith('1/C'):
        if not {'T/C', 'k + T^2/C'} <= fixed and not pushed:
            return force
        return longer if layout.last_slips else beyond
    if not charged:
        return 'the charge, measured; else a known external force'
    return ('slow triangles from the relaxed state that pass its break charge in both directions, '
            'with more rows or less noise')


def _hertz(value) -> str:
    return f'{value / 1e3:.3g} kHz' if value >= 1e3 else f'{value:.3g} Hz'
