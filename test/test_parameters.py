# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""The parameter file: what is accepted, what is refused, and in which words."""

import dataclasses
import math
import os
import pickle

from piezo_stack_sim.errors import InputError
from piezo_stack_sim.plant import Plant
from piezo_stack_sim.plant.parameters import (
    Actuator, Device, device_from_mapping, load_device, Noise, parameter_specs, save_device)
from piezo_stack_sim.plant.parameters.validation import check_value
from piezo_stack_sim.resources import config_file, config_folder
import pytest

TABLE = config_file('ae0505d16.yaml').read_text(encoding='utf-8')


@pytest.fixture
def changed(tmp_path):
    """Return a function that loads the nominal file with one text replaced by another."""
    def load(old, new):
        assert old in TABLE
        path = tmp_path / 'device.yaml'
        path.write_text(TABLE.replace(old, new, 1), encoding='utf-8')
        return load_device(path)
    return load


def refusal(load, *arguments, **named):
    """Return the message of the InputError that a call raises."""
    with pytest.raises(InputError) as caught:
        load(*arguments, **named)
    message = str(caught.value)
    assert '\n' not in message
    return message


def test_the_nominal_device_has_the_tables_of_the_paper():
    a = Device.nominal().actuator
    assert (a.mass, a.stiffness, a.damping) == (0.00375, 6e6, 150.0)
    assert (a.linear_capacitance, a.transformer_ratio) == (1.2e-6, 10.0)
    assert sum(a.maxwell_stiffness) == pytest.approx(4.0e6)
    assert sum(a.maxwell_break_voltage[:9]) == pytest.approx(16.0)
    charges = [0.1, 0.5, 1, 10, 15, 20, 30, 40, 70, 160]
    assert [1e6 * q for q in a.break_charges] == pytest.approx(charges)


def test_the_full_range_file_differs_in_nothing_but_the_last_element():
    printed = Device.nominal().actuator
    full = load_device(config_file('ae0505d16_full_range.yaml')).actuator
    assert full.maxwell_break_voltage[-1] == math.inf
    volts = (*full.maxwell_break_voltage[:-1], 80.0)
    assert full.replace(maxwell_break_voltage=volts) == printed


@pytest.mark.parametrize('path', sorted(config_folder().glob('*.yaml')), ids=lambda p: p.name)
def test_every_supplied_file_survives_saving_and_loading(path, tmp_path):
    device = load_device(path)
    save_device(device, tmp_path / 'again.yaml', comment='two\nlines')
    assert load_device(tmp_path / 'again.yaml') == device


def test_values_survive_saving_to_the_last_bit(tmp_path):
    device = Device.nominal().replace(
        actuator={'mass': 0.1 + 0.2, 'damping': 1e2 / 3}, noise={'displacement': 1e-9 / 7},
        drive='charge', rate=12345.678901234567)
    save_device(device, tmp_path / 'device.yaml')
    assert load_device(tmp_path / 'device.yaml') == device


def test_a_failed_save_leaves_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / 'device.yaml'
    save_device(Device.nominal(), path)
    before = path.read_bytes()

    def broken(*_):
        raise OSError(28, 'No space left on device')

    monkeypatch.setattr(os, 'replace', broken)
    message = refusal(save_device, Device.nominal().replace(rate=50.0), path)
    assert 'No space left' in message
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ['device.yaml']


