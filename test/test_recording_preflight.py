# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Preflight names what is wrong with a recording, mends what is safe, and refuses the rest."""

import numpy as np
from piezo_stack_sim.errors import InputError
from piezo_stack_sim.recording import parse_units, preflight, read_csv, write_csv
from piezo_stack_sim.recording.grid import find_grid
import pytest
from recorded import answered, DEVICE, pushed, set_of, slow, triangle, with_channel


def checked(*recordings, device=DEVICE, **options):
    """Return the recordings that pass, and the findings as text."""
    result, findings = preflight(set_of(*recordings), device, **options)
    return result.recordings, [str(each) for each in findings]


def mended(recording, *others, device=DEVICE):
    """Return the first recording after preflight and the only finding about it."""
    passed, findings = checked(recording, *others, device=device)
    assert len(findings) == 1, findings
    return passed[0], findings[0]


def refusal(recording, device=DEVICE):
    """Return the one refusal of a recording."""
    with pytest.raises(InputError) as error:
        preflight(set_of(recording), device)
    assert str(error.value).startswith('refused: triangle.csv')
    return str(error.value)


def same(one, other):
    """Return whether two recordings have equal columns up to rounding."""
    return all(np.allclose(one.columns()[name], values, rtol=1e-12, atol=1e-15)
               for name, values in other.columns().items())


def arrivals(time, seed):
    """Return when messages sent at `time` arrive, each with a delay of its own."""
    late = np.random.default_rng(seed).exponential(2e-4, time.size)
    times = np.maximum.accumulate(time + late)
    return times - times[0]


@pytest.mark.parametrize('recording', [slow(), pushed(), slow(noise=0.0), answered(
    triangle(3000, 100e-6), drive='charge')], ids=['slow', 'pushed', 'noiseless', 'charge'])
def test_a_good_recording_passes_untouched(recording):
    passed, findings = checked(recording)
    assert not findings
    assert same(passed[0], recording)


@pytest.mark.parametrize('channel, factor, unit', [
    ('displacement', 1e6, 'um'), ('displacement', 1e9, 'nm'), ('displacement', 1e3, 'mm'),
    ('charge', 1e6, 'uC'), ('charge', 1e9, 'nC'), ('voltage', 1e3, 'mV'), ('voltage', 1e-3, 'kV'),
])
def test_a_unit_wrong_by_thousands_is_recognised_by_the_size_it_gives(channel, factor, unit):
    recording = slow()
    wrong = with_channel(recording, channel, recording.measured[channel] * factor)
    passed, finding = mended(wrong)
    assert finding.startswith('repaired: triangle.csv: ') and f'{channel} is in {unit}' in finding
    assert same(passed, recording)


@pytest.mark.parametrize('channel, stated, factor, words', [
    ('displacement', None, 1e3, 'displacement is in mm, as its size tells: multiplied by 1e-3'),
    ('displacement', ('--unit', 1e-6), 1e3,
     'displacement is in nm, as its size tells, and not in um as --unit says: --unit is '
     'overruled: multiplied by 1e-09 instead of 1e-06'),
    ('displacement', ('the header', -1e-3), 1e3,
     'displacement is in um, as its size tells, and not in mm as the header says: the header is '
     'overruled: multiplied by -1e-06 instead of -0.001'),
    ('displacement', ('--unit', 3e-3), 1e3, 'displacement is 1e3 times too large, as its size '
     'tells, with the factor 0.003 of --unit: --unit is overruled: multiplied by 3e-06 instead'),
    ('command', ('the header', 1e-3), 1e-3,
     'voltage_command is in V, as its size tells, and not in mV as the header says'),
    ('command', ('the header', 1.0), 1e-3, 'is in kV, as its size tells, and not in V as the'),
    ('command', ('--unit', 20.0), 1e-3,
     'voltage_command is 1e3 times too small, as its size tells, with the factor 20 of --unit'),
])
def test_a_unit_that_was_given_and_is_another_is_said_to_be_overruled(
        channel, stated, factor, words):
    recording = slow()
    if channel == 'command':
        wrong = recording.replace(command=recording.command * factor)
    else:
        wrong = with_channel(recording, channel, recording.measured[channel] * factor)
    name = 'voltage_command' if channel == 'command' else channel
    passed, finding = mended(wrong.replace(stated={name: stated} if stated else {}))
    assert same(passed, recording)
    assert words in finding


@pytest.mark.parametrize('stated, mend', [
    (None, '--unit displacement=um'), (('the header', 1e-6), '--unit displacement=m')])
def test_a_displacement_too_small_for_its_unit_is_refused_with_the_one_it_may_be_in(
        stated, mend):
    recording = slow()
    wrong = with_channel(recording, 'displacement', recording.measured['displacement'] * 1e-6)
    with pytest.raises(InputError) as caught:
        checked(wrong.replace(stated={'displacement': stated} if stated else {}))
    assert str(caught.value).endswith(mend)


@pytest.mark.parametrize('factor, unit', [(1e3, 'mV'), (1e-3, 'kV')])
def test_a_command_in_another_unit_is_recognised_too(factor, unit):
    recording = slow()
    passed, finding = mended(recording.replace(command=recording.command * factor))
    assert f'voltage_command is in {unit}' in finding
    assert same(passed, recording)


