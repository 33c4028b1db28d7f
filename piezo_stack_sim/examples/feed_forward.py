# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Open-loop control by voltage through the inverse of the Maxwell model."""

from __future__ import annotations

import sys

from piezo_stack_sim.examples.experiment import Controller, perform
from piezo_stack_sim.examples.pi_control import constant_gain
from piezo_stack_sim.examples.tracking import HEIGHT, removed, Run
from piezo_stack_sim.plant.inverse import InverseStack
from piezo_stack_sim.plant.parameters import Actuator, Device


def through(inverse: InverseStack) -> Controller:
    """Return a controller that asks the inverse for each next sample of the reference."""
    def control(wanted: float, wanted_next: float, measured: float) -> float:
        return inverse.voltage(wanted_next)
    return control


def scattered(actuator: Actuator) -> Actuator:
    """Return the actuator with every parameter off by its uncertainty, up and down in turn."""
    share = actuator.relative_uncertainty

    def off(values):
        return [value * (1.0 + share * (-1.0) ** i) for i, value in enumerate(values)]

    stiffness, capacitance, ratio = off((actuator.stiffness, actuator.linear_capacitance,
                                         actuator.transformer_ratio))
    return actuator.replace(
        stiffness=stiffness, linear_capacitance=capacitance, transformer_ratio=ratio,
        maxwell_stiffness=tuple(off(actuator.maxwell_stiffness)),
        maxwell_break_voltage=tuple(off(actuator.maxwell_break_voltage)))


def controllers(device: Device, delay: int) -> dict[str, Controller]:
    """Return a constant gain, the inverse, and the inverse of a model that is a little wrong."""
    actuator, load = device.actuator, device.load
    gain = HEIGHT / InverseStack(actuator, load).voltage(HEIGHT)  # m/V
    return {
        'constant gain': constant_gain(gain),
        'inverse model': through(InverseStack(actuator, load)),
        f'inverse, {actuator.relative_uncertainty:.0%} off': through(
            InverseStack(scattered(actuator), load)),
    }


def conclude(runs: list[Run]) -> str:
    """Say what the runs show."""
    gain, inverse, off = runs
    return (f'The inverse model removes {removed(gain, inverse):.2%} of the error that a constant '
            f'gain leaves, without any sensor; with every parameter off by its uncertainty it '
            f'still removes {removed(gain, off):.0%}.')


def main() -> int:
    """Run the example."""
    return perform('feed_forward', __doc__, 'voltage', controllers, conclude)


if __name__ == '__main__':
    sys.exit(main())