@pytest.mark.parametrize('old, new, words', [
    # a unit slip
    ('1.2e-6', '1.2', ['linear_capacitance = 1.2', 'F', 'uF', 'write 1.2e-06']),
    ('1.2e-6', '1.2 uF', ['linear_capacitance', 'write 1.2e-06']),
    ('1.2e-6', '1200.0', ['linear_capacitance', 'nF']),
    ('rate: 1000.0', 'rate: 1.0', ['rate = 1.0', 'Hz', 'kHz', 'write 1000']),
    ('rate: 1000.0', 'rate: 1 kHz', ['rate = 1 kHz', 'write 1000']),
    ('mass: 0.00375', 'mass: 3.75', ['mass', 'kg', 'write 0.00375']),
    ('stiffness: 6.0e+6', 'stiffness: 6.0', ['stiffness', 'N/um', 'write 6e+06']),
    ('stiffness: 6.0e+6', 'stiffness: 6.0e+9', ['stiffness', 'N/m']),
    ('[2.0e+6, 0.6e+6', '[2.0, 0.6', ['maxwell_stiffness[0] = 2.0', 'write 2e+06']),
    ('[0.0, 150.0]', '[0.0, 0.15]', ['voltage_range', 'kV', 'write [0.0, 150.0]']),
    ('ratio: 10.0', 'ratio: 10000.0', ['transformer_ratio', 'write 10']),
    ('damping: 150.0', 'damping: 150000.0', ['damping', 'N s/m']),
    ('uncertainty: 0.02', 'uncertainty: 2', ['uncertainty', '%', 'write 0.02']),
    ('rate: 1000.0', 'noise: {displacement: 0.5}', ['noise.displacement', 'nm', 'write 5e-10']),
    ('rate: 1000.0', 'command_timeout: 100', ['command_timeout', 'ms', 'write 0.1']),
    # a wrong value
    ('mass: 0.00375', 'mass: -0.00375', ['mass = -0.00375', 'negative']),
    ('mass: 0.00375', 'mass: .nan', ['mass = nan', 'finite']),
    ('mass: 0.00375', 'mass: .inf', ['mass = inf', 'finite']),
    ('mass: 0.00375', 'mass: 1' + 400 * '0', ['mass', 'finite']),
    ('mass: 0.00375', 'mass: true', ['mass = True', 'a number']),
    ('mass: 0.00375', 'mass:', ['mass', 'empty']),
    ('mass: 0.00375', 'mass: [1.0]', ['mass = [1.0]', 'a number']),
    ('mass: 0.00375', 'mass: 2020-01-01', ['mass', 'a number']),
    ('drive: voltage', 'drive: volage', ['drive = volage', 'did you mean voltage?']),
    ('drive: voltage', 'drive: off', ['drive = False', 'voltage, charge, open, shorted']),
    ('model: NEC/TOKIN AE0505D16', 'model: 505', ['model = 505', 'quotes']),
    ('rate: 1000.0', 'load: {clamped: 1}', ['load.clamped = 1', 'true or false']),
    ('rate: 1000.0', 'noise: {seed: 1.5}', ['noise.seed = 1.5', 'whole']),
    # a wrong list
    ('[0.2, 0.3, 0.3', '[0.2, 0.3', ['maxwell_break_voltage', '10 values', 'has 9']),
    ('[0.2, 0.3, 0.3', '[0.2, 0.03, 0.3', ['maxwell_break_voltage[1] = 0.03', 'increase']),
    ('[0.2, 0.3, 0.3', '[.inf, 0.3, 0.3', ['maxwell_break_voltage[0]', 'last']),
    ('80.0]', 'inf]', ['maxwell_break_voltage[9] = inf', 'write .inf']),
    ('80.0]', '.nan]', ['maxwell_break_voltage[9] = nan', 'finite']),
    ('[0.0, 150.0]', '[150.0, 0.0]', ['voltage_range', 'write [0, 150]']),
    ('[0.0, 150.0]', '[0.0]', ['voltage_range', '2 numbers', 'has 1']),
    ('[0.0, 150.0]', '150.0', ['voltage_range = 150.0', '[ ]']),
    ('[0.0, 150.0]', '[]', ['voltage_range', 'empty']),
    # a wrong key
    ('mass:', 'mas:', ['actuator.mas = 0.00375', 'did you mean actuator.mass?']),
    ('actuator:', 'actuater:', ['actuater.model', 'did you mean actuator.model?']),
    ('rate:', 'Rate:', ['Rate = 1000.0', 'did you mean rate?']),
    ('rate: 1000.0', 'mass: 0.003', ['mass = 0.003', 'did you mean actuator.mass?']),
    ('rate: 1000.0', 'color: red', ['color = red', 'remove it']),
    ('mass: 0.00375', 'damping: 1.0', ['damping', 'once', 'line 12']),
    ('rate: 1000.0', 'actuator.mass: 0.003', ['actuator.mass', 'once', 'line 12']),
    ('rate: 1000.0', 'load: 3', ['load = 3', 'expected keys']),
    ('rate: 1000.0', 'effects:', ['effects = None', 'expected keys']),
    ('rate: 1000.0', 'effects: {nothing_of_the_kind: {a: 1.0}}', ['effects.nothing_of_the_kind']),
    ('rate: 1000.0', '1: 3', ['1', 'word']),
    ('ros__parameters', 'ros_parameters', ['did you mean ros__parameters?']),
    ('/**:\n', '/**:\n  x: 1\n', ['x = 1', 'ros__parameters']),
    # not YAML, or more than YAML
    ('rate: 1000.0', 'rate: [', ['expected YAML']),
    ('rate: 1000.0', 'rate: &one 1.0\n    command_timeout: *one', ['aliases']),
    ('mass: 0.00375', 'mass: !!python/object/apply:os.system [ls]', ['expected YAML', 'tag']),
])
def test_a_wrong_file_names_key_value_expectation_and_mend(changed, tmp_path, old, new, words):
    message = refusal(changed, old, new)
    assert message.startswith(str(tmp_path / 'device.yaml') + ':')
    for word in words:
        assert word in message