def test_a_charge_command_in_microcoulomb_is_recognised():
    recording = answered(triangle(3000, 100e-6), drive='charge')
    passed, finding = mended(recording.replace(command=recording.command * 1e6))
    assert 'charge_command is in uC' in finding
    assert same(passed, recording)


def test_command_and_voltage_in_kilovolt_are_told_from_all_else_being_too_large():
    recording = slow()
    wrong = with_channel(recording, 'voltage', recording.measured['voltage'] / 1e3)
    passed, findings = checked(wrong.replace(command=recording.command / 1e3))
    assert [('voltage is in kV' in each, 'voltage_command is in kV' in each)
            for each in sorted(findings)] == [(True, False), (False, True)]
    assert same(passed[0], recording)


def test_a_force_in_millinewton_is_recognised():
    recording = pushed()
    passed, finding = mended(recording.replace(external_force=recording.external_force * 1e3))
    assert 'external_force is in mN' in finding
    assert same(passed, recording)


def test_a_force_in_kilonewton_is_told_by_the_answer_to_it():
    recording = pushed()
    passed, finding = mended(recording.replace(external_force=recording.external_force / 1e3))
    assert 'external_force is in kN' in finding
    assert same(passed, recording)


@pytest.mark.parametrize('newton, blocked', [(9.80665, False), (9.80665e-3, True)])
def test_a_force_in_weights_is_noted_with_the_unit_to_give(newton, blocked):
    recording = pushed()
    wrong = recording.replace(external_force=recording.external_force / newton)
    passed, findings = checked(wrong)
    assert f'answered as if it were {newton:.2g} times as large' in findings[0]
    assert '--unit external_force=9.80665;' in findings[0]
    assert '--unit external_force=9.80665e-3' in findings[0]
    assert same(passed[0], wrong)
    assert [('beyond the blocking force' in each, 'gain' in each) for each in findings[1:]] == [
        (True, False)] * blocked
    mend = parse_units([f'external_force={newton}'])['external_force']
    assert not checked(wrong.replace(external_force=mend * wrong.external_force))[1]


def only_displacement(recording):
    """Return the recording without its other channels."""
    return recording.replace(measured={'displacement': recording.measured['displacement']})


def test_a_command_that_its_own_recording_cannot_tell_takes_the_unit_of_the_set():
    recordings = [only_displacement(each) for each in (pushed(), slow())]
    wrong = [each.replace(command=each.command / 1e3) for each in recordings]
    passed, findings = checked(*wrong)
    assert sum('voltage_command is in kV' in each for each in findings) == 2
    assert all(same(one, other) for one, other in zip(passed, recordings))


def test_a_command_of_hardly_any_volts_is_noted():
    wrong = only_displacement(pushed())
    _, findings = checked(wrong.replace(command=wrong.command / 1e3), only_displacement(slow()))
    assert any('voltage_command reaches 0.04 V of 150' in each for each in findings)


def test_a_command_outside_the_range_is_noted_with_its_row():
    _, finding = mended(slow(height=180.0))
    assert "voltage_command is 179.9 V there, outside the device's range" in finding


@pytest.mark.parametrize('channel', ['charge', 'displacement'])
def test_a_unit_that_nobody_uses_is_refused(channel):
    recording = slow()
    assert channel in refusal(with_channel(recording, channel, recording.measured[channel] / 1e3))


def test_a_gain_that_no_unit_explains_is_noted_and_kept():
    recording = slow()
    passed, finding = mended(with_channel(
        recording, 'displacement', recording.measured['displacement'] * 30.0))
    assert finding.startswith('note: ') and '--unit takes factors' in finding
    assert np.array_equal(passed.measured['displacement'],
                          recording.measured['displacement'] * 30.0)


@pytest.mark.parametrize('channels, gain', [
    (('voltage', 'charge', 'displacement'), 4.0), (('charge', 'displacement'), 30.0)])
def test_what_an_amplifier_lies_before_is_told_by_its_gain(channels, gain):
    recording = slow()
    recording = recording.replace(
        command=recording.command / gain,
        measured={name: recording.measured[name] for name in channels})
    passed, findings = checked(recording)
    told, = (each for each in findings if 'amplifier' in each)
    assert told.startswith('note: ')
    assert float(told.rsplit('=', 1)[1]) == pytest.approx(gain, rel=0.01)
    assert np.array_equal(passed[0].command, recording.command)


@pytest.mark.parametrize('gain', [15.0, 50.0, 200.0])
def test_a_gain_beyond_any_effect_is_asked_for_and_no_unit_is_guessed(gain):
    recording = slow()
    text = refusal(recording.replace(command=recording.command / gain))
    assert float(text.rsplit('=', 1)[1]) == pytest.approx(gain, rel=0.01)


def test_a_voltage_behind_a_divider_is_told_from_a_command_before_an_amplifier():
    recording = slow()
    _, findings = checked(with_channel(recording, 'voltage',
                                       recording.measured['voltage'] / 100.0))
    told, = findings
    assert told.startswith('note: ') and 'divider' in told
    assert float(told.rsplit('--unit voltage=', 1)[1]) == pytest.approx(100.0, rel=0.01)


