# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Second effects beside a first one whose true form the library does not have."""

from types import SimpleNamespace

from fitters import fitter_of
import numpy as np
from piezo_stack_sim.gap import diagnose_set
from piezo_stack_sim.gap.cores import parallel
from piezo_stack_sim.gap.deciding import decision
from piezo_stack_sim.gap.deciding.ranked import DEFAULTS, Ranked
from piezo_stack_sim.gap.fitting import pairs
from piezo_stack_sim.gap.fitting.candidates import search_singles
from piezo_stack_sim.gap.fitting.fit import Fitter, TONE
from piezo_stack_sim.gap.fitting.form import Forms, LEAST
from piezo_stack_sim.gap.fitting.lens import Cells
from piezo_stack_sim.gap.fitting.pairs import merit_of, search_partners
from piezo_stack_sim.gap.measured.evidence import prepare
from piezo_stack_sim.gap.measured.forward import residuals, simulate_set, spans
from piezo_stack_sim.plant import Device, simulate
from piezo_stack_sim.recording import programmes
from piezo_stack_sim.recording.recording import RecordingSet
import pytest

NOISE = {'voltage': 5e-3, 'charge': 5e-9, 'displacement': 2e-9}


@pytest.fixture(scope='module')
def device():
    return Device.nominal()


def converted(values, period, conversion=8e-5):
    """Return what a converter with a clock of its own shows: its last finished reading."""
    time = period * np.arange(len(values))
    taken = np.maximum(np.floor(time / conversion) - 1.0, 0.0) * conversion
    return np.interp(taken, time, values)


def a_set(device, spoil=converted):
    """Return recordings with white noise, the displacement read by a slow converter."""
    random, recordings = np.random.default_rng(7), []
    for programme in (programmes.triangle(peaks=(30.0, 90.0), cycles=1), programmes.multisine()):
        answer = simulate(device, programme.time, programme.command, programme.external_force)
        measured = {name: getattr(answer, name) for name in NOISE}
        measured['displacement'] = spoil(measured['displacement'], programme.period)
        recordings.append(programme.replace(measured={
            name: values + NOISE[name] * random.standard_normal(len(programme))
            for name, values in measured.items()}))
    return RecordingSet('bench', tuple(recordings))


@pytest.fixture(scope='module')
def evidence(device):
    recordings = a_set(device).recordings
    return prepare(recordings, simulate_set(device, recordings))


def test_noise_has_the_same_power_in_every_cell(evidence):
    cells = Cells(evidence, fitted=True)
    noise = np.random.default_rng(1).standard_normal(residuals(Device.nominal(), evidence).size)
    spectrum = cells.spectrum(noise)
    seen = np.concatenate([rows.ravel() for rows in cells.blocks])
    assert np.unique(seen).size == seen.size  # no row counts twice
    assert spectrum @ spectrum == pytest.approx(noise[seen] @ noise[seen], rel=1e-9)
    assert cells.nats(noise) < 0.1 * spectrum.size
    # Ten times as loud loses the logarithm of ten in every coefficient.
    louder = cells.nats(1000.0 * noise) - cells.nats(100.0 * noise)
    assert louder == pytest.approx(spectrum.size * np.log(10.0), rel=1e-6)


def test_fitted_and_withheld_rows_have_no_cell_in_common(evidence):
    fitted, withheld = (np.concatenate([rows.ravel() for rows in Cells(evidence, each).blocks])
                        for each in (True, False))
    assert not np.intersect1d(fitted, withheld).size


def doing(does):
    """Return who simulates effects that do what is given, (N,) each, to a residual."""
    def residual_of(others, phi, fit):
        gone, = set(fit.effects) - set(others)
        return fit.residual + does[gone]

    return SimpleNamespace(residual_of=residual_of)


def leaving(residual, *effects):
    """Return what looks like a fit of some effects."""
    return SimpleNamespace(effects=dict.fromkeys(effects, {}), phi=None, residual=residual)


@pytest.fixture(scope='module')
def bursts(evidence):
    """Return noise, what an effect does now and then, and an error of its form of a tenth."""
    n = residuals(Device.nominal(), evidence).size
    random = np.random.default_rng(2)
    act = np.where(np.arange(n) % 1500 < 300, 3000.0, 0.0)
    return random.standard_normal(n), act * random.standard_normal(n), 0.1 * (
        act * random.standard_normal(n))


