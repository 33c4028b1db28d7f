# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""The plant against the equations: recordings by an independent integrator, facts, invariants."""

import csv
import gzip
import math
import os
from pathlib import Path
import shutil
import subprocess
import sys
import threading
from time import sleep

from numba import njit
import numpy as np
import piezo_stack_sim
from piezo_stack_sim.effects.registry import EFFECTS
from piezo_stack_sim.errors import InputError
from piezo_stack_sim.plant import (
    compilation, Device, Load, offline, Plant, PlantState, simulate, simulate_many, stack)
from piezo_stack_sim.plant.lanes import LANES, padded, sums
from piezo_stack_sim.recording.recording import Recording
import pytest

REFERENCE = Path(__file__).resolve().parents[2] / 'shared' / 'reference'
RECORDINGS = ('triangle', 'decay', 'steps', 'multisine', 'force', 'triangle_100hz_90v',
              'ideal_step_90v', 'shorted_force', 'charge_chirp')


@pytest.fixture(scope='module')
def device():
    return Device.nominal()


def rise(device, voltage, seconds=2.0, rows=4000):
    """Lead the relaxed device slowly to a voltage and let it rest."""
    time = np.linspace(0.0, seconds, rows)
    command = voltage * np.minimum(time / (0.8 * seconds), 1.0)
    return simulate(device, time, command)


@pytest.mark.parametrize('name', RECORDINGS)
def test_the_plant_stays_within_a_nanometre_of_an_independent_integrator(device, name):
    path = REFERENCE / f'{name}.csv.gz'
    if not path.exists():
        pytest.skip('no reference recordings beside the checkout')
    with gzip.open(path, 'rt') as file:
        header = next(csv.reader(file))
        rows = np.loadtxt(file, delimiter=',')
    column = dict(zip(header, rows.T))
    drive = 'charge' if 'charge_command' in column else (
        'shorted' if name == 'shorted_force' else 'voltage')
    command = column.get('charge_command', column.get('voltage_command'))
    answer = simulate(device, column['time'], command, column['external_force'], drive)
    assert np.abs(answer.displacement - column['displacement']).max() < 1e-9
    assert np.abs(answer.charge - column['charge']).max() < 10e-9


@pytest.mark.parametrize('voltage, charge, displacement', [
    (10.0, 7.958683e-6, 0.742414e-6), (30.0, 32.362925e-6, 3.018930e-6),
    (60.0, 79.140940e-6, 7.382550e-6), (90.0, 133.100671e-6, 12.416107e-6),
    (100.0, 151.087248e-6, 14.093960e-6)])
def test_a_slow_rise_ends_where_the_equations_say(device, voltage, charge, displacement):
    answer = rise(device, voltage)
    # The held command moves in small steps that ring: a few tenths of a nanometre.
    assert answer.charge[-1] == pytest.approx(charge, abs=2e-8)
    assert answer.displacement[-1] == pytest.approx(displacement, abs=2e-9)


@pytest.mark.parametrize('peak, first, left', [
    (30.0, 3.0228e-6, 0.6008e-6), (60.0, 7.3923e-6, 1.3371e-6), (90.0, 12.4308e-6, 2.1652e-6)])
def test_a_triangle_peaks_and_leaves_what_the_paper_parameters_give(device, peak, first, left):
    rows = 1000
    turn = np.arange(2 * rows) / rows % 1.0
    command = peak * np.minimum(2.0 * turn, 2.0 - 2.0 * turn)
    answer = simulate(device, np.arange(command.size) * 1e-5, command)
    assert answer.displacement[:rows].max() == pytest.approx(first, abs=2e-10)
    # The lowest point of the turn, a row or two after the command was back at zero.
    assert answer.displacement[rows:rows + 5].min() == pytest.approx(left, abs=1e-10)


def test_an_ideal_step_of_90_volts_rings_and_the_hysteresis_remembers_it(device):
    for rows in (50, 500, 5000):  # from the equations, not from the step of the rows
        answer = simulate(device, np.linspace(0.0, 5e-3, rows), np.full(rows, 90.0))
        assert answer.displacement[-1] == pytest.approx(16.0607e-6, abs=1e-9)
        assert answer.charge_out_of_range


