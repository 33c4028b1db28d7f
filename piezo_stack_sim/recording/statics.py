# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What a device answers to slow inputs, without memory: enough to tell units and signs.

Not the plant: the rising curve of the Maxwell elements from the relaxed state (Eqs. 6 to 10),
taken as odd, with the static transducer (Eqs. 11, 14, 15). Good to a factor of about five.
"""

import numpy as np


class Statics:
    """
    The static device.

    Parameters
    ----------
    device : Device
        Of its actuator: stiffness (N/m), transformer_ratio (C/m), linear_capacitance (F),
        maxwell_stiffness (V/C), maxwell_break_voltage (V), voltage_range (V); of its load:
        stiffness (N/m) and clamped.

    """

    def __init__(self, device):
        actuator, load = device.actuator, device.load
        self.ratio, self.capacitance = actuator.transformer_ratio, actuator.linear_capacitance
        # A clamped device is one with a spring that nothing moves.
        self.stiffness = 1e15 if load.clamped else actuator.stiffness + load.stiffness
        elastance = np.array(actuator.maxwell_stiffness, dtype=float)
        limit = np.array(actuator.maxwell_break_voltage, dtype=float)
        # The last element is a spring: past its printed limit no real stack follows Table 2.
        limit[np.argmax(limit / elastance)] = np.inf
        self.elastance = float(elastance.sum())
        # The largest command of the data sheet, whichever its sign.
        self.voltage_limit = float(max(abs(each) for each in actuator.voltage_range))
        self._lowest = float(min(actuator.voltage_range)) / self.voltage_limit
        free = self.capacitance + self.ratio**2 / self.stiffness
        breaks = np.append((limit / elastance)[np.isfinite(limit)], 0.0)
        knots = np.unique(np.append(breaks, self.voltage_limit * free + breaks.max() * 2.0))
        self._charge = knots
        self._voltage = np.minimum(
            elastance * knots[:, None], limit).sum(axis=1) + knots / free

    def charge_of(self, voltage):
        """Return the charge (C) at a voltage (V), both shape (n,); odd, linear at the ends."""
        return np.sign(voltage) * _extended(np.abs(voltage), self._voltage, self._charge)

    def voltage_of(self, charge):
        """Return the voltage (V) at a charge (C), both shape (n,)."""
        return np.sign(charge) * _extended(np.abs(charge), self._charge, self._voltage)

    @property
    def charge_limit(self):
        """Return the charge at the largest voltage, C."""
        return float(self.charge_of(np.array([self.voltage_limit]))[0])

    def limit(self, drive):
        """Return the largest command of a drive, V or C; infinite where there is none."""
        return {'voltage': self.voltage_limit, 'charge': self.charge_limit}.get(drive, np.inf)

    def lowest(self, drive):
        """Return the lowest command of a drive, V or C: zero for a device of one polarity."""
        return self._lowest * self.limit(drive) if drive in ('voltage', 'charge') else -np.inf

    @property
    def blocking_force(self):
        """Return the force that takes the largest stroke back at open leads, N."""
        stroke = self.ratio * self.charge_limit / (
            self.ratio**2 + self.stiffness * self.capacitance)
        return stroke * (self.stiffness + self.ratio**2 / self.capacitance)

    def answer(self, drive, command, force):
        """
        Return what the measured channels do.

        Parameters
        ----------
        drive : str
            The drive.
        command : ndarray, shape (n,)
            V or C.
        force : ndarray, shape (n,)
            N.

        Returns
        -------
        dict of str to ndarray, shape (n,)
            voltage (V), charge (C), displacement (m).

        """
        k, c, t = self.stiffness, self.capacitance, self.ratio
        if drive in ('voltage', 'shorted'):
            voltage = command if drive == 'voltage' else np.zeros_like(command)
            # At a fixed voltage, all elements sticking: q = T x / (1 + K C).
            soft = 1.0 + self.elastance * c
            by_force = force / (k + t**2 / c * (1.0 - 1.0 / soft))
            charge = self.charge_of(voltage)
            return {
                'voltage': voltage,
                'charge': charge + t * by_force / soft,
                'displacement': t * charge / (t**2 + k * c) + by_force,
            }
        charge = command if drive == 'charge' else np.zeros_like(command)
        by_force = force / (k + t**2 / c)
        return {
            'voltage': self.voltage_of(charge) - t / c * by_force,
            'charge': charge,
            'displacement': t * charge / (t**2 + k * c) + by_force,
        }


def _extended(x, knots, values):
    """Interpolate, and go on in the last direction past the last knot."""
    slope = (values[-1] - values[-2]) / (knots[-1] - knots[-2])
    return np.interp(x, knots, values) + np.maximum(x - knots[-1], 0.0) * slope