def test_a_size_that_no_unit_explains_is_refused():
    recording = slow()
    text = refusal(with_channel(
        recording, 'displacement', recording.measured['displacement'] * 3e4))
    assert 'displacement' in text and '--unit displacement=' in text


def test_a_unit_is_not_guessed_without_a_device():
    recording = slow()
    wrong = with_channel(recording, 'displacement', recording.measured['displacement'] * 1e6)
    assert 'hardly in m' in refusal(wrong, device=None)


@pytest.mark.parametrize('channel', ['voltage', 'charge', 'displacement'])
def test_a_swapped_sign_is_turned(channel):
    recording = slow()
    passed, finding = mended(with_channel(recording, channel, -recording.measured[channel]))
    assert f'{channel} has the wrong sign' in finding
    assert same(passed, recording)


def test_an_inverting_amplifier_is_seen_by_all_answers_being_turned():
    recording = slow()
    passed, finding = mended(recording.replace(command=-recording.command))
    assert 'voltage_command has the wrong sign' in finding
    assert same(passed, recording)


def test_an_inverting_amplifier_is_seen_by_a_command_outside_the_range_too():
    recording = only_displacement(slow())
    passed, findings = checked(recording.replace(command=-recording.command))
    assert 'voltage_command has the wrong sign' in findings[0]
    assert same(passed[0], recording)


def test_a_force_counted_in_compression_is_turned():
    recording = pushed()
    passed, finding = mended(recording.replace(external_force=-recording.external_force))
    assert 'external_force has the wrong sign' in finding
    assert same(passed, recording)


def test_what_a_force_alone_moves_too_little_may_have_its_unit_wrong():
    """The gain of the sensor would be as good a guess: both are named."""
    recording = pushed(height=0.0)
    lone = recording.replace(measured={'displacement': recording.measured['displacement']})
    far = lone.replace(measured={'displacement': lone.measured['displacement'] / 30.0})
    told = [each for each in checked(far, slow())[1] if 'times as far' in each]
    assert len(told) == 1 and 'check the unit of external_force, which alone moves it' in told[0]


def test_sign_of_displacement_under_force_alone_is_taken_from_the_other_recordings():
    recording = pushed(height=0.0)
    lone = recording.replace(measured={'displacement': recording.measured['displacement']})
    turned = lone.replace(external_force=-lone.external_force)
    (passed, _), findings = checked(turned, slow())
    assert any('external_force has the wrong sign' in each for each in findings)
    assert same(passed, lone)


def test_a_sign_that_nobody_can_tell_is_refused():
    recording = pushed(height=0.0, name='triangle')
    lone = recording.replace(measured={'displacement': -recording.measured['displacement']})
    assert '--unit external_force=-1' in refusal(lone)


def test_motion_beyond_resonance_is_not_taken_for_a_wrong_sign():
    command = 20.0 + 20.0 * np.sin(np.linspace(0.0, 600.0 * np.pi, 3000))
    recording = answered(command * np.minimum(np.arange(3000) / 300.0, 1.0), rate=100e3)
    fast = recording.measured['displacement'] - 2.0 * np.where(
        np.arange(3000) < 300, 0.0, recording.measured['displacement'] - 4e-6)
    _, findings = checked(with_channel(recording, 'displacement', fast))
    assert not any('sign' in each for each in findings)


def test_duplicated_rows_are_dropped_and_named():
    recording = slow()
    rows = np.insert(np.arange(3000), 1200, [1198, 1199])
    passed, finding = mended(recording.take(rows))
    assert 'row 1200: 2 rows are there twice' in finding
    assert same(passed, recording)


def test_times_of_too_few_digits_are_no_duplicates_where_the_device_rests():
    command = np.r_[np.zeros(400), triangle(3000, 60.0)]
    recording = answered(command, rate=4e3)
    coarse = recording.replace(time=np.round(recording.time, 3), measured={
        name: np.round(values / 2e-8) * 2e-8 for name, values in recording.measured.items()
        if name == 'displacement'})
    passed, findings = checked(coarse)
    assert len(passed[0]) == 3400 and not any('twice' in each for each in findings)
    assert passed[0].duration == pytest.approx(recording.duration, rel=1e-3)


def test_swapped_rows_are_sorted_when_that_makes_the_times_regular():
    recording = slow()
    rows = np.arange(3000)
    rows[[700, 701]] = 701, 700
    passed, finding = mended(recording.take(rows))
    assert 'row 702: 2 rows are out of order' in finding
    assert same(passed, recording)


def test_two_runs_in_one_file_are_refused_with_the_row_to_split_at():
    recording = slow()
    again = slow(seed=1)
    text = refusal(recording.take(np.r_[0:3000, 0:3000]).replace(
        measured={name: np.r_[values, again.measured[name]]
                  for name, values in recording.measured.items()}, rows=np.arange(2, 6002)))
    assert 'row 3002: the time goes back by 0.2999 s' in text and 'split the file there' in text


def test_a_clock_that_was_set_back_is_refused():
    recording = slow()
    text = refusal(recording.replace(time=recording.time - np.where(
        np.arange(3000) < 1500, 0.0, 0.00025)))
    assert 'row 1502: the time goes back by' in text


