# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the library lacks is told from what it has by what each leaves, the numbers re-tuned."""

import math

import numpy as np
from piezo_stack_sim.effects.registry import EFFECTS
from piezo_stack_sim.gap import diagnose_set
from piezo_stack_sim.gap.cores import parallel
from piezo_stack_sim.gap.fitting.fit import Fitter
from piezo_stack_sim.gap.lacking.along import suspect_pitch
from piezo_stack_sim.gap.lacking.answered import suspect_filter
from piezo_stack_sim.gap.lacking.course import Course
from piezo_stack_sim.gap.lacking.in_series import capacitor_in_series
from piezo_stack_sim.gap.lacking.meeting import meet, meet_one
from piezo_stack_sim.gap.lacking.strangers import PLAY
from piezo_stack_sim.gap.measured.evidence import prepare
from piezo_stack_sim.gap.measured.forward import simulate_set
from piezo_stack_sim.gap.measured.where import block_residuals
from piezo_stack_sim.plant import Device, simulate
from piezo_stack_sim.recording import programmes
from piezo_stack_sim.recording.recording import RecordingSet
import pytest
from scipy import signal

NOISE = {'voltage': 5e-3, 'charge': 5e-9, 'displacement': 2e-9}
ALL = ('voltage', 'charge', 'displacement')


def slow(*case):
    """Return a case that another one tells most of."""
    return pytest.param(*case, marks=pytest.mark.slow)


@pytest.fixture(scope='module')
def device():
    return Device.nominal()


def a_set(device, channels=ALL, spoil=None, played=None, lively=False, given=None):
    """Return recordings of a device, what it answers and what it was played spoilt perhaps."""
    given = given or [
        programmes.triangle(peaks=(30.0, 90.0), cycles=2), programmes.steps(hold=1.5),
        programmes.multisine(periods=2) if lively else programmes.force(cycles=2)]
    recordings = []
    for seed, programme in enumerate(given):
        random = np.random.default_rng(seed)
        command = played(programme) if played else programme.command
        answer = simulate(device, programme.time, command, programme.external_force)
        clean = {name: getattr(answer, name) for name in ALL}
        clean |= spoil(device, programme, clean) if spoil else {}
        recordings.append(programme.replace(measured={
            name: clean[name] + NOISE[name] * random.standard_normal(len(programme))
            for name in channels}))
    return RecordingSet('bench', tuple(recordings))


def fitter_of(device, recordings):
    """Return a fitter for a set and the fit of the nominal device."""
    rows = recordings.recordings
    fitter = Fitter(device, prepare(rows, simulate_set(device, rows)))
    fitter.prepare(parallel)
    return fitter, fitter.fit({})


def runs_slow(device, programme, clean):
    """Return the displacement as a clock reads it that runs 0.4 % slow."""
    return {'displacement': np.interp(
        0.996 * programme.time, programme.time, clean['displacement'])}


def has_play(device, programme, clean):
    """Return a displacement that follows with a play of 30 nm."""
    follower, out = clean['displacement'][0], []
    for place in clean['displacement']:
        follower = min(max(follower, place - 1.5e-8), place + 1.5e-8)
        out.append(follower)
    return {'displacement': np.array(out)}


def leaks(device, programme, clean):
    """Return a displacement into which the voltage leaks."""
    return {'displacement': clean['displacement'] - 1.1e-9 * clean['voltage']}


def forgets(device, programme, clean):
    """Return a charge that a high-pass filter of the first order lets through, of 9 s."""
    b, a = signal.butter(1, 1.0 / (2.0 * np.pi * 9.0), 'high', fs=1.0 / programme.period)
    return {'charge': signal.lfilter(b, a, clean['charge'])}


def jumps(device, programme, clean):
    """Return charge and displacement of a domain that turns at 70 V, and back at 20 V."""
    actuator = device.actuator
    turned, state = [], 0.0
    for voltage in clean['voltage']:
        state = 1.0 if voltage > 70.0 else 0.0 if voltage < 20.0 else state
        turned.append(state)
    ratio, cap = actuator.transformer_ratio, actuator.linear_capacitance
    per_charge = ratio / (ratio ** 2 + actuator.stiffness * cap)
    return {'charge': clean['charge'] + 4e-7 * np.array(turned),
            'displacement': clean['displacement'] + 4e-7 * per_charge * np.array(turned)}


