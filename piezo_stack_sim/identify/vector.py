# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The parameters of an actuator as a vector without bounds, and back.

The terminals and the tip show T/C and the open-lead stiffness k + T^2/C
(Eq. 20); how the latter splits into k and T^2/C they show only while the last
element slips.  The vector has the two and the split, so that what recordings
leave open lies along one axis; and 1/C + k_n instead of k_n, for the two are in
series while the last element sticks.  All else enters by its logarithm: m, b,
the k_i, and the break charges V_i/k_i instead of V_i.
"""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np

from piezo_stack_sim.plant.parameters import Actuator, Device

RATIO, OPEN, SPLIT, MASS, DAMPING = range(5)
PLACES = {'mass': MASS, 'damping': DAMPING}  # in the vector
LINEAR = 5  # where the Maxwell elements begin
NEVER = 1.0  # C; an element that breaks here does not, in the simulations of a fit
SOFTEST = 1e-3  # of 1/C + k_n, the least that k_n can be
CLOSEST = 1e-6  # relative distance that two break charges keep


@dataclass(frozen=True)
class Layout:
    """
    What a vector means.

    ``n`` elements, the last of which slips or not; ``polarised`` numbers the
    recordings that began with a remanence, each with a peak voltage (V) in the
    vector; ``device`` gives whatever is not identified.
    """

    device: Device
    n: int
    last_slips: bool
    polarised: tuple[int, ...] = ()

    @property
    def breaks(self) -> int:
        """How many elements slip."""
        return self.n if self.last_slips else self.n - 1

    @property
    def size(self) -> int:
        """How many numbers the vector has."""
        return LINEAR + self.n + self.breaks + len(self.polarised)

    @property
    def shown(self) -> tuple[tuple[str, int], ...]:
        """Which combinations the vector has, by the names of `named`, and where in it."""
        return (('T/C', RATIO), ('k + T^2/C', OPEN),
                ('1/C + maxwell_stiffness[-1]', LINEAR + self.n - 1))

    def actuator(self, vector) -> Actuator:
        """Return the actuator that a vector stands for; elements in order of break charge."""
        ratio, stiff, m, b = (math.exp(vector[i]) for i in (RATIO, OPEN, MASS, DAMPING))
        k = stiff / (1.0 + math.exp(-vector[SPLIT]))
        C = (stiff - k) / ratio ** 2  # Eq. 20 solved for C
        elastance = np.exp(vector[LINEAR:LINEAR + self.n])
        elastance[-1] = max(elastance[-1] - 1.0 / C, SOFTEST * elastance[-1])
        start = LINEAR + self.n
        charges = np.exp(vector[start:start + self.breaks])
        if not self.last_slips:
            charges = np.append(charges, np.inf)
        order = np.argsort(charges, kind='stable')
        elastance, charges = elastance[order], charges[order]
        for i in range(1, self.n):
            charges[i] = max(charges[i], charges[i - 1] * (1.0 + CLOSEST))
        return self.device.actuator.replace(
            mass=m, stiffness=k, damping=b, linear_capacitance=C, transformer_ratio=ratio * C,
            maxwell_stiffness=tuple(elastance),
            maxwell_break_voltage=tuple(elastance * charges))

    def device_for(self, vector, recording: int | None = None) -> Device:
        """Return the device, for a recording that began polarised with that history."""
        actuator = self.actuator(vector)
        if not self.last_slips:
            *volts, _ = actuator.maxwell_break_voltage
            actuator = actuator.replace(
                maxwell_break_voltage=(*volts, actuator.maxwell_stiffness[-1] * NEVER))
        device = self.device.replace(actuator=actuator)
        if recording in self.polarised:
            place = self.size - len(self.polarised) + self.polarised.index(recording)
            device = device.with_effects(
                {'initial_polarisation': {'peak_voltage': float(math.exp(vector[place]))}})
        return device

    def vector(self, actuator: Actuator, peaks=()) -> np.ndarray:
        """Return the vector of an actuator and the earlier peaks (V) of polarised recordings."""
        T, C, k = (actuator.transformer_ratio, actuator.linear_capacitance, actuator.stiffness)
        charges = np.array(actuator.break_charges)[:self.breaks]
        elastance = np.array(actuator.maxwell_stiffness)
        elastance[-1] += 1.0 / C
        return np.concatenate([
            [math.log(T / C), math.log(k + T * T / C), math.log(k * C / T ** 2),
             math.log(actuator.mass), math.log(actuator.damping)],
            np.log(elastance), np.log(charges), np.log(np.asarray(peaks, float)),
        ])

    def named(self, vector) -> dict[str, float]:
        """Return the physical numbers (SI) of a vector by name, all positive."""
        actuator = self.actuator(vector)
        T, C, k = (actuator.transformer_ratio, actuator.linear_capacitance, actuator.stiffness)
        values = {'mass': actuator.mass, 'stiffness': k, 'damping': actuator.damping,
                  'linear_capacitance': C, 'transformer_ratio': T}
        for i, value in enumerate(actuator.maxwell_stiffness):
            values[f'maxwell_stiffness[{i}]'] = value
        for i, value in enumerate(actuator.maxwell_break_voltage[:self.breaks]):
            values[f'maxwell_break_voltage[{i}]'] = value
        values['T/C'] = T / C
        values['k + T^2/C'] = k + T * T / C
        values['1/C + maxwell_stiffness[-1]'] = 1.0 / C + actuator.maxwell_stiffness[-1]
        return values

    def derivative(self, vector) -> np.ndarray:
        """Return d ln(named) / d vector, shape (names, size)."""
        step = 1e-6
        columns = []
        for j in range(self.size):
            ends = []
            for sign in (1.0, -1.0):
                moved = np.array(vector, dtype=float)
                moved[j] += sign * step
                ends.append(np.log(list(self.named(moved).values())))
            columns.append((ends[0] - ends[1]) / (2.0 * step))
        return np.column_stack(columns)
