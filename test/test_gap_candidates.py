# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Hypotheses that could pass for what they are not, and true ones that must not be lost.

What is lost is tried in the library's own form: it asks of the search alone.
"""

from dataclasses import replace
from types import SimpleNamespace

from fitters import fitter_of
import numpy as np
from piezo_stack_sim.effects.registry import EFFECTS
from piezo_stack_sim.gap.fitting.candidates import (
    _disappointed, _from_relatives, is_idle, Probe, Search, search_singles, tune, tune_as_best)
from piezo_stack_sim.gap.fitting.descent import _bounded_step, descend, Landscape
from piezo_stack_sim.gap.fitting.fit import _inverse, Fit, Fitter
from piezo_stack_sim.gap.fitting.nominal import Nuisance
from piezo_stack_sim.gap.fitting.pairs import _promise
from piezo_stack_sim.gap.fitting.starts import extent_of, Place, starts_of
from piezo_stack_sim.gap.fitting.swings import apart, History
from piezo_stack_sim.gap.measured.forward import (
    followed, residuals, settling_time, simulate_set, spans)
from piezo_stack_sim.plant import Device, simulate
from piezo_stack_sim.recording import programmes
import pytest


@pytest.fixture(scope='module')
def device():
    return Device.nominal()


def searched(fitter, effect):
    """Return the numbers with which an effect is found among others."""
    search = search_singles(fitter, lambda message: None,
                            (effect, 'amplifier_saturation', 'stiffness_hardening'))
    return search.fits[effect].effects[effect]


def unit_of(device, seed, **effects):
    """Return what fits a unit whose parameters scatter within their uncertainty."""
    random, nuisance = np.random.default_rng(seed), Nuisance(device)
    unit = nuisance.apply(device, nuisance.bound * random.uniform(-1, 1, nuisance.bound.size))
    return fitter_of(device, unit.with_effects(effects), (
        programmes.triangle(), programmes.steps(), programmes.decay()), random)


@pytest.mark.parametrize('seed', [20, 22, 27, 30, 31, 32])
def test_a_unit_within_its_uncertainty_is_tuned_to_the_noise(device, seed):
    # Break voltages make side valleys: from these units one look does not come out of them.
    fitter = unit_of(device, seed)
    assert tune(fitter).cost < 1.02 * fitter.rows.size


@pytest.mark.parametrize('effect, seed', [
    pytest.param({'creep': {'gain_per_decade': 0.01}}, 30, marks=pytest.mark.slow),
    pytest.param({'sensor_nonlinearity': {'quadratic': 0.01}}, 36, marks=pytest.mark.slow),
    ({'parallel_stiffness': {'stiffness': 3e6}}, 37)])
def test_the_best_effect_is_led_out_of_side_valleys_of_the_parameters_too(device, effect, seed):
    fitter = unit_of(device, seed, **effect)
    search = search_singles(fitter, lambda message: None, (*effect, 'sensor_lag'))
    assert search.best.cost < 1.05 * fitter.rows.size


@pytest.mark.parametrize('near, comes', [(3.0, True), (1.0, False)])
def test_parameters_that_an_effect_found_are_tried_without_it(device, near, comes):
    fitter = unit_of(device, 30)
    # As left in a valley, and what an effect that does nothing found beside another.
    stuck, free = fitter.fit({}, steps=0), tune(fitter)
    search = Search(stuck, {'creep': replace(free, effects={'creep': {'gain_per_decade': 0.0}}),
                            'creep+sensor_lag': stuck})  # two that never did any better
    least = near if comes else near * free.cost / stuck.cost / 2.0
    assert tune_as_best(fitter, search, least) == comes
    assert (search.nominal.cost < 1.02 * fitter.rows.size) == comes
    assert set(search.fits['creep+sensor_lag'].effects) == (
        {'creep', 'sensor_lag'} if comes else set())


@pytest.mark.parametrize('effects, idle', [
    ({'amplifier_bandwidth': {'output_resistance': 20.0}}, True),
    ({'amplifier_current_limit': {'limit': 0.05, 'output_resistance': 2.0}}, False)])
def test_a_limit_that_the_current_never_meets_is_no_cause(device, effects, idle):
    # The resistance of a limiter explains that of a driver, and its limit nothing.
    fitter = fitter_of(device, device.with_effects(effects), (
        programmes.triangle(peaks=(30.0, 90.0), cycles=1), programmes.multisine()),
        np.random.default_rng(7))
    fit = min((fitter.fit({'amplifier_current_limit': {'limit': limit}}, steps=12)
               for limit in (0.05, 0.2)), key=lambda fit: fit.cost)
    assert fit.cost < 1.05 * fitter.rows.size  # it explains everything either way
    assert is_idle(fitter, fit, 'amplifier_current_limit') == idle


@pytest.mark.parametrize('limit, idle', [(0.06, False), (0.08, True)])
def test_a_limit_counts_that_a_loud_resistance_hides(device, limit, idle):
    fitter = fitter_of(device, device.with_effects({'amplifier_current_limit': {
        'limit': limit, 'output_resistance': 16.0, 'rise': 1.0}}), (
        programmes.triangle(peaks=(30.0, 90.0), cycles=1), programmes.multisine()),
        np.random.default_rng(7))
    fit = min((fitter.fit({'amplifier_current_limit': {
        'limit': start, 'output_resistance': 16.0, 'rise': 1.0}}, steps=12)
        for start in (0.05, 0.1)), key=lambda fit: fit.cost)
    held = {'amplifier_current_limit': {**fit.effects['amplifier_current_limit'], 'limit': 100.0}}
    fall = fitter.fit(held, fit.phi, steps=0).cost - fit.cost
    assert fall < 0.01 * (fitter.fit({}, fit.phi, steps=0).cost - fit.cost)
    assert (fall > 0.02 * fitter.rows.size) == (not idle)
    assert is_idle(fitter, fit, 'amplifier_current_limit') == idle


@pytest.mark.parametrize('bow, idle', [(7.6e-4, False), (2e-3, True)])
def test_a_limit_counts_that_takes_most_of_what_its_resistance_leaves(device, bow, idle):
    # Its fall is next to nothing of what the resistance explains, and something else is left.
    limit = {'limit': 0.06, 'output_resistance': 16.0, 'rise': 1.0}
    fitter = fitter_of(device, device.with_effects({
        'amplifier_current_limit': limit, 'sensor_nonlinearity': {'quadratic': bow}}), (
        programmes.triangle(peaks=(30.0, 90.0), cycles=1), programmes.multisine()),
        np.random.default_rng(7))
    fit = fitter.fit({'amplifier_current_limit': limit}, steps=12)
    held = {'amplifier_current_limit': {**fit.effects['amplifier_current_limit'], 'limit': 100.0}}
    noise, without = fitter.rows.size, fitter.fit(held, fit.phi, steps=0).cost
    assert fit.cost > 1.05 * noise
    assert without - fit.cost < 0.01 * (fitter.fit({}, fit.phi, steps=0).cost - fit.cost)
    assert (without - fit.cost > 0.5 * (without - noise)) == (not idle)
    assert is_idle(fitter, fit, 'amplifier_current_limit') == idle


def test_a_driver_with_a_lag_and_a_limit_has_one_resistance(device):
    limit, slow = 'amplifier_current_limit', 'amplifier_bandwidth'
    true = {limit: {'limit': 0.05, 'output_resistance': 16.0}, slow: {'time_constant': 2e-5}}
    fitter = fitter_of(device, device.with_effects(true), (
        programmes.triangle(peaks=(30.0, 90.0), cycles=1), programmes.multisine()),
        np.random.default_rng(7))
    fit = fitter.fit({slow: {'time_constant': 1e-5, 'output_resistance': 12.0},
                      limit: {'limit': 0.07, 'output_resistance': 1.0}}, steps=12)
    assert fit.cost < 1.02 * fitter.rows.size
    assert fit.effects[slow]['output_resistance'] == 0.0
    assert [free.effect for free in fit.free
            if free.parameter.name == 'output_resistance'] == [limit]
    assert fit.effects[limit]['output_resistance'] == pytest.approx(16.0, rel=0.03)
    assert fit.effects[slow]['time_constant'] == pytest.approx(2e-5, rel=0.1)


@pytest.mark.parametrize('gap, idle', [(5e-6, False), (1e-8, True)])
def test_a_stop_without_a_gap_is_a_spring(device, gap, idle):
    unit = device.with_effects({'contact': {'gap': gap, 'stiffness': 5e6}})
    fitter = fitter_of(device, unit, (programmes.triangle(peaks=(30.0, 90.0), cycles=1),),
                       np.random.default_rng(3))
    fit = fitter.fit({'contact': {'gap': max(gap, 1e-7), 'stiffness': 5e6}}, steps=12)
    assert fit.cost < 1.05 * fitter.rows.size  # it explains everything either way
    assert is_idle(fitter, fit, 'contact') == idle


@pytest.mark.parametrize('effect, values', [
    # Many periods of the fastest command, from where a fit walks into the next dip.
    ('sensor_delay', {'delay': 1.14e-3}),
    ('command_delay', {'delay': 1.15e-3}),
    # Heavier than a hundred stacks.
    ('added_mass', {'mass': 0.9}),
    # A broad one, between the usual places.
    ('mechanical_resonance', {'participation': -0.05, 'frequency': 1825.0,
                              'damping_ratio': 0.11})])
def test_an_effect_is_found_where_no_usual_place_is_near(device, effect, values):
    random = np.random.default_rng(5)
    fitter = fitter_of(device, device.with_effects({effect: values}), (
        programmes.triangle(peaks=(30.0, 90.0), cycles=1), programmes.multisine()), random)
    found = searched(fitter, effect)
    for name, value in values.items():
        assert found[name] == pytest.approx(value, rel=0.05)


def test_a_filter_that_swings_is_found_in_slow_recordings_too(device):
    # What they show of it is no time, and grows with the square of its times: no line from none.
    given = {'time_constant': 4e-5, 'quality_factor': 0.6}
    fitter = fitter_of(device, device.with_effects({'sensor_lag': given}), (
        programmes.triangle(peaks=(30.0, 90.0)), programmes.decay(rate=10e3)),
        np.random.default_rng(5))
    found = searched(fitter, 'sensor_lag')
    assert found == pytest.approx(given, rel=0.1)


@pytest.mark.parametrize('swings', [
    (18.6, 0.0, 0.0), pytest.param((42.0, -9.0, 25.0), marks=pytest.mark.slow)])
def test_earlier_swings_are_found_to_the_noise(device, swings):
    # From neither side do derivatives lead there: at each volt another element slips.
    names = 'peak_voltage', 'turn_voltage', 'return_voltage'
    unit = device.with_effects({'initial_polarisation': dict(zip(names, swings))})
    fitter = fitter_of(device, unit, (programmes.triangle(), programmes.steps()),
                       np.random.default_rng(8))
    search = search_singles(fitter, lambda message: None, (
        'initial_polarisation', 'asymmetric_hysteresis', 'stiffness_hardening'))
    assert search.nominal.cost > 10.0 * fitter.rows.size
    assert search.fits['initial_polarisation'].cost < 1.1 * fitter.rows.size


@pytest.mark.parametrize('starts, peaks', [
    ((40.0, 55.0), [50.0]), ((-30.0, 55.0, 40.0), [50.0, -20.0])])
def test_swings_that_meet_are_searched_once(starts, peaks):
    # Two valleys, the one at 50 V the deeper, each with a turn at a quarter of its peak, back.
    def cost(place):
        peak, turn, _ = place.values()
        nearest = min((50.0, -20.0), key=lambda valley: abs(peak - valley))
        return 1e3 + (0.0 if nearest > 0.0 else 200.0) + (peak - nearest) ** 2 + (
            turn + 0.25 * nearest) ** 2

    names = 'peak_voltage', 'turn_voltage', 'return_voltage'
    histories = [History('initial_polarisation', dict(zip(names, (start, 0.0, 0.0))), cost)
                 for start in starts]
    found = apart([history.first() for history in histories])
    assert [led.place['peak_voltage'] for led in found] == pytest.approx(peaks, rel=0.02)
    whole = histories[0].others(found[0])
    assert whole.place['turn_voltage'] == pytest.approx(-0.25 * peaks[0], abs=1.0)
    assert whole.cost < found[0].cost


@pytest.mark.parametrize('cost, starts', [
    (10.0, ['command_delay']), (80.0, ['command_delay']), (97.0, [])])
def test_a_delay_is_started_where_a_lag_does_better(cost, starts):
    # Of 39 us, read every 50 us: a fit from none goes back to none.
    phi = np.zeros(2)
    search = Search(Fit({}, phi, np.empty(0), 100.0))
    search.fits = {
        'command_delay': Fit({'command_delay': {'delay': 0.0}}, phi, np.empty(0), 100.0),
        'sensor_lag': Fit({'sensor_lag': {'time_constant': 4e-5}}, phi + 1.0, np.empty(0), cost),
        'thermal_drift': Fit({'thermal_drift': {}}, phi, np.empty(0), 100.0)}
    places = _from_relatives(search)
    assert [name for name, _, _ in places] == starts
    assert all(place == {'delay': 4e-5} and (there == 1.0).all() for _, place, there in places)


def test_a_current_limit_is_started_with_the_resistance_of_a_slow_driver():
    phi = np.zeros(2)
    search = Search(Fit({}, phi, np.empty(0), 100.0))
    driver = {'output_resistance': 24.0, 'time_constant': 2e-6}
    search.fits = {
        'amplifier_bandwidth': Fit({'amplifier_bandwidth': driver}, phi + 1.0, np.empty(0), 8.0),
        'amplifier_current_limit': Fit({}, phi, np.empty(0), 100.0),
        'leakage': Fit({'leakage': {'resistance': 1e9}}, phi, np.empty(0), 8.0),
        'rate_dependent_hysteresis': Fit({}, phi, np.empty(0), 100.0)}
    search.probes = {name: [] for name in search.fits}
    search.probes['amplifier_current_limit'] = [
        Probe('amplifier_current_limit', {'limit': limit, 'sink_share': 1.0,
                                          'output_resistance': 1.0}, np.ones((1, 1)), gain, gain)
        for limit, gain in ((0.02, 3.0), (0.01, 1.0))]
    # What only bears the same name is nothing that they share.
    assert [(name, place) for name, place, _ in _from_relatives(search)] == [
        ('amplifier_current_limit', {'limit': limit, 'sink_share': 1.0, 'output_resistance': 24.0})
        for limit in (0.02, 0.01)]


def test_who_promised_most_and_kept_nothing_sets_out_from_nothing():
    phi = np.zeros(2)
    look = Place({'onset': 1e-3}, {'quadratic': 0.02, 'branch': 0.003})
    costs = {'asymmetric_hysteresis': 100.0, 'stiffness_hardening': 50.0, 'creep': 100.0,
             'sensor_gain': 60.0}
    gains = {'asymmetric_hysteresis': 80.0, 'stiffness_hardening': 70.0, 'creep': 40.0,
             'sensor_gain': 90.0}
    search = Search(Fit({}, phi + 0.3, np.empty(0), 100.0), {
        name: Fit({}, phi, np.empty(0), cost) for name, cost in costs.items()}, {
        name: [Probe(name, {}, None, gain, gain, look)] for name, gain in gains.items()})
    (name, place, start), = _disappointed(search)
    assert name == 'asymmetric_hysteresis'
    assert place == {'onset': 1e-3, 'quadratic': 0.0, 'branch': 0.0}
    assert np.array_equal(start, phi)


@pytest.mark.parametrize('frequency', [460.0, 1167.0, 1420.0])
def test_a_light_resonance_is_found_wherever_it_lies(device, frequency):
    mode = {'participation': 0.05, 'frequency': frequency, 'damping_ratio': 0.016}
    fitter = fitter_of(device, device.with_effects({'mechanical_resonance': mode}), (
        programmes.decay(), programmes.triangle()), np.random.default_rng(4),
        {'displacement': 5e-10})
    found = searched(fitter, 'mechanical_resonance')
    assert found['frequency'] == pytest.approx(frequency, rel=0.02)


@pytest.mark.parametrize('frequency', [1670.0, 2080.0, 2600.0])
def test_a_sharp_resonance_beside_a_late_sensor_is_seen_from_close_by(device, frequency):
    mode = {'participation': -0.2, 'frequency': frequency, 'damping_ratio': 0.01}
    late = {'sensor_delay': {'delay': 3e-5}}
    fitter = fitter_of(device, device.with_effects({**late, 'mechanical_resonance': mode}), (
        programmes.multisine(), programmes.triangle()), np.random.default_rng(4),
        {'displacement': 5e-9})
    places = [place for place in starts_of(EFFECTS['mechanical_resonance'], extent_of(
        fitter.evidence, fitter.base)) if place.shape['frequency'] != frequency]
    nominal = fitter.fit(late)

    def promise(place):
        values, = place.looks
        moved = fitter.residual_of({**late, 'mechanical_resonance': values}, nominal.phi)
        gain, factors = fitter.linear_gain((moved - nominal.residual)[:, None], nominal)
        return gain, place.at(EFFECTS['mechanical_resonance'], factors)

    _, best = max(map(promise, places), key=lambda promised: promised[0])
    assert best['frequency'] == pytest.approx(frequency, rel=0.05)
    found = fitter.fit({**late, 'mechanical_resonance': best}, nominal.phi)
    found = found.effects['mechanical_resonance']
    assert found['frequency'] == pytest.approx(frequency, rel=0.01)
    assert found['participation'] < -0.1


def test_what_only_the_other_way_would_gain_promises_nothing(device):
    fitter = fitter_of(device, device.with_effects({'sensor_gain': {'gain_error': 0.02}}),
                       (programmes.triangle(),), np.random.default_rng(4))
    nominal = fitter.fit({}, held=True)
    place = Place({}, {'gain_error': 0.01})
    moved = fitter.residual_of({'sensor_gain': {'gain_error': 0.01}}, nominal.phi)
    there = (moved - nominal.residual)[:, None]

    def gain(direction, low, high):
        return fitter.linear_gain(direction, nominal, lambda f: np.clip(f, low, high))

    whole, factors = fitter.linear_gain(there, nominal)
    assert place.at(EFFECTS['sensor_gain'], factors)['gain_error'] == pytest.approx(0.02, rel=0.2)
    assert gain(there, 0.0, np.inf) == (pytest.approx(whole), pytest.approx(factors))
    assert gain(-there, 0.0, np.inf) == (pytest.approx(0.0, abs=1e-6 * whole), 0.0)
    # Half of the way of a parabola is three quarters of its fall.
    assert gain(there, 0.0, factors / 2.0)[0] == pytest.approx(0.75 * whole)


@pytest.mark.parametrize('wanted, bound', [((5.0, -4.0), 1.0), ((0.5, -3.0), 1.0),
                                           ((4.0, 4.0), 2.0), ((0.3, -0.7), 1.0)])
def test_a_look_within_bounds_promises_what_is_best_there(wanted, bound):
    """Of two strengths that are much alike, one cut off would leave the other to do harm."""
    random = np.random.default_rng(8)
    one, other = random.standard_normal((2, 400))
    directions = np.column_stack([one, one + 0.2 * other])
    left = -directions @ wanted + 0.1 * random.standard_normal(400)
    rows = SimpleNamespace(cleared=lambda each, fit: each,
                           view=lambda fit: SimpleNamespace(left=left))
    gain, factors = Fitter.linear_gain(rows, directions, None,
                                       lambda f: np.clip(f, -bound, bound))
    assert np.abs(factors).max() <= bound + 1e-9
    tried = np.array(np.meshgrid(*2 * (np.linspace(-bound, bound, 401),))).reshape(2, -1)
    falls = left @ left - np.sum((left[:, None] + directions @ tried) ** 2, axis=0)
    assert gain == pytest.approx(falls.max(), rel=1e-3)
    assert factors == pytest.approx(tried[:, falls.argmax()], abs=0.02)


def test_a_second_effect_that_would_have_to_be_negative_promises_nothing(device):
    delay = {'command_delay': {'delay': 2e-5}}
    fitter = fitter_of(device, device.with_effects(delay), (programmes.triangle(),),
                       np.random.default_rng(4))
    nominal = fitter.fit({}, held=True)
    late = (fitter.residual_of(delay, nominal.phi) - nominal.residual)[:, None]
    place = Place({}, {'delay': 2e-5}, dense=True)
    gain, _, there = _promise(fitter, nominal, Probe('command_delay', {}, late, look=place))
    assert gain > 1e3 and there['delay'] == pytest.approx(2e-5, rel=0.05)
    gain, _, there = _promise(fitter, nominal, Probe('command_delay', {}, -late, look=place))
    assert gain == pytest.approx(0.0, abs=1e-3) and there['delay'] == 0.0


@pytest.mark.parametrize('frequency', [230.0, 900.0, 3300.0])
def test_a_resonance_that_only_follows_is_looked_at_without_simulating_it(device, frequency):
    # In rows that are further apart than the stack needs to follow, and in such that are not.
    fitter = fitter_of(device, device, (programmes.multisine(), programmes.decay(),
                                        programmes.steps()), np.random.default_rng(4))
    mode = {'participation': 0.1, 'frequency': frequency, 'damping_ratio': 0.03}
    shown = simulate_set(device, [track.recording for track in fitter.evidence.tracks])
    told = followed(fitter.evidence, shown, EFFECTS['mechanical_resonance'].answer(**mode),
                    settling_time(device))
    true = residuals(device.with_effects({'mechanical_resonance': mode}), fitter.evidence)
    true = true - fitter.base
    # The direction tells, and not its length.
    for where in [slice(None), *(where for (_, channel), where in zip(
            fitter.evidence.keys, spans(fitter.evidence)) if channel == 'displacement')]:
        assert told[where] @ true[where] > 0.95 * np.linalg.norm(
            told[where]) * np.linalg.norm(true[where])
    assert not any(np.any(told[where]) for (_, channel), where in zip(
        fitter.evidence.keys, spans(fitter.evidence)) if channel == 'charge')


@pytest.mark.parametrize('mass', [4.4e-3, pytest.param(0.0137, marks=pytest.mark.slow)])
def test_a_mass_on_a_joint_is_found_by_slow_recordings_alone(device, mass):
    # A resonance that is moved is seen from one place of the ladder, and hardly from the next.
    fitter = fitter_of(device, device.with_effects({'added_mass': {
        'mass': mass, 'joint_frequency': 6.32e4}}), (
            programmes.triangle(), programmes.steps(), programmes.force(cycles=1)),
        np.random.default_rng(4))
    search = search_singles(fitter, lambda message: None, ('added_mass', 'sensor_lag'))
    assert search.fits['added_mass'].cost < 1.05 * fitter.rows.size  # to the noise
    assert search.fits['added_mass'].effects['added_mass']['mass'] == pytest.approx(mass, rel=0.02)


@pytest.mark.parametrize('part', [0.3, 0.66, 0.9])
@pytest.mark.parametrize('effect', ['command_delay', 'sensor_delay'])
def test_a_delay_within_the_time_between_two_rows_is_found_past_its_hills(device, effect, part):
    # Between two commands the stack swings, and the gap goes up and down with the delay.
    delay = part * programmes.decay().period
    fitter = fitter_of(device, device.with_effects({effect: {'delay': delay}}), (
        programmes.decay(), programmes.triangle()), np.random.default_rng(5),
        {'displacement': 1e-9})
    # A first fit stops on a kink nearby; the next valley is half as far or twice.
    assert searched(fitter, effect)['delay'] == pytest.approx(delay, rel=0.05)


def test_places_close_together_do_not_make_a_delay_a_relative_of_everything(device):
    effect = EFFECTS['command_delay']
    fitter = fitter_of(device, device, (programmes.decay(),), np.random.default_rng(5),
                       {'displacement': 1e-9})
    places = starts_of(effect, extent_of(fitter.evidence, fitter.base))
    within = [place.looks[0]['delay'] for place in places if place.dense]
    period = programmes.decay().period
    assert np.diff([0.0, *within]).max() < 0.1 * period and max(within) >= 0.99 * period
    assert 3 <= sum(not place.dense for place in places) < len(within)


def test_a_driver_faster_than_the_rows_is_found_by_its_voltage(device):
    # The lag of 6 us hardly shows in rows 50 us apart, and twice the resistance makes far more.
    numbers = {'output_resistance': 17.6, 'time_constant': 6e-6}
    fitter = fitter_of(device, device.with_effects({'amplifier_bandwidth': numbers}), (
        programmes.decay(), programmes.steps(), programmes.triangle()), np.random.default_rng(9),
        {'voltage': 1.4e-3})
    found = searched(fitter, 'amplifier_bandwidth')
    assert found['output_resistance'] == pytest.approx(numbers['output_resistance'], rel=0.1)


def test_a_current_limit_that_is_rarely_met_is_found_under_noise(device):
    # The difference of noisy rows of charge, 50,000 a second, is a larger current than any.
    limit = {'limit': 0.039, 'output_resistance': 1.3}
    fitter = fitter_of(device, device.with_effects({'amplifier_current_limit': limit}), (
        programmes.triangle(), programmes.multisine()), np.random.default_rng(6))
    found = searched(fitter, 'amplifier_current_limit')
    assert found['limit'] == pytest.approx(limit['limit'], rel=0.05)


def test_a_stop_met_at_the_end_of_the_way_is_found(device):
    # From the first two places to set out from, a softer stop and one met earlier, it is not.
    programme = programmes.triangle()
    way = simulate(device, programme.time, programme.command,
                   programme.external_force).displacement.max()
    stop = {'gap': 0.95 * way, 'stiffness': 16e6}
    fitter = fitter_of(device, device.with_effects({'contact': stop}), (programme,),
                       np.random.default_rng(3))
    found = searched(fitter, 'contact')
    assert found['gap'] == pytest.approx(stop['gap'], rel=0.01)
    assert found['stiffness'] == pytest.approx(stop['stiffness'], rel=0.1)


def test_derivatives_that_are_alike_do_not_end_the_search():
    """They differ by many orders of size besides: nothing of the smaller ones may be lost."""
    column = np.array([[3.0, 3.0, 1e-9, 0.0], [3.0, 3.0, 2e-9, 1.0]])
    square = 1e12 * column.T @ column
    inverse = _inverse(square + np.diag([0.0, 0.0, 0.0, 1.0]))
    told = column @ inverse @ column.T * 1e12
    assert told == pytest.approx(np.eye(2), abs=1e-3)


def test_numbers_cost_what_the_rows_narrow_them_down(device):
    unit = device.with_effects({'sensor_nonlinearity': {'quadratic': 0.01}})
    recorded = (programmes.triangle(peaks=(30.0, 90.0), cycles=1), programmes.force(cycles=1))

    def spent(effect, start, noise):
        fitter = fitter_of(device, unit, recorded, np.random.default_rng(2), {
            'charge': 10.0 * noise, 'displacement': noise})
        return fitter.spent(fitter.fit({effect: start}))

    bow = {'quadratic': 0.01, 'cubic': 1e-4, 'quartic': 1e-4}
    coarse, fine = (spent('sensor_nonlinearity', bow, noise) for noise in (2e-9, 1e-9))
    # Each of three numbers is known twice as well.
    assert fine - coarse == pytest.approx(3.0 * np.log(2.0), abs=0.1)
    # Where a bowed transducer is right is much what the nominal ratio tells, and costs less.
    assert 5.0 < spent('transducer_nonlinearity', {'curvature': 0.01}, 1e-9) < fine
    fitter = fitter_of(device, device, recorded, np.random.default_rng(2))
    assert fitter.spent(fitter.fit({})) == 0.0


@pytest.mark.parametrize('seed', range(8))
def test_a_step_goes_as_far_as_its_bounds_allow_however_unlike_these_are(seed):
    random = np.random.default_rng(seed)
    n, damping = 12, 1e-3
    tall = random.standard_normal((40, n)) * 10.0 ** random.uniform(-3, 3, n)
    square, slope = tall.T @ tall, tall.T @ (100.0 * random.standard_normal(40))
    scale = np.sqrt(np.diag(square))
    # A number at its bound, one that is as good as free, and all between.
    low = -10.0 ** random.uniform(-8, 1, n) / scale
    high = 10.0 ** random.uniform(-8, 24, n) / scale
    step = _bounded_step(square, np.zeros(n), slope, damping, low, high)
    assert np.all(step >= low) and np.all(step <= high)
    downhill = -(square @ step + damping * scale ** 2 * step + slope) / scale
    floor = 1e-5 * np.abs(slope / scale).max()
    inside = (step > low + 1e-9 / scale) & (step < high - 1e-9 / scale)
    assert inside.any() and not inside.all()
    assert np.abs(downhill[inside]).max() < floor
    assert np.all(downhill[step <= low + 1e-9 / scale] < floor)
    assert np.all(downhill[step >= high - 1e-9 / scale] > -floor)


def test_a_step_that_hardly_moves_an_effect_teaches_nothing_about_it():
    """Else what the nominal parameters do would count as sensitivity: an interval of nothing."""
    random = np.random.default_rng(11)
    basis, _ = np.linalg.qr(random.standard_normal((400, 3)))
    effect, nominal, bent = 20.0 * basis.T

    def residual(walk, phi):
        return effect * walk[0] + nominal * (phi[0] - 0.5) + bent * (phi[0] - 0.5) ** 2

    landscape = Landscape(residual, lambda values: values, np.array([-1.0]), np.array([1.0]),
                          np.array([1.0]), np.array([10.0]))
    end = descend(landscape, np.array([1e-7]), np.zeros(1), None, 1)
    assert 0.1 < end.phi[0] and abs(end.walk[0]) < 1e-6
    assert np.linalg.norm(end.effect[:, 0] - effect) < np.linalg.norm(effect)