def test_a_wrong_form_is_told_by_what_is_left_of_what_the_effect_does(evidence, bursts):
    noise, does, wrong = bursts
    forms = Forms(doing({'creep': does}), Cells(evidence, fitted=True))
    right, poor = (forms.of(leaving(left, 'creep')) for left in (noise, noise + wrong))
    assert right.shares['creep'] == LEAST  # no better than any form is thought to be
    assert 0.07 < poor.shares['creep'] < 0.14
    # Noise costs next to nothing; what is left of a loud effect, less if its form excuses it.
    unexcused = forms.nats(leaving(noise + wrong))
    assert forms.nats(leaving(noise)) < 0.05 * unexcused
    assert forms.nats(leaving(noise + wrong, 'creep')) < 0.7 * unexcused


def test_what_the_form_of_a_loud_effect_misses_hides_nothing_where_it_does_not_act(
        evidence, bursts):
    noise, does, wrong = bursts
    forms = Forms(doing({'creep': does}), Cells(evidence, fitted=True))
    weak = np.sin(np.arange(noise.size) / 40.0)

    def deviations(look):
        seen = look(noise + wrong + weak)
        return abs(look(weak) @ seen) / np.linalg.norm(look(weak)) / np.std(seen)

    assert deviations(lambda values: values) < 2.0
    assert deviations(forms.lens(leaving(noise + wrong + weak, 'creep'))) > 5.0


def test_a_second_effect_is_dearer_as_an_error_of_form_than_as_an_effect(evidence, bursts):
    noise, does, wrong = bursts
    weak = 3.0 * np.sin(np.arange(noise.size) / 40.0)
    forms = Forms(doing({'creep': does, 'leakage': weak}), Cells(evidence, fitted=True))
    alone = leaving(noise + wrong + weak, 'creep')
    both = leaving(noise + wrong, 'creep', 'leakage')
    assert forms.nats(alone) - forms.nats(both) > DEFAULTS.formed


@pytest.mark.slow
def test_a_weak_second_effect_is_found_beside_what_the_form_of_the_first_misses(device):
    truth = device.with_effects({'asymmetric_hysteresis': {'quadratic': 0.016}})
    answer = diagnose_set(a_set(truth), device, traces=False).document
    assert answer['verdict'] == 'MULTIPLE'
    assert set(answer['selected']) == {'asymmetric_hysteresis', 'sensor_delay'}


def test_where_the_first_hardly_acts_only_another_kind_of_effect_shows(device):
    truth = device.with_effects({'asymmetric_hysteresis': {'quadratic': 0.016}})
    recordings = a_set(truth).recordings
    fitter = Fitter(device, prepare(recordings, simulate_set(device, recordings)))
    fitter.prepare(parallel)
    cells = Cells(fitter.evidence, fitted=False)
    late = {'sensor_delay': {'delay': 1.2e-4}}
    alone = fitter.fit(late)

    def clear(effect, values):
        return merit_of(fitter, cells, alone, fitter.fit({**late, effect: values}), clear=True)

    bowed = clear('asymmetric_hysteresis', {'quadratic': 0.01})
    assert bowed.clear > DEFAULTS.clear and bowed.clear_part > DEFAULTS.clear_part
    # A lag mends much of the form of a delay, but where the delay acts: not enough else to count.
    lag = clear('sensor_lag', {'time_constant': 2e-5})
    assert lag.nats > DEFAULTS.second
    assert lag.clear < DEFAULTS.clear and lag.clear_part < DEFAULTS.clear_part


@pytest.mark.slow
def test_what_the_form_of_a_lone_cause_misses_is_no_second_cause(device):
    answer = diagnose_set(a_set(device), device, traces=False).document
    assert answer['verdict'] == 'CAUSE'
    assert answer['selected'] == ['sensor_delay']


@pytest.mark.parametrize('removed, asked', [
    # Beside the lag, which leaves most, nothing may be found: the saturation is asked, too.
    (0.05, ['sensor_lag', 'amplifier_saturation']),
    (0.60, ['sensor_lag', 'amplifier_saturation']),
    (0.90, ['sensor_lag'])])
