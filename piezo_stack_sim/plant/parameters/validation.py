# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""From any mapping of parameters to a checked device, with a mend for whatever is wrong."""

from collections.abc import Mapping
from dataclasses import fields
from difflib import get_close_matches
import math
import numbers
import re

from piezo_stack_sim.effects.asymmetric_hysteresis import is_too_soft, SOFTEST
from piezo_stack_sim.errors import InputError
from piezo_stack_sim.plant.parameters.device import Actuator, Device, Load, Noise
from piezo_stack_sim.plant.parameters.plausibility import implausible
from piezo_stack_sim.plant.parameters.table import parameter_specs

# Every ROS node has these; a parameter file may set them and they say nothing of the device.
_ROS_OWN = re.compile(r'use_sim_time$|start_type_description_service$|qos_overrides(\.|$)')


def device_from_mapping(mapping, source='parameters', lines=None):
    """
    Check parameters and return the device that they describe.

    Parameters
    ----------
    mapping : mapping
        Sections and keys as in a parameter file: nested, or flat with dotted names as ROS has
        them, or both.
    source : str
        What an error message names as the origin.
    lines : dict of str to int, optional
        Line of each dotted name in the source, for error messages.

    Returns
    -------
    Device

    Raises
    ------
    InputError
        One line with the key, the value, what was expected and how to mend it.

    """
    report = _Report(source, lines or {})
    specs = parameter_specs()
    sections = _sections(specs)
    given, named = {}, set()
    for name, value in _flat(mapping, '', report):
        if _ROS_OWN.match(name):
            continue
        if name in sections:
            if not isinstance(value, Mapping):
                report.fail(name, value, 'expected keys with values',
                            'indent "key: value" lines under it')
            named.add(name)
        elif name not in specs:
            report.unknown(name, value, [*specs, *sections])
        elif name in given:
            report.fail(name, value, 'expected once', 'it is given twice; keep one')
        else:
            given[name] = check_value(specs[name], value, report)
    values = {}
    for name, spec in specs.items():
        if name in given:
            values[name] = given[name]
        elif spec.required:
            report.missing(spec)
        elif not name.startswith('effects.'):
            values[name] = spec.default
    effects = {name.removeprefix('effects.'): {} for name in named if name.count('.') == 1}
    for name, value in given.items():
        if name.startswith('effects.'):
            _, effect, parameter = name.split('.')
            effects.setdefault(effect, {})[parameter] = value
    device = _build(values, effects)
    _check_elements(device.actuator, report)
    _check_strains(device, report)
    _check_rails(device, report)
    _check_bow(device, report)
    trouble = implausible(device.actuator)
    if trouble:
        report.fail(*trouble)
    return device


def check_value(spec, value, report=None):
    """
    Return the value of one parameter in its proper type.

    Parameters
    ----------
    spec : ParameterSpec
        Its row of the table.
    value : object
        As read from YAML or from ROS.
    report : object, optional
        Where errors go; by default an InputError that names the parameter.

    Returns
    -------
    float, int, bool, str or tuple of float

    Raises
    ------
    InputError
        The value is of the wrong type, not finite, or outside its bounds.

    """
    report = report or _Report('parameters', {})
    if spec.kind == 'string':
        if not isinstance(value, str):
            report.fail(spec.name, value, f'expected {spec.expected}', 'put it in quotes'
                        if not spec.choices else _spelling(str(value), spec.choices))
        if spec.choices and value not in spec.choices:
            report.fail(spec.name, value, f'expected {spec.expected}',
                        _spelling(value, spec.choices))
        return value
    if spec.kind == 'boolean':
        if not isinstance(value, bool):
            report.fail(spec.name, value, f'expected {spec.expected}', 'write true or false')
        return value
    if spec.kind == 'doubles':
        return _check_list(spec, value, report)
    number = _check_number(spec, value, report, spec.name)
    if spec.kind == 'integer':
        if not number.is_integer():
            report.fail(spec.name, value, f'expected {spec.expected}', 'leave out the fraction')
        return int(number)
    return number


