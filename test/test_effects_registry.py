# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Claims about every effect, and about any combination of them."""

from itertools import combinations
import math
from pathlib import Path
import re

from effect_probes import ALL, CHANNELS, device, IDEAL, mixed
import numpy as np
from piezo_stack_sim.effects.base import BLOCKS
from piezo_stack_sim.effects.registry import EFFECTS, find
from piezo_stack_sim.errors import InputError
from piezo_stack_sim.plant import load_device, Plant, save_device, simulate
import pytest

DESIGN = {
    'drive': {'command_delay', 'amplifier_bandwidth', 'amplifier_current_limit',
              'amplifier_gain', 'amplifier_saturation'},
    'electrical': {'creep', 'rate_dependent_hysteresis', 'asymmetric_hysteresis', 'leakage',
                   'initial_polarisation'},
    'transducer': {'transducer_nonlinearity', 'transducer_ratio'},
    'mechanical': {'added_mass', 'series_compliance', 'parallel_stiffness',
                   'stiffness_hardening', 'friction', 'mechanical_resonance', 'contact',
                   'mount_creep'},
    'environment': {'thermal_drift', 'periodic_disturbance'},
    'sensor': {'sensor_lag', 'sensor_delay', 'sensor_gain', 'sensor_nonlinearity',
               'sensor_drift'},
}
LOADED = {'mass': 0.02, 'stiffness': 2e6, 'damping': 20.0}
# Above this an output has moved, below the floor it has not; V, C and m.
MOVED = {'voltage': 1e-3, 'charge': 1e-9, 'displacement': 5e-12}
FLOOR = {'voltage': 1e-9, 'charge': 1e-13, 'displacement': 1e-14}

every_effect = pytest.mark.parametrize('name', EFFECTS)
every_parameter = pytest.mark.parametrize('name, parameter', [
    pytest.param(name, parameter, id=f'{name}.{parameter.name}')
    for name, effect in EFFECTS.items() for parameter in effect.parameters])


def outputs(response):
    """Return all outputs as one array, for comparisons to the bit."""
    return np.array([response.displacement, response.velocity, response.charge,
                     response.voltage, response.force])


def neutral(name):
    """Return the neutral values of an effect."""
    return {p.name: p.neutral for p in EFFECTS[name].parameters}


def test_the_effects_of_the_design_stand_in_their_blocks():
    for block, names in DESIGN.items():
        assert {name for name in names if EFFECTS[name].block == block} == names
    assert set().union(*DESIGN.values()) <= set(EFFECTS)


def test_effects_are_applied_in_the_order_in_which_a_signal_meets_them():
    order = [BLOCKS.index(effect.block) for effect in EFFECTS.values()]
    assert order == sorted(order)


@every_effect
def test_an_effect_is_one_small_file_with_equations_and_source(name):
    effect = EFFECTS[name]
    module = __import__(f'piezo_stack_sim.effects.{name}', fromlist=['EFFECT'])
    text = Path(module.__file__).read_text(encoding='utf-8')
    assert len(text.splitlines()) <= 80
    assert effect.id == name and re.fullmatch('[a-z_]+', name)
    assert 'Source: ' in module.__doc__ and 'Look-alikes: ' in module.__doc__
    assert effect.summary.endswith('.') and '\n' not in effect.summary
    assert effect.channels and set(effect.channels) <= set(CHANNELS)


@every_parameter
def test_a_parameter_says_what_it_is(name, parameter):
    assert parameter.unit and parameter.description and parameter.scale in ('linear', 'log')
    assert parameter.lower < parameter.upper
    assert parameter.lower <= parameter.typical <= parameter.upper
    assert parameter.lower <= parameter.start <= parameter.upper or (
        parameter.start == parameter.neutral and math.isinf(parameter.neutral))
    if parameter.scale == 'log':
        assert parameter.lower > 0.0
    if parameter.magnitude:
        assert parameter.default is None, 'what is not given must be neutral'


@every_effect
def test_typical_values_are_not_neutral_and_empty_ones_are(name):
    effect = EFFECTS[name]
    assert not effect.is_neutral(effect.typical())
    assert effect.is_neutral({}) and effect.is_neutral(neutral(name))


@every_effect
def test_neutral_equals_absent_to_the_bit(name):
    time, voltage, force = mixed(1500)
    absent = simulate(IDEAL, time, voltage, force)
    for values in ({}, neutral(name)):
        present = simulate(IDEAL.with_effects({name: values}), time, voltage, force)
        assert np.array_equal(outputs(absent), outputs(present))


