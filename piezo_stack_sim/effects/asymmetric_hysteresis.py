# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A saturating, asymmetric ceramic: the loop is bowed.

The reversible last element of the Maxwell capacitor becomes a polynomial.  With
s = q/q_full, and V_full, q_full the end of the first rise:

    v_bow = -V_full (4 quadratic s (1 - s) + 2.598 cubic s (1 - s^2))

Both terms vanish at s = 0 and 1 and reach 1 between: the numbers are departures
from the straight line, as fractions of the full voltage.

The branches may differ as well: an element breaks at V_i (1 + branch) on the way
up and at -V_i (1 - branch) on the way down.  That is an element with V_i both
ways that starts off its middle, and a constant voltage:

    z_i(0) = -branch V_i,   v_branch = branch sum V_i

Look-alikes: ``sensor_nonlinearity`` (error over position, charge clean),
``stiffness_hardening`` (changes q-x and the resonance).
Source: Oezer and Royston 2001, last element K q + a2 q^2 + a3 q^3; bows of 2 to
10 % of a unipolar stroke are an engineering estimate.
"""

import math

from piezo_stack_sim.effects.base import Effect, Parameter

WAVE = 1.5 * math.sqrt(3.0)  # s (1 - s^2) reaches 1/WAVE


def apply(model, quadratic, cubic, branch):
    """Bow the voltage over the charge, and let the branches differ."""
    if branch != 0.0:
        model.branch_difference += branch
        model.add_state('branch_offset', {}, 1.0)
        model.add_opposing_voltage({'branch_offset': branch * sum(
            volt for volt in model.maxwell_v if math.isfinite(volt))})
    volts, charge = model.reference.voltage, model.reference.charge
    model.add_opposing_voltage({'charge': -(4.0 * quadratic + WAVE * cubic) * volts / charge})
    v2, v3 = model.smooth_voltage
    model.smooth_voltage = (v2 + 4.0 * quadratic * volts / charge ** 2,
                            v3 + WAVE * cubic * volts / charge ** 3)


EFFECT = Effect(
    'asymmetric_hysteresis', 'electrical',
    'The loop of charge and displacement over voltage is bowed: rise and fall differ in shape.',
    (
        Parameter('quadratic', '1', 0.0, -0.06, 0.06, 0.02,
                  'bow of voltage over charge; positive: more charge at half the voltage',
                  runtime=False),
        Parameter('cubic', '1', 0.0, -0.03, 0.03, 0.0,
                  'S shape of voltage over charge, equal for both signs', runtime=False),
        Parameter('branch', '1', 0.0, -0.15, 0.15, 0.0,
                  'by how much elements break later rising than falling', runtime=False),
    ),
    apply, channels=('charge', 'displacement'))
