# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Figure 13: a force of 10 Hz, leads open and shorted."""

import numpy as np
from piezo_stack_sim import plotting
from piezo_stack_sim.figures.base import Figure, Number, squeeze, width_at_equal
from piezo_stack_sim.plant.analysis import open_stiffness

ROWS = 2000


def draw(setting):
    """Draw force and displacement against time and against each other."""
    figure, axes = plotting.new_figure(2, 2, height=4.4, sharex='col',
                                       gridspec_kw={'width_ratios': [1.3, 1.0]})
    grid = axes[0, 1].get_gridspec()
    for ax in axes[:, 1]:
        ax.remove()
    loop = figure.add_subplot(grid[:, 1])
    runs = {drive: squeeze(setting, drive, rows=ROWS) for drive in ('shorted', 'open')}
    for i, (drive, run) in enumerate(runs.items()):
        x = run.response.displacement
        look = {**plotting.line(i), 'label': f'leads {drive}'}
        plotting.plot(axes[1, 0], run.time, x, x='time_ms', y='displacement', **look)
        # From there on it repeats; the open one goes back on its own line, the dashes with it.
        shown = slice(0, (3 if drive == 'shorted' else 1) * ROWS // 2 + 1)
        plotting.plot(loop, x[shown], run.held[shown], x='displacement', y='external_force',
                      **look)
    plotting.plot(axes[0, 0], run.time, run.command, x='time_ms', y='external_force',
                  **plotting.line(0))
    axes[0, 0].set_xlabel('')
    axes[0, 0].set_title('(a) against time')
    plotting.legend_above(axes[1, 0])
    loop.set_title('(b) against each other')
    shorted, opened = (runs[drive].response.displacement for drive in ('shorted', 'open'))
    last = runs['open'].cycle(ROWS)
    force = runs['open'].held
    travels = [float(np.ptp(x[last])) for x in (shorted, opened)]
    widths = [width_at_equal(-force[last], x[last]) / travel
              for x, travel in zip((shorted, opened), travels)]
    return figure, [
        Number('first minimum, shorted', float(shorted[:ROWS].min()), 'm',
               f'squeezed by {setting.squeeze:g} N from the relaxed state'),
        Number('left at the end of a cycle, shorted', float(shorted[ROWS]), 'm',
               'the force is gone, the charge is not'),
        Number('minimum, open', float(opened.min()), 'm',
               f'{setting.squeeze:g} N over {open_stiffness(setting.device) * 1e-6:.4g} N/µm'),
        Number('stiffness ratio', travels[0] / travels[1], '',
               'open over shorted: "significantly greater stiffness when the leads are open"'),
        Number('loop width of travel, shorted', widths[0], '%', 'hysteresis', 3),
        Number('loop width of travel, open', widths[1], '%',
               'no hysteresis: what is left is the lag of the damper', 2),
    ]


FIGURE = Figure(
    'figure_13', 'External force, 10 Hz',
    'The simulated response to a 10 Hz sinusoidal force "accurately reflects the quasistatic '
    'measured behavior": open leads are stiffer and show no loop.', draw,
    'The force squeezes from zero and back.')
