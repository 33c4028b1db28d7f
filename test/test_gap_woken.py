# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""What mends the form of an effect is free once the effect is believed, and not before."""

from fitters import fitter_of
import numpy as np
from piezo_stack_sim.effects.registry import EFFECTS
from piezo_stack_sim.gap.fitting.candidates import search_singles
from piezo_stack_sim.gap.fitting.fit import free_parameters
from piezo_stack_sim.gap.fitting.woken import has_late, woken
from piezo_stack_sim.plant import Device, Plant
from piezo_stack_sim.recording import programmes
import pytest


@pytest.fixture
def device():
    """Return the stack of the paper."""
    return Device.nominal()


def faded(device, swings, part):
    """Return how strained elements are that have lost unequal parts of what swings left them."""
    names = 'peak_voltage', 'turn_voltage', 'return_voltage'
    strains = Plant(device.with_effects({
        'initial_polarisation': dict(zip(names, swings))})).strains
    lost = np.random.default_rng(11).uniform(0.0, part, strains.size)
    return {f'strain_{i + 1}': float(z) for i, z in enumerate((strains * (1.0 - lost))[:9])}


@pytest.mark.parametrize('name, has', [
    ('initial_polarisation', True), ('mechanical_resonance', True), ('creep', False),
    ('amplifier_current_limit', False)])  # nobody looks for its knee: it is no swing
def test_what_mends_a_form_is_looked_for_where_there_is_a_way_to_it(name, has):
    assert has_late(name) == has


@pytest.mark.parametrize('swings', [
    (18.6, 0.0, 0.0), pytest.param((42.0, -9.0, 25.0), marks=pytest.mark.slow)])
def test_a_history_that_has_faded_is_found_to_the_noise(device, swings):
    # Three swings are not enough for it: they leave many times the noise.
    unit = device.with_effects({'initial_polarisation': faded(device, swings, 0.4)})
    fitter = fitter_of(device, unit, (programmes.triangle(), programmes.steps()),
                       np.random.default_rng(8))
    search = search_singles(fitter, lambda message: None, (
        'initial_polarisation', 'asymmetric_hysteresis', 'stiffness_hardening'))
    swung = search.fits['initial_polarisation']
    assert not any(free.parameter.late for free in swung.free)
    assert swung.cost > 3.0 * fitter.rows.size
    assert woken(fitter, swung).cost < 1.1 * fitter.rows.size


def test_what_three_swings_explain_stays_as_it_was(device):
    unit = device.with_effects({'initial_polarisation': {'peak_voltage': 30.0}})
    fitter = fitter_of(device, unit, (programmes.triangle(),), np.random.default_rng(3))
    swung = fitter.fit({'initial_polarisation': {'peak_voltage': 30.0}})
    assert woken(fitter, swung) is swung


RINGS = {'participation': 0.2, 'frequency': 1830.0, 'damping_ratio': 0.02}


@pytest.mark.parametrize('second', [
    pytest.param({'second_participation': 0.05, 'second_frequency': 2900.0,
                  'second_damping_ratio': 0.03}, marks=pytest.mark.slow),
    pytest.param({'second_participation': -0.03, 'second_frequency': 640.0,
                  'second_damping_ratio': 0.015}, marks=pytest.mark.slow)])
def test_the_second_mode_of_a_structure_is_found_beside_the_first(device, second):
    unit = device.with_effects({'mechanical_resonance': {**RINGS, **second}})
    fitter = fitter_of(device, unit, (programmes.multisine(), programmes.triangle()),
                       np.random.default_rng(5))
    one = search_singles(fitter, lambda message: None, ('mechanical_resonance', 'added_mass'))
    one = one.fits['mechanical_resonance']
    assert not any(free.parameter.late for free in one.free)
    assert one.cost > 2.0 * fitter.rows.size
    both = woken(fitter, one)
    assert both.cost < 1.1 * fitter.rows.size
    for name, value in second.items():
        assert both.effects['mechanical_resonance'][name] == pytest.approx(value, rel=0.05)


def test_a_structure_with_one_mode_keeps_it(device):
    unit = device.with_effects({'mechanical_resonance': RINGS})
    fitter = fitter_of(device, unit, (programmes.multisine(),), np.random.default_rng(5))
    one = fitter.fit({'mechanical_resonance': RINGS})
    assert woken(fitter, one) is one


@pytest.mark.parametrize('name', [name for name in EFFECTS if has_late(name)])
def test_late_numbers_are_walked_only_once_they_are_off_neutral(name):
    typical = EFFECTS[name].typical()
    late = [p for p in EFFECTS[name].parameters if p.late]
    assert all(p.start == p.neutral for p in late)
    assert not any(free.parameter.late for free in free_parameters(name, typical))
    awake = free_parameters(name, {**typical, late[0].name: 0.5})
    assert [free.parameter.name for free in awake if free.parameter.late] == [late[0].name]