def test_lost_rows_are_filled_in_and_counted():
    recording = slow()
    passed, finding = mended(recording.take(np.delete(np.arange(3000), [50, 900, 901])))
    assert 'row 52: 3 rows were lost in 2 places' in finding or \
        'row 53: 3 rows were lost in 2 places' in finding
    assert np.allclose(passed.time, recording.time) and passed.rows[50] == 0
    assert np.allclose(passed.command, recording.command, atol=1e-9)
    assert np.allclose(passed.measured['displacement'], recording.measured['displacement'],
                       atol=2e-8)


def test_after_a_gap_with_unknown_commands_nothing_is_used():
    recording = slow()
    passed, finding = mended(recording.take(np.delete(np.arange(3000), np.r_[2100:2300])))
    assert 'row 2302: 200 rows are missing' in finding and '2100 rows before it' in finding
    assert same(passed, recording.take(slice(0, 2100)))


def test_a_recording_whose_command_is_lost_early_is_refused():
    text = refusal(slow().take(np.delete(np.arange(3000), np.r_[300:500])))
    assert '200 rows are missing' in text


def test_a_gap_within_a_hold_is_kept():
    steps = np.repeat([0.0, 30.0, 60.0, 0.0], 1000)
    recording = answered(steps).take(np.delete(np.arange(4000), np.r_[1300:1800]))
    passed, finding = mended(recording)
    assert finding.startswith('note: ') and 'count as held' in finding
    assert same(passed, recording)


def test_gaps_within_holds_are_one_note():
    steps = np.repeat([0.0, 30.0, 60.0, 0.0], 1000)
    recording = answered(steps).take(np.delete(
        np.arange(4000), np.r_[300:400, 1300:1800, 2500:2520]))
    passed, finding = mended(recording)
    assert 'row 402: 620 rows are missing in 3 places, up to 0.0501 s' in finding
    assert same(passed, recording)


@pytest.mark.parametrize('order', [(1, 8), (8, 1), (2, 1), (1, 2)])
def test_a_change_of_the_rate_is_no_loss_of_rows(order):
    command = np.r_[triangle(3000, 60.0), np.zeros(3000)] + triangle(6000, 20.0, turns=7)
    rows = np.r_[0:3000:order[0], 3000:6000:order[1]]
    recording = answered(command).take(rows)
    passed, finding = mended(recording)
    assert finding.startswith('note: ') and 'the sampling changes there' in finding
    assert f'row {rows[3000 // order[0]] + 2}:' in finding
    assert same(passed, recording)


def test_a_lost_row_of_a_fast_wave_is_filled_in_along_it_and_beside_a_jump_by_a_line():
    time = np.arange(6000) * 1e-4
    wave = 30.0 * np.sin(2.0 * np.pi * 400.0 * time)  # 25 rows a period; lines are off by 0.9 V
    jumps = 20.0 * (time % 0.1 > 0.05)
    lost = np.arange(40, 5900, 97)
    for command, off in ((wave, 0.05), (jumps, 10.0 + 1e-9), (wave + jumps, 10.9)):
        recording = answered(command, noise=0.0)
        passed, _ = checked(recording.take(np.delete(np.arange(6000), lost)))
        wrong = np.abs(passed[0].command - command)
        assert wrong.max() < off
        assert np.median(wrong[lost]) < 0.05


def test_many_lost_rows_are_refused():
    keep = np.random.default_rng(1).random(3000) > 0.2
    assert 'rows are missing in' in refusal(slow().take(keep))


def test_times_of_arrival_are_put_back_on_their_grid():
    recording = slow(rate=1000.0)
    passed, finding = mended(recording.replace(time=arrivals(recording.time, seed=2)))
    assert 'jitter by' in finding
    assert np.allclose(np.diff(passed.time), 1e-3, rtol=1e-5)


def test_a_row_lost_among_late_arrivals_is_found():
    recording = slow(rate=1000.0)
    kept = np.delete(np.arange(3000), [1500])
    passed, findings = checked(recording.replace(time=arrivals(recording.time, seed=3)).take(kept))
    assert any('1 rows were lost in 1 places' in each for each in findings)
    assert len(passed[0]) == 3000


def test_late_arrivals_that_recover_are_not_lost_rows():
    recording = slow(rate=1000.0)
    times = arrivals(recording.time, seed=4)
    times[800:820] = times[819] + 1e-6 * np.arange(20)
    passed, findings = checked(recording.replace(time=np.maximum.accumulate(times)))
    assert len(passed[0]) == 3000
    assert not any('lost' in each for each in findings)


def test_times_in_two_kinds_of_steps_have_no_grid():
    time = np.concatenate(([0.0], np.cumsum(np.repeat([1e-4, 1.0], 10))))
    assert find_grid(time) is None
    assert find_grid(time[:11]).kind == 'regular'


def test_irregular_sampling_is_kept_as_it_is():
    recording = slow()
    time = np.cumsum(np.random.default_rng(5).uniform(0.5e-4, 1.5e-4, 3000))
    time -= time[0]
    passed, finding = mended(recording.replace(time=time))
    assert finding.startswith('note: ') and 'sampled irregularly' in finding
    assert np.array_equal(passed.time, time)


def test_times_with_too_few_digits_are_spread_out():
    recording = slow(rate=10e3)
    passed, finding = mended(recording.replace(time=np.round(recording.time, 3)))
    assert 'jitter' in finding
    assert np.allclose(np.diff(passed.time), 1e-4, rtol=1e-3)


