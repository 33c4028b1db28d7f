# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""What real sensors add to a true value: white noise and the steps of a converter."""

from __future__ import annotations

import numpy as np

from piezo_stack_sim.plant.parameters import Noise


def disturbs(noise: Noise) -> bool:
    """Tell whether the sensors change anything at all."""
    return any((noise.displacement, noise.charge, noise.voltage, noise.displacement_resolution,
                noise.charge_resolution, noise.voltage_resolution))


def disturb(noise: Noise, displacement, charge, voltage, draws):
    """
    Add noise, then quantise.

    Parameters
    ----------
    noise : Noise
        Standard deviations and converter steps, SI units.
    displacement, charge, voltage : numpy.ndarray, shape (n,)
        True values (m, C, V).
    draws : numpy.ndarray, shape (n, 3)
        Standard normal numbers; always three a row, so that a seed gives the
        same noise however the rows are cut into calls.

    Returns
    -------
    tuple of numpy.ndarray
        Displacement, charge and voltage as the sensors show them.

    """
    return (_quantised(displacement + noise.displacement * draws[:, 0],
                       noise.displacement_resolution),
            _quantised(charge + noise.charge * draws[:, 1], noise.charge_resolution),
            _quantised(voltage + noise.voltage * draws[:, 2], noise.voltage_resolution))


def _quantised(values, step: float):
    return values if step <= 0.0 else np.rint(values / step) * step
