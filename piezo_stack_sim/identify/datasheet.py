# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""A first actuator from the numbers of a catalogue, and what had to be assumed for it."""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np

from piezo_stack_sim.errors import InputError
from piezo_stack_sim.plant.parameters import Actuator, Device
from piezo_stack_sim.plant.quasi_static import cycle

DENSITY = 7500.0  # kg/m3, PZT
HYSTERESIS = 0.15  # of the stroke, loop width; catalogues say 0.10 to 0.20
DAMPING_RATIO = 0.13  # with open leads; Table 1 of the paper has 0.1296
SHARE = 6.0 / 89.333  # k/(k + T^2/C) of Table 1; nothing in a catalogue shows it
# How the elements of Table 2 are spread: break charges over that of the last rise to the full
# voltage, and the share that each has in the softening of the rising curve.
BREAKS = np.array([0.004, 0.02, 0.08, 0.15, 0.25, 0.5])
SOFTENING = np.array([0.03, 0.02, 0.16, 0.18, 0.17, 0.44])
ALIKE = 1.5  # factor between two ways to the moving mass that the rough model leaves open
INNER, OUTER = 22, 16  # bisections


@dataclass(frozen=True)
class DataSheet:
    """
    What a catalogue says, in SI units; None where it says nothing.

    ``free_stroke`` (m) and ``blocking_force`` (N) at the top of
    ``voltage_range`` (V), ``capacitance`` (F) for large signals, ``resonance``
    (Hz) with one end held (half of that with both ends free), ``length`` (m),
    ``area`` (m2), ``mass`` (kg) of the stack, ``hysteresis`` the loop width as
    a share of the stroke.
    """

    free_stroke: float
    blocking_force: float
    capacitance: float
    voltage_range: tuple[float, float]
    resonance: float | None = None
    length: float | None = None
    area: float | None = None
    mass: float | None = None
    hysteresis: float | None = None


def actuator_from(sheet: DataSheet, model: str = 'from data sheet'
                  ) -> tuple[Actuator, list[str]]:
    """
    Return an actuator that shows what a data sheet says, and the assumptions made.

    The cycled stroke, the charge of that cycle and the loop width come out as
    given; stiffness is blocking force over stroke.

    Parameters
    ----------
    sheet : DataSheet
        The catalogue numbers.
    model : str
        Name of the actuator.

    Returns
    -------
    actuator : Actuator
    assumed : list of str
        One line each.

    Raises
    ------
    InputError
        If the numbers contradict each other.

    """
    low, high = sheet.voltage_range
    swing = high - low
    assumed = []
    hysteresis = sheet.hysteresis
    if hysteresis is None:
        hysteresis = HYSTERESIS
        assumed.append(f'hysteresis {hysteresis:g} of the stroke: catalogues say 0.10 to 0.20')
    if not 0.0 < hysteresis < 0.4:
        raise InputError(f'--hysteresis {hysteresis:g}: expected a share of the stroke between '
                         '0 and 0.4; 15 % is 0.15')
    charge = sheet.capacitance * swing
    gain = sheet.free_stroke / charge  # x/q = T/(T^2 + k C) = 1/a
    shorted = sheet.blocking_force / sheet.free_stroke
    # Free, the elastance of the whole is K + k/(T a), K that of the Maxwell elements. With
    # r = T/C and k + T^2/C = a r (Eq. 20), the stiffness at a held voltage, Eq. 21, is
    # a r total/(total + r/a), whatever k is.
    a, total = 1.0 / gain, 1.0 / sheet.capacitance
    if shorted >= a * a * total:
        raise InputError(
            f'blocking force {sheet.blocking_force:g} N over stroke {sheet.free_stroke:g} m: '
            f'expected less than {a * a * total:.4g} N/m for {sheet.capacitance:g} F, else the '
            'stack would give more work than it takes; check the units')
    ratio = shorted * total / (a * total - shorted / a)
    assumed.append(f'k/(k + T^2/C) = {SHARE:.3f} as in Table 1: no catalogue shows it')
    share = min(SHARE, 0.8 * total * a / ratio / (1.0 + 0.8 * total * a / ratio))
    stiff = a * ratio
    k, C = share * stiff, (1.0 - share) * stiff / ratio ** 2
    mass = _mass(sheet, shorted, assumed)
    assumed.append(f'damping ratio {DAMPING_RATIO:g} with open leads, as in Table 1')
    assumed.append(f'{BREAKS.size + 1} Maxwell elements spread as in Table 2 of the paper, scaled '
                   'to the loop width; the last one never slips')
    plain = Actuator(
        model=model, mass=mass, stiffness=k, damping=2.0 * DAMPING_RATIO * math.sqrt(stiff * mass),
        linear_capacitance=C, transformer_ratio=ratio * C, maxwell_stiffness=(1.0,),
        maxwell_break_voltage=(math.inf,), voltage_range=sheet.voltage_range,
        relative_uncertainty=0.2)
    assumed.append('relative_uncertainty 0.2: stacks of one type scatter by 10 to 20 %')
    return _with_loop(plain, hysteresis, charge, swing), assumed