def test_beside_a_quiet_effect_in_many_rows_the_loud_one_is_asked_for_its_partners_too(
        monkeypatch, evidence, removed, asked):
    quiet = Ranked('sensor_lag', 2000.0, removed, 1, 0.7, 9.0)
    second = Ranked('amplifier_saturation', 300.0, 0.95, 1, 0.4, 9.0)
    assert asked_for_partners(monkeypatch, evidence, [quiet, second]) == asked


@pytest.mark.parametrize('removed, asked', [
    # The best may have found its place for what the other does: that may know a better one.
    (0.36, ['mechanical_resonance', 'sensor_delay']),
    (0.60, ['mechanical_resonance'])])
def test_where_no_one_explains_most_partners_are_looked_for_beside_the_next_other_kind_too(
        monkeypatch, evidence, removed, asked):
    singles = [Ranked('mechanical_resonance', 858.0, removed, 3, 0.65, 500.0),
               Ranked('added_mass', 840.0, 0.34, 1, 0.65, 510.0),
               Ranked('sensor_delay', 814.0, 0.33, 1, 0.67, 520.0)]
    resembling = {frozenset(('mechanical_resonance', 'added_mass'))}
    assert asked_for_partners(monkeypatch, evidence, singles, resembling) == asked


@pytest.mark.parametrize('left, asked', [
    # The loudest recording is left at 500 times the noise by the best alone.
    (0.1, ['sensor_lag']),  # noise
    (4.0, ['sensor_lag']),  # a hundredth of that
    (40.0, ['sensor_lag', 'amplifier_saturation'])])
def test_beside_no_other_are_partners_looked_for_once_two_leave_next_to_nothing(
        monkeypatch, evidence, left, asked):
    quiet = Ranked('sensor_lag', 2000.0, 0.05, 1, 0.7, 500.0)
    second = Ranked('amplifier_saturation', 300.0, 0.95, 1, 0.4, 90.0)
    monkeypatch.setattr(decision, 'leading_pairs', lambda fitter, search, most: list(search.fits))
    assert asked_for_partners(monkeypatch, evidence, [quiet, second], found=left) == asked


@pytest.mark.parametrize('explains, exchanged', [(12.0, []), (25.0, ['one+other'])])
def test_a_pair_of_which_the_second_explains_next_to_nothing_stands_for_no_other(
        monkeypatch, evidence, explains, exchanged):
    best = Ranked('creep', 2000.0, 0.98, 4, 0.1, 500.0)
    monkeypatch.setattr(decision, 'leading_pairs', lambda fitter, search, most: list(search.fits))
    assert searched(monkeypatch, evidence, [best], found=300.0, explains=explains)[1] == exchanged


@pytest.mark.parametrize('removed, alone', [(0.29, ['one+third']), (0.8, [])])
def test_where_no_one_explains_most_what_is_found_late_is_asked_for_each_of_two(
        monkeypatch, evidence, removed, alone):
    """A slow driver and a wrong gain: neither removes half of the gap, and both nearly all."""
    best = Ranked('amplifier_bandwidth', 331.0, removed, 2, 0.2, 245.0)
    monkeypatch.setattr(decision, 'leading_pairs',
                        lambda fitter, search, most: list(search.fits)[:1])
    assert searched(monkeypatch, evidence, [best], found=300.0, explains=300.0)[2] == alone


def asked_for_partners(*given, **settings):
    """Return the effects beside which others are looked for, in order."""
    return searched(*given, **settings)[0]