def test_times_in_nanoseconds_since_1970_become_seconds_from_zero():
    recording = slow()
    passed, findings = checked(recording.replace(time=1.7e18 + 1e9 * recording.time))
    assert any('taken as ns since 1970' in each for each in findings)
    assert np.allclose(passed[0].time, recording.time, atol=1e-6)


def test_rows_in_milliseconds_are_not_taken_for_seconds():
    recording = slow(rate=1000.0)
    assert '--unit time=ms' in refusal(recording.replace(time=recording.time * 1e6))
    _, finding = mended(recording.replace(time=recording.time * 1e3))
    assert finding.startswith('note: ') and '--unit time=ms' in finding


def test_rows_half_a_minute_apart_are_taken_if_the_unit_of_the_time_is_said(tmp_path):
    recording = slow()
    recording = recording.replace(time=30.0 * np.arange(len(recording)))
    assert '--unit time=ms (or time=s)' in refusal(recording)
    path = tmp_path / 'run.csv'
    write_csv(recording, path)
    said = read_csv(path, units=parse_units(['time=s']))
    assert np.array_equal(checked(said)[0][0].time, recording.time)
    headed = path.read_text().replace('time,', 'time [s],', 1)
    path.write_text(headed)
    assert np.array_equal(checked(read_csv(path))[0][0].time, recording.time)


def test_a_few_missing_samples_are_filled_in():
    recording = slow()
    values = recording.measured['charge'].copy()
    values[[7, 800, 801]] = np.nan
    passed, finding = mended(with_channel(recording, 'charge', values))
    assert 'row 9: charge is missing in 3 of 3000 rows' in finding
    assert np.allclose(passed.measured['charge'], recording.measured['charge'], atol=1e-6)


def test_rows_at_the_ends_whose_samples_are_missing_are_left_out():
    recording = slow()
    values = recording.measured['charge'].copy()
    values[[0, 1, 800, 2998, 2999]] = np.nan
    passed, finding = mended(with_channel(recording, 'charge', values))
    assert finding.endswith('filled in by straight lines, the first 2 rows are left out, the last '
                            '2 rows are left out')
    assert np.array_equal(passed.command, recording.command[2:2998])
    assert passed.time == pytest.approx(recording.time[:2996])
    assert passed.rows.tolist() == recording.rows[2:2998].tolist()
    assert np.allclose(passed.measured['charge'], recording.measured['charge'][2:2998], atol=1e-6)


def test_a_first_row_in_which_the_device_jumps_is_kept_whatever_is_missing_there():
    recording = from_rest(40.0 + 0.5 * np.sin(2.0 * np.pi * 50e-4 * np.arange(3000)))
    values = recording.measured['displacement'].copy()
    values[0] = np.nan
    passed, finding = checked(with_channel(recording, 'displacement', values))
    assert np.array_equal(passed[0].command, recording.command)
    assert passed[0].start == (0.0, 0.0)
    assert 'the first 1 rows, in which others jump, hold the value that follows' in finding[0]


def test_a_channel_that_is_mostly_missing_is_left_out():
    recording = slow()
    values = np.where(np.arange(3000) < 2000, recording.measured['charge'], np.nan)
    passed, findings = checked(with_channel(recording, 'charge', values))
    assert 'charge' not in passed[0].measured
    assert any('row 2002: charge is missing in 1000 of 3000 rows' in each for each in findings)


def test_a_slower_channel_is_interpolated_with_a_word():
    recording = slow()
    values = np.where(np.arange(3000) % 10 == 0, recording.measured['displacement'], np.nan)
    passed, finding = mended(with_channel(recording, 'displacement', values))
    assert 'measured every 10th row only' in finding
    assert np.allclose(passed.measured['displacement'][:2990],
                       recording.measured['displacement'][:2990], atol=1e-7)


def test_commands_written_only_when_they_change_are_held():
    steps = np.repeat([0.0, 30.0, 60.0, 0.0], 1000)
    recording = answered(steps)
    sparse = np.where(np.arange(4000) % 1000 == 0, steps, np.nan)
    passed, finding = mended(recording.replace(command=sparse))
    assert 'voltage_command is empty in 3996 rows' in finding
    assert np.array_equal(passed.command, steps)


def test_rows_without_numbers_count_as_lost():
    recording = slow()
    command = recording.command.copy()
    command[[100, 2100]] = np.nan, np.inf
    passed, findings = checked(recording.replace(command=command))
    assert 'row 2102: voltage_command has impossible values in 1 rows, here inf' in findings[0]
    assert 'row 102: 2 rows lack a time or an input' in findings[1]
    assert np.allclose(passed[0].command, recording.command, atol=1e-9)


def test_numbers_that_stand_for_no_answer_count_as_missing():
    recording = slow()
    values = recording.measured['displacement'].copy()
    values[[100, 101, 2000]] = -9999.0, 1e38, np.inf
    passed, findings = checked(with_channel(recording, 'displacement', values))
    assert 'row 102: displacement has impossible values in 3 rows, here -9999' in findings[0]
    assert 'row 102: displacement is missing in 3 of 3000 rows' in findings[1]
    assert np.allclose(passed[0].measured['displacement'],
                       recording.measured['displacement'], atol=5e-8)