def test_an_error_names_the_line(changed, tmp_path):
    line = next(i for i, text in enumerate(TABLE.splitlines(), 1) if 'mass:' in text)
    message = refusal(changed, 'mass: 0.00375', 'mass: -1.0')
    assert message.startswith(f'{tmp_path / "device.yaml"}:{line}: ')


@pytest.mark.parametrize('rails', [{'lower': 50.0, 'upper': 20.0}, {'lower': 20.0, 'upper': 20.0}])
def test_rails_that_leave_no_room_are_named(rails):
    given = Device.nominal().to_mapping()
    given['effects'] = {'amplifier_saturation': rails}
    with pytest.raises(InputError, match='amplifier_saturation.lower.*expected less than upper'):
        device_from_mapping(given)


def test_a_strain_of_an_element_that_there_is_not_is_named():
    few = Device.nominal().to_mapping()
    for name in ('maxwell_stiffness', 'maxwell_break_voltage'):
        few['actuator'][name] = few['actuator'][name][-3:]
    few['effects'] = {'initial_polarisation': {'strain_3': 0.1, 'strain_9': 0.0}}
    assert device_from_mapping(few).effects
    few['effects'] = {'initial_polarisation': {'strain_3': 0.1, 'strain_9': 0.5}}
    with pytest.raises(InputError, match=r'strain_9 = 0.5: expected 0, for there are 3 elements'):
        device_from_mapping(few)


@pytest.mark.parametrize('name', [n for n, spec in parameter_specs().items() if spec.required])
def test_a_missing_key_is_named(name):
    mapping = Device.nominal().to_mapping()
    section, key = name.split('.')
    del mapping[section][key]
    assert f'{name} is missing' in refusal(device_from_mapping, mapping)


@pytest.mark.parametrize('text', [
    '', '\n', 'time,voltage\n0.0,1.0\n', '[1, 2]', '- a\n- b', 'just text', 5000 * '[', 500 * '{',
    '\x00\x01', '%YAML 9.9\n---\na: 1', 'a: 1\n---\nb: 2', '!!python/object/apply:os.system [ls]',
    '? [a, b]\n: 1', ': : :', '"', '/**: {ros__parameters: }', '/**: {ros__parameters: 3}',
    '/**: {ros__parameters: {}}', 'actuator: {mass: 1.0}', '/**:\n\tros__parameters: {}',
])
def test_what_is_no_parameter_file_is_refused_in_one_line(tmp_path, text):
    path = tmp_path / 'device.yaml'
    path.write_text(text, encoding='utf-8')
    assert refusal(load_device, path).startswith(str(path))


def test_files_that_cannot_be_read_are_refused_in_one_line(tmp_path):
    binary = tmp_path / 'binary.yaml'
    binary.write_bytes(bytes(range(256)))
    large = tmp_path / 'large.yaml'
    large.write_bytes(b'#' * 2_000_000)
    assert 'no such file' in refusal(load_device, tmp_path / 'nothing.yaml')
    assert 'folder' in refusal(load_device, tmp_path)
    assert 'UTF-8' in refusal(load_device, binary)
    assert '1 MB' in refusal(load_device, large)
    assert 'cannot be read' in refusal(load_device, 'a\0b')


def test_numbers_may_be_written_as_people_write_them(changed):
    assert changed('stiffness: 6.0e+6', 'stiffness: 6e6').actuator.stiffness == 6e6
    assert changed('rate: 1000.0', 'rate: 1000').rate == 1000.0
    assert changed('damping: 150.0', 'damping: 0').actuator.damping == 0.0


def test_parameters_that_every_ros_node_has_are_left_alone(changed):
    overrides = 'qos_overrides: {/clock: {publisher: {depth: 5}}}'
    changed('rate: 1000.0', 'use_sim_time: true')
    changed('rate: 1000.0', overrides)


