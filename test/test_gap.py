# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""The diagnosis on devices with one known effect: what it must see, and must not claim."""

from dataclasses import replace

import numpy as np
from piezo_stack_sim.effects.registry import EFFECTS
from piezo_stack_sim.gap import diagnose_set
from piezo_stack_sim.gap.cores import parallel
from piezo_stack_sim.gap.deciding.doubt import _is_felt
from piezo_stack_sim.gap.deciding.ranked import DEFAULTS
from piezo_stack_sim.gap.deciding.score import Judge
from piezo_stack_sim.gap.fitting.blackbox import lagged
from piezo_stack_sim.gap.fitting.candidates import search_singles
from piezo_stack_sim.gap.fitting.fit import Fit, Fitter, free_parameters
from piezo_stack_sim.gap.fitting.nominal import Nuisance
from piezo_stack_sim.gap.lacking.back_coupling import suspect_block
from piezo_stack_sim.gap.lacking.bursts import suspect_bursts, suspect_jumps
from piezo_stack_sim.gap.lacking.course import Course, suspect_clock, suspect_heat, suspect_play
from piezo_stack_sim.gap.lacking.misread import suspect_charge
from piezo_stack_sim.gap.lacking.staircase import suspect_steps
from piezo_stack_sim.gap.measured.evidence import of_any_colour, prepare, quieter, reweigh
from piezo_stack_sim.gap.measured.forward import residuals, simulate_set
from piezo_stack_sim.gap.measured.noise import estimate_noise, integrated_correlation, repetition
from piezo_stack_sim.gap.measured.where import block_residuals, last_cut, shares
from piezo_stack_sim.gap.quantities import significant
from piezo_stack_sim.plant import Device, simulate
from piezo_stack_sim.recording import programmes
from piezo_stack_sim.recording.recording import RecordingSet
import pytest
from scipy import signal

NOISE = {'voltage': 5e-3, 'charge': 5e-9, 'displacement': 2e-9}


@pytest.fixture(scope='module')
def device():
    return Device.nominal()


def measure(device, programme, channels, seed):
    """Play a programme to a device and read its sensors with white noise."""
    random = np.random.default_rng(seed)
    answer = simulate(device, programme.time, programme.command, programme.external_force)
    return programme.replace(measured={
        name: getattr(answer, name) + NOISE[name] * random.standard_normal(len(programme))
        for name in channels})


def a_set(device, channels=('voltage', 'charge', 'displacement')):
    """Return two short recordings of a device: triangles and a force at a bias."""
    rows = [programmes.triangle(peaks=(30.0, 90.0), cycles=1), programmes.force(cycles=2)]
    return RecordingSet('bench', tuple(
        measure(device, programme, channels, seed) for seed, programme in enumerate(rows)))


@pytest.fixture(scope='module')
def diagnosed(device):
    """Diagnose sets once, as several tests ask about the same."""
    cache = {}

    def get(effects, channels=('voltage', 'charge', 'displacement'), scatter=0.0):
        key = (str(effects), channels, scatter)
        if key not in cache:
            actuator = device.actuator
            truth = device.with_effects(effects).replace(actuator=actuator.replace(
                transformer_ratio=actuator.transformer_ratio * (1.0 + scatter),
                stiffness=actuator.stiffness * (1.0 - scatter)))
            cache[key] = diagnose_set(a_set(truth, channels), device, traces=False).document
        return cache[key]

    return get


def test_a_device_as_in_the_file_has_no_gap(diagnosed):
    answer = diagnosed({})
    assert answer['verdict'] == 'NO_GAP'
    assert answer['selected'] == [] and answer['where']['block'] is None


def test_scatter_within_the_stated_uncertainty_is_calibration_and_no_effect(diagnosed):
    answer = diagnosed({}, scatter=0.01)
    assert answer['verdict'] == 'NO_GAP'
    fitted = answer['calibration']['transformer_ratio']
    assert fitted['fitted'] == pytest.approx(10.1, abs=0.02)


@pytest.mark.slow
def test_a_gain_error_of_the_driver_shows_in_the_voltage_and_lies_in_the_drive(diagnosed):
    answer = diagnosed({'amplifier_gain': {'gain_error': 0.01}})
    assert answer['verdict'] == 'CAUSE' and answer['selected'] == ['amplifier_gain']
    assert answer['where']['block'] == 'drive'
    best = answer['causes'][0]['parameters']['gain_error']
    assert best['value'] == pytest.approx(0.01, abs=5e-4)
    assert answer['shrinkage']['displacement']['S'] > 0.95


def test_a_compliance_before_the_sensor_is_found_and_the_gap_shrinks_to_the_noise(diagnosed):
    answer = diagnosed({'series_compliance': {'compliance': 5e-9}})
    assert answer['selected'] == ['series_compliance']
    assert answer['where']['block'] == 'mechanical'
    assert answer['shrinkage']['displacement']['S'] > 0.99
    # The charge never saw it.
    assert answer['gap']['charge']['over_noise'] < 1.1


