# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""The score: truth scores full, luck does not, tampering is noticed, rates are honest."""

import json

import numpy as np
from piezo_stack_sim.challenge import labels, page
from piezo_stack_sim.challenge.answer import answer, answer_set, code_version, read_answers
from piezo_stack_sim.challenge.judge import BLOCK, judge, true_shrinkage
from piezo_stack_sim.challenge.rates import calibration, wilson
from piezo_stack_sim.challenge.score import missed, read_floors, score
from piezo_stack_sim.errors import InputError
import pytest

HIDDEN = {
    'set_000': ('none', []),
    'set_001': ('one', ['creep']),
    'set_002': ('one', ['sensor_lag']),
    'set_003': ('two', ['friction', 'amplifier_gain']),
    'set_004': ('absent', ['detent']),
    'set_005': ('absent', ['backlash']),
}


def label(kind, ids):
    """Return a label as `make` writes it, in short."""
    return {
        'kind': kind, 'channels': ['voltage', 'charge', 'displacement'],
        'scatter': {'m': 0.01}, 'curve': {'of_the_file': False, 'scattered': False},
        'effects': [{'id': name, 'block': BLOCK[name],
                     'lookalikes': ['friction'] if name == 'backlash' else [],
                     'over_noise_calibrated': {'displacement': 5.0}} for name in ids],
    }


def truthful(name):
    """Return the answer of somebody who knows what is hidden in a set."""
    kind, ids = HIDDEN[name]
    verdict = {'none': 'NO_GAP', 'one': 'CAUSE', 'two': 'MULTIPLE', 'absent': 'UNKNOWN'}[kind]
    known = ids if kind in {'one', 'two'} else []
    return {
        'verdict': verdict, 'selected': known, 'ambiguity_set': [], 'confidence': 1.0,
        'where': {'block': BLOCK[ids[0]] if ids else None},
        'causes': [{'effect': '+'.join(known), 'probability': 1.0}] if known else [],
        'baselines': {'bic': {'verdict': 'CAUSE', 'effect': 'creep'},
                      'whiteness': {'verdict': 'NO_GAP', 'effect': None}},
    }


def oracle(recordings, parameter_file):
    """Diagnose as `truthful`."""
    return truthful(recordings.name), {}


def blind(recordings, parameter_file):
    """Name creep, whatever the recordings."""
    return {'verdict': 'CAUSE', 'selected': ['creep'], 'ambiguity_set': [],
            'causes': [{'effect': 'creep', 'probability': 0.9}],
            'where': {'block': 'electrical'}}, {}


def broken(recordings, parameter_file):
    """Fail."""
    raise ValueError('no')


def answered(folder, diagnose, seed=3):
    """Return a public folder with labels and answers."""
    out = folder / 'public'
    out.mkdir(parents=True)
    (out / 'challenge.json').write_text(json.dumps({'sets': list(HIDDEN)}))
    labels.commit(out, {'seed': seed, 'sets': {
        name: label(*entry) for name, entry in HIDDEN.items()}})
    for name in HIDDEN:
        answer_set(out, name, diagnose, 'one version')
    return out


def test_right_answers_score_full(tmp_path):
    """Every question that the batch puts is answered right, and no alarm is false."""
    result = score([answered(tmp_path, oracle)])
    rates = result['rates']
    for question in ('detected', 'effect', 'block', 'covered', 'both', 'both_open', 'either',
                     'unknown', 'unknown_block', 'right'):
        assert rates[question]['rate'] == 1.0, question
    assert rates['false_alarm']['rate'] == rates['false_unknown']['rate'] == 0.0
    assert result['calibration']['first_cause']['ece'] == 0.0
    json.dumps(result)


def test_a_bar_counts_the_sets_with_the_channels_it_is_set_for():
    answer = {'verdict': 'AMBIGUOUS', 'selected': ['creep'],
              'ambiguity_set': ['creep', 'mount_creep'], 'where': {'block': 'electrical'}}
    full = label('one', ['mount_creep'])
    row = judge(full, answer)
    assert row['effect_full'] is False and row['block_full'] is False
    assert row['covered_bare'] is None
    row = judge({**full, 'channels': ['displacement']}, answer)
    assert row['effect_full'] is None and row['block_full'] is None
    assert row['covered_bare'] is True
    pair = judge(label('two', ['creep', 'friction']), answer)
    assert pair['effect_full'] is None and pair['block_full'] is None


