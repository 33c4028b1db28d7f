# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Scores a batch of answers: proves both hashes, judges every set, adds up."""

from collections import Counter
import hashlib
import json
from pathlib import Path

import numpy as np

from piezo_stack_sim.challenge import labels as label_files
from piezo_stack_sim.challenge.answer import read_answers, set_names
from piezo_stack_sim.challenge.judge import (
    BALANCES, BLOCK, judge, MAGNITUDES, true_shrinkage)
from piezo_stack_sim.challenge.rates import calibration, rate, summary
from piezo_stack_sim.errors import InputError

SCHEMA = 'piezo_stack_sim/challenge-score/1'

#: Question, what it asks, and the bar that the project set itself.
QUESTIONS = {
    'detected': ('a gap is noticed where something is hidden', None),
    'false_alarm': ('a gap is claimed where nothing is hidden', 0.01),
    'effect': ('one effect: named first', None),
    'effect_full': ('the same with voltage, charge and displacement', 0.95),
    'ranked_first': ('one effect: ranked first, whatever the verdict', None),
    'false_second': ('one effect: a second claimed that is not there', None),
    'block': ('right block (of all but the empty sets)', None),
    'block_full': ('one effect, with voltage, charge and displacement: right block', 0.98),
    'covered': ('one effect: among those left open', None),
    'covered_bare': ('the same from displacement alone', 0.95),
    'both': ('two effects: both named', 0.80),
    'both_open': ('the same, or left open what the other may be', None),
    'either': ('two effects: at least one named', 0.98),
    'unknown': ('absent from the library: answered UNKNOWN', 0.90),
    'unknown_or_lookalike': ('the same, or an effect that explains it as well', None),
    'unknown_block': ('absent from the library: UNKNOWN with the right block', 0.90),
    'false_unknown': ('in the library, but answered UNKNOWN', None),
    'right': ('verdict right as a whole', None),
}
#: The questions by which groups of sets are compared.
BRIEF = ('detected', 'effect', 'block', 'covered', 'right')

#: What the diagnosis notes of simpler ways to decide, and of its own way without a part of it.
SIMPLER = ('lowest_error', 'bic', 'whiteness')
ABLATIONS = ('no_cutting', 'no_calibration', 'no_correlation', 'no_withheld')
#: Questions of which a low rate is the good one.
LESS_IS_BETTER = ('false_alarm', 'false_second', 'false_unknown')


def read_floors(path):
    """
    Return the recorded floors of a JSON file: a dict of question to int.

    Raises
    ------
    InputError
        When the file cannot be read, or names a question that there is not.

    """
    wanted = 'expected a JSON object of question to whole number, such as {"detected": 9}'
    try:
        floors = json.loads(Path(path).read_text(encoding='utf-8'))
    except OSError as error:
        raise InputError(f'{path}: {error.strerror}; {wanted}') from None
    except ValueError as error:
        raise InputError(f'{path}: {error}; {wanted}') from None
    if not isinstance(floors, dict):
        raise InputError(f'{path}: {wanted}')
    for name, number in floors.items():
        if name not in QUESTIONS:
            raise InputError(f'{path}: no question {name!r}; there are {", ".join(QUESTIONS)}')
        if type(number) is not int:
            raise InputError(f'{path}: {name}: {json.dumps(number)}; {wanted}')
    return floors


def missed(result, floors):
    """
    Return a sentence for each recorded floor that a score does not reach.

    Parameters
    ----------
    result : dict
        As :func:`score` returns it.
    floors : dict of str to int
        Question to how many hits there must be; for false alarms and the like,
        how many there may be.

    """
    out = []
    for name, wanted in floors.items():
        hits, of = result['rates'][name]['hits'], result['rates'][name]['of']
        less = name in LESS_IS_BETTER
        if hits > wanted if less else hits < wanted:
            out.append(f'{QUESTIONS[name][0]}: {hits} of {of}, expected at '
                       f'{"most" if less else "least"} {wanted}')
    return out


