# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Rows that are lost, doubled, late or out of order are named, and put back where that is safe."""

import numpy as np
from piezo_stack_sim.recording import parse_units, read_csv, write_csv
from piezo_stack_sim.recording.grid import find_grid
import pytest
from recorded import answered, checked, mended, refusal, same, slow, triangle


def arrivals(time, seed):
    """Return when messages sent at `time` arrive, each with a delay of its own."""
    late = np.random.default_rng(seed).exponential(2e-4, time.size)
    times = np.maximum.accumulate(time + late)
    return times - times[0]


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