@pytest.mark.parametrize('channel, constant', [
    ('displacement', -9999.0), ('displacement', 99.0), ('charge', -1.0), ('voltage', 9999.0)])
def test_a_constant_that_stands_for_no_answer_decides_no_unit(channel, constant):
    recording = slow()
    values = recording.measured[channel].copy()
    values[np.random.default_rng(5).choice(3000, 45, replace=False)] = constant
    passed, findings = checked(with_channel(recording, channel, values))
    assert f'{channel} has impossible values in 45 rows, here {constant:g}' in findings[0]
    assert not any('size tells' in each for each in findings)
    assert np.ptp(passed[0].measured[channel]) == pytest.approx(
        np.ptp(recording.measured[channel]), rel=0.01)


def test_a_channel_of_one_value_where_it_has_any_is_checked_all_the_same():
    recording = slow()
    values = np.full(3000, np.nan)
    values[::100] = 1e-6
    passed, findings = checked(with_channel(recording, 'displacement', values))
    assert 'displacement' not in passed[0].measured and findings


def test_a_lone_number_among_the_inputs_that_nothing_answers_is_none():
    recording = slow()
    command, force = recording.command.copy(), np.zeros(3000)
    command[500], force[700] = -9999.0, 1e7
    passed, findings = checked(recording.replace(command=command, external_force=force))
    assert 'row 502: voltage_command has impossible values in 1 rows' in findings[0]
    assert 'row 702: external_force has impossible values in 1 rows' in findings[1]
    assert np.abs(passed[0].command - recording.command).max() < 0.1
    assert not passed[0].external_force.any()


def test_a_short_pulse_in_a_long_rest_is_an_answer_and_no_spike():
    command = np.zeros(20000)
    command[9000:9150] = 60.0
    recording = answered(command, rate=1e3)
    passed, findings = checked(recording)
    assert not findings
    assert same(passed[0], recording)
    voltage = recording.measured['voltage'].copy()
    voltage[3000] = -9999.0
    _, findings = checked(with_channel(recording, 'voltage', voltage))
    assert 'row 3002: voltage has impossible values in 1 rows, here -9999' in findings[0]


def from_rest(command):
    """Return a recording that begins at rest: its first row is sampled before its command."""
    recording = answered(np.concatenate(([0.0], command))).take(slice(1, None))
    return recording.replace(time=np.arange(len(recording)) / 10e3)


@pytest.mark.parametrize('rest', [0, 1, 20, 100])
def test_a_device_that_steps_to_a_bias_in_its_first_rows_was_at_rest_before(rest):
    command = 40.0 + 0.5 * np.sin(2.0 * np.pi * 50e-4 * np.arange(3000))
    command[:rest] = 0.0
    recording = from_rest(command)
    passed, findings = checked(recording)
    assert not findings
    assert same(passed[0], recording) and passed[0].start == (0.0, 0.0)


@pytest.mark.parametrize('constant', [-9999.0, 1e38])
def test_what_stands_for_no_answer_does_so_in_the_first_row_too(constant):
    recording = from_rest(40.0 + 0.5 * np.sin(2.0 * np.pi * 50e-4 * np.arange(3000)))
    values = recording.measured['displacement'].copy()
    values[0] = constant
    _, findings = checked(with_channel(recording, 'displacement', values))
    assert 'row 3: displacement has impossible values in 1 rows' in findings[0]


def test_a_lone_zero_among_the_commands_is_one_that_the_device_followed():
    command = 40.0 + 0.5 * np.sin(2.0 * np.pi * 50e-4 * np.arange(3000))
    command[1500] = 0.0
    recording = from_rest(command)
    passed, findings = checked(recording)
    assert not findings and same(passed[0], recording)


def test_an_empty_force_is_none():
    recording = slow()
    passed, finding = mended(recording.replace(external_force=np.full(3000, np.nan)))
    assert 'external_force is empty throughout' in finding
    assert same(passed, recording)


def test_a_dead_channel_is_left_out():
    recording = slow()
    passed, findings = checked(with_channel(recording, 'charge', np.full(3000, 0.125)))
    assert 'charge is 0.125 in every row' in findings[0]
    assert set(passed[0].measured) == {'voltage', 'displacement'}


def test_a_channel_of_mere_noise_is_left_out():
    recording = slow()
    noise = 2e-9 * np.random.default_rng(6).standard_normal(3000)
    passed, findings = checked(with_channel(recording, 'displacement', noise))
    assert 'not connected?' in findings[0]
    assert set(passed[0].measured) == {'voltage', 'charge'}


def logged_late(recording):
    """Return a recording with every command beside what was measured after it."""
    command = np.concatenate((recording.command[:1], recording.command[:-1]))
    return recording.replace(command=command)


def wobbling(**settings):
    """Return the recording of a bias with steps of random height, as a real driver lags them."""
    random = np.random.default_rng(11)
    command = 40.0 + 20.0 * np.repeat(random.uniform(-1.0, 1.0, 100), 30)
    recording = answered(np.concatenate((np.linspace(0.0, 40.0, 200), command)), **settings)
    voltage, lagged = recording.measured['voltage'], np.zeros(len(recording))
    for k in range(1, lagged.size):
        lagged[k] = lagged[k - 1] + 0.8 * (voltage[k] - lagged[k - 1])
    return with_channel(recording, 'voltage', lagged)


