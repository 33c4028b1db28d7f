# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Numbers of diagnosis.json: intervals that a device can have, and what corrected.yaml gets."""

from dataclasses import replace

import numpy as np
from piezo_stack_sim.gap.cores import parallel
from piezo_stack_sim.gap.deciding.experiment import next_experiment
from piezo_stack_sim.gap.deciding.ranked import Ranked
from piezo_stack_sim.gap.deciding.score import Judge
from piezo_stack_sim.gap.fitting.fit import Fitter
from piezo_stack_sim.gap.measured.evidence import prepare
from piezo_stack_sim.gap.measured.forward import simulate_set
from piezo_stack_sim.gap.report_parts import (
    calibration_part, cause_part, outdone, stuck_of, worsened)
from piezo_stack_sim.plant import Device, simulate
from piezo_stack_sim.recording import programmes
import pytest

NOISE = {'charge': 5e-9, 'displacement': 2e-9}
TRUTH = {'series_compliance': {'compliance': 5e-9}, 'sensor_lag': {'time_constant': 2e-4}}
PAIR = '+'.join(TRUTH)


def fitter_of(arbitrary=False):
    """Return a fitter to a triangle and a force on a device with two effects."""
    device, random = Device.nominal(), np.random.default_rng(4)
    runs = []
    for run in (programmes.triangle(peaks=(60.0,), cycles=1, rate=5000.0),
                programmes.force(cycles=1, rate=5000.0)):
        answer = simulate(device.with_effects(TRUTH), run.time, run.command, run.external_force)
        runs.append(run.replace(arbitrary=arbitrary, measured={
            name: getattr(answer, name) + noise * random.standard_normal(len(run))
            for name, noise in NOISE.items()}))
    fitter = Fitter(device, prepare(runs, simulate_set(device, runs), device))
    fitter.prepare(parallel)
    return fitter


@pytest.fixture(scope='module')
def fitter():
    return fitter_of()


@pytest.fixture(scope='module')
def nominal(fitter):
    return fitter.fit({})


@pytest.fixture(scope='module')
def both(fitter):
    return fitter.fit(TRUTH)


def part_of(fitter, nominal, fit, earlier=None):
    judge = Judge.from_residual(fitter.evidence, fit.residual, nominal.residual)
    return cause_part(Ranked(PAIR, 1.0, 0.9, 2), fit, 0.9, judge, nominal, fitter, earlier)


def test_an_interval_holds_nothing_that_no_device_can_have(fitter, nominal, both):
    # Rows that hardly tell anything would have it reach below no compliance and no lag at all.
    blind = replace(both, slope=1e-3 * both.slope)
    rows = part_of(fitter, nominal, blind)['parameters']
    for row in rows.values():
        assert row['lower'] == 0.0 <= row['ci'][0] <= row['value']
        assert row['value'] < row['ci'][1] <= row['upper']
    assert rows['series_compliance.compliance']['ci'][0] == 0.0
    assert rows['sensor_lag.time_constant']['ci'][0] == 0.0
    # Where the rows tell more it ends where they say.
    rows = part_of(fitter, nominal, both)['parameters']
    assert rows['series_compliance.compliance']['ci'] == [
        pytest.approx(5e-9, rel=0.1), pytest.approx(5e-9, rel=0.1)]


def test_what_a_later_fit_keeps_is_as_sure_as_where_it_was_fitted(fitter, nominal, both):
    later = fitter.fit(both.effects, both.phi, 2, kept=['sensor_lag'])
    name = 'sensor_lag.time_constant'
    assert part_of(fitter, nominal, later)['parameters'][name]['ci'] is None
    kept = part_of(fitter, nominal, later, both)['parameters'][name]
    assert kept == part_of(fitter, nominal, both)['parameters'][name]
    assert kept['ci'][0] < TRUTH['sensor_lag']['time_constant'] < kept['ci'][1]
    # What was fitted once more is as sure as it is there.
    name = 'series_compliance.compliance'
    assert part_of(fitter, nominal, later, both)['parameters'][name] == (
        part_of(fitter, nominal, later)['parameters'][name])


def test_numbers_that_were_not_kept_tell_nothing_of_those_of_now(fitter, nominal, both):
    other = {**both.effects, 'sensor_lag': {'time_constant': 3e-4}}
    later = fitter.fit(other, both.phi, 1, kept=['sensor_lag'])
    row = part_of(fitter, nominal, later, both)['parameters']['sensor_lag.time_constant']
    assert row['ci'] is None