def test_open_leads_show_no_hysteresis_and_the_stiffness_of_equation_20(device):
    time = np.arange(4001) * 5e-5
    force = -100.0 * (1.0 - np.cos(2.0 * np.pi * 10.0 * time))
    answer = simulate(device, time, np.zeros(4001), force, 'open')
    actuator = device.actuator
    k_open = actuator.stiffness + actuator.transformer_ratio ** 2 / actuator.linear_capacitance
    assert k_open == pytest.approx(89.3333e6, rel=1e-5)
    assert answer.displacement.min() == pytest.approx(-200.0 / k_open, abs=1e-11)
    assert answer.displacement[-1] == pytest.approx(0.0, abs=1e-10)
    assert np.all(answer.charge == 0.0)


def test_shorted_leads_are_softer_and_remember(device):
    time = np.arange(4001) * 5e-5
    force = -100.0 * (1.0 - np.cos(2.0 * np.pi * 10.0 * time))
    answer = simulate(device, time, np.zeros(4001), force, 'shorted')
    assert answer.displacement[:2000].min() == pytest.approx(-3.84083e-6, abs=1e-9)
    assert answer.displacement[2000] == pytest.approx(-0.22560e-6, abs=2e-9)


def test_charge_drive_is_linear_without_a_loop(device):
    time = np.arange(2001) * 1e-3
    charge = 60e-6 * (1.0 - np.cos(2.0 * np.pi * time))
    once = simulate(device, time, charge, drive='charge').displacement
    half = simulate(device, time, 0.5 * charge, drive='charge').displacement
    assert np.abs(once - 2.0 * half).max() < 1e-15
    # Static gain x/q, rising and falling.
    assert np.abs(once[1:] - 0.0932836 * charge[:-1]).max() < 1e-9


def test_a_clamped_stack_pushes_the_blocked_force(device):
    blocked = device.replace(load=Load(clamped=True))
    full_range = blocked.replace(actuator=device.actuator.replace(
        maxwell_break_voltage=(*device.actuator.maxwell_break_voltage[:-1], math.inf)))
    for voltage, force in ((100.0, 529.0), (150.0, 837.0)):
        answer = rise(full_range, voltage)
        assert answer.force[-1] == pytest.approx(force, abs=0.6)
        assert answer.displacement[-1] == 0.0


def test_the_last_element_that_never_slips_gives_the_full_stroke(device):
    actuator = device.actuator.replace(
        maxwell_break_voltage=(*device.actuator.maxwell_break_voltage[:-1], math.inf))
    answer = rise(device.replace(actuator=actuator), 150.0)
    assert answer.displacement[-1] == pytest.approx(22.5e-6, abs=0.05e-6)
    assert not answer.charge_out_of_range


def test_an_element_that_never_slips_bears_any_history(device):
    actuator = device.actuator.replace(
        maxwell_break_voltage=(*device.actuator.maxwell_break_voltage[:-1], math.inf))
    polarised = device.replace(actuator=actuator).with_effects(
        {'initial_polarisation': {'peak_voltage': 90.0}})
    answer = rise(polarised, 90.0)
    # The sensors are zeroed where the rise begins: what remained from before is missing.
    assert 9e-6 < answer.displacement[-1] < 11e-6


def noisy_walk(rows, seed):
    random = np.random.default_rng(seed)
    command = np.clip(45.0 + np.cumsum(random.normal(0.0, 3.0, rows)), 0.0, 90.0)
    return command, random.normal(0.0, 20.0, rows)


@pytest.mark.parametrize('drive', ['voltage', 'charge'])
def test_results_do_not_depend_on_how_commands_are_cut_into_calls(device, drive):
    command, force = noisy_walk(600, 1)
    command = command if drive == 'voltage' else command * 1e-6
    whole = Plant(device, 1e-4, drive).run(command, force)
    plant, cut = Plant(device, 1e-4, drive), []
    for start, end in ((0, 1), (1, 40), (40, 41), (41, 333), (333, 600)):
        cut.append(plant.run(command[start:end], force[start:end]).displacement)
    assert np.array_equal(whole.displacement, np.concatenate(cut))
    one_by_one = Plant(device, 1e-4, drive)
    samples = [one_by_one.advance(u, f) for u, f in zip(command, force)]
    assert np.array_equal(whole.charge, [sample.charge for sample in samples])


