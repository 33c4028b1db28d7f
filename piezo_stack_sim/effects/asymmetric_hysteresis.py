# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A saturating, asymmetric ceramic: the loop is bowed.

The reversible last element of the Maxwell capacitor becomes a polynomial, whose
linear part is the nominal one.  With s = q/q_full, and V_full, q_full the end of
the first rise, the same charge takes more voltage by

    v_bow = V_full (quadratic s^2 + cubic s^3)

The loop departs from its own chord by a quarter of ``quadratic``.

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
from piezo_stack_sim.errors import InputError


#: Slope of the bow at the end of the first rise (V_full/q_full) from which more charge may take
#: less voltage: the last element and the load of the nominal stack hold 0.8 against it.
SOFTEST = -0.3


def is_too_soft(quadratic, cubic):
    """Tell whether the voltage may fall as the charge grows, as that of no ceramic does."""
    return 2.0 * quadratic + 3.0 * cubic < SOFTEST - 1e-9


def apply(model, quadratic, cubic, branch):
    """Bow the voltage over the charge, and let the branches differ."""
    if is_too_soft(quadratic, cubic):
        raise InputError('effects.asymmetric_hysteresis: the voltage falls as the charge grows; '
                         'expected a larger quadratic or cubic')
    if branch != 0.0:
        model.branch_difference += branch
        model.add_state('branch_offset', {}, 1.0)
        model.add_opposing_voltage({'branch_offset': branch * sum(
            volt for volt in model.maxwell_v if math.isfinite(volt))})
    volts, charge = model.reference.voltage, model.reference.charge
    v2, v3 = model.smooth_voltage
    model.smooth_voltage = (v2 + quadratic * volts / charge ** 2, v3 + cubic * volts / charge ** 3)


EFFECT = Effect(
    'asymmetric_hysteresis', 'electrical',
    'The loop of charge and displacement over voltage is bowed: rise and fall differ in shape.',
    (
        Parameter('quadratic', '1', 0.0, -0.06, 0.4, 0.08,
                  'voltage at full charge beyond the straight line; positive: saturation',
                  runtime=False),
        Parameter('cubic', '1', 0.0, -0.1, 0.1, 0.0,
                  'the same, odd in the charge: both ends of a bipolar loop alike', runtime=False),
        Parameter('branch', '1', 0.0, -0.1, 0.1, 0.0,
                  'by how much elements break later rising than falling', runtime=False),
    ),
    apply, channels=('charge', 'displacement'))