def finely(device, programme, parts=40):
    """Return times and displacement within the rows, ``parts`` of each."""
    time = np.arange(parts * len(programme)) * programme.period / parts
    return time, simulate(device, time, np.repeat(programme.command, parts),
                          np.repeat(programme.external_force, parts)).displacement


def is_averaged(device, programme, clean):
    """Return the displacement as a recorder gives it that averages each row."""
    time, place = finely(device, programme)
    middle = np.append(0.5 * (place[1:] + place[:-1]), place[-1])
    return {'displacement': np.append(
        place[0], middle.reshape(len(programme), -1).mean(axis=1)[:-1])}


def starts_anyhow(device, programme, clean):
    """Return the displacement by a recorder that is started 0.2 to 3 ms late, each time anew."""
    time, place = finely(device, programme)
    late = {'triangle': 1.3e-3, 'steps': 2.9e-3, 'force': 3e-4, 'multisine': 6e-4,
            'decay': 2e-4, 'slower': 2.1e-3}[programme.name]
    return {'displacement': np.interp(programme.time - late, time, place)}


def wanders(device, programme, clean):
    """Return the displacement as a clock reads it that is fast at first, and slow at the end."""
    time = programme.time
    end = time[-1]
    late = 1.5e-4 * end * np.sin(4.2 * time / end) * (time / end) ** 0.5
    return {'displacement': np.interp(time - late, time, clean['displacement'])}


def warms(device, programme, clean):
    """Return what a ratio makes that grows by the current of the last 0.3 s."""
    stack = device.actuator
    other = simulate(device.replace(actuator=stack.replace(
        transformer_ratio=1.02 * stack.transformer_ratio)), programme.time, programme.command,
        programme.external_force)
    current = np.abs(np.gradient(clean['charge'], programme.time))
    decay = np.exp(-programme.period / 0.3)
    warm = 150.0 * signal.lfilter([1.0 - decay], [1.0, -decay], current / (1.0 + current / 0.02))
    return {name: clean[name] + warm * (getattr(other, name) - clean[name])
            for name in ('charge', 'displacement')}


def warms_up(programme):
    """Return a command beside which an offset of 80 mV grows, slower and slower."""
    return programme.command + 0.08 * programme.time / (programme.time + 2.0)


def reads_by(channel, factor=1.0, lag=None, shift=0.0):
    """Return what makes of a channel what its amplifier reads, by its own clock."""
    def spoil(device, programme, clean):
        values = factor * np.interp(programme.time - shift, programme.time, clean[channel])
        if lag is not None:
            decay = np.exp(-programme.period / lag)
            start = values[0]
            values = start + signal.lfilter([1.0 - decay], [1.0, -decay], values - start)
        return {channel: values}

    return spoil


@pytest.mark.parametrize('channel, factor, lag, shift, says', [
    slow('charge', 1.05, None, 0.0, 'reads about 5.0 % too much'),
    slow('charge', 0.96, None, 0.0, 'reads about 4.0 % too little'),
    slow('charge', 1.0, 2e-3, 0.0, 'has a lag of about 2.0 ms'),
    slow('voltage', 1.03, None, 0.0, 'reads about 3.0 % too much'),
    slow('voltage', 1.0, 5e-4, 0.0, 'has a lag of about 500 µs'),
    slow('charge', 1.0, None, 3e-4, 'comes late by about 300 µs'),
    ('voltage', 1.0, None, -1e-3, 'comes early by about 1.0 ms')])
def test_a_reading_that_is_wrong_alone_is_known_by_how_much(
        device, channel, factor, lag, shift, says):
    fitter, nominal = fitter_of(
        device, a_set(device, spoil=reads_by(channel, factor, lag, shift)))
    met = meet(fitter, nominal)
    assert met.suspect.block == 'sensor' and channel in met.suspect.reason
    assert met.misread == channel
    assert says in met.suspect.reason
    assert np.mean(met.residual ** 2) - 1.0 < 0.05


