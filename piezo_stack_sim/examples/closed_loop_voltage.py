# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""PI control of the displacement by voltage: the controller works against hysteresis."""

from __future__ import annotations

import sys

from piezo_stack_sim.examples.experiment import Controller, perform
from piezo_stack_sim.examples.pi_control import constant_gain, ProportionalIntegral
from piezo_stack_sim.examples.tracking import HEIGHT, removed, Run
from piezo_stack_sim.plant.inverse import InverseStack
from piezo_stack_sim.plant.parameters import Device


def controllers(device: Device, delay: int) -> dict[str, Controller]:
    """Return a constant gain that is right at the peak of the reference, and PI."""
    gain = HEIGHT / InverseStack(device.actuator, device.load).voltage(HEIGHT)  # m/V
    return {'constant gain': constant_gain(gain),
            'PI by voltage': ProportionalIntegral(gain, delay, device.actuator.voltage_range)}


def conclude(runs: list[Run]) -> str:
    """Say what the runs show."""
    gain, pi = runs
    return (f'By voltage the stack is hysteretic: its loop is {gain.loop_width:.0%} of the stroke '
            f'wide. PI removes {removed(gain, pi):.0%} of the error.')


def main() -> int:
    """Run the example."""
    return perform('closed_loop_voltage', __doc__, 'voltage', controllers, conclude)


if __name__ == '__main__':
    sys.exit(main())
