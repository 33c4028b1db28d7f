# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Recordings that are noisier than others are weighed so; what is no noise is not taken for it."""

from dataclasses import replace

import numpy as np
from piezo_stack_sim.gap.compare import compare_set
from piezo_stack_sim.gap.lacking.bursts import suspect_bursts
from piezo_stack_sim.gap.lacking.course import Course
from piezo_stack_sim.gap.measured.evidence import noisier, prepare, TOLD
from piezo_stack_sim.gap.measured.where import block_residuals, by_regime
from piezo_stack_sim.plant import Device, simulate
from piezo_stack_sim.recording import programmes
from piezo_stack_sim.recording.recording import RecordingSet
import pytest

NOISE = {'voltage': 5e-3, 'charge': 5e-9, 'displacement': 2e-9}


def recorded(more=None, device=None):
    """Return recordings, and simulations of them; ``more`` maps a residual, by recording."""
    device, random = device or Device.nominal(), np.random.default_rng(8)
    recordings, simulated = [], []
    for i, programme in enumerate((programmes.triangle(peaks=(30.0, 90.0), cycles=2),
                                   programmes.multisine(), programmes.decay())):
        answer = simulate(device, programme.time, programme.command)
        clean = {channel: getattr(answer, channel) for channel in NOISE}
        noise = {channel: level * random.standard_normal(len(programme))
                 for channel, level in NOISE.items()}
        if more is not None and i == 1:
            noise = more(noise, programme)
        recordings.append(programme.replace(measured={
            channel: values + noise[channel] for channel, values in clean.items()}))
        simulated.append(clean)
    return recordings, simulated


def louder_in(evidence):
    """Return how much noisier each recording is, where that is more than an error of estimate."""
    return [{channel: times for channel, times in track.louder.items() if times > TOLD}
            for track in evidence.tracks]


def by_three(noise, programme):
    return {**noise, 'displacement': 3.0 * noise['displacement']}


def test_a_recording_is_weighed_by_a_noise_of_its_own():
    evidence = prepare(*recorded(by_three))
    triangle, multisine, decay = evidence.tracks
    assert louder_in(evidence) == [{}, {'displacement': pytest.approx(3.0, rel=0.08)}, {}]
    assert multisine.zero['displacement'] == pytest.approx(6e-9, rel=0.03)
    for quiet in (triangle, decay):
        assert quiet.zero['displacement'] == pytest.approx(2e-9, rel=0.08)


def test_who_compares_is_told_of_it_and_sees_no_gap():
    recordings, _ = recorded(by_three)
    told = compare_set(RecordingSet('loud', tuple(recordings)), Device.nominal())
    assert told['gap']['displacement']['over_noise'] == pytest.approx(1.0, abs=0.03)
    what, = [finding['what'] for finding in told['preflight']]
    assert what.startswith('displacement is ') and 'times as noisy as in the quietest' in what


def tone(noise, programme):
    return {**noise, 'displacement': noise['displacement'] + 6e-9 * np.sin(
        2e4 * programme.time)}


def bursts(noise, programme):
    # A reading that sticks now and then for a few rows.
    random = np.random.default_rng(1)
    wrong = np.repeat(random.standard_normal(len(programme) // 20 + 1)
                      * (random.random(len(programme) // 20 + 1) < 0.1), 20)
    return {**noise, 'displacement': noise['displacement'] + 2e-8 * wrong[:len(programme)]}


def with_the_motion(noise, programme):
    # As loud as the voltage is high.
    return {**noise, 'displacement': noise['displacement'] * (
        1.0 + 0.03 * np.abs(programme.command))}


def at_the_top(noise, programme):
    # Fifteen times as loud at the end of the range, which is seldom reached.
    high = programme.command > 0.9 * programme.command.max()
    return {**noise, 'displacement': noise['displacement'] * np.where(high, 15.0, 1.0)}


def coarse_command(noise, programme):
    # What a coarse converter leaves out of the command is white; charge and stack follow it.
    step = 0.06
    left = step * (np.random.default_rng(2).random(len(programme)) - 0.5)
    return {'voltage': noise['voltage'] + left, 'charge': noise['charge'] + 1.3e-6 * left,
            'displacement': noise['displacement']}


@pytest.mark.parametrize('wrong', [
    tone, bursts, with_the_motion, at_the_top, coarse_command])
def test_what_is_no_noise_is_not_taken_for_it(wrong):
    assert louder_in(prepare(*recorded(wrong))) == [{}, {}, {}]


def test_readings_noisier_at_times_are_told_from_readings_that_stick():
    recordings, simulated = recorded(at_the_top)
    evidence = prepare(recordings, simulated)
    cuts = block_residuals(Device.nominal(), evidence, simulated)
    suspect = suspect_bursts(evidence.tracks, cuts, Course.of(evidence, simulated, cuts))
    assert suspect.block == 'sensor' and 'noisier at some times' in suspect.reason


def test_what_is_as_quiet_as_its_noise_lies_in_no_regime():
    recordings, simulated = recorded()
    evidence = prepare(recordings, simulated)
    quiet = np.full(sum(track.measured[c].size for track in evidence.tracks
                        for c in track.channels), 0.9)
    assert all(row['share'] == row['ratio'] == 0.0 for row in by_regime(evidence, quiet))


def test_who_moves_by_a_force_alone_neither_rises_nor_holds_nor_lies_low():
    recordings, simulated = recorded()
    pushed = recordings[0].replace(drive='open', command=0.0 * recordings[0].command,
                                   external_force=10.0 * np.sin(300.0 * recordings[0].time))

    def shares(given):
        evidence = prepare(given, simulated[:len(given)])
        loud = [np.full(track.measured[c].size, 2.0) for track in evidence.tracks
                for c in track.channels]
        return {row['name']: row['share'] for row in by_regime(evidence, np.concatenate(loud))}

    assert list(shares([pushed])) == ['external force']
    # The power is the same in all rows: no more lies in a regime than there are rows in it.
    moved = len(recordings[1]) / (len(recordings[0]) + len(recordings[1]))
    both = shares([pushed, recordings[1]])
    assert both['rising'] + both['falling'] <= moved + 0.01
    assert both['low bias'] + both['high bias'] <= moved + 0.01


def test_a_single_recording_is_not_called_noisier_than_the_quietest():
    recordings, simulated = recorded()
    evidence = prepare(recordings, simulated)
    first, *others = evidence.tracks
    loud = replace(first, louder={'displacement': 1.4})
    told = noisier(replace(evidence, tracks=(loud, *others)))
    assert [finding.what for finding in told] == [
        'displacement is 1.4 times as noisy as in the quietest recording']
    assert noisier(replace(evidence, tracks=(loud,))) == []
    bare = replace(others[0], measured={'charge': others[0].measured['charge']})
    assert noisier(replace(evidence, tracks=(loud, bare))) == []
