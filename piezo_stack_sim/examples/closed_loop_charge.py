# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""PI control of the displacement by charge: the controller sees a linear stack."""

from __future__ import annotations

import sys

from piezo_stack_sim.examples.experiment import Controller, perform
from piezo_stack_sim.examples.pi_control import constant_gain, ProportionalIntegral
from piezo_stack_sim.examples.tracking import HEIGHT, Run
from piezo_stack_sim.plant.inverse import InverseStack
from piezo_stack_sim.plant.parameters import Device


def controllers(device: Device, delay: int) -> dict[str, Controller]:
    """Return a constant gain, which charge allows, and PI."""
    gain = HEIGHT / InverseStack(device.actuator, device.load).charge(HEIGHT)  # m/C
    limits = (0.0, 1.5 * HEIGHT / gain)  # C
    return {'constant gain': constant_gain(gain),
            'PI by charge': ProportionalIntegral(gain, delay, limits)}


def conclude(runs: list[Run]) -> str:
    """Say what the runs show."""
    gain, pi = runs
    return (f'By charge the stack is linear: its loop is {gain.loop_width:.2%} of the stroke '
            f'wide, and a constant gain alone tracks within {gain.peak_error * 1e9:.1f} nm. '
            f'PI follows within {pi.peak_error * 1e9:.0f} nm, which is its delay.')


def main() -> int:
    """Run the example."""
    return perform('closed_loop_charge', __doc__, 'charge', controllers, conclude)


if __name__ == '__main__':
    sys.exit(main())