@pytest.mark.slow
@pytest.mark.parametrize('channel, channels', [
    ('charge', ALL), ('charge', ('charge', 'displacement')), ('voltage', ALL)])
def test_no_two_effects_are_found_for_a_reading_with_another_gain(device, channel, channels):
    """They would have to cancel in the displacement, which is right."""
    answer = diagnose_set(a_set(device, channels, reads_by(channel, 1.04)), device,
                          traces=False).document
    assert answer['verdict'] == 'UNKNOWN' and answer['where']['block'] == 'sensor'
    assert f'the {channel} is wrong by a factor' in answer['reason']


@pytest.mark.slow
@pytest.mark.parametrize('effect', ['amplifier_gain', 'amplifier_bandwidth', 'leakage'])
def test_what_is_wrong_and_followed_is_no_wrong_reading(device, effect):
    recordings = a_set(device.with_effects({effect: EFFECTS[effect].typical()}))
    answer = diagnose_set(recordings, device, traces=False).document
    assert answer['selected'] == [effect]


@pytest.mark.parametrize('spoil, played, channels, block', [
    (runs_slow, None, ('displacement',), 'sensor'), slow(has_play, None, ALL, 'mechanical'),
    slow(leaks, None, ALL, 'sensor'), slow(forgets, None, ALL, 'sensor'),
    slow(jumps, None, ('charge', 'displacement'), 'electrical'),
    slow(warms, None, ALL, 'transducer'), slow(is_averaged, None, ALL, 'sensor'),
    slow(starts_anyhow, None, ('displacement',), 'sensor'),
    (wanders, None, ('displacement',), 'sensor'),
    slow(None, warms_up, ('charge', 'displacement'), 'drive')])
def test_a_stranger_is_known_by_what_it_leaves_beside_re_tuned_parameters(
        device, spoil, played, channels, block):
    stack = device.actuator
    other = device.replace(actuator=stack.replace(
        stiffness=1.012 * stack.stiffness, transformer_ratio=0.992 * stack.transformer_ratio))
    # Of slow motions a mean over a row is what a sample is.
    recordings = a_set(other, channels, spoil, played, lively=spoil is is_averaged)
    fitter, nominal = fitter_of(device, recordings)
    met = meet(fitter, nominal)
    assert met.suspect.block == block
    gap = np.mean(nominal.residual ** 2) - 1.0
    assert gap > 0.1 and np.mean(met.residual ** 2) - 1.0 < 0.25 * gap


@pytest.mark.slow
@pytest.mark.parametrize('effect', [
    'thermal_drift', 'initial_polarisation', 'sensor_lag', 'friction', 'creep'])
def test_no_stranger_takes_the_place_of_what_the_library_has(device, effect):
    recordings = a_set(device.with_effects({effect: EFFECTS[effect].typical()}))
    answer = diagnose_set(recordings, device, traces=False).document
    assert effect in {*answer['selected'], *answer['ambiguity_set']}


@pytest.mark.slow
@pytest.mark.parametrize('spoil, why', [
    (is_averaged, 'mean over its row'), (starts_anyhow, 'late by another time'),
    (wanders, 'by a time that wanders')])
def test_what_the_recorder_did_is_no_cause(device, spoil, why):
    # At two rates: at one, a mean over a row is a delay like any other.
    given = [programmes.multisine(), programmes.decay(), programmes.multisine(
        band=(5.0, 500.0), period=0.4, rate=5e3, peak=20.0).replace(name='slower')]
    answer = diagnose_set(a_set(device, spoil=spoil, given=given), device, traces=False).document
    assert answer['verdict'] == 'UNKNOWN' and answer['where']['block'] == 'sensor'
    assert answer['where']['shares']['sensor'] > 0.9  # and what was cut is named like it
    assert why in answer['reason']


