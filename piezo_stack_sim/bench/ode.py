# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""The device by a general solver of ordinary differential equations, as one would with scipy."""

from __future__ import annotations

import numpy as np

from piezo_stack_sim.plant.parameters import Device


def run(device: Device, time, command, external_force=None, method: str = 'LSODA',
        tolerance: float = 1e-6) -> dict[str, np.ndarray]:
    """
    Integrate a voltage-driven, unclamped device row by row with a solver of ``scipy.integrate``.

    The states are displacement and velocity; the charge follows from the displacement as long as
    neither the command nor the direction changes, by a piecewise-linear table of the elements
    that yield. So the solver starts anew at each row, and the table is made anew at each reversal.

    Parameters
    ----------
    device : Device
        Its actuator and load; effects are left out.
    time, command, external_force : array_like, shape (n,)
        s, V and N; held from row to row.
    method : str
        ``LSODA``, ``RK45``, or another solver of it.
    tolerance : float
        Relative tolerance; absolute ones follow from the sizes of the states.

    Returns
    -------
    dict of ndarray, shape (n,)
        ``displacement`` (m) and ``charge`` (C), sampled just before each row's command.

    """
    from scipy import integrate

    actuator, load = device.actuator, device.load
    m, b = actuator.mass + load.mass, actuator.damping + load.damping
    C, T = actuator.linear_capacitance, actuator.transformer_ratio
    stiffness = actuator.stiffness + load.stiffness
    k = np.array(actuator.maxwell_stiffness)
    limit = np.array(actuator.maxwell_break_voltage)
    force = np.zeros(len(time)) if external_force is None else external_force

    solver_class = getattr(integrate, method)
    scale = tolerance * np.array([1e-5, 1e-2])  # m, m/s
    y, memory = np.zeros(2), _Memory(0.0, np.zeros(k.size), k, limit, T, C, 0.0)
    out = np.zeros((len(time), 2))
    for row in range(len(time) - 1):
        memory = memory.turned(y[0], command[row])
        push = force[row]

        def slope(_time, y):
            x, v = y
            q = memory.charge(x)
            return v, (T * (q - T * x) / C - stiffness * x - b * v + push) / m  # Eqs. 11, 14, 15

        # A solver for each row, as the command jumps there; cheaper than solve_ivp and its events.
        duration = time[row + 1] - time[row]
        solver = solver_class(slope, time[row], y, time[row + 1], rtol=tolerance, atol=scale,
                              first_step=min(2e-6, 0.5 * duration))
        while solver.status == 'running':
            before = y
            solver.step()
            y = solver.y.copy()
            if before[1] * y[1] < 0.0:  # it turned within the step: a parabola says where
                top = before[0] - 0.5 * before[1] ** 2 * (solver.t - solver.t_old) / (
                    y[1] - before[1])
                memory = memory.turned(top, command[row])
        out[row + 1] = y[0], memory.charge(y[0])
    return {'displacement': out[:, 0], 'charge': out[:, 1]}


class _Memory:
    """Eqs. 11, 12, 16 and 17 from one turning point on: the charge from the displacement."""

    def __init__(self, q, z, k, limit, T, C, command):
        """Tabulate the voltage over the Maxwell capacitor and C against the charge that comes."""
        steps = np.concatenate([-(z + limit) / k, (limit - z) / k])
        steps = np.unique(np.concatenate([steps[np.isfinite(steps)], [-1e-2, 1e-2]]))  # C
        volts = np.clip(z + np.outer(steps, k), -limit, limit).sum(axis=1)
        self.voltages, self.charges = volts + (q + steps) / C, q + steps
        self.command, self.elastance = command, T / C
        self.q, self.z, self.k, self.limit, self.T, self.C = q, z, k, limit, T, C

    def turned(self, x, command):
        """Return the memory from the displacement x (m) on, for a command (V)."""
        q = self.charge(x)
        z = np.clip(self.z + self.k * (q - self.q), -self.limit, self.limit)  # Eq. 16
        return _Memory(q, z, self.k, self.limit, self.T, self.C, command)

    def charge(self, x):
        """Return q (C) for a displacement x (m): v_in + T x / C = v_rc + q / C."""
        return np.interp(self.command + self.elastance * x, self.voltages, self.charges)
