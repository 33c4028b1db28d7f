# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""The parameters of a device: one table, one file format, frozen data."""

from piezo_stack_sim.plant.parameters.device import Actuator, Device, Load, Noise
from piezo_stack_sim.plant.parameters.file import load_device, save_device
from piezo_stack_sim.plant.parameters.table import parameter_specs, ParameterSpec
from piezo_stack_sim.plant.parameters.validation import device_from_mapping

__all__ = [
    'Actuator',
    'Device',
    'Load',
    'Noise',
    'ParameterSpec',
    'device_from_mapping',
    'load_device',
    'parameter_specs',
    'save_device',
]
