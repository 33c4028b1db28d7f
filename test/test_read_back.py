# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Noise of who read a command or a force is taken off, unless the device got it."""

import numpy as np
from piezo_stack_sim.gap.compare import compare_set
from piezo_stack_sim.gap.measured.read_back import by_lines, noise_in, smoothed, without_noise
from piezo_stack_sim.plant import Device, simulate
from piezo_stack_sim.recording import programmes
from piezo_stack_sim.recording.recording import RecordingSet
import pytest

NOISE = {'voltage': 1e-2, 'charge': 2e-9, 'displacement': 1e-9}
INPUTS = [(programmes.triangle(), 'command'), (programmes.steps(), 'command'),
          (programmes.multisine(), 'command'), (programmes.decay(), 'command'),
          (programmes.force(), 'command'), (programmes.force(), 'external_force')]
NAMES = [f'{programme.name}-{name}' for programme, name in INPUTS]


@pytest.mark.parametrize('programme, name', INPUTS, ids=NAMES)
def test_an_input_as_it_was_sent_has_no_noise(programme, name):
    assert noise_in(getattr(programme, name)) == 0.0


@pytest.mark.parametrize('level', [5e-3, 5e-2])
@pytest.mark.parametrize('programme, name', INPUTS, ids=NAMES)
def test_the_noise_of_an_input_is_known_and_most_of_it_taken_off(programme, name, level):
    sent = getattr(programme, name)
    read = sent + level * np.random.default_rng(3).standard_normal(sent.size)
    noise = noise_in(read)
    assert noise == pytest.approx(level, rel=0.08)
    left = min(np.std(way(read, noise) - sent) for way in (smoothed, by_lines))
    assert left < 0.6 * level


def test_a_turn_is_kept_that_the_hysteresis_remembers():
    sent = programmes.triangle(peaks=(80.0,), cycles=2).command
    read = sent + 5e-3 * np.random.default_rng(4).standard_normal(sent.size)
    # The largest of the noise about a turn is twice its deviation and more.
    assert np.ptp(smoothed(read, 5e-3)) == pytest.approx(np.ptp(sent), abs=4e-3)


def recorded(read_by=5e-3, got=False):
    """Return recordings of which the command was read with noise, that the device got or not."""
    device, rows = Device.nominal(), []
    for seed, programme in enumerate((programmes.triangle(peaks=(30.0, 90.0), cycles=2),
                                      programmes.steps(hold=1.0))):
        random = np.random.default_rng(seed)
        read = programme.command + read_by * random.standard_normal(len(programme))
        answer = simulate(device, programme.time, read if got else programme.command)
        rows.append(programme.replace(command=read, measured={
            channel: getattr(answer, channel) + level * random.standard_normal(len(programme))
            for channel, level in NOISE.items()}))
    return RecordingSet('bench', tuple(rows))


def quieted(recordings):
    device = Device.nominal()
    answers = [simulate(device, each.time, each.command) for each in recordings]
    return without_noise(recordings, device, [
        {channel: getattr(answer, channel) for channel in NOISE} for answer in answers])


def test_noise_that_the_device_got_is_part_of_the_command():
    recordings = recorded(got=True).recordings
    same, told = quieted(recordings)
    assert not told
    for one, other in zip(same, recordings):
        assert one is other


def test_a_command_that_was_read_back_makes_no_gap():
    told = compare_set(recorded(), Device.nominal())
    assert [row['over_noise'] for row in told['gap'].values()] == pytest.approx([1.0] * 3, abs=.06)
    assert [finding['severity'] for finding in told['preflight']] == ['repaired'] * 2
    assert all('of noise, which the device did not get' in finding['what']
               for finding in told['preflight'])


def test_what_is_left_of_the_noise_is_small_beside_what_it_would_have_done():
    device = Device.nominal()
    read = recorded().recordings
    quiet, _ = quieted(read)
    for one, other in zip(quiet, read):
        raw, sent = (simulate(device, other.time, each.command).charge for each in (other, one))
        assert 0.0 < one.unsure['charge'] < 0.5 * np.std(raw - sent)