def score(publics, labels=(), first=None):
    """
    Return the score of the answers in public folders, all together.

    Parameters
    ----------
    publics : sequence of str or Path
        Folders with ``answers/``, each of a batch.
    labels : sequence of str or Path, optional
        Their label files; beside the folders by default.
    first : int, optional
        Only so many sets of each batch, which are in a random order.

    Returns
    -------
    dict
        JSON-ready; see `SCHEMA`.

    Raises
    ------
    InputError
        When labels or answers are not those committed to, are missing, or are there twice.

    """
    publics = [Path(public) for public in publics]
    if labels and len(labels) != len(publics):
        raise InputError(f'labels: {len(labels)}; expected one file for each of the '
                         f'{len(publics)} batches, in their order, or none')
    asked, answers, rows, seconds, failures, batches = {}, {}, {}, [], {}, []
    for public, file in zip(publics, labels or [None] * len(publics)):
        revealed = label_files.reveal(public, file)
        if set(set_names(public)) != set(revealed['sets']):
            raise InputError(f'{public}: sets and labels differ; expected the same names in both')
        batch = {'labels_sha256': (public / 'labels.sha256').read_text().split()[0]}
        if any(known['labels_sha256'] == batch['labels_sha256'] for known in batches):
            raise InputError(f'{public}: its labels are those of another batch named before it; '
                             'expected each batch once')
        found = read_answers(public, first)
        batches.append({**batch, 'sets': len(found),
                        'code': next(iter(found.values()))[1]['code']})
        for name, (answer, run) in found.items():
            key = name if len(publics) == 1 else f'{len(batches)}/{name}'
            label = revealed['sets'][name]
            asked[key], answers[key] = label, (answer, run)
            rows[key] = judge(label, answer, shrinkage_of(public, name, label, answer))
            seconds.append(run['seconds'])
            if run['failure']:
                failures[key] = run['failure']
    found = list(rows.values())
    claims = [entry for row in found for entry in row['shrinkage'].values()]
    return {
        'schema': SCHEMA,
        'sets': len(rows),
        'kinds': dict(Counter(row['kind'] for row in found)),
        'batches': batches,
        'rates': rates(found),
        'ambiguity': {
            'all': summary(row['set_size'] for row in found),
            'displacement_alone': summary(row['set_size'] for row in found
                                          if row['channels'] == 'displacement'),
        },
        'calibration': {
            'first_cause': stated(found, 'probability', 'probability_right'),
            'verdict': stated(found, 'confidence', 'right'),
        },
        'shrinkage': {
            'true': summary(entry['true'] for entry in claims),
            'true_one_effect': summary(entry['true'] for row in found if row['kind'] == 'one'
                                       for entry in row['shrinkage'].values()),
            'claimed_minus_true': summary(entry['claimed'] - entry['true'] for entry in claims),
            'absolute_difference': summary(abs(entry['claimed'] - entry['true'])
                                           for entry in claims),
            'interval_coverage': rate(entry['inside'] for entry in claims),
        },
        'seconds': {**summary(seconds), 'maximum': max(seconds)},
        'failures': failures,
        'by_effect': grouped(found, lambda row: row['hidden'][0] if row['kind'] in {
            'one', 'absent'} else None),
        'by_magnitude': grouped(found, lambda row: row['magnitude'],
                                [name for _, name in MAGNITUDES]),
        'pairs_by_balance': pairs(found, lambda row: row['balance'],
                                  [name for _, name in BALANCES]),
        'pairs_by_magnitude': pairs(found, lambda row: row['magnitude'],
                                    [name for _, name in MAGNITUDES]),
        'pairs_by_channels': pairs(found, lambda row: row['channels']),
        'by_channels': grouped(found, lambda row: row['channels']),
        'by_unit': grouped(found, lambda row: row['unit']),
        'by_kind': grouped(found, lambda row: row['kind'], ['none', 'one', 'two', 'absent']),
        'confusion': confusion(found),
        'baselines': baselines(asked, answers),
        'answers': rows,
    }