def test_offline_and_streaming_are_the_same_to_the_bit(device):
    command, force = noisy_walk(500, 2)
    offline_ = simulate(device, np.arange(501) * 1e-3, np.append(command, 0.0),
                        np.append(force, 0.0))
    streamed = Plant(device, 1e-3, 'voltage').run(command, force)
    assert np.array_equal(offline_.displacement[1:], streamed.displacement)


def test_rows_of_unequal_length_give_what_equal_rows_give(device):
    command, force = noisy_walk(300, 3)
    time = np.arange(300) * 1e-4
    even = simulate(device, time, command, force)
    # Split random rows in two by repeating their command: nothing may change.
    random = np.random.default_rng(4)
    extra = np.sort(random.choice(299, 60, replace=False))
    between = time[extra] + 1e-4 * random.uniform(0.2, 0.8, 60)
    order = np.argsort(np.concatenate([time, between]), kind='stable')
    split = simulate(device, np.concatenate([time, between])[order],
                     np.concatenate([command, command[extra]])[order],
                     np.concatenate([force, force[extra]])[order])
    kept = np.flatnonzero(order < 300)
    assert np.abs(split.displacement[kept] - even.displacement).max() < 1e-10


FOLLOWING = [
    {},
    {'sensor_lag': {'time_constant': 2e-4}},
    {'sensor_lag': {'time_constant': 3e-8}},
    {'mechanical_resonance': {'participation': 0.4, 'frequency': 2500.0, 'damping_ratio': 0.02}},
    {'mechanical_resonance': {'participation': 0.4, 'frequency': 2500.0, 'damping_ratio': 0.02,
                              'second_participation': -0.1, 'second_frequency': 700.0}},
    {'leakage': {'resistance': 1e5}},
    # Behind each other, between rows, after a bow: all at once.
    {'leakage': {'resistance': 1e5}, 'transducer_nonlinearity': {'quadratic': 0.02},
     'mechanical_resonance': {'participation': -0.3, 'frequency': 900.0, 'damping_ratio': 0.1},
     'sensor_lag': {'time_constant': 1e-3}, 'sensor_delay': {'delay': 3.3e-5}},
]


@pytest.mark.parametrize('drive', ['voltage', 'charge'])
@pytest.mark.parametrize('effects', FOLLOWING)
def test_the_two_kernels_agree(device, effects, drive, monkeypatch):
    import dataclasses
    device = device.with_effects(effects)
    command, force = noisy_walk(400, 5)
    command *= 1.0 if drive == 'voltage' else 1e-6
    fast = Plant(device, 1e-4, drive)
    assert fast.system.is_ideal == (drive == 'voltage' or 'leakage' not in effects)
    fast = fast.run(command, force)
    assemble = stack.assemble
    monkeypatch.setattr(
        stack, 'assemble', lambda model: dataclasses.replace(assemble(model), is_ideal=False))
    general = Plant(device, 1e-4, drive).run(command, force)
    assert np.ptp(fast.displacement) > 1e-6
    assert np.abs(fast.displacement - general.displacement).max() < 1e-12
    assert np.abs(fast.charge - general.charge).max() < 1e-11


@pytest.mark.parametrize('time_constant', [1e-12, 5e-324])
def test_a_lag_that_nothing_could_show_is_none(device, time_constant):
    command, force = noisy_walk(100, 5)
    lagging = device.with_effects({'sensor_lag': {'time_constant': time_constant}})
    assert np.array_equal(Plant(lagging, 1e-4, 'voltage').run(command, force).displacement,
                          Plant(device, 1e-4, 'voltage').run(command, force).displacement)