@pytest.mark.parametrize('recording', [
    slow(), wobbling(), answered(triangle(3000, 100e-6), drive='charge')],
    ids=['triangle', 'steps behind a lag', 'charge'])
def test_a_command_that_shows_in_its_own_row_counts_from_the_row_before(recording):
    assert checked(recording)[1] == []
    passed, finding = mended(logged_late(recording))
    assert finding.startswith('repaired: ') and 'in its own row' in finding
    assert np.array_equal(passed.command[:-1], recording.command[:-1])
    assert all(np.array_equal(passed.measured[name], values)
               for name, values in recording.measured.items())


def test_a_measured_voltage_that_is_played_is_no_measurement_of_the_driver():
    recording = slow()
    played = recording.replace(command=recording.measured['voltage'])
    passed, findings = checked(played)
    assert set(passed[0].measured) == set(recording.measured) - {'voltage'}
    assert any('voltage is the command, row by row' in each for each in findings)
    # What was read before a row's command took effect is what the row before commanded.
    assert np.array_equal(passed[0].command[:-1], recording.measured['voltage'][1:])


@pytest.mark.parametrize('channels', [('charge', 'displacement'), ('displacement',)])
def test_jumps_tell_that_without_the_voltage(channels):
    recording = wobbling()
    recording = recording.replace(
        measured={name: recording.measured[name] for name in channels})
    passed, findings = checked(logged_late(recording))
    assert len([each for each in findings if 'in its own row' in each]) == 1
    assert np.array_equal(passed[0].command[:-1], recording.command[:-1])
    assert np.array_equal(checked(recording)[0][0].command, recording.command)


def test_a_recording_that_does_not_tell_was_logged_as_the_others():
    sine = answered(45.0 * (1.0 - np.cos(np.linspace(0.0, 2.0 * np.pi, 3000))), name='sine')
    passed, findings = checked(logged_late(sine), logged_late(slow()))
    assert [('sine.csv' in each, 'in other recordings' in each) for each in findings] == [
        (True, True), (False, False)]
    assert np.array_equal(passed[0].command[:-1], sine.command[:-1])
    # Where the others disagree, or none tells, it stays as it is.
    for others in [logged_late(slow()), wobbling(name='steps')], []:
        passed, _ = checked(sine, *others)
        assert np.array_equal(passed[0].command, sine.command)


def test_shorted_leads_show_no_voltage_and_that_is_no_dead_channel():
    recording = pushed(height=0.0, drive='shorted', noise=0.0)
    passed, findings = checked(recording)
    assert not findings
    assert set(passed[0].measured) == {'voltage', 'charge', 'displacement'}


def test_a_clipped_channel_is_noted_with_its_first_row():
    recording = slow()
    clipped = np.minimum(recording.measured['displacement'], 9e-6)
    passed, finding = mended(with_channel(recording, 'displacement', clipped))
    first = 2 + int(np.argmax(clipped == 9e-6))
    assert f'row {first}: displacement is cut off at 9e-06' in finding
    assert np.array_equal(passed.measured['displacement'], clipped)


def test_a_force_at_the_end_of_its_sensor_is_noted_and_one_that_is_held_is_not():
    recording = pushed()
    clipped = np.maximum(recording.external_force, -80.0)
    _, findings = checked(recording.replace(external_force=clipped))
    first = 2 + int(np.argmax(clipped == -80.0))
    assert f'row {first}: external_force is cut off at -80' in findings[0]
    held = answered(recording.command, clipped)
    assert not checked(held)[1]


def test_a_channel_that_the_recorder_repeated_is_noted():
    recording = slow()
    values = recording.measured['charge'].copy()
    values[400:460] = values[400]
    _, finding = mended(with_channel(recording, 'charge', values))
    assert 'row 402: charge stands still at' in finding and '60 rows' in finding


@pytest.mark.parametrize('channel, offset', [('charge', 2e-5), ('displacement', -3e-6)])
def test_sensors_that_do_not_begin_at_zero_are_zeroed(channel, offset):
    recording = slow()
    passed, finding = mended(with_channel(
        recording, channel, recording.measured[channel] + offset))
    assert f'row 2: {channel} begins at' in finding
    assert np.allclose(passed.measured[channel], recording.measured[channel], atol=3e-7)


def test_an_offset_of_the_voltage_is_physics_and_stays():
    recording = slow()
    passed, finding = mended(with_channel(
        recording, 'voltage', recording.measured['voltage'] + 5.0))
    assert finding.startswith('note: ') and 'offset of the driver' in finding
    assert np.allclose(passed.measured['voltage'][0], 5.0, atol=0.1)


@pytest.mark.parametrize('channels', [
    ('voltage', 'charge', 'displacement'), ('displacement',)])
def test_a_recording_that_begins_at_a_bias_is_simulated_from_there(channels):
    recording = answered(40.0 + triangle(3000, 30.0))
    recording = recording.replace(
        measured={name: recording.measured[name] for name in channels})
    passed, findings = checked(recording)
    assert [each for each in findings if 'the device rests at 40 V where it begins' in each]
    assert passed[0].start == (40.0, 0.0)
    for channel, values in passed[0].measured.items():
        start = 40.0 if channel == 'voltage' else 0.0
        assert values[0] == pytest.approx(start, abs=0.02 * np.ptp(values))
        assert np.ptp(values) == np.ptp(recording.measured[channel])
    assert preflight(set_of(*passed), DEVICE)[0].recordings[0].start == (40.0, 0.0)