def test_one_answer_for_everything_scores_what_it_deserves(tmp_path):
    """Naming creep always is right once, and overconfident."""
    rates = (result := score([answered(tmp_path, blind)]))['rates']
    assert rates['effect']['hits'] == 1 and rates['effect']['of'] == 2
    assert rates['false_alarm']['rate'] == 1.0
    assert rates['both']['rate'] == rates['either']['rate'] == rates['unknown']['rate'] == 0.0
    assert result['calibration']['first_cause']['ece'] > 0.5
    assert result['confusion']['nothing'] == {'creep': 1}


def test_a_score_below_its_floor_is_told_with_both_numbers(tmp_path):
    floors = {'detected': 5, 'false_alarm': 0, 'effect': 2, 'unknown': 2}
    assert missed(score([answered(tmp_path / 'knows', oracle)]), floors) == []
    low = missed(score([answered(tmp_path / 'blind', blind)]), floors)
    assert [line.split(': ')[-1] for line in low] == [
        '1 of 1, expected at most 0', '1 of 2, expected at least 2', '0 of 2, expected at least 2']


@pytest.mark.parametrize('text, word', [
    ('{"luck": 1}', 'no question'), ('[1, 2]', 'JSON object'), ('{"detected": "many"}', '"many"'),
    ('{"detected": true}', 'whole number'), ('{', 'JSON object'), (None, 'No such file')])
def test_floors_that_are_none_are_refused_with_the_file_and_the_mend(tmp_path, text, word):
    path = tmp_path / 'floors.json'
    if text is not None:
        path.write_text(text)
    with pytest.raises(InputError, match=word) as refusal:
        read_floors(path)
    assert str(path) in str(refusal.value) and '\n' not in str(refusal.value)


def test_batches_are_scored_together(tmp_path):
    """Rates over all their sets are known better, and so is a calibration."""
    knows, guesses = answered(tmp_path / 'knows', oracle), answered(tmp_path / 'blind', blind, 4)
    both = score([knows, guesses])
    apart = [score([out]) for out in (knows, guesses)]
    assert both['sets'] == len(both['answers']) == 2 * len(HIDDEN)
    assert [batch['sets'] for batch in both['batches']] == [len(HIDDEN)] * 2
    for name, rate in both['rates'].items():
        assert rate['hits'] == sum(one['rates'][name]['hits'] for one in apart)
        assert rate['of'] == sum(one['rates'][name]['of'] for one in apart)
    page.write(both, tmp_path)
    head = (tmp_path / 'score.md').read_text()[:600]
    for out in (knows, guesses):
        assert f'abels `{(out / "labels.sha256").read_text()[:16]}`' in head


def test_a_batch_is_not_scored_twice_nor_with_the_labels_of_none(tmp_path):
    """One line says which, and what was expected."""
    out = answered(tmp_path, oracle)
    with pytest.raises(InputError, match='expected each batch once'):
        score([out, out])
    with pytest.raises(InputError, match='one file for each of the 2 batches'):
        score([out, out], [labels.label_file(out)])


def test_baselines_are_scored_on_the_same_sets(tmp_path):
    """What the diagnosis notes of simpler criteria, and the commonest effect, get rates too."""
    baselines = score([answered(tmp_path, oracle)])['baselines']
    assert baselines['bic']['effect']['hits'] == 1
    assert baselines['whiteness']['detected']['rate'] == 0.0
    assert baselines['commonest']['false_alarm']['rate'] == 1.0


def test_a_diagnosis_that_fails_is_a_wrong_answer(tmp_path):
    """The batch is scored all the same, and says so."""
    result = score([answered(tmp_path, broken)])
    assert len(result['failures']) == len(HIDDEN)
    assert result['rates']['right']['rate'] == 0.0


def test_an_answer_changed_afterwards_is_noticed(tmp_path):
    """Its hash is on record."""
    out = answered(tmp_path, blind)
    path = out / 'answers' / 'set_002.json'
    path.write_text(path.read_text().replace('creep', 'sensor_lag'))
    with pytest.raises(InputError, match='changed after'):
        score([out])