def _mass(sheet, shorted, assumed) -> float:
    """Return the moving mass (kg): from the resonance, else a third of the stack's mass."""
    third = 'moving mass a third of the stack: one end held, strain even'
    ways = []
    if sheet.resonance is not None:
        ways.append(('--resonance', shorted / (2.0 * math.pi * sheet.resonance) ** 2, [
            'resonance with one end held and the leads shorted; m = k_s/(2 pi f)^2']))
    if sheet.mass is not None:
        ways.append(('--mass', sheet.mass / 3.0, [third]))
    if sheet.length is not None and sheet.area is not None:
        ways.append(('--length with --area', DENSITY * sheet.length * sheet.area / 3.0,
                     [f'density {DENSITY:g} kg/m3', third]))
    if not ways:
        raise InputError('no --resonance, no --mass, and not both --length and --area: '
                         'expected one of them for the moving mass; give one')
    (used, mass, why), *others = ways
    assumed += why
    off = [(name, other / mass) for name, other, _ in others
           if not 1.0 / ALIKE < other / mass < ALIKE]
    if off:
        rest = ', '.join(f'{name} says {ratio:.3g} times as much' for name, ratio in off)
        mend = ''
        if used == '--resonance' and any(4.0 / ALIKE < ratio < 4.0 * ALIKE for _, ratio in off):
            mend = (f'; if {sheet.resonance:g} Hz is that of the stack free at both ends, give '
                    f'half of it, --resonance {0.5 * sheet.resonance:g}')
        assumed.append(f'moving mass {mass:.3g} kg, of {used}, although {rest}{mend}')
    return mass


def _with_loop(plain: Actuator, hysteresis, charge, swing) -> Actuator:
    """Return the actuator with elements that give the loop width and the charge wanted."""
    def built(size, soft) -> Actuator:
        # Each element gives up its share of the voltage that hysteresis takes.
        volts = size * SOFTENING * swing
        return plain.replace(
            maxwell_stiffness=(*(volts / (BREAKS * charge)), soft),
            maxwell_break_voltage=(*volts, math.inf))

    def fitted(size) -> Actuator:
        # The last element makes up the charge: more elastance, less charge.
        lower, upper = 1e-6 * swing / charge, 20.0 * swing / charge
        for _ in range(INNER):
            middle = math.sqrt(lower * upper)
            if _cycle(built(size, middle))[0] > charge:
                lower = middle
            else:
                upper = middle
        return built(size, upper)

    small, big = 1e-4, 0.9
    for _ in range(OUTER):
        size = math.sqrt(small * big)
        if _cycle(fitted(size))[1] < hysteresis:
            small = size
        else:
            big = size
    found = fitted(big)
    reached, width = _cycle(found)
    if abs(reached / charge - 1.0) > 0.02 or abs(width / hysteresis - 1.0) > 0.05:
        raise InputError(f'hysteresis {hysteresis:g}: no stack of this stroke, force and '
                         f'capacitance shows it, expected about {width:.3g}; check the numbers')
    return found


def _cycle(actuator: Actuator) -> tuple[float, float]:
    """Return charge (C) and loop width over stroke of the settled cycle of the full range."""
    path = cycle(Device(actuator), *actuator.voltage_range, points=25)
    half = path.displacement.size // 2 + 1
    width = np.abs(path.displacement[:half] - path.displacement[half - 1:][::-1]).max()
    return float(np.ptp(path.charge)), float(width / np.ptp(path.displacement))
