# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Figure 3: charge to displacement is linear and of second order."""

import numpy as np
from piezo_stack_sim import plotting
from piezo_stack_sim.figures.base import Figure, Number, width_at_equal
from piezo_stack_sim.plant import simulate
from piezo_stack_sim.plant.analysis import charge_gain, damping_ratio, natural_frequency
from piezo_stack_sim.plant.analysis import open_stiffness
from piezo_stack_sim.plant.quasi_static import lead
from piezo_stack_sim.plant.response import charge_to_displacement, simulated

ROWS = 2000
RATES = (100.0, 1000.0)  # Hz


def draw(setting):
    """Draw two charge loops and the frequency response with the second-order line."""
    device = setting.device
    figure, axes = plotting.new_figure(2, 2, height=4.2, sharex='col',
                                       gridspec_kw={'width_ratios': [1.0, 1.35]})
    high = float(lead(device, setting.peaks[1]).charge[-1])
    numbers = []
    for i, rate in enumerate(RATES):
        phase = np.arange(2 * ROWS + 1) / ROWS
        charge = 0.5 * high * (1.0 - np.cos(2.0 * np.pi * phase))
        response = simulate(device, phase / rate, charge, drive='charge')
        last = slice(ROWS, None)
        q, x, v = response.charge[last], response.displacement[last], response.voltage[last]
        plotting.plot(axes[i, 0], q, x, x='charge', y='displacement', **plotting.line(0))
        axes[i, 0].set_title(f'({"ab"[i]}) {rate:g} Hz')
        stroke = np.ptp(x)
        numbers += [
            Number(f'q-x loop at {rate:g} Hz', width_at_equal(q, x) / stroke, '%',
                   'of stroke; what is left is the lag of the linear dynamics', 3),
            Number(f'v-x loop at {rate:g} Hz', width_at_equal(v, x) / stroke, '%',
                   'of stroke, in the same run: the hysteresis lies between voltage and charge',
                   3),
        ]
    axes[0, 0].set_xlabel('')

    opened = open_stiffness(device)
    f0 = natural_frequency(device, opened)
    line_at = np.geomspace(10.0, 4.0 * f0, 400)
    marks_at = np.sort(np.concatenate([
        np.geomspace(10.0, 0.7 * f0, 16), np.geomspace(0.8 * f0, 4.0 * f0, 12)]))
    line, marks = charge_to_displacement(device, line_at), simulated(device, marks_at)[0]
    gain, phase = axes[:, 1]
    for ax, quantity, of in ((gain, 'gain', np.abs), (phase, 'phase', _degrees)):
        plotting.plot(ax, line_at, of(line), x='frequency', y=quantity,
                      label='second order', **plotting.line(0))
        plotting.plot(ax, marks_at, of(marks), x='frequency', y=quantity,
                      label='simulated', **plotting.marker(1))
        ax.set_xscale('log')
    gain.set_yscale('log')
    gain.set_xlabel('')
    gain.set_title('(c) frequency response')
    gain.legend(loc='lower left')
    phase.set_yticks([0, -45, -90, -135, -180])
    off = np.abs(marks / charge_to_displacement(device, marks_at) - 1.0).max()
    return figure, [
        *numbers,
        Number('static x/q', charge_gain(device), 'm/C', 'T/(T² + k C)'),
        Number('natural frequency', f0, 'Hz', 'charge held, that is leads open'),
        Number('damping ratio', damping_ratio(device, opened), '', 'b / (2 sqrt(m (k + T²/C)))'),
        Number('marks off the line', off, '%',
               'largest distance of simulated and closed-form response', 2),
    ]


def _degrees(response):
    return np.degrees(np.unwrap(np.angle(response)))


FIGURE = Figure(
    'figure_03', 'Charge to displacement',
    'No hysteresis shows between displacement and net charge, and "endpoint displacement as a '
    'function of electrical charge is well approximated by second-order linear dynamics".', draw)
