# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Figure 12: a linearly decaying sine of 100 Hz."""

import numpy as np
from piezo_stack_sim import plotting
from piezo_stack_sim.figures.base import Figure, Number
from piezo_stack_sim.plant import simulate
from piezo_stack_sim.plant.quasi_static import lead

FREQUENCY = 100.0  # Hz
CYCLES = 10
ROWS = 1000


def draw(setting):
    """Draw voltage and displacement against time, and their loops."""
    phase = np.arange(CYCLES * ROWS + 1) / ROWS
    fade = 1.0 - phase / CYCLES
    bias = 0.5 * setting.peaks[-1]
    command = bias * (1.0 - fade * np.cos(2.0 * np.pi * phase))
    time = phase / FREQUENCY
    response = simulate(setting.device, time, command, drive='voltage')
    slow = lead(setting.device, command[:-1]).displacement
    x = response.displacement
    figure, axes = plotting.new_figure(2, 2, height=4.4, sharex='col',
                                       gridspec_kw={'width_ratios': [1.6, 1.0]})
    plotting.plot(axes[0, 0], time, command, x='time_ms', y='voltage_command', **plotting.line(0))
    plotting.plot(axes[1, 0], time, x, x='time_ms', y='displacement', **plotting.line(0))
    axes[0, 0].set_xlabel('')
    axes[0, 0].set_title('(a) against time')
    grid = axes[0, 1].get_gridspec()
    for ax in axes[:, 1]:
        ax.remove()
    loop = figure.add_subplot(grid[:, 1])
    plotting.plot(loop, response.voltage, x, x='voltage', y='displacement', linewidth=0.9,
                  **plotting.line(0))
    loop.set_title('(b) against voltage')
    stroke = float(np.ptp(x))
    gains = [np.ptp(x[rows]) / np.ptp(response.voltage[rows])
             for rows in (slice(ROWS // 2, 3 * ROWS // 2), slice(-3 * ROWS // 2, -ROWS // 2))]
    middle = 0.5 * float(x[ROWS // 2] + x[ROWS])
    return figure, [
        Number('gain of the first cycle', float(gains[0]), 'm/V', 'peak to peak'),
        Number('gain of the last but one', float(gains[1]), 'm/V',
               'smaller: amplitude-dependent, as hysteresis is and linear dynamics is not'),
        Number('where it ends', float(x[-1]), 'm', f'at {bias:g} V'),
        Number('middle of its largest loop', middle, 'm',
               'near it: shrinking cycles wipe out the history'),
        Number('distance to the same led slowly', float(np.abs(x[1:] - slow).max()) / stroke, '%',
               'of stroke: nested loops at 100 Hz are the quasi-static ones', 2),
    ]


FIGURE = Figure(
    'figure_12', 'Decaying sine, 100 Hz',
    'Accuracy is shown, too, by the "response to a linearly decaying 100-hertz sinusoidal '
    'voltage input".', draw,
    'The paper does not print amplitude, bias and duration: here about half the highest voltage, '
    'from all of it to nothing in ten cycles.')