def _check_list(spec, values, report):
    if isinstance(values, (str, bytes, Mapping)) or not hasattr(values, '__iter__'):
        report.fail(spec.name, values, f'expected {spec.expected}', 'write it in [ ]')
    values = list(values)
    if not values:
        report.fail(spec.name, values, f'expected {spec.expected}', 'it is empty; fill it')
    if spec.length is not None and len(values) != spec.length:
        report.fail(spec.name, values, f'expected {spec.expected}', f'it has {len(values)}')
    return tuple(
        _check_number(spec, value, report, f'{spec.name}[{i}]',
                      infinite=spec.infinite_last and i == len(values) - 1)
        for i, value in enumerate(values)
    )


def _check_number(spec, value, report, name, infinite=False):
    expected = f'expected {spec.expected}'
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        report.fail(name, value, expected, _mend_type(spec, value))
    try:
        number = float(value)
    except OverflowError:
        number = math.inf if value > 0 else -math.inf
        infinite = False
    if infinite and number == math.inf or number == spec.default:
        return number  # the neutral value of an effect may lie outside what the effect can be
    if not math.isfinite(number):
        where = '; only the last element may be .inf' if spec.infinite_last else ''
        report.fail(name, value, expected, f'write a finite number{where}')
    if spec.zero and number == 0.0:
        return number
    if not spec.lower <= number <= spec.upper:
        report.fail(name, value, expected, _mend_size(spec, number))
    return number


def _mend_type(spec, value):
    """Say how to write a number that was not one, '1.2 uF' and the like included."""
    if value is None:
        return 'it is empty; give a value'
    text = str(value).strip()
    written = re.match(r'([-+]?[\d.]+(?:[eE][-+]?\d+)?)\s*(.*)$', text)
    if written:
        unit = written.group(2).replace('\u00b5', 'u').replace('\u03bc', 'u')
        sizes = {'': 1.0, spec.unit: 1.0, **dict(spec.slips)}
        try:
            number = float(written.group(1))
        except ValueError:
            return 'write a plain number'
        if unit in sizes:
            return f'write {number * sizes[unit]:.6g} without unit or quotes'
        return f'write a plain number in {spec.unit or "SI units"}'
    if text.lower() in ('inf', '+inf', 'infinity'):
        return 'write .inf'
    return 'write a plain number'


def _mend_size(spec, number):
    if spec.lower >= 0.0 > number:
        return 'it must not be negative'
    fitting = [(unit, number * size) for unit, size in spec.slips
               if spec.lower <= number * size <= spec.upper]
    if fitting:
        unit, mended = fitting[0]
        if spec.lower > 0.0:  # the likeliest puts the value into the middle of its range
            middle = math.sqrt(spec.lower * spec.upper)
            unit, mended = min(fitting, key=lambda pair: abs(math.log(pair[1] / middle)))
        return f'it looks like {unit}; write {mended:.6g}'
    return f'is it in {spec.unit}?' if spec.unit else 'mend the value'


def _check_elements(actuator, report):
    """Check what only several values together can violate."""
    stiffness, volts = actuator.maxwell_stiffness, actuator.maxwell_break_voltage
    if len(stiffness) != len(volts):
        report.fail(
            'actuator.maxwell_break_voltage', volts,
            f'expected {len(stiffness)} values, one for each of actuator.maxwell_stiffness',
            f'it has {len(volts)}')
    # From a relaxed state the elements yield in order of V_i/k_i, and the kernel counts on it.
    charges = actuator.break_charges
    for i in range(1, len(charges)):
        if not charges[i] > charges[i - 1]:
            report.fail(
                f'actuator.maxwell_break_voltage[{i}]', volts[i],
                'expected break charges V_i/k_i that increase',
                f'this one is {charges[i]:.6g} C after {charges[i - 1]:.6g} C; '
                'order the elements by V_i/k_i')
    low, high = actuator.voltage_range
    if not low < high:
        report.fail('actuator.voltage_range', actuator.voltage_range,
                    'expected the lowest voltage first', f'write [{high:g}, {low:g}]')


def _check_strains(device, report):
    """Check that no element is said to be strained that there is not."""
    elements = len(device.actuator.maxwell_stiffness)
    for name, value in device.effects.get('initial_polarisation', {}).items():
        number = name.removeprefix('strain_')
        if value and number.isdigit() and int(number) > elements:
            report.fail(f'effects.initial_polarisation.{name}', value,
                        f'expected 0, for there are {elements} elements', 'remove it')