@pytest.mark.slow
@pytest.mark.parametrize('channels', [ALL, ('charge', 'displacement')])
def test_an_offset_that_warms_up_is_no_remanence_and_no_drift(device, channels):
    answer = diagnose_set(
        a_set(device, channels, played=warms_up), device, traces=False).document
    assert answer['verdict'] == 'UNKNOWN' and answer['where']['block'] == 'drive'


def test_a_driver_that_stops_at_no_current_is_no_recorder_that_starts_late(device):
    """It makes a loop that a lag can imitate, another one in every recording, but not well."""
    def crosses_over(programme):
        current = np.gradient(programme.command, programme.period)
        return programme.command - 0.3 * np.tanh(current / 200.0)

    fitter, nominal = fitter_of(device, a_set(device, ('displacement',), played=crosses_over))
    met = meet(fitter, nominal)
    assert 'late by another time' not in met.suspect.reason or met.cost > 0.9 * nominal.cost


def test_a_drift_of_the_displacement_alone_is_not_called_the_drivers(device):
    drifts = device.with_effects({'thermal_drift': EFFECTS['thermal_drift'].typical()})
    fitter, nominal = fitter_of(device, a_set(drifts, ('displacement',)))
    met = meet(fitter, nominal)
    assert met is None or met.suspect.block != 'drive'


def rings(programme):
    """Return the command behind a filter that rings at 2 kHz."""
    fast = 2.0 * np.pi * 2e3
    b, a, dt = signal.cont2discrete(
        ([fast ** 2], [1.0, 0.1 * fast, fast ** 2]), programme.period, 'zoh')
    return signal.lfilter(np.ravel(b), a, programme.command)


def other_loop(device, programme, clean):
    """Return charge, and what follows it, of another loop than that of the file."""
    actuator = device.actuator
    ratio, cap = actuator.transformer_ratio, actuator.linear_capacitance
    voltage = clean['voltage']
    more = 3e-7 * np.sin(np.pi * voltage / max(voltage.max(), 1.0))
    more *= np.sign(np.gradient(voltage))
    return {'charge': clean['charge'] + more, 'displacement': clean['displacement']
            + more * ratio / (ratio ** 2 + actuator.stiffness * cap)}


@pytest.mark.parametrize('spoil, played, block', [
    (None, rings, 'drive'), (other_loop, None, None), (jumps, None, None), (None, None, None),
    (None, warms_up, None)])
def test_a_driver_that_rings_is_told_by_charge_and_displacement(device, spoil, played, block):
    recordings = a_set(device, ('charge', 'displacement'), spoil, played, True).recordings
    simulated = simulate_set(device, recordings)
    evidence = prepare(recordings, simulated)
    suspect = suspect_filter(evidence, simulated, block_residuals(device, evidence, simulated))
    assert (suspect and suspect.block) == block


def alternates(device, programme, clean):
    """Return a displacement that a force moves to and fro along the way, every 1.7 um."""
    place = clean['displacement']
    return {'displacement': place + 2e-8 * np.sin(2.0 * np.pi * place / 1.7e-6 + 0.4)}


def bends(device, programme, clean):
    """Return a displacement whose reading is bent over the stroke."""
    place = clean['displacement']
    return {'displacement': place + 3e-8 * np.sin(np.pi * place / place.max())}


def vibrates(device, programme, clean):
    """Return a displacement beside a vibration."""
    return {'displacement': clean['displacement'] + 3e-8 * np.sin(
        2.0 * np.pi * 13.7 * programme.time)}


@pytest.mark.parametrize('spoil, told', [
    (alternates, True), (bends, False), slow(vibrates, False), slow(has_play, False),
    slow(runs_slow, False), (None, False)])
@pytest.mark.parametrize('not_felt, block', [(False, 'mechanical'), (True, 'sensor')])
def test_a_force_that_alternates_along_the_way_is_told_by_its_pitch(
        device, spoil, told, not_felt, block):
    recordings = a_set(device, ('displacement',), spoil).recordings
    simulated = simulate_set(device, recordings)
    evidence = prepare(recordings, simulated)
    course = Course.of(evidence, simulated, block_residuals(device, evidence, simulated))
    suspect = suspect_pitch(course, not_felt)
    assert (suspect and suspect.block) == (block if told else None)
    assert not told or '1.7 um' in suspect.reason


