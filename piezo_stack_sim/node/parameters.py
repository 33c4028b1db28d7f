# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""The parameters of a device as ROS parameters: declared, described, checked, changed."""

from __future__ import annotations

import math
from typing import Any

from piezo_stack_sim.errors import InputError
from piezo_stack_sim.plant.parameters import (
    Device, device_from_mapping, load_device, parameter_specs, ParameterSpec)
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter

_TYPES = {
    'double': Parameter.Type.DOUBLE, 'doubles': Parameter.Type.DOUBLE_ARRAY,
    'integer': Parameter.Type.INTEGER, 'boolean': Parameter.Type.BOOL,
    'string': Parameter.Type.STRING,
}


def descriptor(spec: ParameterSpec) -> ParameterDescriptor:
    """Return the descriptor of a row of the parameter table: unit, range, read-only or not."""
    unit = f', {spec.unit}' if spec.unit else ''
    result = ParameterDescriptor(
        name=spec.name, type=_TYPES[spec.kind].value, description=f'{spec.description}{unit}',
        additional_constraints=f'expected {spec.expected}', read_only=spec.read_only)
    if math.isfinite(spec.lower) and math.isfinite(spec.upper):
        if spec.kind == 'double':
            # One interval has to hold the special values too; the checks are the stricter ones.
            special = [v for v in (0.0 if spec.zero else None, spec.default)
                       if isinstance(v, float)]
            result.floating_point_range = [FloatingPointRange(
                from_value=min([spec.lower, *special]), to_value=max([spec.upper, *special]))]
        elif spec.kind == 'integer':
            result.integer_range = [
                IntegerRange(from_value=int(spec.lower), to_value=int(spec.upper), step=1)]
    return result


def flat(device: Device) -> dict[str, Any]:
    """Return every parameter of a device by its dotted name; absent effects as neutral."""
    mapping = device.to_mapping()
    values = {}
    for name, spec in parameter_specs().items():
        value: Any = mapping
        for step in name.split('.'):
            value = value.get(step) if isinstance(value, dict) else None
        values[name] = spec.default if value is None else value
    return values


class DeviceParameters:
    """
    The parameters of one node.

    Parameters
    ----------
    node : rclpy.node.Node
        The node; its overrides (files, ``-p``) are read.
    files : list of str
        Parameter files that the node was started with, for error messages.
    bare_files : bool
        Whether nothing besides the files set a parameter.

    Raises
    ------
    InputError
        A key is unknown, a value is wrong, or something is missing.

    """

    def __init__(self, node: Node, files: list[str], bare_files: bool) -> None:
        self._node = node
        # rclpy has no public way to see which overrides nobody has declared.
        self._overrides = {
            name: parameter.value for name, parameter in node._parameter_overrides.items()}
        self.device = self._read(files, bare_files)
        for name, value in flat(self.device).items():
            spec = parameter_specs()[name]
            value = list(value) if spec.kind == 'doubles' else value
            # The value is checked already and has its type, 1 for 1.0 included.
            node.declare_parameter(name, value, descriptor(spec), ignore_override=True)

    def _read(self, files: list[str], bare_files: bool) -> Device:
        given = {name: value for name, value in self._overrides.items()
                 if not name.startswith('qos_overrides.')}
        if len(files) == 1:
            # The file alone knows its line numbers. What else was given may mend it.
            try:
                device = load_device(files[0], node=self._node.get_fully_qualified_name())
            except InputError:
                if bare_files:
                    raise
            else:
                if bare_files:
                    return device
        if not any(name.startswith('actuator.') for name in given):
            self._node.get_logger().info('no actuator given: the NEC/TOKIN AE0505D16 of the paper')
            given = {**_named(Device.nominal()), **given}
        return device_from_mapping(given, source=', '.join(files) or 'parameters')

    def check_all_used(self) -> None:
        """
        Refuse overrides that nothing has declared: QoS of a misspelt topic, for one.

        Call it when every publisher and subscription exists.
        """
        for name, value in self._overrides.items():
            if not self._node.has_parameter(name):
                known = self._node.list_parameters(['qos_overrides'], 0).names
                raise InputError(f'parameters: {name} = {value}: expected a known parameter'
                                 f'{_did_you_mean(name, known)}')

    def changed(self, parameters: list[Parameter]) -> Device:
        """
        Return the device with some parameters changed.

        Raises
        ------
        InputError
            If the new values are not those of a device.

        """
        values = {p.name: p.value for p in parameters if p.name in parameter_specs()}
        return device_from_mapping({**_named(self.device), **values}, source='parameters')


def _named(device: Device) -> dict[str, Any]:
    """Return the parameters of a device, those of absent effects left out."""
    return {name: value for name, value in flat(device).items()
            if not name.startswith('effects.') or name.split('.')[1] in device.effects}


def _did_you_mean(name: str, known: list[str]) -> str:
    from difflib import get_close_matches
    close = get_close_matches(name, known, n=1, cutoff=0.6)
    return f'; did you mean {close[0]}?' if close else '; remove it'
