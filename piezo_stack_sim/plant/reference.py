# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""The scales of an actuator: what "full" means for its voltage, charge, stroke and stiffness."""

from __future__ import annotations

from dataclasses import dataclass
import math

from piezo_stack_sim.plant.parameters import Actuator


@dataclass(frozen=True)
class Reference:
    """
    Scales by which effects state their strength as a fraction.

    ``voltage`` (V), ``charge`` (C) and ``stroke`` (m) are the end of the first
    slow rise of the free stack; ``elastance`` (V/C, dv/dq) and ``stiffness``
    (N/m, leads shorted, Eq. 21) hold at large signals, where only the last
    Maxwell element sticks.
    """

    voltage: float
    charge: float
    stroke: float
    elastance: float
    stiffness: float


def reference_of(actuator: Actuator) -> Reference:
    """
    Return the scales of an actuator.

    The full voltage is the end of its range, or, if that comes first, the
    voltage at which the last Maxwell element would slip (the table says nothing
    beyond).
    """
    k, T, C = actuator.stiffness, actuator.transformer_ratio, actuator.linear_capacitance
    free = C + T * T / k  # Eqs. 11 and 15 at rest: q = free v_t
    full = max(abs(end) for end in actuator.voltage_range)
    q = v = 0.0
    slope = sum(actuator.maxwell_stiffness) + 1.0 / free
    for edge, k_i in zip(actuator.break_charges, actuator.maxwell_stiffness):
        at_edge = v + slope * (edge - q) if math.isfinite(edge) else math.inf
        if at_edge >= full:
            q, v = q + (full - v) / slope, full
            break
        q, v = edge, at_edge
        slope -= k_i  # Eq. 8: this element slips from here on
    last = actuator.maxwell_stiffness[-1]
    return Reference(v, q, T * q / free / k, last + 1.0 / free,
                     k + T * T * last / (1.0 + C * last))