def shrinkage_of(public, name, label, answer):
    """Return the true S by channel, or nothing when predictions or truth are not at hand."""
    predicted = public / 'answers' / f'{name}.npz'
    kept = label_files.truth_folder(public) / f'{name}.npz'
    if not (predicted.is_file() and kept.is_file()):
        return {}
    with np.load(kept) as truth, np.load(predicted) as predictions:
        arrays = {key: truth[key] for key in truth.files}
        if fingerprint(arrays) != label['truth_sha256']:
            raise InputError(f'{kept}: not the truth that the labels commit to')
        return true_shrinkage(answer, arrays,
                              {key: predictions[key] for key in predictions.files},
                              {channel: entry['rms'] for channel, entry in label['noise'].items()})


def fingerprint(arrays):
    """Return the SHA-256 of named arrays, whatever the file that holds them."""
    digest = hashlib.sha256()
    for key in sorted(arrays):
        digest.update(key.encode() + arrays[key].tobytes())
    return digest.hexdigest()


def rates(rows, questions=tuple(QUESTIONS)):
    """Return the Wilson rate of every question over judged sets."""
    return {question: rate(row[question] for row in rows) for question in questions}


def stated(rows, probability, outcome):
    """Return the calibration of a stated probability over the rows that state one."""
    pairs = [(row[probability], bool(row[outcome])) for row in rows
             if row[probability] is not None and row[outcome] is not None]
    return calibration([p for p, _ in pairs], [hit for _, hit in pairs])


def grouped(rows, key, order=None):
    """Return sets, rates and ambiguity-set size by group; `key` may return None for no group."""
    return {name: {'sets': len(group), **rates(group, BRIEF),
                   'unknown': rate(row['unknown'] for row in group),
                   'set_size': summary(row['set_size'] for row in group)['median']}
            for name, group in split(rows, key, order).items()}


def pairs(rows, key, order=None):
    """Return sets and the rates of both found, and of one at least, of pairs by group."""
    rows = [row for row in rows if row['kind'] == 'two']
    return {name: {'sets': len(group), **rates(group, ('both', 'either'))}
            for name, group in split(rows, key, order).items()}


def split(rows, key, order=None):
    """Return rows by group, sorted or in a given order; `key` may return None for no group."""
    groups = {}
    for row in rows:
        group = key(row)
        if group is not None:
            groups.setdefault(group, []).append(row)
    return {name: groups[name] for name in order or sorted(groups) if name in groups}


def confusion(rows):
    """Return how often what was hidden (row) got which answer (column); pairs are left out."""
    counts = {}
    for row in rows:
        if row['kind'] == 'two':
            continue
        hidden = row['hidden'][0] if row['hidden'] else 'nothing'
        counts.setdefault(hidden, Counter())[row['answered']] += 1
    return {hidden: dict(answered) for hidden, answered in counts.items()}


def baselines(labels, answers):
    """
    Return the rates of simpler ways to answer, on the same sets.

    `lowest_error`, `bic` and `whiteness` are what the diagnosis notes under ``baselines`` of its
    answers (verdict and effect); `commonest` names the commonest hidden effect every time.

    """
    hidden = Counter(effect['id'] for label in labels.values() if label['kind'] == 'one'
                     for effect in label['effects'])
    out = {}
    if hidden:
        commonest = min(hidden, key=lambda name: (-hidden[name], name))
        out['commonest'] = {'effect': commonest, **rates(
            [judge(label, simple('CAUSE', commonest)) for label in labels.values()])}
    for name in (*SIMPLER, *ABLATIONS):
        rows = []
        for key, label in labels.items():
            noted = (answers[key][0].get('baselines') or {}).get(name)
            if noted:
                rows.append(judge(label, simple(noted.get('verdict') or 'CAUSE',
                                                noted.get('effect'), noted.get('block'))))
        if rows:
            out[name] = {'sets': len(rows), **rates(rows)}
    return out


def simple(verdict, effect, block=None):
    """Return a bare answer that names one effect, several joined by plus, or none."""
    ids = effect.split('+') if effect else []
    if not ids:
        return {'verdict': verdict, 'where': {'block': block}}
    return {'verdict': verdict, 'causes': [{'effect': effect}], 'selected': ids,
            'where': {'block': block or BLOCK.get(ids[0])}}