def searched(monkeypatch, evidence, singles, resembling=frozenset(), found=None, explains=0.0):
    """
    Return the effects beside which others are looked for, and the pairs that are exchanged.

    Beside each the same pair is found that leaves ``found`` times the noise power, if any, and
    of which the second explains so many nats.  Another is found where it is exchanged, and last
    are those of such that are asked what each of the two does alone.
    """
    search = SimpleNamespace(bases={}, asked=set(), fits={},
                             nominal=SimpleNamespace(residual=np.ones(9)))
    bases = []

    def partners(fitter, search, base, *rest):
        bases.append(base)
        search.asked.add(base)
        if found is not None:
            search.fits['one+other'] = SimpleNamespace(residual=None, effects={}, phi=None)

    monkeypatch.setattr(decision, '_singles', lambda *given: singles)
    monkeypatch.setattr(decision, 'search_partners', partners)
    monkeypatch.setattr(decision, 'exchange', lambda *given: None)
    monkeypatch.setattr(decision, 'polish_pairs', lambda *given: None)
    monkeypatch.setattr(decision, 'search_mended', lambda *given: None)
    exchanged, alone = [], []

    def exchange(fitter, search, name, *rest):
        exchanged.append(name)
        search.fits['one+third'] = SimpleNamespace(
            residual=None, effects={'one': {}, 'third': {}}, phi=None)

    monkeypatch.setattr(decision, 'exchange_alike', exchange)
    monkeypatch.setattr(decision, 'add_pair', lambda fitter, search, start, phi: (
        alone.append('+'.join(start)) if 'third' in start else None))
    monkeypatch.setattr(decision, 'explained', lambda *given: SimpleNamespace(nats=explains))
    removable = SimpleNamespace(share=lambda residual: 1.0)
    monkeypatch.setattr(decision, 'Removable', lambda *given: removable)
    judge = SimpleNamespace(evidence=evidence, structure=lambda residual: found, cells=None)
    monkeypatch.setattr(decision, 'Forms', lambda *given: None)
    decision.search_pairs(None, search, judge, DEFAULTS, None,
                          SimpleNamespace(resembling=resembling, kin=resembling))
    return bases, exchanged, alone


HUM = 9.37  # Hz: 1.4 periods of the shortest recording


@pytest.fixture(scope='module')
def humming(device):
    """Return a fitter of a stack with a sensor gain of 3 % and a hum of 60 nm, never in step."""
    random, recordings = np.random.default_rng(11), []
    truth = device.with_effects({'sensor_gain': {'gain_error': 0.03}})
    for programme in (programmes.triangle(), programmes.force(),
                      programmes.decay(duration=0.15)):
        answer = simulate(truth, programme.time, programme.command, programme.external_force)
        hum = 6e-8 * np.sin(2.0 * np.pi * HUM * programme.time + random.uniform(0.0, 6.0))
        measured = {'charge': answer.charge, 'displacement': answer.displacement + hum}
        recordings.append(programme.replace(measured={
            name: values + NOISE[name] * random.standard_normal(len(programme))
            for name, values in measured.items()}))
    fitter = Fitter(device, prepare(recordings, simulate_set(device, recordings)))
    fitter.prepare(parallel)
    return fitter


def test_a_hum_is_found_of_which_one_recording_holds_hardly_a_period(humming):
    line, left = humming.find_tone({'sensor_gain': {'gain_error': 0.03}},
                                   np.zeros(len(humming.nuisance.names)))
    assert line.frequency == pytest.approx(HUM, rel=2e-3)
    assert line.amplitudes[0] == pytest.approx(6e-8, rel=0.02)
    powers = [np.mean(left[where] ** 2) for where in spans(humming.evidence)]
    assert max(powers) < 1.3


def test_beside_a_hum_that_is_never_in_step_a_second_effect_explains_what_it_does(humming):
    line = {TONE: {'frequency': HUM}}
    alone, both = humming.fit(line), humming.fit({**line, 'sensor_gain': {'gain_error': 0.01}})
    cells = Cells(humming.evidence, fitted=False)
    merit = merit_of(humming, cells, alone, both)
    assert merit.nats > 100.0 and merit.part > 0.9
    # Taken off as it was, not matched anew.
    again = humming.residual_of(both.effects, both.phi, both)
    assert again == pytest.approx(both.residual, abs=1e-9)


