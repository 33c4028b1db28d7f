# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""The model cut at its terminals: the driver by its voltage, the rest by what that drives."""

from types import SimpleNamespace

from fitters import fitter_of
import numpy as np
from piezo_stack_sim.gap import diagnose_set
from piezo_stack_sim.gap.cores import parallel
from piezo_stack_sim.gap.deciding.isolability import Alike
from piezo_stack_sim.gap.deciding.ranked import DEFAULTS, Ranked
from piezo_stack_sim.gap.deciding.terminals import Part, Terminals
from piezo_stack_sim.gap.deciding.verdict import Cut, decide
from piezo_stack_sim.gap.fitting.candidates import Probe, Search
from piezo_stack_sim.gap.fitting.fit import Fitter
from piezo_stack_sim.gap.lacking.misread import is_voltage_misread
from piezo_stack_sim.gap.measured.evidence import prepare
from piezo_stack_sim.gap.measured.forward import simulate_set
from piezo_stack_sim.gap.measured.voltage import above_noise, FINE, MeasuredVoltage
from piezo_stack_sim.plant import Device, simulate
from piezo_stack_sim.recording import programmes
from piezo_stack_sim.recording.recording import Recording, RecordingSet
import pytest
from scipy.signal import butter, lfilter

NOISE = {'voltage': 5e-3, 'charge': 5e-9, 'displacement': 2e-9}
FINER = 10


def slow(command, period):
    """Return the output of a driver with two equal poles at 150 Hz, which no effect has."""
    pole = butter(1, 150.0, fs=1.0 / period)
    return lfilter(*pole, lfilter(*pole, command))


def coarse(command, _):
    """Return the output of a driver that has lost its lower bits."""
    return 0.5 * np.round(command / 0.5)


def clocked(every):
    """Return a driver that looks at the command when a clock of its own tells it to."""
    def driver(command, period):
        ticks = np.floor(np.arange(command.size) * period / every) * every
        return command[np.round(ticks / period).astype(int)]

    return driver


