# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Figure 2: hysteresis, the same at every speed, from voltage and from force to displacement."""

import numpy as np
from piezo_stack_sim import plotting
from piezo_stack_sim.figures.base import Figure, Number, squeeze, triangle, width_at_equal

RATES = (1.0, 10.0, 100.0)  # Hz
ROWS = 1000
# The three lie upon each other: thick and light below thin and dark.
LOOKS = ({'color': '#c4c9cf', 'linewidth': 6.0, 'linestyle': '-'},
         {'color': '#3d8bd0', 'linewidth': 2.6, 'linestyle': '-'},
         {'color': '#111111', 'linewidth': 0.8, 'linestyle': '-'})


def draw(setting):
    """Draw both loops, at three speeds."""
    figure, (left, right) = plotting.new_figure(1, 2, height=3.0)
    peak, widths = setting.peaks[-1], []
    for i, rate in enumerate(RATES):
        run = triangle(setting, peak, rate, cycles=2, rows=ROWS)
        voltage, x = run.response.voltage, run.response.displacement
        shown = slice(0, 3 * ROWS // 2 + 1)  # from there on it repeats
        plotting.plot(left, voltage[shown], x[shown], x='voltage', y='displacement',
                      label=f'{rate:g} Hz', **LOOKS[i])
        last = run.cycle(ROWS)
        widths.append(width_at_equal(voltage[last], x[last]))
    stroke = float(np.ptp(x[last]))

    force = squeeze(setting, 'shorted', rows=ROWS)
    plotting.plot(right, force.held[shown], force.response.displacement[shown],
                  x='external_force', y='displacement', **plotting.line(0))
    last = force.cycle(ROWS)
    force_width = width_at_equal(-force.held[last], force.response.displacement[last])
    left.set_title('(a) voltage, no force')
    left.legend(title='triangle at')
    right.set_title('(b) force, leads shorted')
    return figure, [
        Number('loop width', widths[0], 'm',
               f'voltage loop to {peak:g} V at {RATES[0]:g} Hz, largest distance of its branches'),
        Number('loop width of stroke', widths[0] / stroke, '%', 'settled cycle'),
        Number('change of loop width with speed', widths[-1] / widths[0] - 1.0, '%',
               f'from {RATES[0]:g} to {RATES[-1]:g} Hz: the hysteresis is rate-independent', 2),
        Number('force loop width', force_width, 'm',
               f'leads shorted, 0 to {setting.squeeze:g} N: from force to displacement, too', 3),
    ]


FIGURE = Figure(
    'figure_02', 'Hysteresis',
    'Rate-independent hysteresis shows "between voltage and displacement as well as between force '
    'and displacement".', draw,
    'First rise from the relaxed state and the settled cycle after it.')