def test_a_long_replay_keeps_in_step_with_a_hum(device):
    """A recording of 24 s is averaged over the periods of the hum: its single rows still tell."""
    random, recordings, hums = np.random.default_rng(4), [], []
    for programme in (programmes.triangle(peaks=(60.0,)), programmes.steps()):
        turn = 2.0 * np.pi * 72.4116 * programme.time
        one, two = random.uniform(0.0, 6.0, 2)
        hums.append(4e-8 * np.sin(turn + one) + 1.2e-8 * np.sin(2.0 * turn + two))
        answer = simulate(device, programme.time, programme.command)
        recordings.append(programme.replace(measured={
            'displacement': answer.displacement + hums[-1]
            + NOISE['displacement'] * random.standard_normal(len(programme))}))
    fitter = Fitter(device, prepare(recordings, simulate_set(device, recordings)))
    fitter.prepare(parallel)
    found = fitter.in_step(fitter.fit({TONE: {'frequency': 72.1}}), parallel)
    assert found.line.frequency == pytest.approx(72.4116, abs=2e-3)
    for other, recording, hum in zip(fitter.devices_of(found), recordings, hums):
        with_hum, without = (simulate(each, recording.time, recording.command).displacement
                             for each in (other, fitter.device_with({}, found.phi)))
        assert np.std(with_hum - without - hum) < 0.05 * np.std(hum)


@pytest.mark.slow
def test_what_is_loud_in_a_few_cells_is_found_whatever_explains_more_of_them(
        device, monkeypatch):
    truth = device.with_effects({
        'parallel_stiffness': {'stiffness': 1e7}, 'contact': {'gap': 3e-6, 'stiffness': 6e5},
        'stiffness_hardening': {'quadratic': 0.05, 'cubic': 0.02},
        'leakage': {'resistance': 1e8}})
    recorded = (programmes.triangle(peaks=(30.0, 90.0), cycles=1), programmes.multisine(),
                programmes.steps())
    fitter = fitter_of(device, truth, recorded, np.random.default_rng(3), NOISE)
    names = ('leakage', 'parallel_stiffness', 'stiffness_hardening', 'contact')
    search = search_singles(fitter, lambda message: None, names)
    # What mends the form of the first leads by cells.
    monkeypatch.setattr(pairs, '_leading', lambda gains, most, near=0.0: [])
    search_partners(fitter, search, 'parallel_stiffness', lambda message: None, names)
    found = search.fits['leakage+parallel_stiffness'].effects
    assert found['leakage']['resistance'] == pytest.approx(1e8, rel=0.05)


@pytest.mark.parametrize('lost, best', [
    ({0: 3086.0, pairs.ALONE_STEPS: 6120.0}, 3086.0),  # the other hardly matters
    ({0: 9000.0, pairs.ALONE_STEPS: 6120.0}, 6120.0)])
def test_one_of_two_is_asked_alone_from_where_it_loses_less(monkeypatch, lost, best):
    def fit(effects, phi, steps):
        return SimpleNamespace(effects=effects, phi=phi, nats=lost[steps])

    def better(one, other):
        return one.nats < other.nats

    forms = SimpleNamespace(fitter=SimpleNamespace(fit=fit), better=better)
    monkeypatch.setattr(pairs, '_settled', lambda forms, start, weighings: start)
    pair = SimpleNamespace(effects={'leakage': {}, 'amplifier_gain': {}}, phi=np.zeros(3))
    alone = pairs._alone(forms, 'leakage', pair)
    assert alone.nats == best and list(alone.effects) == ['leakage']


@pytest.mark.slow
def test_what_resembles_a_pair_is_judged_where_neither_of_the_two_was_asked_alone(device):
    true = device.with_effects({'sensor_lag': {'time_constant': 5e-5},
                                'sensor_gain': {'gain_error': 0.02}})
    fitter = fitter_of(device, true, [programmes.triangle(cycles=1), programmes.multisine()],
                       np.random.default_rng(3), NOISE)
    search = search_singles(fitter, str, ('sensor_lag', 'sensor_delay', 'sensor_gain',
                                          'amplifier_gain'))
    name = pairs.pair_of('sensor_lag', 'sensor_gain')
    search.fits[name] = fitter.fit({**search.fits['sensor_lag'].effects,
                                    **search.fits['sensor_gain'].effects})
    asked = pairs.exchange_alike(fitter, search, name, {
        frozenset(('sensor_lag', 'sensor_delay')), frozenset(('sensor_gain', 'amplifier_gain'))},
        str)
    forms = Forms(fitter, Cells(fitter.evidence, fitted=True))
    late, driven = asked
    assert (late, driven) == (pairs.pair_of('sensor_delay', 'sensor_gain'),
                              pairs.pair_of('sensor_lag', 'amplifier_gain'))
    nats = {each: pairs.explained(forms, search, each).nats for each in [name, *asked]}
    # The voltage was measured: a wrong gain of the driver explains nothing beside the lag.
    assert nats[name] > nats[driven] and nats[late] > nats[driven]