@pytest.mark.parametrize('seed', range(4))
def test_over_a_closed_cycle_the_device_takes_energy_in(device, seed):
    random = np.random.default_rng(seed)
    rows = 4000
    phase = np.arange(3 * rows) / rows
    shape = sum(random.normal() * np.sin(2.0 * np.pi * (h * phase + random.uniform()))
                for h in range(1, 5))
    command = 40.0 + 8.0 * (shape - shape[0])
    squeeze = sum(random.normal() * np.sin(2.0 * np.pi * (h * phase + random.uniform()))
                  for h in range(1, 4))
    force = 20.0 * (squeeze - squeeze[0])
    answer = simulate(device, np.arange(3 * rows) * 1e-5, command, force)
    q, x = answer.charge, answer.displacement
    # A held source does its work at its own voltage and force.
    taken = np.cumsum(command[:-1] * np.diff(q) + force[:-1] * np.diff(x))
    assert taken[2 * rows] - taken[rows] > 0.0


@pytest.mark.parametrize('effects', [{}, {'rate_dependent_hysteresis': {'growth': 0.1}}])
def test_a_saved_state_continues_as_if_nothing_had_happened(device, effects):
    device = device.with_effects(effects)
    command, force = noisy_walk(400, 7)
    plant = Plant(device, 1e-4, 'voltage')
    plant.run(command[:200], force[:200])
    saved = plant.state.to_dict()
    expected = plant.run(command[200:], force[200:])
    other = Plant(device, 1e-4, 'voltage')
    other.restore(PlantState.from_dict(saved))
    assert np.array_equal(other.run(command[200:], force[200:]).displacement,
                          expected.displacement)


def test_a_state_that_no_history_leads_to_is_refused(device):
    plant = Plant(device, 1e-4, 'voltage')
    saved = plant.state.to_dict()
    saved['blocks'][0] = 1e-3
    with pytest.raises(InputError, match='blocks further apart'):
        plant.restore(PlantState.from_dict(saved))


@pytest.mark.parametrize('part', ['flags', 'inputs', 'memory', 'zero'])
def test_a_state_that_another_version_saved_is_refused(device, part):
    plant = Plant(device, 1e-4, 'voltage')
    saved = plant.state.to_dict()
    saved[part].pop()
    with pytest.raises(InputError, match=f'{part} has .* another version'):
        plant.restore(PlantState.from_dict(saved))


@pytest.mark.parametrize('effect', ['command_delay', 'sensor_delay'])
def test_a_state_of_a_device_with_other_delays_is_refused(device, effect):
    saved = Plant(device, 1e-3, 'voltage').state
    late = Plant(device.with_effects({effect: {'delay': 2.5e-3}}), 1e-3, 'voltage')
    with pytest.raises(InputError, match='delays'):
        late.restore(saved)


def test_a_compilation_beside_that_fails_is_told(monkeypatch):
    told, told_failed = threading.Event(), []
    monkeypatch.setattr(compilation.sys, 'executable', shutil.which('false'))
    kernel = compilation.LateKernel(
        told.set, lambda status: (told_failed.append(status), told.set()))
    assert told.wait(60.0)
    kernel.stop()
    assert told_failed == [1]


def led_slowly(device, voltage, force):
    """Return a plant led to a force, then to a voltage, in a second each: it hardly rings."""
    rise = np.linspace(0.0, 1.0, 100001)
    rise = rise * rise * (3.0 - 2.0 * rise)
    plant = Plant(device, 1e-5)
    plant.run(0.0 * rise, force * rise)
    plant.run(voltage * rise, np.full(rise.size, force))
    plant.run(np.full(2000, voltage), np.full(2000, force))
    return plant


@pytest.mark.parametrize('start', [(50.0, 0.0), (0.0, -150.0), (50.0, -150.0)])
@pytest.mark.parametrize('effects', [
    {}, {'series_compliance': {'compliance': 2e-8}},
    {'stiffness_hardening': {'quadratic': 0.2, 'cubic': 0.3}},
    {'contact': {'gap': 2e-6, 'stiffness': 2e7}}, {'transducer_nonlinearity': {'curvature': 0.03}},
    {'amplifier_gain': {'gain_error': 0.03, 'offset': 0.4}},
    {'amplifier_bandwidth': {'output_resistance': 20.0}},
    {'initial_polarisation': {'peak_voltage': 90.0}},
    {'asymmetric_hysteresis': {'quadratic': 0.02, 'cubic': 0.01, 'branch': 0.1}}])
