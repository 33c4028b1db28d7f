# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""From the parameters of a device to a model: the ideal stack, then its effects."""

from __future__ import annotations

import numpy as np

from piezo_stack_sim.errors import InputError
from piezo_stack_sim.plant.assembly import Model
from piezo_stack_sim.plant.parameters import Device
from piezo_stack_sim.plant.reference import reference_of

DRIVES = ('voltage', 'charge', 'open', 'shorted')


def build_model(device: Device, drive: str | None = None) -> Model:
    """
    Put a device together: Eqs. 11 to 17, its load, and every effect that is not neutral.

    Raises
    ------
    InputError
        If the drive is unknown.

    """
    drive = drive or device.drive
    if drive not in DRIVES:
        raise InputError(f'drive {drive!r}: expected one of {", ".join(DRIVES)}')
    actuator, load = device.actuator, device.load
    model = Model(
        m=actuator.mass, b=actuator.damping, k=actuator.stiffness,
        C=actuator.linear_capacitance, T=actuator.transformer_ratio,
        maxwell_k=np.array(actuator.maxwell_stiffness, dtype=float),
        maxwell_v=np.array(actuator.maxwell_break_voltage, dtype=float),
        drive=drive, clamped=load.clamped, load_mass=load.mass, load_damping=load.damping,
        load_stiffness=load.stiffness, reference=reference_of(actuator))
    if device.effects:
        from piezo_stack_sim.effects.registry import apply_effects
        apply_effects(model, device.effects)
    return model