@pytest.mark.parametrize('name', ['/**', 'piezo_stack', '/left/piezo_stack', '/*/piezo_stack'])
def test_any_node_name_heads_a_file(changed, name):
    assert changed('/**', name) == Device.nominal()


def test_of_a_file_for_several_nodes_the_asked_one_is_taken(tmp_path):
    path = tmp_path / 'two.yaml'
    path.write_text(
        TABLE + '/left/piezo_stack:\n  ros__parameters: {rate: 500.0}\n'
        'right:\n  piezo_stack:\n    ros__parameters: {rate: 250.0}\n', encoding='utf-8')
    assert load_device(path, node='/left/piezo_stack').rate == 500.0
    assert load_device(path, node='/right/piezo_stack').rate == 250.0
    assert load_device(path, node='/other/piezo_stack').rate == 1000.0
    assert '/left/piezo_stack, /right/piezo_stack' in refusal(load_device, path)


def test_flat_names_as_ros_has_them_give_the_same_device():
    nominal = Device.nominal()
    flat = {}
    for section, values in nominal.to_mapping().items():
        if isinstance(values, dict):
            flat.update({f'{section}.{key}': value for key, value in values.items()})
        else:
            flat[section] = values
    assert device_from_mapping(flat) == nominal


def test_the_table_and_the_dataclasses_name_the_same_parameters():
    names = set()
    for key, value in Device.nominal().to_mapping().items():
        below = isinstance(value, dict)
        names |= {f'{key}.{field}' for field in value} if below else {key}
    assert names == {n for n in parameter_specs() if not n.startswith('effects.')}


@pytest.mark.parametrize('spec', parameter_specs().values(), ids=lambda spec: spec.name)
def test_every_row_of_the_table_is_documented_and_consistent(spec):
    assert spec.description
    assert spec.lower <= spec.upper
    assert spec.kind in ('double', 'doubles', 'integer', 'boolean', 'string')
    if not spec.required:
        assert check_value(spec, spec.default) == spec.default


def test_a_device_is_frozen_picklable_and_comparable():
    device = Device.nominal().replace(noise=Noise(seed=3))
    with pytest.raises(dataclasses.FrozenInstanceError):
        device.rate = 3.0
    assert pickle.loads(pickle.dumps(device)) == device
    assert hash(device) == hash(device.with_effects({}))
    assert isinstance(device.actuator, Actuator)


def test_with_effects_leaves_the_original_alone():
    device = Device.nominal()
    other = device.with_effects({'creep': {'gain_per_decade': 0.01}})
    assert device.effects == {}
    assert other.effects == {'creep': {'gain_per_decade': 0.01}}


def test_rounding_takes_off_what_nobody_measures_and_no_more():
    printed = Device.nominal().with_effects({'amplifier_saturation': {'upper': math.inf}})
    stack, load = printed.actuator, printed.load
    noisy = printed.replace(
        actuator={'mass': stack.mass * (1 + 3e-14), 'maxwell_break_voltage': tuple(
            volt * (1 - 2e-13) for volt in stack.maxwell_break_voltage)},
        load={'stiffness': load.stiffness + 1e5 * (1 + 4e-12)})
    rounded = noisy.rounded()
    assert rounded == printed.replace(load={'stiffness': load.stiffness + 1e5})
    other = printed.replace(actuator={'mass': stack.mass * (1 + 1e-8)})
    assert other.rounded() != printed


def test_a_bow_that_lets_the_voltage_fall_as_the_charge_grows_is_refused():
    soft = {'quadratic': -0.06, 'cubic': -0.06}
    Plant(Device.nominal().with_effects({'asymmetric_hysteresis': soft}))
    # Nor may a fit go where no file may.
    with pytest.raises(InputError, match='larger quadratic or cubic'):
        Plant(Device.nominal().with_effects({'asymmetric_hysteresis': {**soft, 'cubic': -0.1}}))
    given = Device.nominal().to_mapping()
    given['effects'] = {'asymmetric_hysteresis': {**soft, 'cubic': -0.1}}
    with pytest.raises(InputError, match='cubic = -0.1: expected at least -0.06 beside a quad'):
        device_from_mapping(given)


def test_a_parameter_that_an_effect_lacks_is_looked_for_among_its_own():
    its_own = 'effects.creep has gain_per_decade, onset, power, reference_time'
    for wrong, mend in (('amplitud', its_own),
                        ('reference', 'did you mean effects.creep.reference_time?')):
        with pytest.raises(InputError, match=mend):
            device_from_mapping({'effects': {'creep': {wrong: 0.1}}})