def test_a_device_that_starts_elsewhere_is_where_a_slow_rise_leads(device, effects, start):
    bias, force = start
    if force and ('initial_polarisation' in effects or 'amplifier_gain' in effects):
        pytest.skip('who had been there first, the force or a voltage, makes a difference')
    device = device.with_effects(effects)
    led = led_slowly(device, bias, force)
    at_once = Plant(device, 1e-5, start=start)
    there, here = led.sample(), at_once.sample()
    assert (here.displacement, here.charge) == (0.0, 0.0)
    assert here.voltage == pytest.approx(there.voltage, abs=1e-9)
    # From there on they do the same: the memory of the elements is the same, too.
    time = np.arange(4000) * 1e-5
    command = bias + 20.0 * np.sin(2.0 * np.pi * 100.0 * time) * np.minimum(time / 0.01, 1.0)
    forces = np.full(time.size, force)
    moved, wanted = at_once.run(command, forces), led.run(command, forces)
    stroke = np.ptp(wanted.displacement)
    assert np.abs(moved.displacement - wanted.displacement
                  + there.displacement).max() < 3e-4 * stroke
    assert np.abs(moved.charge - wanted.charge + there.charge).max() < 3e-4 * np.ptp(wanted.charge)


@pytest.mark.parametrize('start', [(60.0, 0.0), (60.0, -80.0), (0.0, -80.0)])
@pytest.mark.parametrize('period', [1e-4, 2e-6])
@pytest.mark.parametrize('effect', [name for name in EFFECTS if name not in {
    'leakage', 'thermal_drift', 'periodic_disturbance', 'sensor_drift'}])
def test_a_device_that_starts_elsewhere_rests_there(device, effect, period, start):
    values = EFFECTS[effect].typical() | ({'gap': 3e-6} if effect == 'contact' else {})
    plant = Plant(device.with_effects({effect: values}), period, start=start)
    held = plant.run(np.full(300, start[0]), np.full(300, start[1]))
    assert np.abs(held.displacement).max() < 1e-14 and np.abs(held.charge).max() < 1e-13


def test_whatever_was_before_a_device_starts_or_says_why_not(device):
    """A fit tries numbers with which springs and voltages yield; it must never be torn."""
    random, started = np.random.default_rng(8), 0
    for effect in ('stiffness_hardening', 'asymmetric_hysteresis', 'contact') * 60:
        values = {p.name: random.uniform(p.lower, p.upper) for p in EFFECTS[effect].parameters
                  if np.isfinite([p.lower, p.upper]).all()}
        past = dict(zip(('peak_voltage', 'turn_voltage', 'return_voltage'),
                        random.uniform(-200.0, 200.0, 3)))
        burdened = device.with_effects({effect: values, 'initial_polarisation': past})
        start = random.choice([0.0, 60.0]), random.choice([0.0, -300.0])
        try:
            plant = Plant(burdened, 1e-4, start=start)
        except InputError as error:
            assert 'rests nowhere' in str(error) or 'finite numbers' in str(error)
            continue
        started += 1
        assert np.isfinite(plant.sample_exact()).all()
    assert started > 100


@pytest.mark.parametrize('drive', ['charge', 'open', 'shorted'])
def test_a_force_from_before_the_start_moves_nothing_under_any_drive(device, drive):
    device = device.with_effects({'stiffness_hardening': {'quadratic': 0.2, 'cubic': 0.3}})
    plant = Plant(device, 1e-4, drive, start=(0.0, -80.0))
    held = plant.run(np.zeros(300), np.full(300, -80.0))
    assert np.abs(held.displacement).max() < 1e-14 and np.abs(held.charge).max() < 1e-13
    freed = plant.run(np.zeros(300))
    assert freed.displacement[-1] > 1e-7


