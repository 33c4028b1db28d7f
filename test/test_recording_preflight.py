# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Preflight names what is wrong with a recording, mends what is safe, and refuses the rest."""

import numpy as np
from piezo_stack_sim.errors import InputError
from piezo_stack_sim.recording import preflight
import pytest
from recorded import (
    answered, checked, DEVICE, mended, pushed, refusal, same, set_of, slow, triangle, with_channel)


@pytest.mark.parametrize('recording', [slow(), pushed(), slow(noise=0.0), answered(
    triangle(3000, 100e-6), drive='charge')], ids=['slow', 'pushed', 'noiseless', 'charge'])
def test_a_good_recording_passes_untouched(recording):
    passed, findings = checked(recording)
    assert not findings
    assert same(passed[0], recording)


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
