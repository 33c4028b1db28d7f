# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Sensors and surroundings, against published or recomputed numbers."""

import math

from effect_probes import device, fundamental, IDEAL, lags, only, sine
import numpy as np
from piezo_stack_sim.errors import InputError
from piezo_stack_sim.plant import Plant, PlantState, simulate
from piezo_stack_sim.plant.build import build_model
import pytest
from scipy.signal import cont2discrete, lfilter


@pytest.mark.parametrize('irregular', [False, True])
def test_a_joint_that_closes_is_read_as_late_as_the_rest(irregular):
    rows = np.arange(2000)
    time, force = rows * 1e-5, 80.0 * np.sin(2e-3 * np.pi * rows)
    if irregular:
        time = np.delete(time, [700, 1301])
        force = np.delete(force, [700, 1301])

    def seen(**effects):
        target = device('series_compliance', compliance=5e-9, stiffening=0.02)
        return simulate(target.with_effects(effects), time, np.zeros(time.size), force,
                        'voltage').displacement

    late = seen(sensor_delay={'delay': 5e-4})
    # It moves by 3 nm from row to row, which is what a missing row may be off by.
    off = np.abs(late[100:] - np.interp(time[100:] - 5e-4, time, seen())).max()
    assert off < (4e-9 if irregular else 1e-12)
    assert np.abs(late - seen()).max() > 1e-7


def _through_a_low_pass(time, values, constant, quality):
    """Return values behind a low pass, by hundreds of times as many rows."""
    fine = np.linspace(time[0], time[-1], 400 * time.size)
    up, down, _ = cont2discrete(((1.0,), ((quality * constant) ** 2, constant, 1.0)[not quality:]),
                                fine[1] - fine[0], 'foh')
    return np.interp(time, fine, lfilter(np.ravel(up), down, np.interp(fine, time, values)))


@pytest.mark.parametrize('irregular', [False, True])
@pytest.mark.parametrize('quality', [0.0, 0.4, 0.65])
@pytest.mark.parametrize('what, given, force', [
    ('transducer_nonlinearity', {'curvature': 0.1}, 0.0),
    ('series_compliance', {'compliance': 1e-8}, -100.0),
    ('series_compliance', {'compliance': 1e-8, 'stiffening': 0.02}, -100.0)])
def test_a_slow_sensor_sees_late_whatever_moves_it(what, given, force, quality, irregular):
    """What follows charge or force at once is shown to the sensor, too."""
    row = 9e-9  # m; it moves by 9 um in 1000 rows, and between rows the reference is a line
    time = np.arange(2001) * 1e-4
    if irregular:  # rows in which the command stands: where it moves it would stand for longer
        time = np.delete(time, [1300, 1301, 1702])
    rise = np.clip(time / 0.1, 0.0, 1.0)
    command, push = (0.0 * rise, force * rise) if force else (60.0 * rise, 0.0 * rise)

    def seen(**effects):
        return simulate(device(what, **given).with_effects(effects), time, command, push,
                        'voltage').displacement

    at_once = seen()
    slow = seen(sensor_lag={'time_constant': 0.01, 'quality_factor': quality})
    assert np.abs(at_once - slow).max() > 2e-7
    assert np.abs(slow - _through_a_low_pass(time, at_once, 0.01, quality)).max() < row
    for delay in (0.02, 0.02003):
        late = seen(sensor_delay={'delay': delay})
        assert np.abs(late[time < delay]).max() < 1e-12  # nothing before its time
        # A ramp in steps swings by some nanometres between rows.
        assert np.abs(late - np.interp(time - delay, time, at_once)).max() < row


@pytest.mark.parametrize('quality', [0.0, 0.65])
def test_what_a_slow_sensor_is_shown_goes_on_in_calls_of_any_size(quality):
    target = device('transducer_nonlinearity', curvature=0.1).with_effects(
        {'sensor_lag': {'time_constant': 0.01, 'quality_factor': quality},
         'sensor_delay': {'delay': 1.23e-3}})
    command = 60.0 * np.clip(np.arange(2000) / 1000.0, 0.0, 1.0)
    whole = Plant(target, 1e-4).run(command).displacement
    plant = Plant(target, 1e-4)
    parts = [plant.run(command[:7]).displacement, plant.run(command[7:700]).displacement]
    state = PlantState.from_dict(plant.state.to_dict())
    other = Plant(target, 1e-4)
    other.restore(state)
    assert np.array_equal(np.concatenate([*parts, other.run(command[700:]).displacement]), whole)
    with pytest.raises(InputError, match='shown besides'):
        bare = only('sensor_lag', time_constant=0.01, quality_factor=quality).with_effects(
            {'sensor_delay': {'delay': 1.23e-3}})
        Plant(bare, 1e-4).restore(state)


def test_a_sensor_that_gets_later_shows_what_it_showed_until_then():
    slow, slower = (device('sensor_delay', delay=delay) for delay in (5e-3, 1e-2))
    plant = Plant(slow, 1e-3, 'voltage', noise=False)
    before = plant.run(np.arange(40.0)).displacement
    plant.set_device(slower)
    after = plant.run(np.arange(40.0, 60.0)).displacement
    steps = np.diff(np.concatenate([before[-1:], after]))
    assert np.all(steps > -1e-10)  # the device only grows longer
    assert np.all(np.abs(after[:5] - after[0]) < 1e-10)  # it stands still for 5 ms


def test_a_second_harmonic_hums_by_itself():
    def moved(**values):
        return np.ptp(simulate(device('periodic_disturbance', **values), np.arange(400) * 1e-4,
                               np.zeros(400)).displacement)

    assert moved(displacement=0.0, harmonic=1e-8) == pytest.approx(2e-8, rel=1e-3)