def test_what_is_kept_at_its_bound_is_stuck_there_all_the_same(fitter, nominal, both):
    lag = next(free for free in both.free if free.effect == 'sensor_lag')
    at_bound = {**both.effects, 'sensor_lag': {
        **both.effects['sensor_lag'], lag.parameter.name: lag.parameter.upper}}
    first = replace(both, effects=at_bound, view=None)
    later = fitter.fit(at_bound, both.phi, 1, kept=['sensor_lag'])
    assert stuck_of(later) == [] and stuck_of(first) == [lag]
    assert stuck_of(later, first) == [lag]
    row = part_of(fitter, nominal, later, first)['parameters'][f'sensor_lag.{lag.parameter.name}']
    assert row['at_bound'] == 'upper'


def test_nominal_parameters_are_told_within_what_is_allowed_and_as_they_are_written(
        fitter, nominal, both):
    rows = calibration_part(fitter, nominal, both)
    written = fitter.device_with(both.effects, both.phi).actuator
    for name, row in rows.items():
        ends = [row['nominal'] * (1.0 + side * row['allowed']) for side in (-1.0, 1.0)]
        assert ends[0] <= row['ci'][0] <= row['fitted'] <= row['ci'][1] <= ends[1]
        assert row['corrected'] == pytest.approx(getattr(written, name), rel=1e-9)
    # What no nominal parameter explains pulls them away; with its cause on they come back.
    assert rows['stiffness']['at_bound'] == 'lower'
    assert rows['stiffness']['corrected'] == pytest.approx(6e6, rel=1e-3)
    assert 'corrected' not in calibration_part(fitter, nominal)['mass']


@pytest.mark.parametrize('part, at_bound', [(-1.0, 'lower'), (0.0, False), (1.0, 'upper')])
def test_a_free_scale_tells_where_it_comes_to_its_bound(part, at_bound):
    fitter = fitter_of(arbitrary=True)
    fit = fitter.fit({}, steps=0)
    phi = fit.phi.copy()
    phi[-1] = part * fitter.nuisance.bound[-1]
    scaled = replace(fit, phi=phi, view=None)
    row = calibration_part(fitter, scaled, scaled)['displacement_scale']
    assert row['at_bound'] == at_bound and row['corrected'] == row['fitted']
    gain = replace(scaled, effects={'sensor_gain': {'gain_error': 0.1}})
    assert 'corrected' not in calibration_part(fitter, scaled, gain)['displacement_scale']


@pytest.mark.parametrize('score, false, warned', [
    (0.2, 0.63, True), (0.0, 0.02, True), (0.63, 0.2, False), (0.999, 0.63, False),
    (-0.3, -0.1, False), (None, None, False)])
def test_a_placebo_that_removes_more_than_the_answer_is_warned_of(score, false, warned):
    found = outdone({'charge': {'S': score}, 'displacement': {'S': 0.9},
                     'placebo': {'charge': false, 'displacement': 0.1}, 'ceiling': {}})
    assert len(found) == warned
    assert not warned or 'charge' in found[0] and 'distrust' in found[0]


@pytest.mark.parametrize('before, after, warned', [
    (1.0, 3.1, True), (4.0, 9.0, True), (4.0, 4.2, False), (9.0, 0.9, False), (0.5, 1.3, False)])
def test_a_channel_that_gets_worse_is_warned_of(before, after, warned):
    rows = {'charge': {'before': 1e-4, 'after': 2e-16, 'noise': 1e-16},
            'displacement': {'before': before * 1e-18, 'after': after * 1e-18, 'noise': 1e-18}}
    found = worsened({**rows, 'placebo': {}, 'ceiling': {}, 'withheld': []})
    assert len(found) == warned
    assert all('displacement' in line and 'explains nothing' in line for line in found)


def test_of_many_tied_causes_it_is_said_how_many_an_experiment_was_tried_with(fitter, both):
    others = ('creep', 'friction', 'added_mass', 'leakage', 'contact', 'thermal_drift')
    names = [f'sensor_lag+{other}' for other in others]
    tied = {name: replace(both, effects={'sensor_lag': {'time_constant': 1e-4 * (1 + i)}})
            for i, name in enumerate(names)}
    asked = next_experiment(fitter, fitter.evidence, tied)
    assert 'of the first 5 of 6 tied causes' in asked['why']
    assert 'thermal_drift' not in asked['separates'] and len(asked['separates']) == 5
    few = next_experiment(fitter, fitter.evidence, dict(list(tied.items())[:2]))
    assert 'of the tied causes' in few['why']