@pytest.mark.parametrize('channels', [
    ('voltage', 'charge', 'displacement'), ('displacement',)])
def test_a_preload_that_was_there_before_is_simulated_from_there(channels):
    recording = answered(triangle(3000, 60.0), np.full(3000, -90.0))
    measured = {name: recording.measured[name] - recording.measured[name][0] for name in channels}
    passed, findings = checked(recording.replace(measured=measured))
    assert [each for each in findings if 'the device rests at -90 N where it begins' in each]
    assert passed[0].start == (0.0, -90.0)
    # A force that comes with the first row moves the device after it.
    jumps = {name: np.append(0.0, recording.measured[name][1:]) for name in channels}
    passed, _ = checked(recording.replace(measured=jumps))
    assert passed[0].start == (0.0, 0.0)


def test_a_relaxed_device_that_jumps_to_its_first_command_does_not_begin_there():
    for channels in ('voltage', 'displacement'), ('displacement',):
        recording = wobbling()
        recording = recording.take(slice(200, None))
        measured = {name: recording.measured[name] for name in channels}
        for values in measured.values():
            values.flags.writeable = True
            values[0] = 0.0
        recording = recording.replace(measured=measured)
        passed, _ = checked(recording)
        assert recording.command[0] != 0.0 and passed[0].start == (0.0, 0.0)


def test_a_step_in_the_very_first_row_is_no_offset():
    recording = answered(np.full(500, 60.0), noise=0.0)
    first = {name: np.r_[0.0, values[1:]] for name, values in recording.measured.items()}
    _, findings = checked(recording.replace(measured=first))
    assert not findings


def test_a_recording_of_a_few_rows_is_refused():
    assert 'only 10 rows' in refusal(slow().take(slice(0, 10)))


def test_a_recording_without_measurements_is_refused_unless_it_is_to_be_simulated():
    bare = slow().replace(measured={})
    assert 'nothing was measured' in refusal(bare)
    passed, _ = checked(bare, require_measured=False)
    assert same(passed[0], bare)


def test_a_copy_of_a_recording_does_not_count_twice():
    recording = slow()
    passed, findings = checked(recording, recording.replace(name='again', source='again.csv'))
    assert [each.name for each in passed] == ['triangle']
    assert any('again.csv: a copy of triangle.csv' in each for each in findings)


@pytest.mark.parametrize('one, other', [
    ('charge', 'displacement'), ('voltage', 'charge'), ('voltage', 'displacement')])
@pytest.mark.parametrize('digits', [None, 9])
def test_one_column_read_as_two_channels_is_refused(one, other, digits):
    recording = slow()
    values = 0.3 * recording.measured[one] + 1e-7
    if digits:
        values = np.array([float(f'{each:.{digits}g}') for each in values])
    assert f'{other} is {one}, row by row' in refusal(with_channel(recording, other, values))


def test_numbers_without_noise_are_refused_only_if_they_are_equal():
    recording = slow(noise=0.0)  # charge and displacement move in proportion
    assert not checked(recording)[1]
    equal = with_channel(recording, 'displacement', recording.measured['charge'])
    assert 'displacement is charge' in refusal(equal)


def test_what_a_noisy_command_shakes_alike_is_no_copy():
    shaken = triangle(3000, 60.0) + np.random.default_rng(3).normal(0.0, 1.0, 3000)
    recording = answered(shaken, noise=0.0)
    assert not any('row by row' in each for each in checked(recording)[1])


def test_missing_channels_are_named_with_what_they_cost():
    recording = slow()
    lone = recording.replace(measured={'displacement': recording.measured['displacement']})
    _, findings = checked(lone)
    assert ['no recording has voltage' in findings[0], 'no recording has charge' in findings[1]] \
        == [True, True]


def test_a_refused_recording_leaves_the_others():
    passed, findings = checked(slow(), pushed().take(slice(0, 5)))
    assert [each.name for each in passed] == ['triangle']
    assert any(each.startswith('refused: force.csv') for each in findings)


def test_strict_preflight_raises_at_the_first_refusal():
    with pytest.raises(InputError, match='refused: force.csv'):
        preflight(set_of(slow(), pushed().take(slice(0, 5))), DEVICE, strict=True)


def test_preflight_changes_nothing_it_is_given():
    recording = slow()
    wrong = with_channel(recording, 'displacement', -1e6 * recording.measured['displacement'])
    before = {name: values.copy() for name, values in wrong.columns().items()}
    preflight(set_of(wrong), DEVICE)
    assert all(np.array_equal(before[name], values) for name, values in wrong.columns().items())


def test_preflight_of_what_has_passed_finds_nothing_more():
    recording = slow()
    wrong = with_channel(recording, 'displacement', 3.0 - 1e6 * recording.measured['displacement'])
    once, findings = preflight(set_of(wrong.take(np.delete(np.arange(3000), [77]))), DEVICE)
    assert len(findings) == 4
    twice, more = preflight(once, DEVICE)
    assert not more and same(twice.recordings[0], once.recordings[0])