@every_effect
def test_an_effect_moves_its_channels_and_no_others(name):
    time, voltage, force = mixed()
    loaded = IDEAL.replace(load=LOADED)
    without = simulate(loaded, time, voltage, force)
    response = simulate(loaded.with_effects({name: ALL[name]}), time, voltage, force)
    for channel in CHANNELS:
        change = np.abs(getattr(response, channel) - getattr(without, channel)).max()
        if channel in EFFECTS[name].channels:
            assert change > MOVED[channel], channel
        else:
            assert change < FLOOR[channel], channel


@every_effect
@pytest.mark.parametrize('drive', ['voltage', 'charge', 'open', 'shorted'])
def test_streaming_equals_offline_to_the_bit(name, drive):
    time, voltage, force = mixed(300, 1e-4)
    command = 1.4e-6 * voltage if drive == 'charge' else voltage
    target = device(name)
    offline = simulate(target, time, command, force, drive)
    plant = Plant(target, 1e-4, drive)
    chunks = [plant.run(command[a:b], force[a:b])
              for a, b in ((0, 1), (1, 97), (97, 98), (98, 299))]
    streamed = np.concatenate([outputs(chunk) for chunk in chunks], axis=1)
    assert np.array_equal(outputs(offline)[:, 1:], streamed)


def test_everything_at_once_works_streams_and_saves(tmp_path):
    time, voltage, force = mixed(500)
    target = IDEAL.with_effects(ALL)
    offline = simulate(target, time, voltage, force)
    assert np.isfinite(outputs(offline)).all()
    plant = Plant(target, 2e-5)
    for row in range(100):
        sample = plant.advance(voltage[row], force[row])
        assert sample.displacement == offline.displacement[row + 1]
        assert sample.charge == offline.charge[row + 1]
    twin = Plant(target, 2e-5)
    twin.restore(plant.state)
    assert twin.advance(50.0, -5.0) == plant.advance(50.0, -5.0)
    save_device(target, tmp_path / 'all.yaml')
    assert load_device(tmp_path / 'all.yaml').effects == target.effects


@pytest.mark.parametrize('first', EFFECTS)
def test_any_pair_of_effects_is_finite(first):
    time, voltage, force = mixed(60, 2e-4)
    names = list(EFFECTS)
    for a, b in combinations(names, 2):
        if a == first:
            pair = IDEAL.with_effects({a: ALL[a], b: ALL[b]})
            response = simulate(pair, time, voltage, force)
            assert np.isfinite(outputs(response)).all(), (a, b)
            assert np.abs(response.displacement).max() < 40e-6, (a, b)


@every_parameter
def test_bounds_can_be_simulated(name, parameter):
    time, voltage, force = mixed(100, 1e-4)
    for value in (parameter.lower, parameter.upper):
        response = simulate(device(name, **{parameter.name: value}), time, voltage, force)
        assert np.isfinite(outputs(response)).all(), value


@every_parameter
def test_a_change_at_run_time_leaves_the_state_where_it_is(name, parameter):
    if not parameter.runtime:
        pytest.skip('read-only while running')
    plant = Plant(IDEAL.with_effects({name: neutral(name)}), 1e-4)
    rise = np.linspace(0.0, 60.0, 150)
    plant.run(rise, np.full(150, -10.0))
    for target in (device(name), device(name, **{parameter.name: parameter.upper}), IDEAL):
        before, blocks = plant.state.states, np.array(plant.state.blocks)
        plant.set_device(target)
        after = plant.state
        for state, value in before.items():
            assert after.states.get(state, value) == pytest.approx(value, rel=1e-12, abs=1e-15)
        assert np.allclose(after.blocks, blocks, rtol=0, atol=1e-8)
        following = plant.run(np.full(2, 60.0), np.full(2, -10.0))
        assert np.isfinite(outputs(following)).all()


@pytest.mark.parametrize('name', ['sensor_lag', 'amplifier_bandwidth', 'mechanical_resonance',
                                  'mount_creep', 'command_delay', 'sensor_delay', 'leakage'])
def test_an_effect_switched_on_at_rest_begins_at_rest(name):
    plant = Plant(IDEAL, 1e-4)
    plant.run(np.concatenate([np.linspace(0.0, 60.0, 300), np.full(200, 60.0)]))
    before = plant.sample_noisy()['displacement']
    plant.set_device(device(name))
    after = plant.run(np.full(100, 60.0)).displacement
    # The nominal curve of a creeping mount holds 0.1 s after a step, not for ever.
    assert np.abs(after - before).max() < (5e-7 if name == 'mount_creep' else 1e-11)


def test_effects_name_others_that_there_are():
    named = {other for effect in EFFECTS.values() for other in (*effect.form_like, effect.becomes)}
    assert named - {''} <= set(EFFECTS)
    assert 'parallel_stiffness' in named and 'command_delay' in named


def test_a_misspelt_effect_is_named():
    with pytest.raises(InputError, match="did you mean 'creep'"):
        find('crep')