@pytest.fixture(params=['slips', 'never slips'])
def ending(request, device):
    """Return a device of which the last element slips at some voltage, or never does."""
    if request.param == 'slips':
        return device
    *volts, _ = device.actuator.maxwell_break_voltage
    return device.replace(actuator={'maxwell_break_voltage': (*volts, math.inf)})


def in_series(device, farads):
    """Return a stack in series with a capacitor, which a Maxwell element is that never slips."""
    actuator, volts = device.actuator, device.actuator.maxwell_break_voltage
    *others, last = actuator.maxwell_stiffness
    ends = (last + 1.0 / farads,) if math.isinf(volts[-1]) else (last, 1.0 / farads)
    return device.replace(actuator=actuator.replace(
        maxwell_stiffness=(*others, *ends),
        maxwell_break_voltage=volts if len(ends) == 1 else (*volts, 1e6)))


def better_than_a_spring(device, recordings):
    """Return how much better a capacitor in series explains a set than the best spring."""
    fitter, nominal = fitter_of(device, recordings)
    spring = fitter.fit({'parallel_stiffness': {'stiffness': 1e6}}, nominal.phi)
    return capacitor_in_series(fitter, spring)


def test_a_capacitor_in_series_asks_for_less_re_tuning_than_the_spring_that_looks_like_it(ending):
    # 40 uF of 1.2 uF: 3 % of the elastance with the end clamped, a third of that with it free.
    found = better_than_a_spring(ending, a_set(in_series(ending, 40e-6)))
    assert found.better > 100.0 and found.chance < 1e-3
    assert found.farads == pytest.approx(40e-6, rel=0.2)


def test_a_capacitor_is_likelier_than_a_spring_that_would_be_softer_than_there_are(device):
    # 140 uF ask for 0.9 % of a ratio and a capacitance that the file knows to 2 %; the spring has
    # 0.7 N/um at most, less than any that a preloaded stack is sold with.
    found = better_than_a_spring(device, a_set(in_series(device, 140e-6)))
    assert found.chance < 0.4
    assert found.farads > 100e-6


def test_a_spring_is_no_capacitor_in_series(device):
    found = better_than_a_spring(device, a_set(device.with_effects(
        {'parallel_stiffness': {'stiffness': 3e6}})))
    assert found.better < -100.0 and found.chance > 0.99


@pytest.mark.slow
def test_a_capacitor_in_series_is_unknown_and_electrical(device):
    document = diagnose_set(a_set(in_series(device, 40e-6)), device).document
    assert (document['verdict'], document['where']['block']) == ('UNKNOWN', 'electrical')
    assert 'in series with the stack' in document['reason']


RUBBING = {'friction': {'coulomb_force': 6.0, 'presliding': 8e-8}}


@pytest.mark.parametrize('effects, spoil', [({}, has_play), (RUBBING, None)])
def test_play_does_not_do_all_that_friction_does(device, effects, spoil):
    recordings = a_set(device.with_effects(effects), ('displacement',), spoil, lively=True)
    fitter, nominal = fitter_of(device, recordings)
    left = meet_one(fitter, nominal, PLAY).residual
    part = (np.mean(left ** 2) - 1.0) / (np.mean(nominal.residual ** 2) - 1.0)
    assert part > 0.2 if effects else part < 0.05


@pytest.mark.slow
@pytest.mark.parametrize('effects, spoil', [({}, has_play), (RUBBING, None)])
def test_without_the_charge_friction_is_less_sure_where_play_does_as_well(device, effects, spoil):
    recordings = a_set(device.with_effects(effects), ('displacement',), spoil, lively=True)
    answer = diagnose_set(recordings, device, traces=False).document
    assert answer['selected'] == ['friction']
    assert (answer['confidence'] < 0.6) == (not effects)
    assert ('play' in answer['reason']) == (not effects)
