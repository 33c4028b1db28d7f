# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Figures 10 and 11: triangles of 30, 60 and 90 V at 100 Hz, against time and against voltage."""

import numpy as np
from piezo_stack_sim import plotting
from piezo_stack_sim.figures.base import Figure, Number, triangle, width_at_equal

FREQUENCY = 100.0  # Hz
ROWS = 1000  # a cycle: 10 us
FINE = 10000  # a cycle, to see how late a peak is


def draw_time(setting):
    """Draw voltage and displacement against time."""
    figure, (top, bottom) = plotting.new_figure(2, 1, height=4.4, sharex=True)
    numbers = []
    for i, peak in enumerate(setting.peaks):
        run = triangle(setting, peak, FREQUENCY, cycles=3, rows=ROWS)
        look = {**plotting.line(i), 'label': f'{peak:g} V'}
        plotting.plot(top, run.time, run.command, x='time_ms', y='voltage_command', **look)
        x = run.response.displacement
        plotting.plot(bottom, run.time, x, x='time_ms', y='displacement', **look)
        numbers += [
            Number(f'first peak, {peak:g} V', float(x[:ROWS].max()), 'm',
                   'rising from the relaxed state'),
            Number(f'offset, {peak:g} V', float(x[ROWS:ROWS + 5].min()), 'm',
                   'at the end of a cycle: "an amplitude-dependent offset"'),
        ]
    fine = triangle(setting, setting.peaks[-1], FREQUENCY, cycles=2, rows=FINE)
    last = fine.cycle(FINE)
    late = (np.argmax(fine.response.displacement[last])
            - np.argmax(fine.response.voltage[last])) / FINE
    top.set_xlabel('')
    plotting.legend_above(top)
    return figure, [*numbers, Number(
        'phase lag at the peaks', 360.0 * float(late), 'deg',
        '"no discernible phase lag": a quarter period of the stack\'s own vibration', 2)]


def draw_loop(setting):
    """Draw displacement against voltage."""
    figure, axes = plotting.new_figure(1, 1, height=3.6, width=4.8)
    numbers = []
    for i, peak in reversed(list(enumerate(setting.peaks))):
        run = triangle(setting, peak, FREQUENCY, cycles=2, rows=ROWS)
        voltage, x = run.response.voltage, run.response.displacement
        shown = slice(0, 3 * ROWS // 2 + 1)  # from there on it repeats
        plotting.plot(axes, voltage[shown], x[shown], x='voltage', y='displacement',
                      label=f'{peak:g} V', **plotting.line(i))
        last = run.cycle(ROWS)
        width, stroke = width_at_equal(voltage[last], x[last]), float(np.ptp(x[last]))
        numbers[:0] = [
            Number(f'loop width, {peak:g} V', width, 'm', 'settled cycle'),
            Number(f'loop width of stroke, {peak:g} V', width / stroke, '%', 'settled cycle', 3),
        ]
    axes.legend(loc='upper left', title='triangle to')
    # Slopes of the largest loop next to its upper end; the rows of the ringing are left out.
    run = triangle(setting, setting.peaks[-1], FREQUENCY, cycles=2, rows=ROWS)
    middle = ROWS + ROWS // 2
    step = max(ROWS // 1000, 1)
    before = _slope(run, middle - 30 * step, middle)
    after = _slope(run, middle + 1, middle + 3 * step)
    return figure, [*numbers, Number(
        'gain before and after the turn', before / after, '',
        'ratio of the slopes: "distinct discontinuities at both extremes", not an ellipse', 2)]


def _slope(run, first, last):
    v, x = run.response.voltage[first:last + 1], run.response.displacement[first:last + 1]
    return float(np.polyfit(v, x, 1)[0])


FIGURE_10 = Figure(
    'figure_10', 'Triangles, 100 Hz, against time',
    'The output shows "distortion on both the rising and falling slopes and maintains an '
    'amplitude-dependent offset", with "no discernible phase lag between the input and output".',
    draw_time)
FIGURE_11 = Figure(
    'figure_11', 'Triangles, 100 Hz, against voltage',
    'Rate-independent hysteresis "is distinguished from a dynamic hysteresis by the distinct '
    'discontinuities exhibited at both extremes".', draw_loop)
