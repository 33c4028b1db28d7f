# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Figures 7 and 8: the rising curve, its piecewise-linear fit, and the Maxwell parameters."""

from itertools import combinations

import numpy as np
from piezo_stack_sim import plotting
from piezo_stack_sim.figures.base import Figure, Number
from piezo_stack_sim.plant.quasi_static import lead

FEW = 5  # pieces, as the paper's Fig. 7 shows


def draw(setting):
    """Draw the rising curve of the Maxwell capacitor with its pieces, and their parameters."""
    actuator = setting.device.actuator
    # The curve of Eq. 13: the voltage at the terminals less the one across C (clamped, q = C v_t).
    clamped = setting.device.replace(load={'clamped': True})
    corners = np.array([charge for charge in actuator.break_charges if np.isfinite(charge)])
    ends = np.concatenate([[0.0], corners])
    if np.isinf(actuator.maxwell_break_voltage[-1]):
        ends = np.append(ends, 1.5 * ends[-1])
    grid = np.unique(np.concatenate([np.linspace(0.0, ends[-1], 2001), ends]))
    v_rc = _voltage(clamped, grid)
    stiffness, volts, _ = parameters(ends, _voltage(clamped, ends))
    chosen, few_error = _few(ends, grid, v_rc, clamped)

    figure, (curve, bars) = plotting.new_figure(
        1, 2, height=3.2, gridspec_kw={'width_ratios': [1.35, 1.0]})
    plotting.plot(curve, grid, v_rc, x='charge', y='voltage', label='rising curve, relaxed state',
                  **plotting.line(0))
    plotting.plot(curve, ends, _voltage(clamped, ends), x='charge', y='voltage',
                  label=f'{ends.size - 1} pieces', **plotting.marker(0))
    plotting.plot(curve, chosen, _voltage(clamped, chosen), x='charge', y='voltage',
                  label=f'{chosen.size - 1} pieces', **plotting.line(1))
    curve.set_ylabel('Maxwell capacitor (V)')
    curve.set_title('(a) piecewise fit')
    curve.legend(loc='upper left')
    curve.set_ylim(top=1.35 * v_rc[-1])
    near = curve.inset_axes([0.6, 0.1, 0.38, 0.3])
    start = ends[min(3, ends.size - 1)] * 1.2  # the corners that crowd at the origin
    for values, look in ((grid[grid <= start], plotting.line(0)),
                         (ends[ends <= start], plotting.marker(0)), (chosen, plotting.line(1))):
        near.plot(values * 1e6, _voltage(clamped, values), **look)
    near.set_xlim(-0.03 * start * 1e6, start * 1e6)
    end = float(_voltage(clamped, [start])[0])
    near.set_ylim(-0.05 * end, 1.05 * end)
    near.tick_params(labelsize=7)
    number = np.arange(1, stiffness.size + 1)
    bars.bar(number - 0.2, stiffness * 1e-6, 0.38, color=plotting.LINES[0][0],
             label='stiffness $k_i$ (V/µC)')
    bars.bar(number + 0.2, volts, 0.38, color='#c9d8e8', edgecolor=plotting.LINES[2][0],
             linewidth=0.7, label='break voltage $V_i$ (V)')
    bars.set_yscale('log')
    bars.set_ylim(0.02, 300.0)
    bars.set_xticks(number)
    bars.grid(False, axis='x')
    bars.set_xlabel('Element')
    bars.set_title('(b) parameters from it')
    bars.legend(loc='upper left', handlelength=1.5)
    known = np.array(actuator.maxwell_stiffness), np.array(actuator.maxwell_break_voltage)
    finite = np.isfinite(known[1])
    return figure, [
        Number('pieces', stiffness.size, '', 'as many elements', 2),
        Number('sum of stiffnesses', stiffness.sum(), 'V/C', 'slope of the first piece, Eq. 6'),
        Number('stiffnesses off Table 2', np.abs(stiffness / known[0] - 1.0).max(), '%',
               'after Eqs. 6 to 8: the rising curve alone gives them back', 2),
        Number('break voltages off Table 2', np.abs(
            volts[finite] / known[1][finite] - 1.0).max(), '%', 'after Eqs. 9, 10 and 19', 2),
        Number(f'{chosen.size - 1} pieces off the curve', few_error / v_rc[-1], '%',
               'of the highest voltage, corners best chosen: more pieces, more accuracy', 3),
    ]


def parameters(charge, voltage):
    """
    Return the Maxwell parameters of a rising curve of straight pieces (Eqs. 6 to 10, 18, 19).

    Parameters
    ----------
    charge, voltage : ndarray, shape (n + 1,)
        Ends of the pieces from the origin on (C, V).

    Returns
    -------
    tuple of ndarray, shape (n,)
        Stiffnesses k_i (V/C), break voltages V_i (V) and slopes s_j (V/C). The last break voltage
        is where the curve ends: whether the element slips there, it does not say.

    """
    slopes = np.diff(voltage) / np.diff(charge)
    stiffness = slopes - np.append(slopes[1:], 0.0)  # Eq. 8: A^-1 takes differences
    return stiffness, stiffness * charge[1:], slopes  # Eq. 10


def _voltage(clamped, charge):
    charge = np.asarray(charge)
    path = lead(clamped, charge, drive='charge')
    return path.voltage - charge / clamped.actuator.linear_capacitance


def _few(ends, grid, curve, clamped):
    """Return the best choice of few corners among all, and the largest error it leaves (V)."""
    def error(inner):
        chosen = ends[[0, *inner, ends.size - 1]]
        return np.abs(np.interp(grid, chosen, _known(chosen)) - curve).max()

    values = dict(zip(ends.tolist(), _voltage(clamped, ends).tolist()))

    def _known(chosen):
        return [values[charge] for charge in chosen.tolist()]

    pieces = min(FEW, ends.size - 1)
    best = min(combinations(range(1, ends.size - 1), pieces - 1), key=error)
    return ends[[0, *best, ends.size - 1]], float(error(best))


FIGURE = Figure(
    'figure_07_08', 'Parameters from the rising curve',
    '"Complete parameterization requires piecewise linear fit of the rising curve of the '
    'hysteresis, taken from an initially relaxed state", and more pieces make it more accurate.',
    draw, 'The paper shows the method with five pieces; its simulations use ten.')