def test_a_timeline_starts_where_a_plant_does(device):
    even, uneven = np.arange(300) * 1e-4, np.cumsum(np.tile([1e-4, 1.5e-4], 150))
    for time in even, uneven:
        command = 30.0 + 10.0 * np.sin(300.0 * (time - time[0]))
        answer = simulate(device, time, command, start=(30.0, 0.0))
        assert answer.voltage[0] == 30.0 and answer.displacement[0] == 0.0
        assert 0.0 < answer.displacement[20] < 2e-6
    # Under charge there is no such place: the charge counts from the start.
    assert simulate(device, even, 1e-5 * even, drive='charge', start=(30.0, 0.0)).voltage[0] == 0.0


@pytest.mark.parametrize('first, second', [('voltage', 'charge'), ('charge', 'voltage'),
                                           ('voltage', 'open'), ('charge', 'open')])
def test_switching_the_drive_does_not_move_the_device(device, first, second):
    plant = Plant(device, 1e-3, first)
    plant.run(np.linspace(0.0, 50.0 if first == 'voltage' else 60e-6, 200))
    plant.run(np.full(50, 50.0 if first == 'voltage' else 60e-6))
    before = plant.sample()
    plant.set_drive(second)
    after = plant.sample()
    assert after.displacement == pytest.approx(before.displacement, abs=1e-13)
    assert after.charge == pytest.approx(before.charge, abs=1e-13)
    assert after.voltage == pytest.approx(before.voltage, abs=1e-6)
    hold = {'voltage': after.voltage, 'charge': after.charge}.get(second, 0.0)
    later = plant.run(np.full(20, hold))
    assert np.abs(later.displacement - before.displacement).max() < 1e-10


def test_many_recordings_at_once_are_what_they_are_one_by_one(device):
    jobs = []
    for seed in range(6):
        command, force = noisy_walk(200, seed)
        jobs.append((device, Recording(f'r{seed}', np.arange(200) * 1e-3, 'voltage', command,
                                       force)))
    together = simulate_many(jobs)
    for (_, recording), answer in zip(jobs, together):
        alone = simulate(device, recording.time, recording.command, recording.external_force)
        assert np.array_equal(answer.displacement, alone.displacement)


@pytest.mark.parametrize('time, command, message', [
    ([0.0, 1.0, 1.0], [0.0, 1.0, 2.0], 'row 3.*does not come after'),
    ([0.0, 1.0], [0.0, math.nan], 'command, row 2'),
    ([0.0, 1.0], [0.0], 'command has shape'),
    ([], [], 'at least a row')])
def test_wrong_rows_are_named(device, time, command, message):
    with pytest.raises(InputError, match=message):
        simulate(device, time, command)


def test_a_command_that_is_not_finite_leaves_the_device_as_it_was(device):
    plant = Plant(device, 1e-3, 'voltage')
    plant.run(np.linspace(0.0, 30.0, 50))
    before = plant.state
    with pytest.raises(InputError, match='nothing was advanced'):
        plant.advance(math.inf)
    assert plant.state == before


def test_extremes_stay_finite(device):
    plant = Plant(device, 1e-3, 'voltage')
    for voltage, force in ((1e4, 0.0), (-1e4, 5e4), (0.0, -1e5), (150.0, 0.0)):
        answer = plant.run(np.full(20, voltage), np.full(20, force))
        assert np.isfinite(answer.displacement).all() and np.isfinite(answer.charge).all()


def test_irregular_rows_may_begin_at_any_time(device):
    time = np.array([0.0, 1e-4, 3e-4, 6e-4, 8e-4, 1.1e-3])
    command = np.linspace(0.0, 50.0, time.size)
    at_zero = simulate(device, time, command)
    for start in (-3e-4, -1.0, 5.0):
        answer = simulate(device, time + start, command)
        for name in ('displacement', 'charge', 'voltage'):
            np.testing.assert_allclose(getattr(answer, name), getattr(at_zero, name), rtol=1e-6)
        assert np.array_equal(answer.time, time + start)


