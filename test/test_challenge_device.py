# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""The generator's own physics: it is the paper's device, and every hidden effect shows."""

from dataclasses import replace
import gzip
from pathlib import Path

import numpy as np
from piezo_stack_sim.challenge import case, programmes
from piezo_stack_sim.challenge.case import EFFECTS, schedule
from piezo_stack_sim.challenge.device import Programme, respond, STEP, Unit
from piezo_stack_sim.challenge.foreign import FOREIGN
from piezo_stack_sim.challenge.guide import AT_FIRST, guide_of, kept, rub
from piezo_stack_sim.challenge.hidden import BLOCKS, Context
from piezo_stack_sim.challenge.known import KNOWN
from piezo_stack_sim.challenge.memory import RESOLUTION
from piezo_stack_sim.challenge.mount import mount_of, relax, speeds, yields_to
from piezo_stack_sim.challenge.sensing import measure, Sensing
from piezo_stack_sim.challenge.structure import sway
from piezo_stack_sim.challenge.unforeseen import UNFORESEEN
import pytest
from scipy.integrate import solve_ivp

REFERENCE = Path(__file__).resolve().parents[2] / 'shared' / 'reference'
DOC = Path(__file__).resolve().parents[1] / 'doc' / 'challenge.md'

#: Seconds instead of half a minute: every kind of excitation once.
SHORT = programmes.Plan(
    triangle_rate=5e3, triangle_frequency=20.0, triangle_peaks=(90.0,),
    decay_rate=10e3, decay_frequency=200.0, steps_rate=500.0, steps_hold=0.4,
    steps_levels=(0.0, 60.0, 20.0), multisine_rate=20e3, multisine_top=3000.0,
    force_frequency=20.0, force_rate=5e3)


@pytest.fixture(scope='module')
def recordings():
    """Return the short programmes."""
    return programmes.programmes(SHORT)


@pytest.fixture(scope='module')
def plain(recordings):
    """Return the responses of the device in which nothing is hidden."""
    return [respond(Unit(), programme) for programme in recordings]


@pytest.mark.skipif(not REFERENCE.is_dir(), reason='reference recordings are not here')
@pytest.mark.parametrize('name', ['triangle', 'decay', 'multisine', 'force', 'steps'])
def test_the_device_without_effects_is_the_papers(name):
    """An independent computation of the same equations agrees within a nanometre."""
    with gzip.open(REFERENCE / f'{name}.csv.gz', 'rt') as stream:
        columns = stream.readline().strip().split(',')
        rows = dict(zip(columns, np.loadtxt(stream, delimiter=',').T))
    channels = respond(Unit(), Programme(name, rows['time'], rows['voltage_command'],
                                         rows['external_force']))
    assert np.abs(channels['displacement'] - rows['displacement']).max() < 1e-9
    assert np.abs(channels['charge'] - rows['charge']).max() < 1e-8
    assert np.abs(channels['voltage'] - rows['voltage']).max() < 1e-9


def test_a_smaller_step_changes_nothing_that_a_sensor_could_see(recordings, plain):
    """The step is small enough, in the fastest programme too."""
    for programme, channels in zip(recordings, plain):
        finer = respond(Unit(), programme, step=0.25 * STEP)
        assert np.abs(finer['displacement'] - channels['displacement']).max() < 4e-10


@pytest.mark.parametrize('key, parameters', [
    ('amplifier_ringing', {'frequency': 3e3, 'damping': 0.03}),
    ('amplifier_ringing', {'frequency': 1.2e4, 'damping': 0.1}),
])
def test_a_smaller_step_changes_nothing_in_what_is_hidden(key, parameters, recordings):
    """Nor is it too large for what the device itself does not have."""
    unit = EFFECTS[key].apply(Unit(), **parameters)
    programme = next(p for p in recordings if p.name == 'multisine')
    once, finer = respond(unit, programme), respond(unit, programme, step=0.25 * STEP)
    assert np.abs(finer['displacement'] - once['displacement']).max() < 1e-9
    assert np.abs(finer['voltage'] - once['voltage']).max() < 1e-6