@pytest.mark.slow
def test_displacement_alone_tells_the_gain_of_the_sensor_from_that_of_the_driver(diagnosed):
    answer = diagnosed({'sensor_gain': {'gain_error': 0.08}}, channels=('displacement',))
    # The driver's gain moves the hysteresis as well, the sensor's only scales what is read.
    # So does a ratio that is off by unequal amounts in its two directions; the charge would tell.
    assert answer['ambiguity_set'] == ['sensor_gain', 'transducer_ratio']
    assert answer['selected'] == ['sensor_gain']
    assert 'charge' in str(answer['next_experiment'])
    assert {cause['effect']: cause for cause in answer['causes']}['amplifier_gain']['S'] < 0.995


def test_a_placebo_never_explains_a_gap(diagnosed):
    for effects in ({'amplifier_gain': {'gain_error': 0.01}},
                    {'series_compliance': {'compliance': 5e-9}}):
        placebo = diagnosed(effects)['shrinkage']['placebo']['displacement']
        assert placebo < 0.3


def test_the_same_input_gives_the_same_answer(device):
    from piezo_stack_sim.gap import diagnose_set
    one, two = (diagnose_set(a_set(device, ('displacement',)), device, traces=False).document
                for _ in range(2))
    assert one['causes'] == two['causes'] and one['verdict'] == two['verdict']


def test_diagnoses_have_the_shape_that_others_rely_on(diagnosed):
    from piezo_stack_sim.gap.schema import validate
    for effects in ({}, {'amplifier_gain': {'gain_error': 0.01}}):
        answer = diagnosed(effects)
        validate({key: value for key, value in answer.items() if key[0] != '_'})


def test_the_noise_is_estimated_from_the_data_alone(device):
    recordings = a_set(device.with_effects({'sensor_gain': {'gain_error': 0.05}})).recordings
    simulated = []
    for recording in recordings:
        answer = simulate(device, recording.time, recording.command, recording.external_force)
        simulated.append({name: getattr(answer, name) for name in NOISE})
    noise = estimate_noise(recordings, simulated)
    for channel, level in NOISE.items():
        assert noise[channel].deviation(1e-4, 6000) == pytest.approx(level, rel=0.08)
    evidence = prepare(recordings, simulated)
    assert 0.4 < np.mean(evidence.tracks[0].fitted) < 0.6


def test_what_a_cause_leaves_tells_the_noise_that_slow_creep_had_raised(device):
    truth = device.with_effects({'creep': {'gain_per_decade': 0.06}})
    programme = programmes.steps(levels=(0.0, 60.0, 20.0), hold=1.0)
    recordings = [measure(truth, programme, NOISE, seed) for seed in range(2)]
    nominal, known = simulate_set(device, recordings), simulate_set(truth, recordings)
    first = prepare(recordings, nominal)
    better = quieter(first, known)
    assert first.noise_rms('charge') > 1.5 * NOISE['charge']
    assert better.noise_rms('charge') == pytest.approx(NOISE['charge'], rel=0.08)
    assert quieter(better, known) is better
    # What was weighted by the old noise is weighted by the new one.
    turn = reweigh(first, better)
    np.testing.assert_allclose(turn(residuals(device, first)), residuals(device, better))


def coloured(n, period, random):
    """Return noise of unit variance (n,): white, 1/f, and of first order with 400 Hz."""
    white = random.standard_normal(n)
    spectrum = np.fft.rfft(random.standard_normal(n))
    spectrum[1:] /= np.sqrt(np.arange(1, spectrum.size))
    spectrum[0] = 0.0
    pink = np.fft.irfft(spectrum, n)
    keep = np.exp(-2.0 * np.pi * 400.0 * period)
    drive = np.sqrt(1.0 - keep ** 2) * random.standard_normal(n)
    red = np.empty(n)
    red[0] = white[0]
    for i in range(1, n):
        red[i] = keep * red[i - 1] + drive[i]
    return {'white': white, 'pink': 0.8 * white + 0.6 * pink / pink.std(), 'red': red}


