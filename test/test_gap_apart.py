# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""What moves with the charge and what moves beside it, told from both."""

from dataclasses import replace

import numpy as np
from piezo_stack_sim.effects.registry import EFFECTS
from piezo_stack_sim.gap.measured.apart import Apart, gain_per_charge, moved_by_charge, noise_moved
from piezo_stack_sim.gap.measured.evidence import prepare
from piezo_stack_sim.gap.measured.forward import residuals, simulate_set, spans
from piezo_stack_sim.gap.measured.where import block_residuals, is_driver_loudest, shares
from piezo_stack_sim.plant import Device, simulate
from piezo_stack_sim.recording import programmes
import pytest

QUIET = {'charge': 1e-9, 'displacement': 1e-9}  # the charge moves the end by a tenth of that
PROGRAMMES = (programmes.triangle(peaks=(30.0, 90.0), cycles=1), programmes.multisine())


def taken(effects, noises=QUIET):
    """Return rms of the displacement's gap over its noise: as it is, and taken apart."""
    device, random, recordings = Device.nominal(), np.random.default_rng(3), []
    unit = device.with_effects(effects)
    for programme in PROGRAMMES:
        answer = simulate(unit, programme.time, programme.command, programme.external_force)
        recordings.append(programme.replace(measured={
            name: getattr(answer, name) + noise * random.standard_normal(len(programme))
            for name, noise in noises.items()}))
    evidence = prepare(recordings, simulate_set(device, recordings), device)
    residual = residuals(device, evidence)
    rows = np.concatenate([np.arange(where.start, where.stop) for (_, channel), where in zip(
        evidence.keys, spans(evidence)) if channel == 'displacement'])
    return tuple(float(np.sqrt(np.mean(values[rows] ** 2)))
                 for values in (residual, Apart(evidence)(residual)))


@pytest.mark.parametrize('effect', [
    'creep', 'asymmetric_hysteresis', 'amplifier_gain', 'amplifier_saturation'])
def test_what_is_wrong_before_the_charge_leaves_hardly_anything_behind_it(effect):
    gap, behind = taken({effect: EFFECTS[effect].typical()})
    assert gap > 20.0
    assert behind ** 2 - 1.0 < (0.05 * gap) ** 2  # the rest is noise


@pytest.mark.parametrize('effect', ['sensor_gain', 'sensor_lag', 'transducer_ratio'])
def test_what_is_wrong_behind_the_charge_stays(effect):
    gap, behind = taken({effect: EFFECTS[effect].typical()})
    assert gap > 10.0
    assert behind > 0.7 * gap


def test_of_a_charge_that_is_hardly_known_nothing_is_taken_off():
    gap, behind = taken({'creep': EFFECTS['creep'].typical()}, QUIET | {'charge': 1e-7})
    assert behind == gap


def cut(drive, electrical, behind):
    """Return the cuts of one recording whose gaps are so many times the noise."""
    return {name: (ratio * np.ones(100), 1.0) for name, ratio in (
        ('drive', drive), ('electrical', electrical), ('behind', behind))}


def test_the_driver_is_to_blame_where_the_measured_voltage_is_most_wrong():
    assert is_driver_loudest([cut(13.0, 6.0, 1.0)])
    assert is_driver_loudest([cut(1.0, 1.0, 1.0), cut(10.0, 1.0, 2.0)])
    assert not is_driver_loudest([cut(3.0, 6.0, 1.0)])
    assert not is_driver_loudest([cut(1.4, 1.0, 1.0)])  # the noise may be estimated so wrong
    without = cut(9.0, 1.0, 1.0)
    del without['drive']
    assert not is_driver_loudest([without])  # nobody measured the voltage


@pytest.mark.parametrize('factor', [1, 4])
def test_noise_of_the_charge_shakes_a_resonance(factor):
    device = Device.nominal()
    heavy = device.replace(load=replace(device.load, mass=0.5))
    white = np.random.default_rng(4).standard_normal(400_000)
    moved = moved_by_charge(heavy, white, 1e-4).reshape(-1, factor).mean(axis=1)
    # Averaged, the noise of the charge is less by the root of the rows; the far end rings.
    expected = np.std(moved) * factor ** 0.5
    assert noise_moved(heavy, 1e-4, factor) == pytest.approx(expected, rel=0.05)
    assert expected > 1.5 * gain_per_charge(heavy)
    assert noise_moved(device, 1e-4) == pytest.approx(gain_per_charge(device), rel=0.01)


@pytest.mark.parametrize('effect, block', [
    ('parallel_stiffness', 'mechanical'), ('contact', 'mechanical'), ('mount_creep', 'mechanical'),
    ('stiffness_hardening', 'mechanical'), ('asymmetric_hysteresis', 'electrical'),
    ('creep', 'electrical'), ('initial_polarisation', 'electrical'), ('sensor_gain', 'mechanical')
])
def test_a_displacement_that_is_wrong_by_itself_takes_its_charge_with_it(effect, block):
    """What lies behind the charge is named mechanical here, whatever it is."""
    fractions = cut_at_its_ports({effect: EFFECTS[effect].typical()})
    assert max(fractions, key=fractions.__getitem__) == block
    assert fractions[block] > 0.8


def cut_at_its_ports(effects, drive='voltage', channels=('voltage', 'charge', 'displacement')):
    """Return the share of each block in the gap of a device with effects to one without."""
    device, random, recordings = Device.nominal(), np.random.default_rng(5), []
    noises = {'voltage': 5e-3, 'charge': 1e-9, 'displacement': 1e-9}
    for programme in PROGRAMMES:
        command = programme.command * (1.0 if drive == 'voltage' else 1.4e-6)
        programme = programme.replace(drive=drive, command=command)
        answer = simulate(device.with_effects(effects), programme.time, command, drive=drive)
        recordings.append(programme.replace(measured={
            name: getattr(answer, name) + noises[name] * random.standard_normal(len(programme))
            for name in channels}))
    simulated = simulate_set(device, recordings)
    evidence = prepare(recordings, simulated, device)
    return shares(block_residuals(device, evidence, simulated), None, evidence.channels)[0]


def test_under_charge_drive_the_voltage_tells_of_the_ceramic():
    """Charge and displacement are as commanded: nothing but the voltage shows the hysteresis."""
    fractions = cut_at_its_ports(
        {'asymmetric_hysteresis': EFFECTS['asymmetric_hysteresis'].typical()}, 'charge')
    assert fractions['electrical'] > 0.9
    stiffer = cut_at_its_ports({'parallel_stiffness': {'stiffness': 5e6}}, 'charge')
    assert stiffer['mechanical'] > 0.9
