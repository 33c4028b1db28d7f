# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Where the joint fit begins: each number from the recordings that show it best."""

from __future__ import annotations

import math

import numpy as np

from piezo_stack_sim.errors import InputError
from piezo_stack_sim.gap.cores import parallel
from piezo_stack_sim.identify.piecewise import choose_pieces, fit_pieces, Pieces
from piezo_stack_sim.identify.rising import Curve, rising_curves, thin
from piezo_stack_sim.identify.tracks import misfits, weighted
from piezo_stack_sim.identify.vector import DAMPING, Layout, MASS
from piezo_stack_sim.plant.parameters import Actuator, Device
from piezo_stack_sim.recording.finding import refuse
from piezo_stack_sim.recording.recording import UNITS
from piezo_stack_sim.recording.sign import falling

SLOW = 2e-3  # s in which a slow recording passes through its span at the least
FEWEST_VOLTS = 1e-3  # an element of less is none
REMANENT = 0.4  # of the cost: an earlier history must explain that much
FREQUENCIES = np.geomspace(300.0, 3e5, 31)  # Hz, tried for the open-lead resonance
DAMPING_RATIOS = (0.02, 0.1, 0.4)


def static_gains(recordings) -> tuple[float | None, float | None]:
    """
    Return what slow rows say of q = a x - c F, from Eqs. 11 and 15 at rest.

    Returns
    -------
    a : float or None
        T + k C/T in C/m; None where charge or displacement was not measured.
    c : float or None
        C/T in C/N; None where no force acted besides.

    """
    square, slope, pushed = np.zeros((2, 2)), np.zeros(2), False
    for recording in recordings:
        charge = recording.measured.get('charge')
        if charge is None and recording.drive == 'charge':
            charge = np.concatenate([[0.0], recording.command[:-1]])
        if charge is None or 'displacement' not in recording.measured:
            continue
        force = recording.external_force
        guide = [recording.command] if recording.drive in ('voltage', 'charge') else []
        if not all(_slow(recording.time, each) for each in (*guide, force)):
            continue
        pushed = pushed or np.ptp(force) > 0.0
        columns = np.column_stack([recording.measured['displacement'], -force])
        columns = columns - columns.mean(axis=0)
        square += columns.T @ columns
        slope += columns.T @ (charge - charge.mean())
    if not square[0, 0] > 0.0:
        return None, None
    if not pushed:
        return float(slope[0] / square[0, 0]), None
    scale = np.sqrt(np.diag(square))
    a, c = np.linalg.lstsq(square / np.outer(scale, scale), slope / scale,
                           rcond=1e-12)[0] / scale
    return (float(a), float(c)) if c > 0.0 else (float(slope[0] / square[0, 0]), None)


def check_signs(recordings):
    """
    Ask that charge, voltage and displacement rise with a slow command.

    Without a device to begin with nothing turns what was wired the other way round.

    Raises
    ------
    InputError
        With the sign to give.

    """
    slow = [each for each in recordings
            if _slow(each.time, each.command) and _slow(each.time, each.external_force)]
    found = [(each, *falling(each)) for each in slow]
    for recording, by_command, _ in found:
        if by_command and len(by_command) == len(recording.measured) > 1:
            raise _wrong_sign(recording, recording.command_name, 'is answered by all channels '
                              'the other way round')
        if by_command:
            raise _wrong_sign(recording, by_command[0], 'falls where the command rises slowly')
    for recording, _, by_force in found:
        if by_force:
            raise _wrong_sign(recording, 'external_force', 'is positive in the direction of '
                              'extension, but the displacement falls where it rises')


def _wrong_sign(recording, channel, what):
    unit = UNITS[channel]
    return InputError(str(refuse(
        recording, None, f'{channel} {what}: it has the wrong sign',
        f'give it with its unit, as in --unit {channel}=-{unit} (or -u{unit}, if that is what it '
        f'is in), or what to begin with, as in --start YAML')))


def _slow(time, guide) -> bool:
    span = np.ptp(guide)
    if span == 0.0:
        return True
    steepest = np.quantile(np.abs(np.diff(guide) / np.diff(time)), 0.95)
    return bool(span > SLOW * steepest)


def find_pieces(recordings, charge_per_displacement, elements) -> tuple[list[Curve], Pieces]:
    """
    Fit the rising curve.

    Raises
    ------
    InputError
        If no recording has one.

    """
    curves = rising_curves(recordings, charge_per_displacement)
    if not curves:
        names = ', '.join(r.name for r in recordings)
        raise InputError(
            f'{names}: no slow rise of the voltage with charge or displacement measured: expected '
            'a triangle or a ramp of 5 ms or more, best from the relaxed state; record one')
    charge, voltage, weight = thin(curves)
    if elements is None:
        return curves, choose_pieces(charge, voltage, weight)
    if charge.size < 2 * elements + 2:
        raise InputError(f'{curves[0].name}: --elements {elements}: expected at most '
                         f'{charge.size // 2 - 1}, the rising curve has {charge.size} points')
    return curves, fit_pieces(charge, voltage, weight, elements)