@pytest.mark.parametrize('hours', [0.1, 6.0])
def test_thermal_drift_goes_on_for_hours(hours):
    seconds = hours * 3600.0
    time = np.linspace(0.0, seconds, 61)
    x = simulate(device('thermal_drift'), time, np.zeros(61)).displacement
    assert x == pytest.approx(2e-7 * (1.0 - np.exp(-time / 300.0)), abs=1e-13)


def test_a_disturbance_is_there_at_rest_with_its_amplitude_and_frequency():
    time = np.arange(4000) * 5e-5
    zero = np.zeros(4000)
    seen = simulate(device('periodic_disturbance'), time, zero).displacement
    assert seen == pytest.approx(2e-8 * np.sin(100.0 * math.pi * time), abs=1e-14)
    twice = only('periodic_disturbance', displacement=2e-8, harmonic=5e-9, harmonic_phase=1.0)
    assert simulate(twice, time, zero).displacement - seen == pytest.approx(
        5e-9 * np.sin(200.0 * math.pi * time + 1.0), abs=1e-14)
    pushed = simulate(only('periodic_disturbance', force=1.0), time, zero, drive='open')
    amplitude = abs(fundamental(time, pushed.displacement, 50.0))
    assert amplitude == pytest.approx(1.0 / 89.3333e6, rel=1e-3)


def test_a_sensor_lag_halves_the_power_at_its_bandwidth():
    (gain, lag), (base, lead) = (lags(target, 1000.0)[2] for target in (
        only('sensor_lag', time_constant=1.0 / (2.0 * math.pi * 1000.0)), IDEAL))
    assert gain / base == pytest.approx(math.sqrt(0.5), rel=1e-3)
    assert lag - lead == pytest.approx(45.0, abs=0.2)


def test_a_sensor_with_a_filter_loses_half_the_amplitude_where_each_loses_half_the_power():
    tau = 1.0 / (2.0 * math.pi * 1000.0)
    (gain, lag), (base, lead) = (lags(target, 1000.0)[2] for target in (
        only('sensor_lag', time_constant=2.0 * tau, quality_factor=0.5), IDEAL))
    assert gain / base == pytest.approx(0.5, rel=1e-3)
    assert lag - lead == pytest.approx(90.0, abs=0.3)


def test_a_quality_of_next_to_nothing_is_one_pole():
    time, voltage = sine(100.0, 0.0, 60.0, 2, 100)
    one, two = (simulate(only('sensor_lag', time_constant=1e-3, quality_factor=quality), time,
                         voltage).displacement for quality in (0.0, 1e-200))
    assert np.array_equal(one, two)


@pytest.mark.parametrize('quality', [0.3, 0.577, 0.707, 1.0])
def test_a_sensor_with_a_filter_of_second_order_has_its_quality_at_its_corner(quality):
    tau = 1.0 / (2.0 * math.pi * 1000.0)
    (gain, lag), (base, lead) = (lags(target, 1000.0)[2] for target in (
        only('sensor_lag', time_constant=tau / quality, quality_factor=quality), IDEAL))
    assert gain / base == pytest.approx(quality, rel=1e-3)
    assert lag - lead == pytest.approx(90.0, abs=0.3)


@pytest.mark.parametrize('delay', [2e-4, 2.5e-4, 3.3e-5])
def test_a_sensor_delay_shifts_the_displacement_and_nothing_else(delay):
    time, voltage = sine(100.0, 0.0, 60.0, 2, 100)  # 0.1 ms rows: whole and split ones
    plain = simulate(IDEAL, np.arange(40001) * 5e-7, np.repeat(voltage, 200)[:40001])
    late = simulate(device('sensor_delay', delay=delay), time, voltage)
    shift = round(delay / 5e-7)
    wanted = np.concatenate([np.zeros(shift), plain.displacement])[::200][:201]
    assert np.abs(late.displacement - wanted).max() < 2e-10
    assert np.abs(late.charge - plain.charge[::200]).max() < 1e-10


def test_linearity_errors_of_a_sensor_vanish_at_both_ends():
    full = build_model(IDEAL).reference.stroke
    position = full * np.array([0.0, 0.5, 1.0 / math.sqrt(3.0), 1.0])

    def error(at=position, **values):
        model = build_model(only('sensor_nonlinearity', **values))
        return (model.reading_maps[0](at, 0.0) - at) / full

    wrong = error(quadratic=0.01, cubic=0.02)
    assert wrong[[0, 3]] == pytest.approx([0.0, 0.0], abs=1e-15)
    assert wrong[2] > wrong[1] > 0.01
    # The third turns back in the middle, alike on both sides of it.
    way = np.linspace(0.0, full, 1001)
    twice = error(way, quartic=0.03)
    assert twice[[0, 500, 1000]] == pytest.approx([0.0, 0.0, 0.0], abs=1e-15)
    assert twice.max() == pytest.approx(0.03, rel=1e-4)
    assert twice == pytest.approx(twice[::-1], abs=1e-15)


@pytest.mark.parametrize('name', ['quadratic', 'cubic', 'quartic'])
def test_beyond_the_stroke_an_error_of_linearity_goes_straight_on(name):
    model = build_model(only('sensor_nonlinearity', **{name: 0.01}))
    full, read = model.reference.stroke, model.reading_maps[0]
    step = 1e-4 * full
    for end, outwards in ((0.0, -step), (full, step)):
        inside, edge, near, far = (
            read(np.array([end + k * outwards]), 0.0)[0] for k in (-1, 0, 1, 3000))
        assert edge == pytest.approx(end, abs=1e-12 * full)
        # No corner at the end, and no bend after it.
        assert near - edge == pytest.approx(edge - inside, rel=1e-3)
        assert far - edge == pytest.approx(3000 * (near - edge), rel=1e-9)