def quick():
    """Return the beginning of the multisine of the withheld rounds: rows of 20 us."""
    whole = programmes.programmes(replace(programmes.Plan(), names=('multisine',)))[0]
    return Programme('multisine', *(
        rows[:2000] for rows in (whole.time, whole.command, whole.force)))


LIMITED = {'sinks': 0.75, 'first': 0.35, 'second': 0.2, 'third': 3e-3}


@pytest.mark.parametrize('parts', [
    {'amplifier_current_limit': {**LIMITED, 'limit': 0.1, 'resistance': 25.0}},
    {'amplifier_bandwidth': {'time_constant': 4e-6, 'inner': 0.1, 'quiescent': 0.2}},
    {'amplifier_bandwidth': {'time_constant': 5e-5, 'inner': 0.1, 'quiescent': 0.02}},
    {'amplifier_bandwidth': {'time_constant': 1e-5, 'inner': 0.1, 'quiescent': 0.05},
     'amplifier_current_limit': {**LIMITED, 'limit': 0.1, 'resistance': 8.0}},
])
def test_a_driver_that_charge_must_wait_for_needs_no_smaller_step(parts):
    """However soon the charge has followed: within the step, or in many."""
    unit = Unit()
    for key, parameters in parts.items():
        unit = EFFECTS[key].apply(unit, **parameters)
    programme = quick()
    once, finer = respond(unit, programme), respond(unit, programme, step=0.125 * STEP)
    assert np.abs(finer['displacement'] - once['displacement']).max() < 8e-10
    assert np.abs(finer['voltage'] - once['voltage']).max() < 4e-3


def test_a_payload_needs_no_smaller_step():
    """Its joint is quicker than the stack."""
    unit, programme = EFFECTS['added_mass'].apply(
        Unit(), mass=3e-3, joint_frequency=6.5e4), quick()
    once, finer = respond(unit, programme), respond(unit, programme, step=0.125 * STEP)
    assert np.abs(finer['displacement'] - once['displacement']).max() < 1.3e-9


def test_a_reading_between_two_points_lies_on_the_motion():
    """A clock of the sensor's own reads where the trace has no points."""
    t, omega = 4e-6 * np.arange(5001), 2.0 * np.pi * 5e3
    trace = np.stack([t, 0.0 * t, 0.0 * t, 1e-6 * np.sin(omega * t), 0.0 * t,
                      1e-6 * omega * np.cos(omega * t)])
    time = t[10::5]
    read = measure(Sensing(conversion_latency=1.7e-6), trace, time, 0)['displacement']
    assert np.abs(read - 1e-6 * np.sin(omega * (time - 1.7e-6))).max() < 1e-11


@pytest.mark.parametrize('key, parameters', [
    ('crossover', {'voltage': 1.0, 'current': 1e-3}),
    ('crossover', {'voltage': 0.05, 'current': 1e-4}),
    ('amplifier_ringing', {'frequency': 3e3, 'damping': 0.03}),
    ('rate_dependent_hysteresis', {'growth': 0.1, 'reference': 6e-3}),
])
def test_rows_in_which_nothing_changes_change_nothing(key, parameters, recordings):
    """A command said again while it holds is the same command."""
    unit = EFFECTS[key].apply(Unit(), **parameters)
    triangle = next(p for p in recordings if p.name == 'triangle')
    t = np.arange(4 * triangle.time.size) * 0.25 * triangle.time[1]
    again = Programme('again', t, np.repeat(triangle.command, 4), 0.0 * t)
    once, more = respond(unit, triangle), respond(unit, again)
    for channel, seen in (('displacement', 1e-9), ('charge', 1e-8)):
        assert np.abs(more[channel][::4] - once[channel]).max() < seen