def first_actuator(pieces: Pieces, gains, guess: Actuator, voltage_range) -> Actuator:
    """
    Put an actuator together from the pieces, the static gains, and a guess for the rest.

    Parameters
    ----------
    pieces : Pieces
        The pieces of the rising curve.
    gains : (float or None, float or None)
        As `static_gains` returns them.
    guess : Actuator
        Gives what the recordings do not show.
    voltage_range : (float, float)
        V.

    Returns
    -------
    Actuator

    """
    T, C, k = guess.transformer_ratio, guess.linear_capacitance, guess.stiffness
    a = gains[0] or (T + k * C / T)
    ratio = 1.0 / gains[1] if gains[1] else T / C
    stiff = a * ratio  # k + T^2/C, for q = x (k + T^2/C) C/T at rest
    share = k / (k + T * T / C)
    keep = pieces.break_charge.size == 0 or pieces.stiffness[:-1] > 0.0
    charges = pieces.break_charge[keep]
    elastance = pieces.stiffness[:-1][keep]
    big = elastance * charges > FEWEST_VOLTS
    charges, elastance = charges[big], elastance[big]
    # v_rc = v - v_t: at rest v_t = q k / (T a), part of the slope of the last piece.
    last = float(pieces.stiffness[-1])
    share = min(share, _largest_share(last, a, ratio, stiff))
    k, C = share * stiff, (1.0 - share) * stiff / ratio ** 2
    T = ratio * C
    elastance = np.append(elastance, max(last - k / (T * a), 0.05 * last))
    return guess.replace(
        stiffness=k, linear_capacitance=C, transformer_ratio=T,
        maxwell_stiffness=tuple(elastance),
        maxwell_break_voltage=(*(elastance[:-1] * charges), math.inf),
        voltage_range=voltage_range)


def _largest_share(last, a, ratio, stiff) -> float:
    """Return the k/(k + T^2/C) at which v_t takes 0.9 of the slope of the last piece."""
    # k/(T a) = share/(1 - share) ratio/a
    most = 0.9 * last * a / ratio
    return most / (1.0 + most)


def find_motion(layout: Layout, vector, tracks, kept=()) -> np.ndarray:
    """
    Return the vector with the best mass and damping: its own, or of a coarse grid.

    The entries ``kept`` of the vector stay as they are.
    """
    kept = list(kept)
    if {MASS, DAMPING} <= set(kept):
        return vector
    stiff = math.exp(vector[1])
    fast = sorted(range(len(tracks)), key=lambda i: _quickness(tracks[i].recording))[-3:]
    chosen = [tracks[i] for i in fast]

    def trial(pair):
        frequency, ratio = pair
        moved = vector.copy()
        m = stiff / (2.0 * math.pi * frequency) ** 2
        moved[MASS], moved[DAMPING] = math.log(m), math.log(2.0 * ratio * math.sqrt(stiff * m))
        moved[kept] = vector[kept]
        return float(np.sum(weighted(chosen, misfits(layout, moved, chosen)) ** 2)), moved

    cost = float(np.sum(weighted(chosen, misfits(layout, vector, chosen)) ** 2))
    trials = parallel(trial, [(f, z) for f in FREQUENCIES for z in DAMPING_RATIOS])
    return min([(cost, vector), *trials], key=lambda pair: pair[0])[1]


def _quickness(recording) -> float:
    guide = recording.command if np.ptp(recording.command) > 0.0 else recording.external_force
    span = np.ptp(guide)
    if span == 0.0:
        return 0.0
    return float(np.sqrt(np.mean(np.square(np.diff(guide) / np.diff(recording.time)))) / span)


def find_polarised(layout: Layout, vector, tracks) -> tuple[Layout, np.ndarray]:
    """Tell which recordings began with a remanence, and from which earlier peak voltage (V)."""
    top = max(abs(v) for v in layout.device.actuator.voltage_range)
    peaks = np.array([0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9, 1.0]) * top

    def cost(track, peak):
        device = layout.device_for(vector)
        if peak:
            device = device.with_effects({'initial_polarisation': {'peak_voltage': float(peak)}})
        single = Layout(device, layout.n, layout.last_slips)
        return float(np.sum(weighted([track], misfits(single, vector, [track])) ** 2))

    def best(track):
        if track.recording.drive != 'voltage':
            return 0.0
        costs = [cost(track, peak) for peak in (0.0, *peaks)]
        j = int(np.argmin(costs))
        return float(peaks[j - 1]) if j and costs[j] < REMANENT * costs[0] else 0.0

    found = dict(zip((track.number for track in tracks), parallel(best, tracks)))
    polarised = tuple(i for i, peak in found.items() if peak)
    new = Layout(layout.device, layout.n, layout.last_slips, polarised)
    return new, np.concatenate([vector[:layout.size],
                                np.log([found[i] for i in polarised])])


def guess_device(start: Device | None) -> Device:
    """Return the device to take from what recordings do not show: given, or the paper's."""
    device = start or Device.nominal()
    return device.replace(effects={})
