# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What follows from the parameters of a device: Eqs. 20 to 26 and the curves a catalogue shows.

Every function takes a `Device` and looks at its actuator and load; effects play no part.
Frequency responses are in `piezo_stack_sim.plant.response`.

"""

from __future__ import annotations

from dataclasses import asdict, dataclass
import math

import numpy as np

from piezo_stack_sim.plant.parameters import Device
from piezo_stack_sim.plant.quasi_static import cycle, force_cycle, lead


@dataclass(frozen=True)
class Mechanics:
    """The moving end with its load: m x'' + b x' + k x = T v_t + F_ext (Eq. 15)."""

    mass: float  # kg
    damping: float  # N s/m
    stiffness: float  # N/m


@dataclass(frozen=True)
class ResonanceCircuit:
    """The IEEE circuit near a resonance: L1, R1 and C1 in series, C0 across them."""

    L1: float  # H, Eq. 23
    R1: float  # ohm, Eq. 24
    C1: float  # F, Eq. 25
    C0: float  # F, Eq. 26


def mechanics(device: Device) -> Mechanics:
    """Return mass, damping and stiffness of actuator and load together."""
    actuator, load = device.actuator, device.load
    return Mechanics(actuator.mass + load.mass, actuator.damping + load.damping,
                     actuator.stiffness + load.stiffness)


def sticking_elastance(device: Device, first: int = 1) -> float:
    """
    Return 1/C_rc, the linearised Maxwell capacitor, in V/C.

    Parameters
    ----------
    device : Device
        The device.
    first : int
        Elements ``first`` to n stick, the others slip; 1 is a small signal, n + 1 none sticks.

    """
    return math.fsum(device.actuator.maxwell_stiffness[first - 1:])


def open_stiffness(device: Device) -> float:
    """Return the stiffness with open leads in N/m (Eq. 20): k + T^2/C."""
    actuator = device.actuator
    return mechanics(device).stiffness + (
        actuator.transformer_ratio ** 2 / actuator.linear_capacitance)


def shorted_stiffness(device: Device, first: int = 1) -> float:
    """
    Return the stiffness with shorted leads in N/m (Eq. 21): k + T^2/(C + C_rc).

    ``first`` is the first element that sticks, as in `sticking_elastance`.

    """
    actuator = device.actuator
    elastance = sticking_elastance(device, first)
    # T^2/(C + 1/K) written so that K = 0, the Maxwell capacitor shorted, needs no infinity.
    return mechanics(device).stiffness + actuator.transformer_ratio ** 2 * elastance / (
        1.0 + actuator.linear_capacitance * elastance)


def natural_frequency(device: Device, stiffness: float) -> float:
    """Return the undamped natural frequency in Hz for a stiffness in N/m."""
    return math.sqrt(stiffness / mechanics(device).mass) / (2.0 * math.pi)


def damping_ratio(device: Device, stiffness: float) -> float:
    """Return the damping ratio b / (2 sqrt(k m)) for a stiffness in N/m."""
    moving = mechanics(device)
    return moving.damping / (2.0 * math.sqrt(stiffness * moving.mass))


def resonance_circuit(device: Device) -> ResonanceCircuit:
    """Return the circuit of the paper's Fig. 14, the load included (Eqs. 23 to 26)."""
    moving, actuator = mechanics(device), device.actuator
    squared = actuator.transformer_ratio ** 2
    return ResonanceCircuit(moving.mass / squared, moving.damping / squared,
                            squared / moving.stiffness, actuator.linear_capacitance)


def small_signal_capacitance(device: Device, clamped: bool = False) -> float:
    """Return dq/dv at the terminals in F when every element sticks, free or clamped."""
    actuator = device.actuator
    behind = actuator.linear_capacitance
    if not clamped and not device.load.clamped:
        behind += actuator.transformer_ratio ** 2 / mechanics(device).stiffness
    return 1.0 / (sticking_elastance(device) + 1.0 / behind)


