# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Units and signs that are wrong are told by the answers, mended or refused."""

import numpy as np
from piezo_stack_sim.errors import InputError
from piezo_stack_sim.recording import parse_units
import pytest
from recorded import answered, checked, mended, pushed, refusal, same, slow, triangle, with_channel


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