def _check_rails(device, report):
    """Check that the rails of a driver leave room between them."""
    rails = device.effects.get('amplifier_saturation', {})
    lower, upper = rails.get('lower', -math.inf), rails.get('upper', math.inf)
    if not lower < upper:
        report.fail('effects.amplifier_saturation.lower', lower,
                    f'expected less than upper, {upper:g} V', 'give the lower rail first')


def _check_bow(device, report):
    """Check that more charge takes more voltage, up to the end of the first rise at least."""
    bow = device.effects.get('asymmetric_hysteresis', {})
    quadratic, cubic = bow.get('quadratic', 0.0), bow.get('cubic', 0.0)
    if is_too_soft(quadratic, cubic):
        least = (SOFTEST - 2.0 * quadratic) / 3.0
        report.fail('effects.asymmetric_hysteresis.cubic', cubic,
                    f'expected at least {least:.3g} beside a quadratic of {quadratic:g}',
                    'else the voltage falls as the charge grows')


def _build(values, effects):
    def section(kind, name):
        return kind(**{
            f.name: values[f'{name}.{f.name}']
            for f in fields(kind) if f'{name}.{f.name}' in values})

    return Device(
        actuator=section(Actuator, 'actuator'),
        load=section(Load, 'load'),
        effects=effects,
        noise=section(Noise, 'noise'),
        **{name: value for name, value in values.items() if '.' not in name},
    )


def _flat(mapping, prefix, report):
    """Yield (dotted name, value), and (dotted name, {}) for a section without keys."""
    if not isinstance(mapping, Mapping):
        report.fail(prefix or 'parameters', mapping, 'expected keys with values',
                    'give a mapping')
    for key, value in mapping.items():
        if not isinstance(key, str):
            report.fail(f'{prefix}{key}', value, 'expected a word as key', 'rename it')
        if isinstance(value, Mapping) and value:
            yield from _flat(value, f'{prefix}{key}.', report)
        else:
            yield prefix + key, value


def _sections(specs):
    """Return the names that stand above others, the effects' own ones among them."""
    return {'effects', *(name.rpartition('.')[0] for name in specs)} - {''}


def _spelling(word, words):
    close = get_close_matches(word.lower(), list(words), n=1, cutoff=0.5)
    return f'did you mean {close[0]}?' if close else 'choose one of them'


class _Report:
    """Words an error as one line: file, key, value, expected, mend."""

    def __init__(self, source, lines):
        self.source = source
        self.lines = lines

    def _where(self, name):
        name = re.sub(r'\[\d+\]$', '', name)
        line = self.lines.get(name)
        return f'{self.source}:{line}' if line else str(self.source)

    def fail(self, name, value, expected, mend):
        """Raise the error of one value."""
        raise InputError(f'{self._where(name)}: {name} = {shown(value)}: {expected}; {mend}')

    def missing(self, spec):
        """Raise the error of a key that is not there."""
        raise InputError(
            f'{self.source}: {spec.name} is missing: expected {spec.expected}; '
            f'add it ({spec.description})')

    def unknown(self, name, value, known: list):
        """Raise the error of a key that nobody knows, with the nearest one that exists."""
        section, _, key = name.rpartition('.')
        siblings = {k.rpartition('.')[2]: k for k in known if k.rpartition('.')[0] == section}
        anywhere = {k.rpartition('.')[2]: k for k in reversed(known)}
        close = [siblings[k] for k in get_close_matches(key, siblings, n=1, cutoff=0.6)]
        own = section.startswith('effects.') and sorted(siblings)
        if not own:  # what another effect has is no help
            close = close or get_close_matches(name, known, n=1, cutoff=0.8)
            close = close or [anywhere[k] for k in get_close_matches(key, anywhere, cutoff=0.8)]
        mend = (f'did you mean {close[0]}?' if close else
                f'{section} has {", ".join(own)}' if own else 'remove it')
        raise InputError(f'{self._where(name)}: {name} = {shown(value)}: '
                         f'expected a known parameter; {mend}')


def shown(value, limit=60):
    """Return a value as text that is short, printable and on one line."""
    if isinstance(value, Mapping):
        value = dict(value)
    elif isinstance(value, tuple):
        value = list(value)
    text = value if isinstance(value, str) else repr(value)
    text = ''.join(c if c.isprintable() else '?' for c in text)
    return text if len(text) <= limit else text[:limit - 3] + '...'