@pytest.mark.parametrize('colour', ['white', 'pink', 'red'])
def test_noise_of_any_colour_is_told_from_a_gap(device, colour):
    random = np.random.default_rng(5)
    recordings, simulated = [], []
    wrong = device.with_effects({'stiffness_hardening': {'cubic': 0.05}})
    for programme in (programmes.triangle(peaks=(30.0, 90.0), cycles=2), programmes.decay(),
                      programmes.multisine(), programmes.force(cycles=3)):
        real, model = (simulate(one, programme.time, programme.command, programme.external_force)
                       for one in (wrong, device))
        noise = 2e-9 * coloured(len(programme), programme.period, random)[colour]
        recordings.append(programme.replace(measured={'displacement': real.displacement + noise}))
        simulated.append({'displacement': model.displacement})
    found = estimate_noise(recordings, simulated)['displacement']
    for recording in recordings:
        # One row, and an average over many: colour decides how much averaging helps.
        assert found.deviation(recording.period, len(recording)) == pytest.approx(2e-9, rel=0.12)
    n, period = len(recordings[0]), recordings[0].period
    many = np.mean([np.var(coloured(n, period, np.random.default_rng(k))[colour]
                           [:n // 50 * 50].reshape(-1, 50).mean(axis=1)) for k in range(20)])
    assert found.deviation(period, n, 50) == pytest.approx(2e-9 * np.sqrt(many), rel=0.25)


@pytest.mark.slow
def test_a_colour_that_shows_where_rows_are_averaged_is_no_gap(device):
    random, recordings = np.random.default_rng(4), []
    rows = [programmes.triangle(peaks=(30.0, 90.0), cycles=2), programmes.decay(),
            programmes.steps(), programmes.force(cycles=3)]
    for programme in rows:
        answer = simulate(device, programme.time, programme.command, programme.external_force)
        part = coloured(len(programme), programme.period, random)
        # A sixth of the power is 1/f: from row to row that is next to nothing.
        pink = (part['pink'] - 0.8 * part['white']) / 0.6
        noise = 2e-9 * (0.92 * part['white'] + 0.4 * pink)
        recordings.append(programme.replace(measured={'displacement':
                                                      answer.displacement + noise}))
    simulated = simulate_set(device, recordings)
    evidence = prepare(recordings, simulated)
    louder = of_any_colour(evidence, simulated)
    residual = residuals(device, evidence)
    white, any_colour = (Judge.from_residual(each, seen, seen).structure(seen) for each, seen in (
        (evidence, residual), (louder, reweigh(evidence, louder)(residual))))
    assert white > DEFAULTS.excess > any_colour
    answer = diagnose_set(RecordingSet('bench', tuple(recordings)), device, traces=False).document
    assert answer['verdict'] == 'NO_GAP'


def test_the_zero_of_a_sensor_is_no_gap(device):
    programme = programmes.triangle(peaks=(30.0, 90.0), cycles=2)
    recording = measure(device, programme, ('displacement',), 3)
    zeroed = recording.replace(measured={
        'displacement': recording.measured['displacement'] + 1.5 * NOISE['displacement']})
    answer = {'displacement': simulate(device, programme.time, programme.command).displacement}
    track = prepare([zeroed], [answer]).tracks[0]
    residual = track.weighted('displacement', answer['displacement'])
    assert abs(residual.mean()) < 0.05
    # Two micrometres are no noise of a row, and must stay visible.
    far = recording.replace(measured={
        'displacement': recording.measured['displacement'] + 1e3 * NOISE['displacement']})
    track = prepare([far], [answer]).tracks[0]
    far = track.weighted('displacement', answer['displacement'])
    expected = (1e3 * NOISE['displacement'] / track.zero['displacement']) ** 2
    assert np.sum(far ** 2) - np.sum(residual ** 2) == pytest.approx(expected, rel=0.05)


def test_the_period_of_a_repeated_command_is_found():
    programme = programmes.multisine()
    assert repetition(programme.command) == round(0.1 / programme.period)
    assert repetition(np.linspace(0.0, 1.0, 1000)) == 0


def test_work_that_is_spread_from_within_spread_work_comes_to_its_end_in_order():
    table = parallel(lambda i: parallel(lambda j: i * j, range(3)), range(64))
    assert table == [[0, i, 2 * i] for i in range(64)]


def test_correlated_rows_count_for_less():
    random = np.random.default_rng(3)
    white = random.standard_normal(20000)
    slow = np.convolve(white, np.ones(50) / 50.0, 'same')
    assert integrated_correlation(white) < 1.5
    assert 30.0 < integrated_correlation(slow) < 80.0


def test_noise_that_is_louder_than_estimated_everywhere_is_no_structure(device):
    recordings = a_set(device, ('displacement',)).recordings
    evidence = prepare(recordings, simulate_set(device, recordings))
    noise = np.random.default_rng(3).standard_normal(residuals(device, evidence).size)
    first = np.arange(noise.size) < evidence.tracks[0].measured['displacement'].size
    judge = Judge.from_residual(evidence, noise, noise)
    noise /= np.sqrt(np.where(first, *judge.powers(noise)))  # as loud as estimated
    assert judge.structure(noise) == pytest.approx(0.0, abs=1e-12)
    # Half as loud again is none of the noise; a tenth of it may be, if it is everywhere.
    assert judge.structure(np.sqrt(np.where(first, 1.5, 1.0)) * noise) == pytest.approx(0.5)
    assert judge.structure(np.sqrt(1.5) * noise) == pytest.approx(0.4)


def test_a_slow_gap_in_one_recording_is_structure_however_few_of_its_rows_are_independent(device):
    recordings = a_set(device, ('voltage',)).recordings
    evidence = prepare(recordings, simulate_set(device, recordings))
    noise = np.random.default_rng(3).standard_normal(residuals(device, evidence).size)
    rows = evidence.tracks[0].measured['voltage'].size
    walks = np.zeros(noise.size)
    walks[:rows] = np.linspace(-1.0, 1.0, rows)
    for height, told in ((0.5, False), (4.0, True)):
        drifting = noise + height * walks
        assert (Judge.from_residual(evidence, drifting, drifting).structure(drifting)
                > DEFAULTS.excess) == told


@pytest.mark.slow
def test_a_file_that_is_sure_of_its_numbers_has_them_kept(device):
    from piezo_stack_sim.gap import diagnose_set
    sure = device.replace(actuator=device.actuator.replace(relative_uncertainty=0.0))
    stiffer = device.actuator.replace(transformer_ratio=1.01 * device.actuator.transformer_ratio)
    answer = diagnose_set(a_set(device.replace(actuator=stiffer)), sure, traces=False).document
    for entry in answer['calibration'].values():
        assert entry['fitted'] == pytest.approx(entry['nominal'], rel=1e-9)
    assert answer['verdict'] != 'NO_GAP'


def test_a_load_is_known_no_better_than_the_stack_that_it_hangs_on(device):
    """The sum of the masses shows in a resonance, and nothing tells whose mass it is."""
    heavy = device.replace(load=replace(device.load, mass=6.0))
    heavier = heavy.replace(load=replace(device.load, mass=6.0 * 1.015))
    run = programmes.multisine(40.0, 6.0, (10.0, 1500.0), rate=10e3)
    misses = [simulate(each, run.time, run.command).displacement for each in (heavy, heavier)]
    nuisance = Nuisance(heavy)
    phi = np.zeros(len(nuisance.names))
    phi[nuisance.names.index('mass')] = 0.015
    tuned = simulate(nuisance.apply(heavy, phi), run.time, run.command).displacement
    assert np.ptp(misses[1] - misses[0]) > 1e-9
    assert np.ptp(misses[1] - tuned) < 1e-3 * np.ptp(misses[1] - misses[0])


@pytest.mark.slow
def test_the_experiment_that_is_proposed_decides_between_what_was_tied(diagnosed, device):
    """A bow of the reading may be the sensor's or the ceramic's: without charge nobody knows."""
    bow = {'sensor_nonlinearity': {'quadratic': 0.02}}
    answer = diagnosed(bow, ('voltage', 'displacement'))
    assert answer['verdict'] == 'AMBIGUOUS'
    assert {'sensor_nonlinearity', 'transducer_nonlinearity'} <= set(answer['ambiguity_set'])
    proposed = answer['next_experiment']
    assert set(proposed['separates']) <= set(answer['ambiguity_set'])
    assert proposed['separation'] > 3.0
    options = dict(proposed['settings'])
    options = {key: tuple(value) if isinstance(value, list) else value
               for key, value in options.items()}
    played = getattr(programmes, proposed['profile'])(**options)
    channels = tuple(c for c in NOISE if c in ('voltage', 'displacement')
                     or c == proposed['add_channel'])
    from piezo_stack_sim.gap import diagnose_set
    more = RecordingSet('bench', (*a_set(device.with_effects(bow), channels),
                                  measure(device.with_effects(bow), played, channels, 7).replace(
                                      name='next')))
    after = diagnose_set(more, device, traces=False).document
    assert 'sensor_nonlinearity' in after['ambiguity_set']
    assert len(after['ambiguity_set']) < len(answer['ambiguity_set'])


@pytest.mark.parametrize('causes, channels, block', [
    (['rate_dependent_hysteresis'], ('displacement',), 'electrical'),
    (['rate_dependent_hysteresis'], ('charge', 'displacement'), 'sensor'),
    (['amplifier_gain'], ('displacement',), 'drive'),
    (['amplifier_gain'], ('voltage', 'displacement'), 'sensor'),
    ([], ('displacement',), 'sensor'),
])
def test_the_last_cut_is_named_after_a_cause_that_it_can_hold(causes, channels, block):
    """Without charge all behind the voltage is one cut, without voltage all behind the command."""
    assert last_cut(causes, 'sensor_lag', channels) == block
    _, blocks = shares([{'behind': (np.ones(10), 0.1)}], block, channels)
    begins = next((port for port in ('charge', 'voltage') if port in channels), 'command')
    assert (blocks[block]['from'], blocks[block]['to']) == ([begins], 'displacement')


def droop(recording):
    """Return a recording whose charge was read through an amplifier that forgets it."""
    charge = recording.measured['charge']
    forgotten = np.exp(-recording.time / 0.05)
    return recording.replace(measured=recording.measured | {'charge': charge * forgotten})


@pytest.mark.parametrize('effects, spoil, block', [
    ({}, None, None),
    ({'creep': {'gain_per_decade': 0.02}}, None, None),  # displacement follows the charge
    ({'sensor_gain': {'gain_error': 0.05}}, None, 'sensor'),
    ({'sensor_nonlinearity': {}}, None, 'sensor'),
    ({'stiffness_hardening': {}}, None, 'mechanical'),
    ({'friction': {}}, None, 'mechanical'),
    ({}, droop, 'sensor'),
])
def test_charge_tells_whether_the_stack_felt_what_displaced_it(device, effects, spoil, block):
    effects = {name: EFFECTS[name].typical() | values for name, values in effects.items()}
    recordings = [spoil(recording) if spoil else recording
                  for recording in a_set(device.with_effects(effects)).recordings]
    simulated = simulate_set(device, recordings)
    cuts = block_residuals(device, prepare(recordings, simulated), simulated)
    suspect = suspect_block(cuts)
    assert (suspect and suspect.block) == block


@pytest.mark.slow
def test_a_spring_that_needs_no_other_ratio_is_not_doubted_for_a_capacitor(diagnosed):
    """In series it would look alike, with a ratio and a capacitance that the file rules out."""
    answer = diagnosed({'parallel_stiffness': {'stiffness': 5e6}})
    assert answer['selected'] == ['parallel_stiffness']
    assert 'capacitor' not in answer['reason']
    assert not any('capacitor in series' in warning for warning in answer['warnings'])


def test_another_ratio_moves_charge_and_displacement_in_opposite_ways(device):
    recording, *_ = a_set(device.with_effects({'transducer_ratio': {'ratio_error': 0.05}})
                          ).recordings
    assert not recording.external_force.any()
    simulated = simulate_set(device, [recording])
    suspect = suspect_block(block_residuals(device, prepare([recording], simulated), simulated))
    assert suspect.block == 'transducer'


@pytest.mark.parametrize('share, rows, driver, block', [
    (0.0, 8000, 1.0, 'sensor'),
    (0.45, 8000, 1.0, 'mechanical'),
    (-0.2, 8000, 1.0, 'transducer'),
    (1.6, 8000, 1.0, 'electrical'),  # more charge than the end can have moved
    (1.6, 8000, 2.0, None),  # a wrong driver moves both as they belong together
    (0.45, 80, 1.0, None),  # too few rows
])
def test_many_rows_tell_the_share_of_charge_below_the_noise_of_one(share, rows, driver, block):
    rng = np.random.default_rng(1)
    wrong = 2.0 * np.sin(np.arange(rows) * 0.37)
    charge = share * wrong + 3.0 * rng.standard_normal(rows)
    moved = wrong + 0.5 * rng.standard_normal(rows)
    cut = {'drive': (driver * rng.standard_normal(rows), 1.0), 'electrical': (charge, 3.0),
           'through': (moved, 0.5), 'behind': (moved - charge, np.hypot(3.0, 0.5))}
    suspect = suspect_block([cut])
    assert (suspect and suspect.block) == block


def knocks(time, x):
    """Return a displacement with the ringing of three knocks."""
    for start in time[-1] * np.array([0.1, 0.4, 0.75]):
        after = np.maximum(time - start, 0.0)
        x = x + 5e-8 * np.exp(-after / 0.01) * np.sin(2.0 * np.pi * 200.0 * after)
    return x


def faint_knocks(time, x):
    """Return a displacement with the same, hardly louder than its noise."""
    return x + 0.2 * (knocks(time, x) - x)


def jumps(time, x):
    """Return a displacement that is read at two levels."""
    return x + 5e-8 * (np.sin(2.0 * np.pi * 7.0 * time ** 1.3) > 0.0)


def sticks(time, x):
    """Return a displacement whose reading sticks for five milliseconds now and then."""
    return np.where(time % 0.1 < 5e-3, np.interp(time - time % 0.1, time, x), x)


@pytest.mark.parametrize('channels', [('displacement',), ('voltage', 'charge', 'displacement')])
@pytest.mark.parametrize('spoil, effect, block', [
    (knocks, None, 'environment'), (faint_knocks, None, 'environment'),
    (jumps, None, None), (sticks, None, 'sensor'),
    (None, 'friction', None), (None, 'sensor_lag', None), (None, 'mechanical_resonance', None)])
def test_bursts_that_ring_are_knocks_else_readings_stick(
        device, spoil, effect, block, channels):
    target = device.with_effects({effect: EFFECTS[effect].typical()} if effect else {})
    recordings = a_set(target, channels).recordings
    if spoil:
        recordings = [each.replace(measured=each.measured | {
            'displacement': spoil(each.time, each.measured['displacement'])})
            for each in recordings]
    simulated = simulate_set(device, recordings)
    evidence = prepare(recordings, simulated)
    cuts = block_residuals(device, evidence, simulated)
    suspect = suspect_bursts(evidence.tracks, cuts, Course.of(evidence, simulated, cuts))
    assert (suspect and suspect.block) == block


def sticks_longer(time, x):
    """Return a displacement whose reading sticks for nine milliseconds now and then."""
    since = (time + 0.05) % 0.1
    return np.where(since < 9e-3, np.interp(time - since, time, x), x)


@pytest.mark.parametrize('spoil, block', [(sticks_longer, 'sensor'), (knocks, 'environment')])
def test_a_reading_that_sticks_while_the_stack_is_shaken_does_not_ring(device, spoil, block):
    # It is wrong to both sides, for the stack goes to and fro meanwhile, as what rings is.
    shaken = programmes.multisine(periods=10)
    shaken = shaken.replace(command=40.0 + 6.0 * np.sin(2.0 * np.pi * 200.0 * shaken.time))
    answer = simulate(device, shaken.time, shaken.command, shaken.external_force)
    noise = 1e-9 * np.random.default_rng(3).standard_normal(len(shaken))
    recordings = [shaken.replace(measured={
        'displacement': spoil(shaken.time, answer.displacement) + noise})]
    simulated = simulate_set(device, recordings)
    evidence = prepare(recordings, simulated)
    cuts = block_residuals(device, evidence, simulated)
    suspect = suspect_bursts(evidence.tracks, cuts, Course.of(evidence, simulated, cuts))
    assert suspect.block == block


@pytest.mark.parametrize('frequency', [600.0, 1500.0])
@pytest.mark.parametrize('channels', [('displacement',), ('voltage', 'charge', 'displacement')])
def test_what_rings_whenever_the_command_turns_is_no_knock(device, channels, frequency):
    def rings(each):
        omega = 2.0 * np.pi * frequency
        mode = signal.bilinear([0.3, 0.0, 0.0], [1.0, omega / 20.0, omega ** 2],
                               1.0 / each.period)
        return signal.lfilter(*mode, 1.3e-7 * (each.command - each.command[0]))

    recordings = [each.replace(measured=each.measured | {
        'displacement': each.measured['displacement'] + rings(each)})
        for each in a_set(device, channels).recordings]
    simulated = simulate_set(device, recordings)
    evidence = prepare(recordings, simulated)
    cuts = block_residuals(device, evidence, simulated)
    assert suspect_bursts(evidence.tracks, cuts, Course.of(evidence, simulated, cuts)) is None


def test_what_comes_in_bursts_with_its_charge_is_no_knock(device):
    """A driver hums as loud as its command is high."""
    given = [programmes.triangle(), programmes.decay(), programmes.steps(),
             programmes.multisine(), programmes.force()]
    recordings = []
    for seed, each in enumerate(given):
        hum = 1e-3 * each.command * np.sin(2.0 * np.pi * 33.0 * each.time)
        recordings.append(each.replace(measured=measure(
            device, each.replace(command=each.command + hum), ('charge', 'displacement'), seed
        ).measured))
    evidence = prepare(recordings, simulate_set(device, recordings))
    fitter = Fitter(device, evidence)
    fitter.prepare(parallel)
    tuned = fitter.device_with({}, fitter.fit({}).phi)
    simulated = simulate_set(tuned, recordings)
    cuts = block_residuals(tuned, evidence, simulated)
    assert suspect_bursts(evidence.tracks, cuts, Course.of(evidence, simulated, cuts)) is None


def faint_jumps(time, x):
    """Return a displacement that is read at two levels, no further apart than its noise."""
    return x + 0.06 * (jumps(time, x) - x)


def drifts(time, x):
    """Return a displacement that walks away."""
    return x + 1e-7 * time / time[-1]


def vibrates(time, x):
    """Return a displacement beside a vibration that nothing here makes."""
    return x + 3e-8 * np.sin(2.0 * np.pi * 13.7 * time)


@pytest.mark.parametrize('spoil, block', [
    (jumps, 'sensor'), (faint_jumps, 'sensor'), (knocks, None), (drifts, None), (vibrates, None),
    (lambda time, x: 1.02 * x, None), (lambda time, x: has_play(x), None)])
def test_a_reading_that_jumps_between_two_levels_is_the_sensors(device, spoil, block):
    recordings = [each.replace(measured={
        'displacement': spoil(each.time, each.measured['displacement'])})
        for each in a_set(device).recordings]
    simulated = simulate_set(device, recordings)
    evidence = prepare(recordings, simulated)
    cuts = block_residuals(device, evidence, simulated)
    suspect = suspect_jumps(cuts, Course.of(evidence, simulated, cuts))
    assert (suspect and suspect.block) == block


def in_steps_of(step):
    """Return a programme whose command a converter rounds to so many volts."""
    def spoil(programme):
        return programme.replace(command=step * np.rint(programme.command / step))
    return spoil


@pytest.mark.parametrize('effect, step, block', [
    (None, 0.4, 'drive'), (None, 0.213, 'drive'), (None, 0.05, 'drive'), (None, 0.035, 'drive'),
    (None, None, None),
    ('friction', None, None),
    ('amplifier_bandwidth', None, None), ('mechanical_resonance', None, None)])
def test_a_command_in_steps_is_the_drives_even_where_nobody_measured_the_voltage(
        device, effect, step, block):
    target = device.with_effects({effect: EFFECTS[effect].typical()} if effect else {})
    recordings = []
    for seed, programme in enumerate((programmes.triangle(peaks=(30.0, 90.0), cycles=1),
                                      programmes.multisine(periods=2))):
        played = in_steps_of(step)(programme) if step else programme
        seen = measure(target, played, ('displacement',), seed)
        recordings.append(programme.replace(measured=seen.measured))
    simulated = simulate_set(device, recordings)
    evidence = prepare(recordings, simulated)
    suspect = suspect_steps(device, evidence, block_residuals(device, evidence, simulated))
    assert (suspect and suspect.block) == block
    # The size is right or not told: the last is finer than any that is tried.
    assert step is None or f'in steps of {significant(step, 2)} V' in suspect.reason or (
        step < 0.04 and 'in steps:' in suspect.reason)


def has_play(x):
    """Return a displacement that follows with a play of 200 nm."""
    follower, out = x[0], []
    for place in x:
        follower = min(max(follower, place - 1e-7), place + 1e-7)
        out.append(follower)
    return np.array(out)


def comes_late(x):
    """Return a displacement that is read two rows late."""
    return np.concatenate([[x[0]] * 2, x[:-2]])


def skewed(x):
    """Return a displacement that is read by a clock that runs 0.3 % slow."""
    row = np.arange(x.size)
    return np.interp(0.997 * row, row, x)


def far_skewed(x):
    """Return a displacement that is read by a clock that runs 3 % slow: at the end all is late."""
    row = np.arange(x.size)
    return np.interp(0.97 * row, row, x)


@pytest.mark.parametrize('spoil, play, clock', [
    (has_play, 'mechanical', None), (comes_late, None, None), (skewed, None, 'sensor'),
    (far_skewed, None, 'sensor'), (lambda x: 1.01 * x, None, None), (lambda x: x, None, None)])
def test_play_and_clocks_are_told_from_what_a_sensor_does(device, spoil, play, clock):
    recordings = [each.replace(measured={
        **each.measured, 'displacement': spoil(each.measured['displacement'])})
        for each in a_set(device).recordings]
    simulated = simulate_set(device, recordings)
    evidence = prepare(recordings, simulated)
    course = Course.of(evidence, simulated, block_residuals(device, evidence, simulated))
    suspects = suspect_play(course), suspect_clock(course)
    assert [suspect and suspect.block for suspect in suspects] == [play, clock]


@pytest.mark.slow
def test_play_is_not_friction_where_the_charge_shows_that_the_stack_does_not_feel_it(device):
    recordings = a_set(device).recordings
    loose = RecordingSet('loose', tuple(each.replace(measured={
        **each.measured, 'displacement': has_play(each.measured['displacement'])})
        for each in recordings))
    answer = diagnose_set(loose, device, traces=False).document
    assert answer['verdict'] == 'UNKNOWN' and answer['where']['block'] == 'mechanical'
    rubs = device.with_effects({'friction': {'coulomb_force': 5.0}})
    assert diagnose_set(a_set(rubs), device, traces=False).document['selected'] == ['friction']


@pytest.mark.parametrize('felt', [True, False])
def test_a_force_explains_charge_that_play_does_not(device, felt):
    unit = device.with_effects({'friction': {'coulomb_force': 0.5}}) if felt else device
    recordings = a_set(unit).recordings
    if not felt:
        recordings = [each.replace(measured={**each.measured, 'displacement': has_play(
            each.measured['displacement'])}) for each in recordings]
    fitter = Fitter(device, prepare(recordings, simulate_set(device, recordings), device))
    fitter.prepare(parallel)
    search = search_singles(fitter, lambda message: None, ('friction',))
    assert search.fits['friction'].cost < search.nominal.cost
    assert _is_felt(fitter, search, 'friction') is felt


def warms(time, x):
    """Return a displacement that grows by the power of the motion of the last 0.2 s."""
    dt = time[1] - time[0]
    return x * (1.0 + 3e3 * lagged(np.gradient(x, dt) ** 2, 0.2 / dt))


ALL = ('voltage', 'charge', 'displacement')


@pytest.mark.parametrize('spoil, channels, block', [
    (warms, ALL, 'transducer'), (warms, ('voltage', 'displacement'), 'transducer'),
    (warms, ('displacement',), None),  # or the driver sags
    (lambda time, x: 1.01 * x, ALL, None), (lambda time, x: x, ALL, None),
    (lambda time, x: comes_late(x), ALL, None), (lambda time, x: has_play(x), ALL, None),
    (lambda time, x: skewed(x), ALL, None)])
def test_a_stack_that_heats_itself_is_told_by_the_power_of_its_motion(
        device, spoil, channels, block):
    clean = [measure(device, each, channels, seed) for seed, each in enumerate(lively())]
    simulated = simulate_set(device, clean)
    recordings = [each.replace(measured=each.measured | {
        'displacement': each.measured['displacement'] + spoil(
            each.time, answer['displacement']) - answer['displacement']})
        for each, answer in zip(clean, simulated)]
    assert heat_of(device, recordings, simulated) == block


@pytest.mark.parametrize('channels', [('charge', 'displacement'), ('displacement',)])
def test_a_driver_that_sags_is_no_stack_that_heats_itself(device, channels):
    def sags(each):
        current = np.abs(np.gradient(each.command, each.time))
        return each.replace(command=each.command * (
            1.0 - 0.01 * lagged(current, 0.05 / each.period) / current.max()))

    recordings = [each.replace(measured=measure(device, sags(each), channels, seed).measured)
                  for seed, each in enumerate(lively())]
    assert heat_of(device, recordings, simulate_set(device, recordings)) is None


def lively():
    """Return programmes between which the power of the motion differs."""
    return [programmes.triangle(peaks=(30.0, 90.0), cycles=1), programmes.multisine(),
            programmes.steps(hold=2.0)]


def heat_of(device, recordings, simulated):
    """Return the block that heat speaks for, or None."""
    evidence = prepare(recordings, simulated)
    cuts = block_residuals(device, evidence, simulated)
    suspect = suspect_heat(Course.of(evidence, simulated, cuts), cuts)
    return suspect and suspect.block


@pytest.mark.slow
def test_what_a_late_sensor_leaves_of_a_wrong_clock_tells_the_clock(device):
    recordings = [each.replace(measured={'displacement': skewed(each.measured['displacement'])})
                  for each in a_set(device, ('displacement',)).recordings]
    answer = diagnose_set(RecordingSet('bench', tuple(recordings)), device, traces=False).document
    assert answer['verdict'] == 'UNKNOWN' and not answer['selected']
    assert answer['where']['block'] == 'sensor'
    assert 'sensor delay removes' in answer['reason'] and 'another speed' in answer['reason']


@pytest.mark.parametrize('effect, spoil, block', [
    (None, droop, 'sensor'), (None, lambda each: each, None),
    ('creep', lambda each: each, None), ('friction', lambda each: each, None),
    ('stiffness_hardening', lambda each: each, None)])
def test_charge_was_measured_wrong_if_nothing_else_is_wrong_without_it(
        device, effect, spoil, block):
    truth = device.with_effects({effect: EFFECTS[effect].typical()} if effect else {})
    recordings = [spoil(each) for each in a_set(truth).recordings]
    fitter = Fitter(device, prepare(recordings, simulate_set(device, recordings)))
    fitter.prepare(parallel)
    tuned = fitter.device_with({}, fitter.fit({}).phi)
    cuts = block_residuals(tuned, fitter.evidence, simulate_set(tuned, recordings))
    suspect = suspect_charge(fitter, cuts)
    assert (suspect and suspect.block) == block


def test_without_the_voltage_a_slow_driver_is_not_taken_for_a_force(device):
    recordings = a_set(device.with_effects({'amplifier_bandwidth': {'output_resistance': 20.0}}),
                       ('charge', 'displacement')).recordings
    simulated = simulate_set(device, recordings)
    cuts = block_residuals(device, prepare(recordings, simulated), simulated)
    assert suspect_block(cuts) is None


def test_a_free_scale_comes_on_top_of_a_known_gain(device):
    known = device.with_effects({'sensor_gain': {'gain_error': 0.5}})
    free = Nuisance(known, scale_free=True)
    phi = np.zeros(len(free.names))
    phi[-1] = 0.1
    assert free.apply(known, phi).effects['sensor_gain']['gain_error'] == pytest.approx(0.65)


def test_what_is_absent_is_not_stuck_and_what_lies_at_a_bound_is():
    losses = {each.parameter.name: each for each in free_parameters(
        'rate_dependent_hysteresis', {'growth': 0.01, 'exponent': 0.5})}
    assert losses['resistance'].stuck(0.0) is None
    assert losses['resistance'].stuck(1e4) == 'upper'
    assert losses['exponent'].stuck(0.2) == 'lower'
    assert losses['exponent'].stuck(0.5) is None
    held = {free.parameter.name: free for free in free_parameters(
        'added_mass', {'mass': 0.05, 'joint_frequency': 5e4})}['joint_frequency']
    assert held.stuck(held.parameter.upper) is None
    assert held.stuck(held.parameter.lower) == 'lower'


@pytest.mark.parametrize('stiffness, stuck', [(1e6, []), (1e5, ['stiffness'])])
def test_a_fit_is_stuck_where_one_of_its_numbers_is(stiffness, stuck):
    stop = EFFECTS['contact'].values({'gap': 5e-6, 'stiffness': stiffness})
    fit = Fit({'contact': stop}, np.zeros(5), np.zeros(9), 0.0, free_parameters('contact', stop))
    assert [free.parameter.name for free in fit.stuck] == stuck
