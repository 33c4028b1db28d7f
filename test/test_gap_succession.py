# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Recordings that begin with what another has left in the device."""

from hypothesis import given, settings, strategies
import numpy as np
from piezo_stack_sim.gap.compare import compare_set
from piezo_stack_sim.gap.measured.forward import simulate_set
from piezo_stack_sim.gap.measured.succession import extremes, in_succession
from piezo_stack_sim.plant import Device, Plant
from piezo_stack_sim.plant.quasi_static import lead
from piezo_stack_sim.recording import programmes, Recording, RecordingSet
import pytest

DEVICE = Device.nominal()
VOLTS = strategies.lists(strategies.floats(-100.0, 100.0), min_size=1, max_size=30)


@given(VOLTS)
@settings(max_examples=200, deadline=None)
def test_extremes_leave_what_the_whole_command_leaves(volts):
    whole = lead(DEVICE, volts).end
    short = lead(DEVICE, extremes(np.array(volts))).end
    assert short.charge == pytest.approx(whole.charge, abs=1e-12)
    assert short.element_voltage == pytest.approx(whole.element_voltage, abs=1e-8)


@pytest.mark.parametrize('volts, kept', [
    ([0.0, 40.0, 60.0, 30.0, 80.0, 0.0], (0.0, 80.0, 0.0)),
    ([0.0, 100.0, 20.0, 60.0, 30.0, 50.0, 40.0], (0.0, 100.0, 20.0, 60.0, 30.0, 50.0, 40.0)),
    ([0.0, 100.0, 20.0, 60.0, 0.0], (0.0, 100.0, 0.0)), ([5.0, 5.0], (0.0, 5.0)),
    ([1.0, 0.0, 2.0, 0.0], (0.0, 2.0, 0.0))])
def test_a_swing_within_a_later_one_is_forgotten(volts, kept):
    assert extremes(np.array(volts)) == kept


def recorded(unit, programmes_of, first=()):
    """Return recordings of a unit one after the other, the sensors zeroed before each."""
    random, state, recordings = np.random.default_rng(6), None, []
    for each in programmes_of:
        plant = Plant(unit, each.period, noise=False, before=first)
        if state is not None:
            plant.restore(state)
        start = plant.sample()
        answer = plant.run(each.command)
        recordings.append(each.replace(measured={
            name: np.append(getattr(start, name), getattr(answer, name)[:-1])
            - getattr(start, name) + noise * random.standard_normal(len(each))
            for name, noise in (('charge', 2e-9), ('displacement', 1e-9))}))
        rest = Plant(unit, 1e-3, noise=False)
        rest.restore(plant.state)
        rest.run(np.zeros(200))
        state = rest.state
    return tuple(recordings)


def humps(name, *heights):
    """Return a command of humps, one after the other."""
    hump = 0.5 * (1.0 - np.cos(2.0 * np.pi * np.arange(2000) / 2000))
    return Recording(name, np.arange(2000 * len(heights)) / 5e3, 'voltage',
                     np.concatenate([height * hump for height in heights]))


def test_recordings_one_after_the_other_have_no_gap():
    given = recorded(DEVICE, (humps('first', 95.0), humps('second', 30.0, 60.0),
                              humps('third', 70.0, 20.0)))
    followed, findings = in_succession(given, DEVICE, simulate_set(DEVICE, given))
    assert [bool(each.before) for each in followed] == [False, True, True]
    assert ['what first left' in each.what for each in findings] == [True, True]
    found = compare_set(RecordingSet('set', given), DEVICE)
    assert all(row['over_noise'] < 1.5 for row in found['gap'].values())
    assert sum('left in the device' in each['what'] for each in found['preflight']) == 2


@pytest.mark.parametrize('effects, first', [
    ({}, ()), ({'creep': {'gain_per_decade': 0.02}}, ()), ({}, (90.0, 0.0)),
    ({'parallel_stiffness': {'stiffness': 5e6}}, ()), ({'leakage': {'resistance': 1e6}}, ())],
    ids=['relaxed', 'creep', 'polarised', 'spring', 'leakage'])
def test_recordings_that_each_began_alike_follow_none(effects, first):
    unit = DEVICE.with_effects(effects)
    given = tuple(recorded(unit, (each,), first)[0] for each in (
        humps('high', 90.0), humps('low', 40.0, 60.0), programmes.steps(rate=1e3)))
    followed, findings = in_succession(given, DEVICE, simulate_set(DEVICE, given))
    assert not findings and not any(each.before for each in followed)


@pytest.mark.parametrize('channels', [('displacement',), ('charge', 'displacement')])
def test_what_a_spring_takes_from_every_stroke_is_not_left_by_another_recording(channels):
    """A smaller stroke looks like one that begins where a larger one has left the device."""
    unit = DEVICE.with_effects({'parallel_stiffness': {'stiffness': 4.2e6}})
    tuned = unit.replace(actuator=unit.actuator.replace(
        transformer_ratio=0.985 * unit.actuator.transformer_ratio))
    given = tuple(
        each.replace(measured={c: each.measured[c] for c in channels}) for each in (
            recorded(tuned, (each,))[0] for each in (
                humps('triangle', 15.0, 15.0, 30.0, 30.0, 47.0, 47.0), humps('decay', 60.0),
                programmes.steps(rate=1e3), humps('multisine', 26.0), humps('force', 44.0))))
    followed, findings = in_succession(given, DEVICE, simulate_set(DEVICE, given))
    assert not findings and not any(each.before for each in followed)


def test_a_sensor_that_reads_too_much_does_not_hide_what_another_recording_left():
    unit = DEVICE.with_effects({'sensor_gain': {'gain_error': 0.05}})
    given = recorded(unit, (humps('first', 40.0, 20.0), humps('second', 100.0)))
    followed, _ = in_succession(given, DEVICE, simulate_set(DEVICE, given))
    assert [bool(each.before) for each in followed] == [False, True]
