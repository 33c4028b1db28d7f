# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Figure 14: the IEEE resonance circuit, of which the mechanics are the inductive part."""

import numpy as np
from piezo_stack_sim import plotting
from piezo_stack_sim.figures.base import Figure, Number
from piezo_stack_sim.plant.analysis import mechanics, natural_frequency, open_stiffness
from piezo_stack_sim.plant.analysis import resonance_circuit
from piezo_stack_sim.plant.response import impedance, resonance_impedance, simulated


def draw(setting):
    """Draw the impedance of the circuit, alone, loaded, and behind the Maxwell capacitor."""
    device = setting.device
    moving = mechanics(device)
    loaded = device.replace(load={
        'mass': device.load.mass + moving.mass, 'damping': device.load.damping + moving.damping,
        'stiffness': device.load.stiffness + 0.5 * moving.stiffness})
    series = natural_frequency(device, moving.stiffness)
    parallel = natural_frequency(device, open_stiffness(device))
    at = np.geomspace(0.03 * series, 6.0 * parallel, 600)
    marks_at = np.geomspace(0.03 * series, 6.0 * parallel, 25)
    marks = simulated(device, marks_at)[1]
    figure, (size, phase) = plotting.new_figure(2, 1, height=4.6, sharex=True)
    curves = (('resonance circuit', resonance_impedance(device, at)),
              ('the same with a load', resonance_impedance(loaded, at)),
              ('with Maxwell capacitor, small signal', impedance(device, at)))
    for ax, quantity, of in ((size, 'impedance', np.abs), (phase, 'phase', _degrees)):
        for i, (name, values) in enumerate(curves):
            plotting.plot(ax, at * 1e-3, of(values), x='frequency', y=quantity, label=name,
                          **plotting.line(i))
        plotting.plot(ax, marks_at * 1e-3, of(marks), x='frequency', y=quantity,
                      label='simulated device', **plotting.marker(2))
        ax.set_xscale('log')
    for ax in (size, phase):
        for f in (series, parallel):
            ax.axvline(f * 1e-3, color='#999999', linewidth=0.8, zorder=0)
        ax.set_xlabel('')
    phase.set_xlabel(plotting.QUANTITIES['frequency_khz'][0])
    phase.set_yticks([-90, -60, -30, 0, 30])
    size.set_yscale('log')
    plotting.legend_above(size, columns=2)
    phase.xaxis.set_major_formatter('{x:g}')
    circuit, other = resonance_circuit(device), resonance_circuit(loaded)
    return figure, [
        Number('L1', circuit.L1, 'H', 'Eq. 23, m/T²'),
        Number('R1', circuit.R1, 'Ω', 'Eq. 24, b/T²'),
        Number('C1', circuit.C1, 'F', 'Eq. 25, T²/k'),
        Number('C0', circuit.C0, 'F', 'Eq. 26, C'),
        Number('series resonance', series, 'Hz', 'of L1 and C1: the mechanics at constant v_t'),
        Number('parallel resonance', parallel, 'Hz', 'with C0: the mechanics with open leads'),
        Number('L1, R1 with the load', other.L1 / circuit.L1, '',
               'times as much with mass and damping doubled: a load increases both', 3),
        Number('C1 with the load', other.C1 / circuit.C1, '',
               'times as much with half the stiffness added: it decreases, C0 stays', 3),
        Number('marks off the line', float(np.abs(
            marks / impedance(device, marks_at) - 1.0).max()), '%',
            'largest distance of simulated and closed-form impedance', 2),
    ]


def _degrees(values):
    return np.degrees(np.angle(values))


FIGURE = Figure(
    'figure_14', 'Resonance circuit',
    'L1, R1 and C1 "are not fundamentally electrical behaviors, but rather are the apparent '
    'behavior of the first mode of mechanical vibration, as seen through the electrical port"; a '
    'load would "increase L1 and R1, decrease C1, and leave C0 unaffected".', draw,
    'At the terminals the Maxwell capacitor stands before the circuit and hides most of it.')
