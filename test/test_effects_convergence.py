# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Results do not depend on how finely the plant works, with any effect and with all."""

from effect_probes import ALL, IDEAL, mixed
import numpy as np
from piezo_stack_sim.plant import simulate, tables
import pytest

NANOMETRE = 1e-9
CASES = [*ALL, 'all']


def target(case):
    """Return the device of a case."""
    return IDEAL.with_effects(ALL if case == 'all' else {case: ALL[case]})


def steps():
    """Return a staircase with rows of 1 ms, as a controller gives."""
    time = np.arange(400) * 1e-3
    level = np.repeat([0.0, 30.0, 60.0, 90.0, 40.0, 70.0, 10.0, 0.0], 50)
    return time, level, np.where(time > 0.17, -20.0, 0.0)


def random():
    """Return a noisy command with rows of 0.1 ms."""
    draws = np.random.default_rng(3)
    time = np.arange(600) * 1e-4
    voltage = np.clip(45.0 + np.cumsum(draws.normal(0.0, 3.0, 600)), 0.0, 90.0)
    return time, voltage, -30.0 + np.cumsum(draws.normal(0.0, 1.0, 600))


PROBES = {'mixed': mixed, 'steps': steps, 'random': random}
everything = [pytest.mark.parametrize('case', CASES), pytest.mark.parametrize('probe', PROBES)]


@everything[0]
@everything[1]
def test_half_the_tick_changes_less_than_a_nanometre(case, probe, monkeypatch):
    time, voltage, force = PROBES[probe]()
    coarse = simulate(target(case), time, voltage, force).displacement
    monkeypatch.setattr(tables, 'TICK', tables.TICK / 2.0)
    fine = simulate(target(case), time, voltage, force).displacement
    assert np.abs(fine - coarse).max() < NANOMETRE


def change_on_finer_rows(device, probe, parts):
    """Return by how much the displacement (m) changes when each row is given in parts."""
    time, voltage, force = PROBES[probe]()
    coarse = simulate(device, time, voltage, force).displacement
    period = time[1] - time[0]
    rows = parts * (time.size - 1) + 1
    fine = simulate(device, np.arange(rows) * period / parts,
                    np.repeat(voltage, parts)[:rows], np.repeat(force, parts)[:rows]).displacement
    return np.abs(fine[::parts] - coarse).max()


@everything[0]
@everything[1]
@pytest.mark.parametrize('parts', [2, 7])
def test_commands_repeated_on_finer_rows_change_less_than_a_nanometre(case, probe, parts):
    device = target(case)
    if case == 'all':  # what it makes of a bow is told below
        device = IDEAL.with_effects({name: values for name, values in ALL.items() if name not in {
            'sensor_lag', 'transducer_nonlinearity'}})
    assert change_on_finer_rows(device, probe, parts) < NANOMETRE


@pytest.mark.parametrize('parts', [2, 7])
def test_a_slow_sensor_sees_a_bow_as_it_grows_from_row_to_row(parts):
    """At once behind an ideal driver, and a joint that closes; late or not."""
    for name in ('transducer_nonlinearity', 'series_compliance'):
        for late in (('sensor_lag',), ('sensor_delay',), ('sensor_lag', 'sensor_delay')):
            device = IDEAL.with_effects({each: ALL[each] for each in (name, *late)})
            assert change_on_finer_rows(device, 'steps', parts) < NANOMETRE


@pytest.mark.parametrize('case', ['creep', 'mount_creep', 'leakage', 'thermal_drift', 'all'])
def test_long_memories_do_not_need_short_rows(case):
    # Three hours: once with rows of a minute, once with rows of a second.
    minutes = np.where((np.arange(181) // 30) % 2 == 0, 60.0, 20.0)
    effects = {name: values for name, values in ALL.items() if name != 'sensor_delay'}
    device = IDEAL.with_effects(effects if case == 'all' else {case: ALL[case]})
    coarse = simulate(device, np.arange(181) * 60.0, minutes)
    fine = simulate(device, np.arange(180 * 60 + 1) * 1.0, np.repeat(minutes, 60)[:10801])
    assert np.abs(coarse.displacement - fine.displacement[::60]).max() < NANOMETRE
    assert np.abs(coarse.charge - fine.charge[::60]).max() < 1e-5 * np.ptp(fine.charge)


def test_rows_that_grow_with_the_decades_of_creep_equal_a_fine_grid():
    spread = np.concatenate([[0.0], np.logspace(-3, 2, 26)])
    x = simulate(target('creep'), spread, np.full(spread.size, 5.0)).displacement
    grid = np.arange(100001) * 1e-3
    fine = simulate(target('creep'), grid, np.full(grid.size, 5.0)).displacement
    assert np.abs(x - np.interp(spread, grid, fine))[1::5].max() < NANOMETRE


@pytest.mark.parametrize('other', ['friction', 'creep', 'asymmetric_hysteresis'])
def test_a_resistance_too_small_to_matter_changes_less_than_a_nanometre(other):
    # Its rounding must not show as motion either: that would lead to events without end.
    time, voltage, force = steps()
    without = simulate(target(other), time, voltage, force).displacement
    for ohm in (1e-9, 1e-3, 6e-3):
        small = IDEAL.with_effects({other: ALL[other], 'amplifier_bandwidth': {
            'output_resistance': ohm, 'time_constant': 0.0}})
        x = simulate(small, time, voltage, force).displacement
        assert np.abs(x - without).max() < NANOMETRE