@pytest.mark.parametrize('key, parameters', [
    ('rate_dependent_hysteresis', {'growth': 0.06, 'reference': 6e-3}),
    ('self_heating', {'growth': 5e-3, 'current': 2e-3, 'time_constant': 0.05}),
    ('crossover', {'voltage': 1.0, 'current': 1e-3}),
])
def test_a_jump_is_a_very_quick_rise(key, parameters):
    """An output that needs 0.03 us for it leaves the same, followed in steps that see that."""
    unit = EFFECTS[key].apply(Unit(), **parameters)
    t = 5e-5 * np.arange(600)
    command = 30.0 + 25.0 * np.sin(2.0 * np.pi * 100.0 * t) * np.minimum(t / 5e-3, 1.0)
    programme = Programme('sine', t, command * np.minimum(t / 5e-3, 1.0), 0.0 * t)
    at_once = respond(unit, programme)
    quickly = respond(unit.change(stack={'output_resistance': 0.03}), programme, step=5e-8)
    assert np.abs(quickly['displacement'] - at_once['displacement']).max() < 1e-9
    assert np.abs(quickly['charge'] - at_once['charge']).max() < 1e-8


def test_what_happened_is_kept_as_finely_as_a_sensor_could_see(recordings):
    """Kept more finely it leaves the same, however often it went to and fro."""
    effect = EFFECTS['creep']
    unit = effect.apply(Unit(), **effect.draw(np.random.default_rng(5), Context(90.0, 1.24e-5)))
    programme = next(p for p in recordings if p.name == 'decay')
    once = respond(unit, programme)['displacement']
    finer = respond(unit, programme, resolution=0.25 * RESOLUTION)['displacement']
    assert np.abs(finer - once).max() < 1e-10


def test_every_effect_of_the_design_is_hidden_in_some_form():
    """The ids and blocks are those of the design document."""
    assert len(KNOWN) == 27
    assert len(KNOWN) + len(FOREIGN) + len(UNFORESEEN) == len(EFFECTS)
    assert {effect.block for effect in EFFECTS.values()} == set(BLOCKS)
    assert all(effect.form for effect in EFFECTS.values())


@pytest.mark.parametrize('key', sorted(EFFECTS))
def test_a_hidden_effect_alters_its_channels_and_no_others(key, recordings, plain):
    """Voltage stays the amplifier's, charge the stack's, and each effect shows where it should."""
    effect = EFFECTS[key]
    random = np.random.default_rng(5)
    context = Context(top=90.0, stroke=1.24e-5)
    # The largest of a few draws: the smallest ones are below what half a second can show.
    changed = dict.fromkeys(('voltage', 'charge', 'displacement'), 0.0)
    for _ in range(3):
        unit = effect.apply(Unit(), **effect.draw(random, context))
        for index, (programme, before) in enumerate(zip(recordings, plain)):
            after = respond(unit, programme, index)
            for channel in changed:
                assert np.isfinite(after[channel]).all()
                changed[channel] = max(changed[channel],
                                       np.abs(after[channel] - before[channel]).max())
    floor = {'voltage': 1e-4, 'charge': 1e-10, 'displacement': 1e-10}
    for channel, size in changed.items():
        if channel in effect.channels:
            assert size > floor[channel], channel
        else:
            assert size < 1e-6 * floor[channel], channel


@pytest.mark.parametrize('key', ['creep', 'mount_creep', 'friction', 'added_mass',
                                 'amplifier_current_limit', 'sensor_delay'])
def test_holds_are_quiet(key, recordings):
    """Coarse steps take over from small ones without a jump that could be seen."""
    effect = EFFECTS[key]
    unit = effect.apply(Unit(), **effect.draw(np.random.default_rng(3), Context(90.0, 1.24e-5)))
    programme = next(p for p in recordings if p.name == 'steps')
    x = respond(unit, programme)['displacement']
    hold = (programme.time > 1.1) & (programme.time < 1.55)
    assert np.abs(np.diff(x[hold], 2)).max() < 2e-10


@pytest.mark.parametrize('frequency', [600.0, 4000.0])
def test_a_structure_left_alone_comes_to_rest(frequency):
    """However hard it was knocked, and however little is lost in it: it is passive."""
    t = 4e-6 * np.arange(30000)
    base = 2e-5 * np.sin(np.pi * np.clip(t * frequency, 0.0, 1.0)) ** 2
    for part in ((1.0, 0.0), (0.0, 1.0)):
        swung = sway(t, base, (frequency, 1.7 * frequency), 0.012, 6e-3 / frequency, part)
        loud = [np.sqrt(np.mean(each ** 2)) for each in np.split(swung, 10)]
        assert np.abs(swung).max() < 2e-4
        assert loud[-1] < 0.2 * loud[1] < loud[0]
    assert all(late < early for early, late in zip(loud, loud[1:]) if early > 1e-12)