def a_set(device, driver, noise=1.0):
    """Return recordings with (so much) white noise of a device behind a driver of any form."""
    random, recordings = np.random.default_rng(11), []
    for programme in (programmes.triangle(peaks=(30.0, 90.0), cycles=1),
                      programmes.multisine(periods=2), programmes.steps(hold=1.0)):
        rows = np.arange(len(programme))
        fine = np.arange(rows[-1] * FINER + 1)
        time = np.interp(fine / FINER, rows, programme.time)
        voltage = driver(programme.command[fine // FINER], time[1] - time[0])
        answer = simulate(device, time, voltage, drive='voltage')
        measured = {name: getattr(answer, name)[::FINER] for name in NOISE}
        recordings.append(programme.replace(measured={
            name: values + noise * NOISE[name] * random.standard_normal(rows.size)
            for name, values in measured.items()}))
    return RecordingSet('bench', tuple(recordings))


def test_white_noise_is_taken_away_and_a_step_is_not():
    random = np.random.default_rng(3)
    noise = 1e-3 * random.standard_normal(5000)
    assert np.std(above_noise(noise, 1e-3)) < 0.1e-3
    step = np.where(np.arange(5000) < 2000, 0.0, 0.05)
    left = above_noise(noise + step, 1e-3) - step
    assert np.std(left) < 0.5e-3
    assert np.abs(left).max() < 5e-3


@pytest.mark.parametrize('driver, least, most', [
    (clocked(7e-5), 1e-5, 3e-5),  # late by 0 to 70 us, by turns: 20 us rms
    (slow, 0.0, 2e-6)])  # hundreds of us late, but as much in the next row
def test_a_clock_of_its_own_is_told_from_a_form_of_its_own(driver, least, most):
    recordings = a_set(Device.nominal(), driver).recordings
    tracks = prepare(recordings, simulate_set(Device.nominal(), recordings)).tracks
    late = max(MeasuredVoltage.of(track, Device.nominal()).jitter for track in tracks)
    assert least <= late < most


def test_the_voltage_between_rows_may_come_later():
    recording = a_set(Device.nominal(), slow).recordings[0]
    track, = prepare([recording], simulate_set(Device.nominal(), [recording])).tracks
    voltage = MeasuredVoltage.of(track, Device.nominal())
    soon = voltage.otherwise(0.0)
    late = voltage.otherwise(recording.period / FINE)
    np.testing.assert_allclose(late[1:], soon[:-1], atol=1e-9)
    assert np.ptp(soon) > 10.0


@pytest.mark.parametrize('channel', ['charge', 'displacement'])
def test_what_follows_the_measured_voltage_is_not_late(channel):
    """Steps as long as a row are: by half of it, and the stack swings after each."""
    device = Device.nominal()
    recording = a_set(device, slow, noise=0.01).recordings[0]
    truth = a_set(device, slow, noise=0.0).recordings[0].measured[channel]
    track, = prepare([recording], simulate_set(device, [recording])).tracks
    voltage = MeasuredVoltage.of(track, device.with_effects(
        {'amplifier_bandwidth': {'time_constant': 2e-3}}))
    late = simulate_set(device, [voltage.as_command()])[0][channel] - truth
    assert np.std(voltage.answer_of(device)[channel] - truth) < 0.3 * np.std(late)


def test_a_jump_is_as_steep_as_the_driver_makes_it():
    """Else the stack swings further than it did, and its hysteresis remembers that."""
    device = Device.nominal()
    quick = device.with_effects({'amplifier_bandwidth': {'time_constant': 1.5e-5}})
    time = 2e-3 * np.arange(600)
    command = np.interp(time, [0.1, 0.2, 0.6, 0.7], [0.0, 60.0, 60.0, 20.0])
    truth = simulate(quick, time, command, drive='voltage')
    recording = Recording('steps', time, 'voltage', command, measured={
        'voltage': truth.voltage, 'charge': truth.charge})
    track, = prepare([recording], simulate_set(quick, [recording])).tracks
    driven = MeasuredVoltage.of(track, quick).as_command()
    as_steep, = simulate_set(device, [driven])
    at_once = simulate(device, time, driven.command, drive='voltage')
    error = np.std(as_steep['charge'] - truth.charge)
    assert error < 0.2 * np.std(at_once.charge - truth.charge)
    assert error < NOISE['charge']


def misread(voltage, _):
    """Return what a probe reads that is not linear."""
    return voltage + 0.05 * np.sin(voltage / 15.0)


def with_reading(recordings, probe):
    """Return recordings whose voltage passed through a probe."""
    return RecordingSet(recordings.name, tuple(
        each.replace(measured={**each.measured, 'voltage': probe(
            each.measured['voltage'], each.time)}) for each in recordings))


def fitter_to(recordings):
    """Return a fitter of the nominal device to recordings."""
    device, runs = Device.nominal(), recordings.recordings
    fitter = Fitter(device, prepare(runs, simulate_set(device, runs), device))
    fitter.prepare(parallel)
    return fitter


def test_a_voltage_that_nothing_follows_was_measured_wrong():
    """Of 50 mV that the driver puts out and of 50 mV that only a probe reads."""
    driven = a_set(Device.nominal(), misread)
    read = with_reading(a_set(Device.nominal(), lambda command, _: command), misread)
    assert is_voltage_misread(fitter_to(read))
    assert not is_voltage_misread(fitter_to(driven))


@pytest.mark.slow
def test_a_hum_that_only_the_probe_of_the_voltage_reads_hides_no_cause():
    stiffer = Device.nominal().with_effects({'parallel_stiffness': {'stiffness': 2e6}})
    recordings = with_reading(
        a_set(stiffer, lambda command, _: command),
        lambda voltage, time: voltage + 7e-3 * np.sin(2.0 * np.pi * 50.0 * time))
    found = diagnose_set(recordings, Device.nominal(), traces=False).document
    assert (found['verdict'], found['selected']) == ('CAUSE', ['parallel_stiffness'])


@pytest.mark.slow
def test_an_effect_behind_a_driver_of_another_form_is_found():
    device = Device.nominal().with_effects({'mount_creep': {'gain_per_decade': 0.01}})
    found = diagnose_set(a_set(device, slow), Device.nominal(), traces=False).document
    assert found['verdict'] == 'MULTIPLE'
    assert set(found['selected']) == {'amplifier_bandwidth', 'mount_creep'}
    assert 'at the terminals' in found['reason']


@pytest.mark.slow
def test_nothing_is_found_behind_such_a_driver_where_nothing_is():
    found = diagnose_set(a_set(Device.nominal(), slow), Device.nominal(), traces=False).document
    assert found['selected'] == ['amplifier_bandwidth']


@pytest.mark.slow
def test_a_driver_that_no_effect_explains_is_unknown_and_its_block_known():
    found = diagnose_set(a_set(Device.nominal(), coarse), Device.nominal(), traces=False).document
    assert found['verdict'] == 'UNKNOWN'
    assert found['where']['block'] == 'drive'
    assert found['selected'] == []


@pytest.fixture
def fits():
    singles = [Ranked('amplifier_gain', 5000.0, 0.9, 2, left=0.5, excess=50.0),
               Ranked('creep', 900.0, 0.1, 2, left=0.9, excess=90.0)]
    pairs = [Ranked('amplifier_gain+creep', 5400.0, 0.99, 4, left=0.01, second=300.0, part=0.8,
                    over=300.0)]
    return singles, pairs, 1.0, 500.0, []


def test_a_second_effect_must_explain_something_behind_the_terminals(fits):
    assert decide(*fits).word == 'MULTIPLE'
    assert decide(*fits, cut=Cut(True)).selected == ('amplifier_gain',)
    assert decide(*fits, cut=Cut(True, supported=frozenset({'creep'}))).word == 'MULTIPLE'


@pytest.mark.parametrize('length, word', [(0.2, 'MULTIPLE'), (0.9, 'CAUSE')])
def test_who_hardly_sees_an_effect_behind_the_terminals_does_not_deny_it(fits, length, word):
    def part(name, gain, length):
        probe = Probe('creep', {}, length * np.ones((100, 1)))
        fits = {name: SimpleNamespace(effects={name: {}})}
        return Part(Search(None, fits, {'creep': [probe]}), SimpleNamespace(
            singles=[Ranked(name, gain, 0.9, 1)], verdict=SimpleNamespace(selected=(), tie=()),
            structure=0.0, alike=Alike([], [], set())), chances={name: 1.0})

    sides = Terminals(part('amplifier_gain', 900.0, 1.0), part('creep', 5.0, length))
    cut = sides.join(None, part('creep', 0.0, 1.0).search, DEFAULTS, print)
    assert decide(*fits, cut=cut).word == word


def test_the_likeliest_driver_is_named_whatever_scores_more_at_a_bound():
    def part(chances):
        fits = {name: SimpleNamespace(effects={name: {}}) for name in chances}
        return Part(Search(None, fits), SimpleNamespace(
            singles=[Ranked(name, gain, 0.9, 1) for name, gain in zip(fits, (400.0, 398.0))],
            verdict=SimpleNamespace(selected=(), tie=()), structure=9.0, alike=Alike([], [], set())
        ), chances=chances)

    limit, slow = 'amplifier_current_limit', 'amplifier_bandwidth'
    sides = Terminals(part({limit: 0.1, slow: 0.9}), part({'creep': 0.8, 'mount_creep': 0.2}))
    assert list(sides.before.best.effects) == [slow]
    chances = sides.chances
    assert max(chances, key=chances.get) == f'{slow}+creep'
    assert chances[f'{limit}+creep'] == pytest.approx(0.08)
    assert sum(chances.values()) == pytest.approx(1.0)


@pytest.mark.parametrize('driver, late, told', [
    ('command_delay', 5e-6, False), ('command_delay', 3e-5, True),
    ('amplifier_bandwidth', 5e-6, True)])
def test_a_part_of_a_row_behind_a_late_driver_tells_of_no_late_sensor(driver, late, told):
    """When it jumped between two rows nobody has measured; what a slow one does is smooth."""
    def part(name, values, gain):
        return Part(
            Search(None, {name: SimpleNamespace(effects={name: values}, phi=None)},
                   {name: [Probe(name, {}, np.ones((100, 1)))]}),
            SimpleNamespace(singles=[Ranked(name, gain, 0.99, 1)], structure=9.0,
                            alike=Alike([], [], set()),
                            verdict=SimpleNamespace(selected=(name,), tie=())),
            SimpleNamespace(evidence=SimpleNamespace(tracks=[
                SimpleNamespace(recording=SimpleNamespace(period=period))
                for period in (4e-5, 2e-3)])), {name: 1.0})

    sides = Terminals(part(driver, {'delay': 7e-5}, 5000.0),
                      part('sensor_delay', {'delay': late}, 900.0))
    assert ('sensor_delay' in sides.between_rows) != told
    if not told:
        cut = sides.join(None, sides.behind.search, DEFAULTS, print)
        assert cut.known and not cut.pair and not cut.allows('sensor_delay')


def test_what_would_show_behind_the_terminals_and_does_not_is_not_there():
    device = Device.nominal()
    fitter = fitter_of(device, device, (programmes.multisine(),), np.random.default_rng(5), NOISE)
    nominal = fitter.fit({})
    search = Search(nominal, dict.fromkeys(('sensor_lag', 'creep'), nominal))
    decision = SimpleNamespace(singles=[Ranked('creep', 300.0, 0.9, 1),
                                        Ranked('sensor_lag', 3.0, 0.0, 1)])
    behind = Part(search, decision, fitter)

    def bears(name, **values):
        return behind.bears({'amplifier_gain': {'gain_error': 0.1}, name: values}, 40.0)

    assert not bears('sensor_lag', time_constant=1e-4)
    assert bears('sensor_lag', time_constant=1e-9)  # hardly there at all
    assert bears('creep', gain_per_decade=0.05)  # found there, if not by these numbers
    assert bears('command_delay', delay=1e-3)  # lies before the terminals


def test_what_both_sides_of_the_terminals_tell_needs_a_hint_in_the_whole_only(fits):
    weak = [Ranked('amplifier_gain+creep', 5010.0, 0.91, 4, left=0.5, second=12.0, part=0.1)]
    cut = Cut(True, 'amplifier_gain+creep', 0.9)
    found = decide(fits[0], weak, *fits[2:], cut=cut)
    assert found.selected == ('amplifier_gain', 'creep')
    assert 'driven by the measured voltage' in found.reason
    none = [Ranked('amplifier_gain+creep', 5000.0, 0.9, 4, left=0.5, second=1.0)]
    assert decide(fits[0], none, *fits[2:], cut=cut).selected == ('amplifier_gain',)


def test_what_leaves_more_behind_the_terminals_needs_more_in_the_whole(fits):
    cut = Cut(True, 'amplifier_gain+creep', 0.6)
    for nats, word in ((12.0, 'CAUSE'), (60.0, 'MULTIPLE')):
        pair = [Ranked('amplifier_gain+creep', 5010.0, 0.91, 4, left=0.5, second=nats, part=0.1)]
        assert decide(fits[0], pair, *fits[2:], cut=cut).word == word