def charge_gain(device: Device) -> float:
    """Return the static displacement per charge in m/C: T/(T^2 + k C)."""
    actuator = device.actuator
    return actuator.transformer_ratio / (
        actuator.transformer_ratio ** 2
        + mechanics(device).stiffness * actuator.linear_capacitance)


def largest_voltage(device: Device) -> float:
    """Return the static voltage in V from which the last element, which should not, slips."""
    actuator = device.actuator
    charge = actuator.break_charges[-1]
    if not math.isfinite(charge):
        return math.inf
    return float(lead(device, charge, drive='charge').voltage[-1])


@dataclass(frozen=True)
class VoltageRow:
    """What the device does at one voltage (V), led slowly; SI units."""

    voltage: float
    rise: float  # m, displacement of the first rise from the relaxed state
    rise_charge: float  # C
    stroke: float  # m, of the settled cycle 0 - voltage - 0
    remaining: float  # m, displacement at the zero of that cycle
    loop_width: float  # m, largest distance of its branches at one voltage
    loop_width_share: float  # of the stroke
    capacitance: float  # F, peak-to-peak charge over voltage of that cycle
    loss: float  # J per cycle
    loss_tangent: float  # of the ellipse of the same area and amplitudes
    blocked_force: float  # N, on a wall, risen from the relaxed state
    stiffness: float  # N/m, blocked force over rise
    in_range: bool  # whether the last element sticks


def voltage_row(device: Device, voltage: float) -> VoltageRow:
    """
    Return stroke, loop, capacitance, loss and blocked force at one voltage.

    Parameters
    ----------
    device : Device
        The device.
    voltage : float
        Peak voltage (V), not zero.

    """
    free = device.replace(load={'clamped': False})
    rise = lead(free, voltage)
    loop = cycle(free, 0.0, voltage)
    stroke = float(np.ptp(loop.displacement))
    charge = float(np.ptp(loop.charge))
    width = loop_width(loop.displacement)
    loss = float(loop.dissipated[-1])
    blocked = lead(device.replace(load={'clamped': True}), voltage)
    lifted, force = float(rise.displacement[-1]), float(blocked.force[-1])
    # The area of an ellipse is pi/4 its width times its height times the sine of its angle.
    sine = loss / (math.pi / 4.0 * charge * abs(voltage))
    return VoltageRow(
        voltage=float(voltage), rise=lifted, rise_charge=float(rise.charge[-1]), stroke=stroke,
        remaining=float(loop.displacement[0]), loop_width=width, loop_width_share=width / stroke,
        capacitance=charge / abs(voltage), loss=loss,
        loss_tangent=sine / math.sqrt(max(1.0 - sine * sine, 1e-12)), blocked_force=force,
        stiffness=force / lifted, in_range=not (loop.out_of_range or blocked.out_of_range))


@dataclass(frozen=True)
class ForceRow:
    """What squeezing by 0 to ``force`` (N) does with the leads shorted; SI units."""

    force: float
    first: float  # m, how far the first squeeze from the relaxed state moves the end
    travel: float  # m, of the settled cycle
    stiffness: float  # N/m, force over travel
    loop_width: float  # m, largest distance of its branches at one force
    loss: float  # J per cycle
    open_travel: float  # m, the same with open leads


def force_row(device: Device, force: float) -> ForceRow:
    """
    Return travel, stiffness and loss when a force squeezes the device with the leads shorted.

    Parameters
    ----------
    device : Device
        The device.
    force : float
        Size of the squeeze (N), positive.

    """
    free = device.replace(load={'clamped': False})
    first = lead(free, 0.0, -force).displacement[-1]
    loop = force_cycle(free, -force, 0.0)
    travel = float(np.ptp(loop.displacement))
    return ForceRow(force=float(force), first=-float(first), travel=travel,
                    stiffness=force / travel, loop_width=loop_width(loop.displacement),
                    loss=float(loop.dissipated[-1]), open_travel=force / open_stiffness(free))


def loop_width(branches) -> float:
    """
    Return the largest distance of the two branches of a cycle at equal input.

    Parameters
    ----------
    branches : array_like, shape (2 n - 1,)
        One branch and then, at the same inputs backwards, the other: as `cycle` gives them.

    """
    values = np.asarray(branches)
    half = values.size // 2 + 1
    return float(np.abs(values[:half] - values[half - 1:][::-1]).max())