@pytest.mark.parametrize('force', [0.03, 8.0])
def test_a_guide_only_takes_energy(force):
    """Whichever way it is moved, and however fast."""
    random, (first, second) = np.random.default_rng(2), guide_of(force, 8e-8, 0.7)
    h = 2e-6
    state, stored = np.append(0.0 * first, AT_FIRST), 0.0
    for speed, steps in zip(random.normal(0.0, 2e-3, 300), random.integers(1, 300, 300)):
        speed = 0.0 if random.random() < 0.1 else speed
        for _ in range(steps):
            after, before = rub(first, second, 0.05, state, speed * h, h), stored
            stored = kept(second, state)
            assert after * speed * h - (stored - before) > -1e-18 * force
        assert abs(after) < 2.0 * force
        if speed == 0.0:
            state[-1] += AT_FIRST


@pytest.mark.parametrize('way', [2.5e-6, 6e-6])
def test_a_mount_yields_as_its_law_says(way):
    """To a hundredth of a nanometre at the end, moved to and fro as in a decay and then held."""
    shares, times = mount_of(20.0, 0.15)

    def place(t):
        faded = 0.5 - 0.5 * np.cos(np.pi * np.minimum(t / 0.01, 1.0))
        swing = np.exp(-t / 0.04) * np.sin(400.0 * np.pi * t) * (t < 0.1)
        return 6e-6 * faded * (1.0 + 0.9 * swing)

    t = np.append(2e-5 * np.arange(5001), 0.1 + 1e-3 * np.arange(1, 2001))
    exact = shares @ solve_ivp(lambda t, y: speeds(shares, times, way, y, place(t)), (0.0, t[-1]),
                               np.zeros(times.size), 'LSODA', t, rtol=1e-8, atol=1e-15,
                               max_step=1e-3).y
    yielded, worst = np.zeros(times.size), 0.0
    for i, h in enumerate(np.diff(t)):
        ends = place(t[i:i + 2])
        stays = yields_to(shares, times, way, yielded, ends.mean(), h)
        relax(shares, times, way, yielded, ends.mean(), h)
        assert shares @ yielded == pytest.approx(stays, abs=2e-11)
        worst = max(worst, abs(shares @ yielded - exact[i + 1]))
    assert worst < 1e-10
    assert exact[-1] > 1e-6


@pytest.mark.parametrize('way', [2.5e-6, 6e-6])
def test_a_mount_only_takes_energy(way):
    """Whichever way it is moved, and it carries nothing in the end."""
    random, (shares, times) = np.random.default_rng(2), mount_of(10.0, 0.1)
    yielded, x, stored, work = np.zeros(times.size), 0.0, 0.0, 0.0
    for target, h in zip(random.normal(0.0, 8e-6, 500), 10.0 ** random.uniform(-5.0, 0.5, 500)):
        work += shares @ (0.5 * (x + target) - yielded) * (target - x)
        x = target
        relax(shares, times, way, yielded, x, h)
        stored = 0.5 * shares @ (x - yielded) ** 2
        assert stored < work + 1e-24
    relax(shares, times, way, yielded, x, 1e3)
    assert np.abs(x - yielded).max() < 1e-15