def test_answers_of_two_versions_are_not_mixed(tmp_path):
    """One code, one score."""
    out = answered(tmp_path, blind)
    answer_set(out, 'set_001', blind, 'another version')
    with pytest.raises(InputError, match='2 versions'):
        read_answers(out)


def test_answering_goes_on_where_it_stopped_and_refuses_other_code(tmp_path):
    """Finished answers stay; those of other code are replaced only on request."""
    out = answered(tmp_path, blind)
    with pytest.raises(InputError, match='other code'):
        answer(out, oracle, jobs=1)
    (out / 'answers' / 'set_004.run.json').unlink()
    counts = []
    version = answer(out, oracle, jobs=1, again=True, progress=counts.append)
    assert version == code_version() and counts == list(range(len(HIDDEN) + 1))
    assert score([out])['rates']['right']['rate'] == 1.0
    counts.clear()
    answer(out, blind, jobs=1, progress=counts.append)
    assert counts == [len(HIDDEN)]
    assert score([out])['rates']['right']['rate'] == 1.0


def test_the_first_sets_of_a_batch_are_answered_and_scored_alone(tmp_path):
    """Whoever has no time for all of them has a score of some, with the labels of all."""
    out = answered(tmp_path, oracle)
    for name in HIDDEN:
        (out / 'answers' / f'{name}.run.json').unlink()
    counts = []
    answer(out, oracle, jobs=1, progress=counts.append, first=2)
    assert counts == [0, 1, 2]
    found = score([out], first=2)
    assert list(found['answers']) == list(HIDDEN)[:2] and found['rates']['right']['rate'] == 1.0
    assert found['batches'][0]['labels_sha256'] == (
        out / 'labels.sha256').read_text().strip()
    with pytest.raises(InputError, match='no answer yet'):
        score([out], first=3)


def test_a_dask_cluster_gives_the_same_answers(tmp_path):
    """Two local workers; without Dask, or with nobody at the address, one line says so."""
    distributed = pytest.importorskip('distributed')
    out = answered(tmp_path, blind)
    before = {name: entry[0] for name, entry in read_answers(out).items()}
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=False,
                                  dashboard_address=None) as cluster:
        answer(out, blind, scheduler=cluster.scheduler_address, again=True)
    found = read_answers(out)
    assert {name: entry[0] for name, entry in found.items()} == before
    assert {run['code'] for _, run in found.values()} == {code_version()}


def test_the_code_version_is_that_of_the_code():
    """It repeats, and it is a hash."""
    assert code_version() == code_version()
    assert len(code_version()) == 64


def test_an_ambiguous_answer_counts_when_it_leaves_the_truth_open():
    """Left open is right, left out is wrong."""
    tie = {'verdict': 'AMBIGUOUS', 'ambiguity_set': ['creep', 'leakage'], 'selected': [],
           'causes': [{'effect': 'leakage', 'probability': 0.5}], 'where': {'block': 'electrical'}}
    row = judge(label('one', ['creep']), tie)
    assert row['covered'] and row['right'] and not row['effect'] and row['set_size'] == 2
    assert not judge(label('one', ['friction']), tie)['right']


def test_a_pair_with_a_stated_exchange_is_right_but_not_both_named():
    answer = {'verdict': 'MULTIPLE', 'selected': ['creep', 'friction'], 'causes': [],
              'ambiguity_set': ['friction', 'contact'], 'where': {'block': 'electrical'}}
    row = judge(label('two', ['creep', 'contact']), answer)
    assert row['both_open'] and row['right'] and not row['both']
    assert not judge(label('two', ['creep', 'leakage']), answer)['both_open']
    assert not judge(label('one', ['creep']), answer)['right']


def test_a_pair_is_judged_by_what_is_selected_not_by_the_best_single():
    """The ranking may list single effects before pairs; the probability is that of the pair."""
    answer = {'verdict': 'MULTIPLE', 'selected': ['creep', 'friction'], 'ambiguity_set': [],
              'causes': [{'effect': 'creep', 'probability': 0.9},
                         {'effect': 'friction+creep', 'probability': 0.7}],
              'where': {'block': 'electrical'}}
    row = judge(label('two', ['friction', 'creep']), answer)
    assert row['both'] and row['right'] and row['block']
    assert row['probability'] == 0.7 and row['probability_right']
    assert row['false_second'] is None
    row = judge(label('one', ['creep']), answer)
    assert row['false_second'] and not row['right']