def default_voltages(device: Device) -> list[float]:
    """Return ten equal steps up to the highest voltage of the device's range."""
    low, high = device.actuator.voltage_range
    peak = high if high > 0.0 else low
    return [peak * step / 10.0 for step in range(1, 11)]


DEFAULT_FORCES = (50.0, 100.0, 200.0, 400.0)  # N; the paper goes to 200


def summary(device: Device) -> dict[str, dict]:
    """
    Return the figures that need no curve, by name.

    Returns
    -------
    dict
        ``{name: {'value': float, 'unit': str, 'source': str}}``.

    """
    n = len(device.actuator.maxwell_stiffness)
    opened = open_stiffness(device)
    stuck = shorted_stiffness(device)
    last = shorted_stiffness(device, n)
    bare = mechanics(device).stiffness
    circuit = resonance_circuit(device)
    rows = [
        ('open_lead_stiffness', opened, 'N/m', 'Eq. 20, k + T²/C'),
        ('shorted_stiffness_all_stick', stuck, 'N/m', 'Eq. 21, small signal'),
        ('shorted_stiffness_last_sticks', last, 'N/m', f'Eq. 21, only element {n} sticks'),
        ('stiffness_ratio_open_to_shorted', opened / stuck, '', 'Eqs. 20, 21, small signal'),
        ('natural_frequency_open', natural_frequency(device, opened), 'Hz', 'parallel resonance'),
        ('natural_frequency_shorted_all_stick', natural_frequency(device, stuck), 'Hz',
         'small signal'),
        ('natural_frequency_shorted_last_sticks', natural_frequency(device, last), 'Hz',
         f'only element {n} sticks'),
        ('natural_frequency_constant_v_t', natural_frequency(device, bare), 'Hz',
         'series resonance of L1, C1'),
        ('damping_ratio_open', damping_ratio(device, opened), '', ''),
        ('damping_ratio_shorted_all_stick', damping_ratio(device, stuck), '', 'small signal'),
        ('small_signal_capacitance_free', small_signal_capacitance(device), 'F', 'all stick'),
        ('small_signal_capacitance_clamped', small_signal_capacitance(device, True), 'F',
         'all stick'),
        ('displacement_per_charge', charge_gain(device), 'm/C', 'T/(T² + k C), static'),
        ('displacement_per_voltage_small_signal',
         charge_gain(device) * small_signal_capacitance(device), 'm/V', 'all stick, static'),
        ('L1', circuit.L1, 'H', 'Eq. 23, m/T²'),
        ('R1', circuit.R1, 'ohm', 'Eq. 24, b/T²'),
        ('C1', circuit.C1, 'F', 'Eq. 25, T²/k'),
        ('C0', circuit.C0, 'F', 'Eq. 26, C'),
        ('largest_voltage', largest_voltage(device), 'V', f'element {n} slips beyond it'
         if math.isfinite(largest_voltage(device)) else f'element {n} never slips'),
    ]
    return {name: {'value': float(value), 'unit': unit, 'source': source}
            for name, value, unit, source in rows}


def analyse(device: Device, voltages=None, forces=None) -> dict:
    """
    Return everything that ``piezo_stack analyse`` prints, as plain numbers.

    Parameters
    ----------
    device : Device
        The device.
    voltages : sequence of float, optional
        Peak voltages (V) of the table; ten steps up to the highest one if not given.
    forces : sequence of float, optional
        Squeezing forces (N) of the table.

    Returns
    -------
    dict
        ``summary`` as `summary` gives it, ``voltage`` and ``force`` as lists of rows.

    """
    voltages = default_voltages(device) if voltages is None else voltages
    forces = DEFAULT_FORCES if forces is None else forces
    return {
        'summary': summary(device),
        'voltage': [asdict(voltage_row(device, voltage)) for voltage in voltages],
        'force': [asdict(force_row(device, force)) for force in forces],
    }
