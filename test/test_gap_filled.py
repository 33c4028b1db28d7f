# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Rows that nobody measured say nothing: neither of a gap, nor of the noise, nor of a cause."""

from dataclasses import replace

import numpy as np
from piezo_stack_sim.errors import InputError
from piezo_stack_sim.gap import diagnose_set
from piezo_stack_sim.gap.compare import compare_set
from piezo_stack_sim.gap.measured.evidence import prepare
from piezo_stack_sim.gap.measured.forward import simulate_set
from piezo_stack_sim.gap.measured.given import simulate_given
from piezo_stack_sim.plant import Device, simulate
from piezo_stack_sim.recording.preflight import preflight
from piezo_stack_sim.recording.recording import Recording, RecordingSet
import pytest

NOISE = 1e-9  # m
TIME = 1e-3 * np.arange(16000)  # the noise of 4000 rows is known to some per cent
FREQUENCIES = np.array([5.0, 13.0, 41.0, 97.0, 167.0, 229.0])  # Hz: between rows it moves far


@pytest.fixture(scope='module')
def device():
    return Device.nominal()


def given():
    """Return a command that moves fast for a sensor of 250 Hz."""
    phases = np.random.default_rng(5).uniform(0.0, 2.0 * np.pi, FREQUENCIES.size)
    waves = np.sin(2.0 * np.pi * np.outer(TIME, FREQUENCIES) + phases).sum(axis=1)
    return 40.0 + 4.0 * (waves - waves[0]) * np.minimum(TIME / 0.2, 1.0)


def recorded(device, kind):
    """Return the recording of a device by a sensor that is slow, loses messages, or neither."""
    command = given()
    read = simulate(device, TIME, command).displacement
    read = read - read[0] + NOISE * np.random.default_rng(7).standard_normal(TIME.size)
    kept = np.ones(TIME.size, dtype=bool)
    if kind == 'seldom':
        read = np.where(np.arange(TIME.size) % 4 == 0, read, np.nan)
    elif kind == 'lost':
        read[np.random.default_rng(9).choice(np.arange(10, 15990, 3), 320, replace=False)] = np.nan
    elif kind == 'rows':
        kept[np.random.default_rng(9).choice(np.arange(10, 15990, 5), 320, replace=False)] = False
    one = Recording('one', TIME[kept], 'voltage', command[kept],
                    measured={'displacement': read[kept]})
    return RecordingSet('set', (one,))


@pytest.mark.parametrize('kind', ['whole', 'seldom', 'lost'])
def test_a_right_device_has_no_gap_however_seldom_it_is_read(device, kind):
    gap = compare_set(recorded(device, kind), device)['gap']['displacement']
    assert gap['over_noise'] == pytest.approx(1.0, abs=0.1)
    assert gap['noise_rms'] == pytest.approx(NOISE, rel=0.1)
    assert gap['rms'] == pytest.approx(NOISE, rel=0.1)


@pytest.mark.parametrize('kind, told', [('seldom', 4000), ('lost', 15680), ('rows', 15680)])
def test_what_was_filled_in_has_no_say(device, kind, told):
    """Whatever stands in the rows that were put in, what is left of a simulation is the same."""
    checked, _ = preflight(recorded(device, kind), device)
    checked, simulated, _ = simulate_given(checked, device)
    recording, = checked.recordings
    filled = recording.filled['displacement']
    assert np.count_nonzero(~filled) == told
    other = recording.replace(measured={'displacement': np.where(
        filled, -1.0, recording.measured['displacement'])})
    changed = simulate_set(device.with_effects({'sensor_delay': {'delay': 2e-3}}), [recording])
    left = []
    for each in (recording, other):
        track, = prepare([each], simulated, device).tracks
        assert track.factor >= len(recording) // told
        left.append(track.weighted('displacement', changed[0]['displacement']))
    assert np.array_equal(*left) and np.any(left[0])


@pytest.mark.parametrize('seed', [1, 2, 3])
def test_noise_is_as_loud_as_noise_where_one_message_of_twenty_was_lost(device, seed):
    """Averages over fewer rows are louder, and rows that were filled in are not quieter."""
    rng = np.random.default_rng(seed)
    one, = recorded(device, 'whole').recordings
    clean = one.measured['displacement'] - NOISE * np.random.default_rng(7).standard_normal(
        TIME.size)
    read = clean + NOISE * rng.standard_normal(TIME.size)
    read[1 + rng.choice(TIME.size - 2, TIME.size // 20, replace=False)] = np.nan
    checked, _ = preflight(RecordingSet('set', (
        one.replace(measured={'displacement': read}),)), device)
    checked, simulated, _ = simulate_given(checked, device)
    track, = prepare(checked.recordings, simulated, device).tracks
    assert track.factor > 1
    left = track.weighted('displacement', simulated[0]['displacement'])
    # 8000 averages tell it to 1.6 %, and the noise is known to one.
    assert np.mean(left ** 2) == pytest.approx(1.0, abs=0.06)


@pytest.mark.slow
@pytest.mark.parametrize('kind', ['seldom', 'lost'])
def test_a_cause_is_found_in_the_rows_that_were_measured(device, kind):
    assert diagnose_set(recorded(device, kind), device, traces=False).document[
        'verdict'] == 'NO_GAP'
    late = device.with_effects({'sensor_lag': {'time_constant': 1e-3}})
    found = diagnose_set(recorded(late, kind), device, traces=False)
    assert 'sensor_lag' in found.document['ambiguity_set'] or (
        found.document['selected'] == ['sensor_lag'])
    assert found.document['shrinkage']['displacement']['S'] > 0.99


def test_what_was_filled_in_stays_known(device):
    """Through rows that were lost besides, and not of a channel that is left out."""
    one, = recorded(device, 'seldom').recordings
    holed = one.replace(
        measured={'displacement': np.nan_to_num(one.measured['displacement'])},
        filled={'displacement': np.isnan(one.measured['displacement'])})
    kept = np.arange(TIME.size) % 100 != 50
    recording, = preflight(RecordingSet('set', (holed.take(kept),)), device)[0].recordings
    told = np.flatnonzero(recording.told('displacement'))
    assert len(recording) == TIME.size
    assert np.array_equal(told, np.flatnonzero(kept & (np.arange(TIME.size) % 4 == 0)))
    # A simulation at other rows takes the inputs along, and no channel.
    assert not holed.replace(measured={}, time=TIME[:3], command=np.zeros(3),
                             external_force=np.zeros(3)).filled


def test_a_mask_of_another_length_is_refused(device):
    one = recorded(device, 'whole').recordings[0]
    with pytest.raises(InputError, match='filled in'):
        replace(one, filled={'displacement': np.zeros(3, dtype=bool)})
