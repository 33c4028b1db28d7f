# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Figure 4: quasi-static force and displacement, leads open and shorted."""

import numpy as np
from piezo_stack_sim import plotting
from piezo_stack_sim.figures.base import Figure, Number
from piezo_stack_sim.plant.analysis import open_stiffness, shorted_stiffness
from piezo_stack_sim.plant.quasi_static import lead

POINTS = 401


def draw(setting):
    """Draw a first squeeze and a settled cycle with shorted leads, and the open-lead line."""
    device = setting.device
    ramp = np.linspace(0.0, -setting.squeeze, POINTS)
    force = np.concatenate([ramp, ramp[-2::-1], ramp[1:], ramp[-2::-1]])
    shorted = lead(device, 0.0, force)
    opened = lead(device, 0.0, force, drive='charge')
    figure, axes = plotting.new_figure(1, 1, height=3.2, width=4.6)
    shown = slice(0, 3 * POINTS - 2)  # from there on it repeats
    plotting.plot(axes, shorted.displacement[shown], force[shown], x='displacement',
                  y='external_force', label='leads shorted', **plotting.line(0))
    plotting.plot(axes, opened.displacement[:POINTS], force[:POINTS], x='displacement',
                  y='external_force', label='leads open', **plotting.line(1))
    axes.legend()
    first, second = (slice(i * (2 * POINTS - 2), (i + 1) * (2 * POINTS - 2) + 1) for i in (0, 1))
    travel = float(np.ptp(shorted.displacement[second]))
    there, back = np.split(opened.displacement[first][:-1], 2)
    gap = float(np.abs(there[1:] - back[:0:-1]).max())
    secant = setting.squeeze / travel
    loop = shorted.displacement[second]
    width = float(np.abs(loop[:POINTS] - loop[POINTS - 1:][::-1]).max())
    return figure, [
        Number('open-lead stiffness', open_stiffness(device), 'N/m', 'Eq. 20'),
        Number('shorted stiffness', secant, 'N/m',
               f'force over travel of the settled cycle to {setting.squeeze:g} N'),
        Number('shorted stiffness, small signal', shorted_stiffness(device), 'N/m', 'Eq. 21'),
        Number('stiffness ratio', open_stiffness(device) / secant, '',
               'open over shorted, at this force'),
        Number('shorted loop width', width, 'm', 'hysteresis with the leads shorted', 3),
        Number('open loop width', gap, 'm', 'no hysteresis with the leads open', 2),
        Number('left behind', float(shorted.displacement[first][-1]), 'm',
               'after the first squeeze with shorted leads'),
    ]


FIGURE = Figure(
    'figure_04', 'Force and displacement',
    'Hysteresis "is observed only when the electrode leads are shorted"; with the leads open the '
    'actuator "exhibits no static hysteresis", and it is significantly stiffer.', draw)