def test_a_sensor_may_be_as_late_as_the_first_of_irregular_rows_is_long(device):
    time = np.cumsum(np.tile([1e-4, 2e-4, 3e-4], 30)) - 1e-4
    late = device.with_effects({'sensor_delay': {'delay': float(np.nextafter(time[1], 0.0))}})
    command = 30.0 - 30.0 * np.cos(200.0 * time)
    answer = simulate(late, time, command)
    prompt = simulate(device, time, command)
    assert np.allclose(answer.displacement[:2], 0.0, atol=1e-12)
    np.testing.assert_allclose(answer.charge, prompt.charge, rtol=1e-6)


def test_the_tick_grid_of_irregular_rows_does_not_drift(device):
    random = np.random.default_rng(9)
    time = np.cumsum(random.uniform(0.5e-3, 1.5e-3, 2000))
    assert np.unique(np.round(np.diff(time), 12)).size > offline.MAX_CLASSES
    command = 30.0 * (1.0 - np.cos(2.0 * np.pi * time))
    answer = simulate(device, time, command)
    slow = simulate(device, np.arange(2000) * 1e-3, 30.0 * (
        1.0 - np.cos(2.0 * np.pi * np.arange(2000) * 1e-3)))
    assert answer.displacement.max() == pytest.approx(slow.displacement.max(), abs=20e-9)


def test_compiled_code_is_not_kept_when_what_it_calls_has_changed(tmp_path):
    """Numba by itself looks at the file of a kernel alone."""
    package = tmp_path / 'piezo_stack_sim'
    shutil.copytree(Path(piezo_stack_sim.__file__).parent, package,
                    ignore=shutil.ignore_patterns('__pycache__'))
    code = ('from piezo_stack_sim.plant.cubic import hermite; hermite(0.5, 0.0, 1.0, 1.0, 1.0); '
            'print(sum(hermite.stats.cache_hits.values()))')

    def hits():
        environment = {name: value for name, value in os.environ.items()
                       if name != 'NUMBA_CACHE_DIR'} | {'PYTHONPATH': os.pathsep.join(
                           [str(tmp_path), *filter(None, sys.path)])}
        return subprocess.run([sys.executable, '-c', code], env=environment, cwd=tmp_path,
                              capture_output=True, text=True, check=True).stdout.strip()

    assert (hits(), hits()) == ('0', '1')
    with open(package / 'plant' / 'layout.py', 'a', encoding='utf-8') as file:
        file.write('# changed\n')
    assert (hits(), hits()) == ('0', '1')


def test_of_several_that_need_the_same_code_one_compiles_it(monkeypatch):
    compiled, all_ask = [], threading.Barrier(3)

    def is_compiled():
        if not asked.done:
            asked.done = True
            all_ask.wait(20.0)  # all have seen that nothing is compiled
            return False
        return bool(compiled)

    class Asked(threading.local):
        done = False

    asked = Asked()
    monkeypatch.setattr(compilation, 'is_compiled', is_compiled)
    monkeypatch.setattr(compilation, '_compile_both', lambda: compiled.append(sleep(0.1)))
    others = [threading.Thread(target=compilation.compile_kernels) for _ in range(2)]
    for other in others:
        other.start()
    compilation.compile_kernels()
    for other in others:
        other.join(20.0)
    assert len(compiled) == 1


@pytest.mark.parametrize('used', [0, 1, 5, 7])
def test_sums_in_lanes_are_the_product_with_the_columns_in_use_and_touch_nothing_else(used):
    random = np.random.default_rng(used)
    columns, rows = 7, padded(13)
    assert rows == 2 * LANES
    weights = random.standard_normal((3, columns, rows))
    z = random.standard_normal(columns)

    @njit
    def product(weights, z, used, out):
        for first in range(0, rows, LANES):
            sums(weights, 1 * columns * rows + first, rows, z, used, out, LANES + first)

    out = np.full(4 * LANES, 9.0)
    product(weights, z, used, out)
    expected = weights[1, :used].T @ z[:used] if used else np.zeros(rows)
    assert out[LANES:3 * LANES] == pytest.approx(expected, rel=1e-14, abs=1e-15)
    assert (out[:LANES] == 9.0).all() and (out[3 * LANES:] == 9.0).all()