@pytest.mark.parametrize('limit, sinks', [(6e-3, 0.6), (0.03, 0.8), (0.1, 0.7)])
@pytest.mark.parametrize('first, second, third', [(0.1, 0.2, 3e-3), (0.35, 0.2, 3e-2)])
def test_a_driver_at_its_limit_arrives_no_sooner_than_that_allows(
        limit, sinks, first, second, third):
    """It sinks less than it sources, hangs nowhere on its way, and hardly overshoots."""
    unit = KNOWN['amplifier_current_limit'].apply(
        Unit(), limit=limit, sinks=sinks, resistance=8.0, first=first, second=second, third=third)
    t = 2e-5 * np.arange(15001)
    command = np.select([t < 0.1, t < 0.2], [100.0, 5.0], 100.0) * (t > 2e-3)
    out = respond(unit, Programme('square', t, command, 0.0 * t))
    charge, rows = out['charge'], [4999, 9999, 14999]
    assert np.abs(out['voltage'][rows] - command[rows]).max() < 1e-3
    up, down = charge[rows[0]] - charge[0], charge[rows[0]] - charge[rows[1]]
    took = []
    for start, way in ((2e-3, up), (0.1, -down)):
        after = (t > start) & (t < start + 0.09)
        part = np.abs(charge[after] - charge[after][0]) / abs(way)
        took.append(np.interp(0.9, part, t[after]) - np.interp(0.1, part, t[after]))
        current = np.diff(charge[after]) / 2e-5 * np.sign(way)
        most = limit if way > 0.0 else sinks * limit
        assert current[5:].max() < 1.6 * most
        assert 0.5 < 0.8 * abs(way) / took[-1] / most < 1.4
    assert took[1] / down > took[0] / up
    # The stack still rings as the limit lets go, and drives a current back: 4 mV.
    assert -1e-6 < out['voltage'].min() and out['voltage'].max() < 100.006


def test_a_random_remanence_is_one_that_a_voltage_history_leaves():
    """Running the same history once more on top changes nothing: it is consistent."""
    unit = KNOWN['initial_polarisation'].apply(Unit(), peak=60.0, seed=4, faded=0.0)
    again = unit.change(history=unit.history + unit.history)
    t = np.arange(200) * 1e-3
    programme = Programme('rise', t, 40.0 * t / t[-1], 0.0 * t)
    first, second = respond(unit, programme), respond(again, programme)
    assert np.allclose(first['displacement'], second['displacement'], atol=1e-10)
    assert np.ptp(first['displacement']) < np.ptp(respond(Unit(), programme)['displacement'])


def test_single_effects_are_hidden_equally_often():
    """A batch goes round the whole list before an effect comes again."""
    hidden = [ids[0] for kind, ids in schedule(300, 7) if kind == 'one']
    counts = [hidden.count(key) for key in KNOWN]
    assert max(counts) - min(counts) <= 1


def test_what_is_unforeseen_is_hidden_only_where_it_is_asked_for():
    """One of them in each device, none in a batch of the usual kind."""
    asked = schedule(12, 7, unforeseen=True)
    assert {ids for _, ids in asked} == {(key,) for key in UNFORESEEN}
    assert {kind for kind, _ in asked} == {'absent'}
    assert not set(UNFORESEEN) & {key for _, ids in schedule(300, 7) for key in ids}


@pytest.mark.skipif(not DOC.is_file(), reason='no doc folder')
def test_the_documentation_says_how_each_effect_is_hidden():
    """The tables of the page are those of the code."""
    page = DOC.read_text()
    for key, effect in EFFECTS.items():
        assert f'| `{key}` | {effect.block} | {effect.form} |' in page


def test_what_the_curve_of_the_file_may_take_is_not_visible():
    random = np.random.default_rng(5)
    setting = case.draw_setting(random, ('creep',))
    recordings = programmes.programmes(SHORT)[:1]
    moved, _ = case.sensitivities(setting, recordings)
    clean = case.responses(setting.clean, recordings)

    def seen(**changes):
        stack = setting.clean.stack
        other = replace(setting.clean, stack=stack._replace(
            **{name: getattr(stack, name) * factor for name, factor in changes.items()}))
        errors = case.difference(setting, case.responses(other, recordings), clean)
        raw = max(float(np.sqrt(np.mean(error ** 2))) for _, _, error in errors)
        return max(case.visibility(setting, errors, moved).values()), raw

    within, raw = seen(V=1.008)
    assert within < 0.05 * raw
    beyond, _ = seen(V=1.08)  # ten times as much, and far beyond what the file admits
    assert beyond > 20.0 * within