@pytest.mark.parametrize('share, exchanged', [
    pytest.param(1.0, False, marks=pytest.mark.slow), (1.5, True)])
def test_who_is_stuck_at_a_bound_may_stand_for_what_its_form_is_like(device, share, exchanged):
    true = device.with_effects({'amplifier_bandwidth': {'output_resistance': 20.0},
                                'sensor_gain': {'gain_error': 0.02}})
    fitter = fitter_of(device, true, [programmes.triangle(cycles=1), programmes.multisine()],
                       np.random.default_rng(3), NOISE)
    search = search_singles(fitter, str, ('amplifier_current_limit', 'amplifier_bandwidth',
                                          'sensor_gain'))
    name = pairs.pair_of('amplifier_current_limit', 'sensor_gain')
    limit = {'limit': 0.05, 'sink_share': share, 'output_resistance': 2.0}
    search.fits[name] = fitter.fit({'amplifier_current_limit': limit,
                                    **search.fits['sensor_gain'].effects}, steps=0)
    assert bool(search.fits[name].stuck) == exchanged
    asked = pairs.exchange_alike(fitter, search, name, (), str)
    other = pairs.pair_of('amplifier_bandwidth', 'sensor_gain')
    assert (other in asked) == exchanged
    if exchanged:
        assert search.fits[other].cost < search.fits[name].cost


def test_one_of_two_is_exchanged_for_another_as_that_was_found_alone(device):
    limit, slow = 'amplifier_current_limit', 'amplifier_bandwidth'
    true = {'limit': 0.04, 'sink_share': 0.7, 'output_resistance': 16.0, 'rise': 1.0}
    fitter = fitter_of(device, device.with_effects({
        limit: true, 'transducer_ratio': {'ratio_error': -0.06}}), [
        programmes.triangle(cycles=1), programmes.multisine()], np.random.default_rng(3), NOISE)
    search = search_singles(fitter, str, (limit, slow, 'transducer_ratio'))
    found = search.fits[limit].effects[limit]
    assert found['limit'] == pytest.approx(true['limit'], rel=0.3)
    name = pairs.pair_of(slow, 'transducer_ratio')
    search.fits[name] = fitter.fit({**search.fits[slow].effects,
                                    **search.fits['transducer_ratio'].effects}, steps=6)
    pairs.exchange_alike(fitter, search, name, {frozenset((limit, slow))}, str)
    other = search.fits[pairs.pair_of(limit, 'transducer_ratio')]
    assert other.cost < 1.1 * fitter.rows.size < 0.5 * search.fits[name].cost
    assert other.effects[limit]['limit'] == pytest.approx(true['limit'], rel=0.05)


def test_both_of_a_pair_that_stand_for_others_are_exchanged_at_once(device):
    true = device.with_effects({'sensor_lag': {'time_constant': 3e-4},
                                'transducer_ratio': {'ratio_error': -0.06}})
    fitter = fitter_of(device, true, [programmes.triangle(cycles=1), programmes.multisine()],
                       np.random.default_rng(3), NOISE)
    names = ('sensor_lag', 'sensor_delay', 'sensor_gain', 'transducer_ratio')
    search = search_singles(fitter, str, names)
    wrong = pairs.pair_of('sensor_delay', 'sensor_gain')
    search.fits[wrong] = fitter.fit({**search.fits['sensor_delay'].effects,
                                     **search.fits['sensor_gain'].effects})
    asked = pairs.exchange_both(fitter, search, wrong, {
        frozenset(('sensor_lag', 'sensor_delay')),
        frozenset(('sensor_gain', 'transducer_ratio'))}, str)
    right = pairs.pair_of('sensor_lag', 'transducer_ratio')
    assert asked == [right]
    assert search.fits[right].cost < 1.1 * fitter.rows.size < 0.5 * search.fits[wrong].cost
    # The nominal ratio may take a part of its error, but nothing else comes late.
    late = search.fits[right].effects['sensor_lag']['time_constant']
    assert late == pytest.approx(3e-4, rel=0.02)
    assert {'sensor_lag', 'transducer_ratio'} <= set(search.bases)  # to be judged by
