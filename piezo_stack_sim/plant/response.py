# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Small-signal frequency responses of a device: in closed form, and measured on the simulation.

The closed forms follow from Eqs. 11 to 15 with the Maxwell capacitor linearised (Eq. 21); the
simulated ones drive the plant with a sine, as one would measure a real device.

"""

from __future__ import annotations

import numpy as np

from piezo_stack_sim.plant.analysis import damping_ratio, mechanics, natural_frequency
from piezo_stack_sim.plant.analysis import open_stiffness, sticking_elastance
from piezo_stack_sim.plant.parameters import Device


def charge_to_displacement(device: Device, frequency):
    """
    Return X/Q in closed form: (T/C) / (m s^2 + b s + k + T^2/C).

    Parameters
    ----------
    device : Device
        The device.
    frequency : array_like, shape (n,)
        Hz.

    Returns
    -------
    ndarray of complex, shape (n,)
        m/C.

    """
    s = 2j * np.pi * np.asarray(frequency, dtype=float)
    moving, actuator = mechanics(device), device.actuator
    ratio = actuator.transformer_ratio / actuator.linear_capacitance
    return ratio / (moving.mass * s * s + moving.damping * s + open_stiffness(device))


def resonance_impedance(device: Device, frequency):
    """
    Return the impedance in ohm of the IEEE circuit alone (Fig. 14): C0 across L1, R1, C1.

    Parameters and result as `charge_to_displacement`; it does not hold the Maxwell capacitor.

    """
    s = 2j * np.pi * np.asarray(frequency, dtype=float)
    moving, actuator = mechanics(device), device.actuator
    compliance = 1.0 / (moving.mass * s * s + moving.damping * s + moving.stiffness)
    return 1.0 / (s * (actuator.linear_capacitance + actuator.transformer_ratio ** 2 * compliance))


def impedance(device: Device, frequency):
    """
    Return the impedance V/I in ohm at the terminals for a signal too small to make anything slip.

    Parameters and result as `charge_to_displacement`: the circuit of Fig. 14 in series with the
    Maxwell capacitor, every element sticking.

    """
    s = 2j * np.pi * np.asarray(frequency, dtype=float)
    return resonance_impedance(device, frequency) + sticking_elastance(device) / s


def simulated(device: Device, frequency, charge: float | None = None, rows: int = 2000):
    """
    Measure both responses on the simulated device with a sine of charge at each frequency.

    Parameters
    ----------
    device : Device
        Driven by charge; its own effects play their part.
    frequency : array_like, shape (n,)
        Hz.
    charge : float, optional
        Amplitude (C); less than the first break charge if not given, so that nothing slips.
    rows : int
        Rows per period. Commands are held, which shifts them by half a row: 2000 rows leave
        0.16 % of it.

    Returns
    -------
    tuple of ndarray of complex, shape (n,)
        X/Q (m/C) and V/I (ohm).

    """
    from piezo_stack_sim.plant.offline import simulate  # loads the compiled kernel

    if charge is None:
        first = device.actuator.break_charges[0]
        charge = 0.4 * (first if np.isfinite(first) else device.actuator.linear_capacitance)
    frequencies = np.atleast_1d(np.asarray(frequency, dtype=float))
    stiffness = open_stiffness(device)
    decay = 1.0 / (2.0 * np.pi * natural_frequency(device, stiffness)
                   * max(damping_ratio(device, stiffness), 1e-3))
    gain = np.empty(frequencies.size, dtype=complex)
    ohm = np.empty(frequencies.size, dtype=complex)
    for i, f in enumerate(frequencies):
        before = int(np.ceil(10.0 * decay * f)) + 1  # periods until the start is forgotten
        phase = 2.0 * np.pi * np.arange((before + 1) * rows + 1) / rows
        response = simulate(device, phase / (2.0 * np.pi * f), charge * np.sin(phase),
                            drive='charge')
        last = slice(before * rows + 1, None)
        turn = np.exp(-1j * phase[last])
        x, q, v = (float(2.0 / rows) * (turn @ getattr(response, name)[last])
                   for name in ('displacement', 'charge', 'voltage'))
        gain[i] = x / q
        ohm[i] = v / (2j * np.pi * f * q)
    return gain, ohm


def compare(device: Device, frequency) -> list[dict]:
    """
    Return both responses at some frequencies, in closed form and simulated.

    Parameters
    ----------
    device : Device
        Its effects are left out: the closed forms do not know them.
    frequency : array_like, shape (n,)
        Hz.

    Returns
    -------
    list of dict
        For each frequency gains (m/C), impedances (ohm), phases (degrees) and, as
        ``gain_deviation`` and ``impedance_deviation``, |simulated / closed form - 1|.

    """
    frequency = np.asarray(frequency, dtype=float)
    gain, ohm = charge_to_displacement(device, frequency), impedance(device, frequency)
    gain_found, ohm_found = simulated(device.replace(effects={}), frequency)
    return [{
        'frequency': float(f),
        'gain': float(abs(g)), 'gain_phase': float(np.angle(g, deg=True)),
        'impedance': float(abs(z)), 'impedance_phase': float(np.angle(z, deg=True)),
        'gain_simulated': float(abs(gs)), 'impedance_simulated': float(abs(zs)),
        'gain_deviation': float(abs(gs / g - 1.0)),
        'impedance_deviation': float(abs(zs / z - 1.0)),
    } for f, g, z, gs, zs in zip(frequency, gain, ohm, gain_found, ohm_found)]
