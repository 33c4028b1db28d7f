# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The whole device as a circuit, for SPICE: an independent computation of Eqs. 11 to 17.

The Maxwell capacitor stands in series with C0 parallel to L1-R1-C1 (Eqs. 23 to 26).  Each Maxwell
element is a capacitor 1/k_i with a symmetric clamp at +-V_i across it; the external force is a
voltage F/T in the mechanical branch, whose charge is T x.

"""

from __future__ import annotations

import math

import numpy as np

from piezo_stack_sim.errors import InputError
from piezo_stack_sim.plant.analysis import resonance_circuit
from piezo_stack_sim.plant.parameters import Device

# An ideal clamp is a kink that no SPICE integrates; this conductance takes a volt of overdrive to
# 10 kA, so that 1 A of charging current leaves 0.1 mV.  Diodes with a small emission coefficient
# would be as sharp, but ngspice cuts its time step to nothing at each reversal.
CLAMP_SIEMENS = 1e4
RISE = 1e-7  # s; a held command steps this fast, well under a percent of the fastest period


def subcircuit(device: Device, name: str = 'piezo_stack') -> str:
    """
    Return the device as a SPICE subcircuit.

    Parameters
    ----------
    device : Device
        Its actuator and load; effects are left out.
    name : str
        Name of the subcircuit. Its pins are the two leads, the external force (1 V is 1 N), and
        as outputs displacement (1 V is 1 um) and charge (1 V is 1 uC).

    Returns
    -------
    str
        Lines that end with a newline.

    """
    actuator, load = device.actuator, device.load
    circuit = resonance_circuit(device)
    T = actuator.transformer_ratio
    lines = [
        f'* {_ascii(actuator.model)}: Goldfarb and Celanovic (1997), Eqs. 11 to 17 and 23 to 26',
        '* pins: leads plus and minus; force in, 1 V = 1 N, positive in the direction of',
        '* extension; displacement out, 1 V = 1 um; charge out, 1 V = 1 uC; start relaxed: UIC',
        f'.subckt {name} plus minus force displacement charge',
        '* Maxwell capacitor: elements 1/k_i, each clamped at +-V_i',
    ]
    if device.effects:
        lines.insert(1, f'* effects left out: {_ascii(", ".join(device.effects))}')
    node = 'plus'
    n = len(actuator.maxwell_stiffness)
    pairs = zip(actuator.maxwell_stiffness, actuator.maxwell_break_voltage)
    for i, (stiffness, volts) in enumerate(pairs, 1):
        after = 't' if i == n else f'e{i}'
        lines.append(f'CM{i} {node} {after} {1.0 / stiffness:.12g} IC=0')
        if math.isfinite(volts):
            across = f'V({node},{after})'
            lines.append(f'BM{i} {node} {after} I={CLAMP_SIEMENS:g}*(max({across}-{volts:.12g},0)'
                         f'+min({across}+{volts:.12g},0))')
        node = after
    lines += [
        '* linear capacitance behind it',
        f'C0 t minus {circuit.C0:.12g} IC=0',
    ]
    if load.clamped:
        lines += ['* clamped: the mechanical branch does not move',
                  'BX displacement 0 V=0*V(force)',
                  f'BQ charge 0 V={1e6 * circuit.C0:.12g}*V(t,minus)']
    else:
        micrometres = 1e6 * circuit.C1 / T
        lines += [
            '* mechanical branch: charge T x, L1 = m/T^2, R1 = b/T^2, C1 = T^2/k, source F/T',
            f'L1 t l1 {circuit.L1:.12g} IC=0',
            f'R1 l1 r1 {circuit.R1:.12g}',
            f'C1 r1 f1 {circuit.C1:.12g} IC=0',
            f'BF f1 minus V=-V(force)/{T:.12g}',
            f'BX displacement 0 V={micrometres:.12g}*V(r1,f1)',
            f'BQ charge 0 V={1e6 * circuit.C0:.12g}*V(t,minus)'
            f'+{1e6 * circuit.C1:.12g}*V(r1,f1)',
        ]
    return '\n'.join([*lines, f'.ends {name}']) + '\n'


def netlist(device: Device, time, command, external_force=None, drive: str = 'voltage', *,
            step: float = 1e-6, held: bool = True, output: str | None = None) -> str:
    """
    Return a complete netlist that plays commands and forces to the device.

    Parameters
    ----------
    device : Device
        The device.
    time : array_like, shape (n,)
        Increasing times (s) from zero.
    command : array_like, shape (n,)
        V or C, ignored with leads open or shorted.
    external_force : array_like, shape (n,), optional
        N.
    drive : str
        ``voltage``, ``charge``, ``open`` or ``shorted``.
    step : float
        Largest internal time step (s).
    held : bool
        Whether a row holds until the next or is joined to it by a line. A charge is always
        joined: a step of it would be an infinite current.
    output : str, optional
        File that ngspice writes its table to: time (s), displacement (m), charge (C) and voltage
        (V). Without it, a ``.print`` that every SPICE understands.

    Returns
    -------
    str

    Raises
    ------
    InputError
        If the drive is unknown or the times do not increase from zero.

    """
    time = np.asarray(time, dtype=float)
    if time.size < 2 or time[0] != 0.0 or not np.all(np.diff(time) > 0.0):
        raise InputError('time: expected at least two rows that increase from zero')
    force = np.zeros(time.size) if external_force is None else external_force
    lines = [f'* piezo_stack_sim: {_ascii(device.actuator.model)}', '', subcircuit(device)]
    if drive == 'voltage':
        lines += ['Vdrive plus 0 PWL(', *_points(time, command, held), '+ )']
    elif drive == 'charge':
        charge = np.asarray(command, dtype=float)
        current = np.append(np.diff(charge) / np.diff(time), 0.0)
        lines += ['Idrive 0 plus PWL(', *_points(time, current, True), '+ )']
    elif drive == 'open':
        lines += ['Iopen 0 plus 0']
    elif drive == 'shorted':
        lines += ['Vshort plus 0 0']
    else:
        raise InputError(f'drive {drive!r}: expected voltage, charge, open or shorted')
    lines += [
        'Vforce force 0 PWL(', *_points(time, force, held), '+ )',
        'Xstack plus 0 force displacement charge piezo_stack',
        '', '* Gear: the trapezoidal rule rings on the clamps',
        '.options method=gear reltol=1e-4 abstol=1e-9 vntol=1e-7 chgtol=1e-16',
        f'.tran {step:g} {time[-1]:.12g} 0 {step:g} UIC',
    ]
    if output is None:
        lines += ['.print tran V(plus) V(charge) V(displacement)', '.end']
    else:
        lines += ['.control', 'set wr_singlescale', 'set numdgt=12', 'run',
                  'let x = V(displacement)*1e-6', 'let q = V(charge)*1e-6', 'let v = V(plus)',
                  f'wrdata {output} x q v', 'quit 0', '.endc', '.end']
    return '\n'.join(lines) + '\n'


def _points(time, values, held):
    """Return the rows of a PWL source, on continuation lines."""
    values = np.asarray(values, dtype=float)
    rows = [(time[0], values[0])]
    for k in range(1, time.size):
        if held and values[k] != values[k - 1]:
            rows.append((time[k], values[k - 1]))
            rows.append((time[k] + min(RISE, 0.01 * (time[k] - time[k - 1])), values[k]))
        elif not held:
            rows.append((time[k], values[k]))
    return [f'+ {t:.12g} {v:.12g}' for t, v in rows]


def _ascii(text):
    """Return text that fits one comment line of any SPICE."""
    return ' '.join(text.encode('ascii', 'replace').decode().split())
