# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""The shape of diagnosis.json, and what of the recordings goes into it."""

import copy
import json

import numpy as np
from piezo_stack_sim.errors import InputError
from piezo_stack_sim.gap.schema import load_schema, validate, VERDICTS
from piezo_stack_sim.gap.traces import build_traces, residual_spectrum, thin_out
from piezo_stack_sim.recording.recording import Recording
import pytest

from synthetic_diagnosis import make_diagnosis, make_recordings, NOISE


@pytest.fixture(scope='module')
def cause():
    """Return one diagnosis; tests that spoil it copy it first."""
    return make_diagnosis('CAUSE')


@pytest.mark.parametrize('verdict', VERDICTS)
def test_a_diagnosis_of_each_verdict_has_the_shape(verdict):
    validate(make_diagnosis(verdict))


def test_the_schema_is_one_itself():
    from jsonschema import Draft202012Validator
    Draft202012Validator.check_schema(load_schema())


def test_an_ordinary_validator_agrees_about_the_traces(cause):
    from jsonschema import Draft202012Validator
    short = copy.deepcopy(cause)
    short['traces']['recordings'] = short['traces']['recordings'][:1]
    validator = Draft202012Validator(load_schema())
    assert validator.is_valid(short)
    short['traces']['recordings'][0]['views']['overview']['time'][3] = 'noon'
    assert not validator.is_valid(short)
    with pytest.raises(InputError, match=r"overview\.time\[3\] is 'noon': expected a?.*number"):
        validate(short)


def _set(path, value):
    def spoil(diagnosis):
        *parents, last = path
        for key in parents:
            diagnosis = diagnosis[key]
        diagnosis[last] = value
    return spoil


def _drop(*path):
    def spoil(diagnosis):
        *parents, last = path
        for key in parents:
            diagnosis = diagnosis[key]
        del diagnosis[last]
    return spoil


@pytest.mark.parametrize(('spoil', 'words'), [
    (_drop('gap'), "'gap' is missing"),
    (_drop('causes', 0, 'se'), "causes[0]: 'se' is missing"),
    (_set(['schema'], 'other/1'), "schema is 'other/1': expected"),
    (_set(['verdict'], 'MAYBE'), "verdict is 'MAYBE': expected one of"),
    (_set(['causes', 0, 'probability'], 1.2), '[0].probability is 1.2: expected at most 1'),
    (_set(['causes', 1, 'effect'], 'Creep!'), 'lower-case words'),
    (_set(['where', 'block'], 'load'), "where.block is 'load': expected"),
    (_set(['where', 'share'], {}), "unknown key 'share': did you mean 'shares'?"),
    (_set(['gap', 'charge', 'rms'], float('nan')), 'gap.charge.rms is nan: expected a finite'),
    (_set(['gap', 'displacement', 'ci'], [1.0]), 'gap.displacement.ci'),
    (_set(['selected'], []), 'selected is []: expected at least 1 items'),
    (_set(['selected'], ['gremlins']), "selected names 'gremlins'"),
    (_set(['ambiguity_set'], ['creep', 'creep']), 'expected each item once'),
    (_set(['shrinkage', 'charge', 'before'], -1.0), 'shrinkage.charge.before is -1.0'),
    (_set(['warnings'], 'hot'), "warnings is 'hot': expected array"),
    (_set(['preflight', 0, 'severity'], 'fatal'), 'preflight[0].severity'),
])
def test_a_wrong_diagnosis_is_refused_in_one_line_that_names_the_key(cause, spoil, words):
    wrong = copy.deepcopy(cause)
    spoil(wrong)
    with pytest.raises(InputError) as caught:
        validate(wrong, 'diagnosis.json')
    message = str(caught.value)
    assert message.startswith('diagnosis.json: ')
    assert words in message
    assert '\n' not in message and len(message) < 400


@pytest.mark.parametrize(('verdict', 'key', 'value'), [
    ('NO_GAP', 'selected', ['creep']),
    ('CAUSE', 'selected', ['creep', 'friction']),
    ('MULTIPLE', 'selected', ['creep']),
    ('AMBIGUOUS', 'ambiguity_set', ['creep']),
])
def test_a_verdict_must_agree_with_what_it_names(verdict, key, value):
    wrong = make_diagnosis(verdict)
    wrong[key] = value
    with pytest.raises(InputError, match=key):
        validate(wrong)


def test_series_of_different_lengths_are_refused(cause):
    wrong = copy.deepcopy(cause)
    wrong['traces']['recordings'][1]['views']['overview']['channels']['charge']['measured'].pop()
    with pytest.raises(InputError, match=r'recordings\[1\].*charge\.measured has 1499 values'):
        validate(wrong)


def test_something_else_than_a_diagnosis_is_refused():
    for other in ([], 'text', 3, None, {}):
        with pytest.raises(InputError):
            validate(other)


def test_a_thinned_out_signal_keeps_its_extremes_and_stays_near():
    time = np.linspace(0.0, 1.0, 40_000)
    signal = np.sin(2 * np.pi * 7 * time ** 2)
    signal[12_345] = 3.0
    rows = thin_out(signal[:, None], 300)
    assert len(rows) == 300
    assert {0, 12_345, 39_999} <= set(rows.tolist())
    assert np.abs(np.interp(time, time[rows], signal[rows]) - signal).max() < 0.01


def test_traces_keep_a_single_spike_of_any_channel():
    recordings, before, after = make_recordings()
    charge = recordings[2].measured['charge'].copy()
    charge[7001] = 1e-3
    spiked = [recording.replace(measured={**recording.measured, 'charge': charge})
              if recording is recordings[2] else recording for recording in recordings]
    view = build_traces(spiked, before, after)['recordings'][2]['views']['overview']
    assert max(view['channels']['charge']['measured']) == pytest.approx(1e-3)


def test_traces_of_many_recordings_stay_small():
    recordings, before, after = make_recordings()
    traces = build_traces(10 * recordings, 10 * before, 10 * after, NOISE)
    assert len(json.dumps(traces)) < 3e6


def test_the_detail_is_every_row_of_the_stretch_with_the_largest_error():
    time = np.arange(50_000) * 1e-3
    measured = np.random.default_rng(3).normal(0, 1e-9, 50_000)
    measured[30_000:30_200] += 1e-7
    recording = Recording('bump', time, 'voltage', 0 * time, measured={'displacement': measured})
    traces = build_traces([recording], [{'displacement': 0 * time}])
    detail = traces['recordings'][0]['views']['detail']
    assert np.allclose(np.diff(detail['time']), 1e-3)
    assert detail['time'][0] <= 30.0 and detail['time'][-1] >= 30.199


def test_lost_samples_are_null_and_do_not_spoil_the_rest():
    recordings, before, after = make_recordings()
    holed = recordings[0].measured['displacement'].copy()
    holed[100:200] = np.nan
    recording = recordings[0].replace(measured={'displacement': holed})
    traces = build_traces([recording], before[:1], after[:1], NOISE)
    text = json.dumps(traces, allow_nan=False)
    assert 'null' in text
    assert all(value > 0 for value in
               traces['recordings'][0]['spectra']['displacement']['after'])


def test_a_spectrum_shows_the_power_that_is_there():
    random = np.random.default_rng(5)
    time = np.arange(200_000) * 1e-4
    frequency, density = residual_spectrum(time, random.normal(0, 3e-9, time.size))
    white = 3e-9 / np.sqrt(5e3)
    assert frequency[-1] <= 5e3
    assert np.median(density) == pytest.approx(white, rel=0.1)
