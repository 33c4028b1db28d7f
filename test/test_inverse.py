# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Claims about the quasi-static inverse of the Maxwell model."""

import numpy as np
from piezo_stack_sim.errors import InputError
from piezo_stack_sim.plant import Device, Load, Plant
from piezo_stack_sim.plant.inverse import InverseStack
import pytest

DEVICE = Device.nominal()
# A slow walk with reversals of every size, so that inner loops open and close.
STEPS = np.linspace(0.0, 1.0, 400)
WALK = 5e-6 * (1.0 - np.cos(2 * np.pi * 4 * STEPS)) * (1.0 - 0.7 * STEPS)


@pytest.mark.parametrize('volts, microns', [(10, 0.742414), (30, 3.018930), (60, 7.382550),
                                            (90, 12.416107), (100, 14.093960)])
def test_the_static_rise_of_the_model_page_is_inverted(volts, microns):
    assert InverseStack(DEVICE.actuator).voltage(microns * 1e-6) == pytest.approx(volts, rel=1e-6)


def test_charge_is_linear_in_displacement():
    inverse = InverseStack(DEVICE.actuator)
    assert inverse.charge(0.0932836e-6) == pytest.approx(1e-6, rel=1e-6)
    assert inverse.charge(2e-6) == 2 * inverse.charge(1e-6)


def test_the_plant_follows_the_inverse_through_reversals():
    commands = InverseStack(DEVICE.actuator).voltages(WALK)
    plant = Plant(DEVICE.replace(rate=10.0))  # slow: each step comes to rest
    rate = 100
    reached = []
    for before, after in zip([0.0, *commands], commands):
        for u in before + (after - before) * np.arange(1, rate + 1) / rate:
            sample = plant.advance(u)
        reached.append(sample.displacement)
    # What is left is the overshoot of a hundred small steps, not hysteresis.
    assert np.abs(np.array(reached) - WALK).max() < 2e-9


def test_a_force_and_a_spring_are_taken_into_account():
    free = InverseStack(DEVICE.actuator)
    sprung = InverseStack(DEVICE.actuator, Load(stiffness=6e6))
    assert free.voltage(1e-6, external_force=-6.0) == pytest.approx(sprung.voltage(1e-6))


def test_reset_forgets_the_past():
    inverse = InverseStack(DEVICE.actuator)
    first = inverse.voltages(WALK)
    assert inverse.voltage(0.0) != 0.0
    inverse.reset()
    assert np.array_equal(inverse.voltages(WALK), first)


def test_a_clamped_stack_has_no_inverse():
    with pytest.raises(InputError, match='clamped'):
        InverseStack(DEVICE.actuator, Load(clamped=True))