def test_pairs_are_told_apart_by_how_loud_the_weaker_is():
    """The largest channel counts; single effects have no balance."""
    pair = label('two', ['friction', 'creep'])
    for weak, balance, size in ((0.5, 'below 1 %', 'below noise'),
                                (20.0, '10 to 30 %', '10 to 30'),
                                (100.0, 'above 30 %', 'above 30')):
        pair['effects'][0]['over_noise_calibrated'] = {'charge': 100.0, 'displacement': 3.0}
        pair['effects'][1]['over_noise_calibrated'] = {'charge': 0.0, 'displacement': weak}
        row = judge(pair, truthful('set_003'))
        assert (row['balance'], row['magnitude']) == (balance, size)
    assert judge(label('one', ['creep']), truthful('set_003'))['balance'] is None


def test_an_effect_as_good_as_an_absent_one_is_counted_apart():
    """Backlash looks like friction: UNKNOWN is what is asked for, friction is noted."""
    friction = {'verdict': 'CAUSE', 'selected': ['friction'], 'where': {'block': 'mechanical'},
                'causes': [{'effect': 'friction', 'probability': 0.8}]}
    row = judge(label('absent', ['backlash']), friction)
    assert not row['unknown'] and row['unknown_or_lookalike']


def test_the_true_shrinkage_is_that_of_the_noise_free_errors():
    """Half of the error left is three quarters of its power gone."""
    real = np.linspace(0.0, 1.0, 50)
    truth = {'true/steps/displacement': real, 'true/decay/displacement': real}
    predictions = {'before/steps/displacement': real + 0.2, 'after/steps/displacement': real + 0.1,
                   'before/decay/displacement': real + 0.2, 'after/decay/displacement': real}
    held = {'shrinkage': {'withheld': ['steps']}}
    quiet, loud = {'displacement': 0.1}, {'displacement': 1.0}
    assert np.isclose(true_shrinkage(held, truth, predictions, quiet)['displacement'], 0.75)
    assert np.isclose(true_shrinkage({}, truth, predictions, quiet)['displacement'], 0.875)
    assert true_shrinkage({}, truth, predictions, loud) == {}


def test_wilson_intervals_are_the_published_ones():
    """Newcombe (1998), Statistics in Medicine 17, 857-872, Table I: 81/263, 15/148 and 0/20."""
    for hits, of, low, high in ((81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605),
                                (0, 20, 0.0, 0.1611)):
        found = wilson(hits, of)
        assert np.isclose(found['low'], low, atol=1e-4)
        assert np.isclose(found['high'], high, atol=1e-4)


def test_the_calibration_error_is_the_gap_between_said_and_came_true():
    """Saying 0.8 and being right every second time is off by 0.3."""
    found = calibration([0.8] * 10, [True, False] * 5)
    assert np.isclose(found['ece'], 0.3)
    assert np.isclose(found['brier'], 0.5 * 0.04 + 0.5 * 0.64)
    assert np.isclose(calibration([0.5] * 10, [True, False] * 5)['ece'], 0.0)


def test_few_answers_show_a_calibration_error_by_chance():
    """One bin of 400 at 1/2: a normal deviation of 0.025, its mean sqrt(2/pi) of that."""
    found = calibration([0.5] * 400, [True] * 400)['ece_by_chance']
    assert np.isclose(found['mean'], 0.025 * np.sqrt(2.0 / np.pi), rtol=0.05)
    assert np.isclose(found['p95'], 0.025 * 1.96, rtol=0.08)
    surely = calibration([1.0] * 9, [True] * 9)['ece_by_chance']
    assert surely == {'mean': 0.0, 'p95': 0.0}


def test_the_page_holds_every_question_and_the_picture(tmp_path):
    """Markdown tables without holes, and a PNG."""
    result = score([answered(tmp_path, blind)])
    page.write(result, tmp_path / 'page')
    text = (tmp_path / 'page' / 'score.md').read_text()
    rows = [line for line in text.splitlines() if line.startswith('|')]
    assert len(rows) > 40
    width = None
    for line in text.splitlines():
        if not line.startswith('|'):
            width = None
            continue
        width = width or line.count('|')
        assert line.count('|') == width, line
    assert (tmp_path / 'page' / 'confusion.png').read_bytes().startswith(b'\x89PNG')
