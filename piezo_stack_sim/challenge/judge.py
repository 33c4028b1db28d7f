# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Judges one answer against what was hidden: which questions were put, which were got right."""

import numpy as np

from piezo_stack_sim.challenge.foreign import FOREIGN
from piezo_stack_sim.challenge.known import KNOWN
from piezo_stack_sim.challenge.unforeseen import UNFORESEEN

BLOCK = {key: effect.block for key, effect in {**KNOWN, **FOREIGN, **UNFORESEEN}.items()}
#: Upper edges of the magnitude classes: rms over noise, after calibration.
MAGNITUDES = ((1.0, 'below noise'), (3.0, '1 to 3'), (10.0, '3 to 10'), (30.0, '10 to 30'),
              (float('inf'), 'above 30'))
#: Upper edges of the classes of a pair: the size of the weaker effect against the stronger.
BALANCES = ((0.01, 'below 1 %'), (0.1, '1 to 10 %'), (0.3, '10 to 30 %'), (1.01, 'above 30 %'))


def first(answer):
    """Return the id of the effect that an answer ranks first: a tuple, empty if none."""
    single = [cause['effect'] for cause in answer.get('causes') or ()
              if '+' not in cause['effect']]
    return tuple(single[:1])


def named(answer):
    """Return the effects that an answer commits itself to, in order."""
    selected = tuple(answer.get('selected') or ())
    if answer['verdict'] in {'CAUSE', 'MULTIPLE'}:
        return selected or first(answer)
    return first(answer) if answer['verdict'] == 'AMBIGUOUS' else ()


def stated(answer):
    """Return the candidate (dict) whose probability an answer stands for: named, or first."""
    causes = answer.get('causes') or [{}]
    names = set(named(answer))
    return next((cause for cause in causes if set(cause.get('effect', '').split('+')) == names),
                causes[0])


def candidates(answer):
    """Return the set of effects that an answer leaves open."""
    if answer['verdict'] not in {'CAUSE', 'MULTIPLE', 'AMBIGUOUS'}:
        return set(answer.get('ambiguity_set') or ())
    return set(named(answer)[:1]) | set(answer.get('selected') or ()) | set(
        answer.get('ambiguity_set') or ())


def sizes(label):
    """
    Return how large each hidden effect is over the noise, after calibration, ascending.

    Each of two by what it adds to the other, where the label tells that.
    """
    return sorted(max(effect.get('over_noise_beside', effect['over_noise_calibrated']).values())
                  for effect in label['effects'])


def magnitude(label):
    """Return the class of magnitude of what is hidden, of the weaker of two, or None."""
    if not label['effects']:
        return None
    weaker = sizes(label)[0]
    return next(name for limit, name in MAGNITUDES if weaker < limit)


def balance(label):
    """Return the class of the weaker of two hidden effects against the stronger, or None."""
    if label['kind'] != 'two':
        return None
    weaker, stronger = sizes(label)
    return next(name for limit, name in BALANCES if weaker < limit * stronger)


def unit(label):
    """Return in what the unit differs from its parameter file."""
    if label['curve']['scattered']:
        return 'parameters and curve'
    return 'parameters' if any(label['scatter'].values()) else 'nothing'


def judge(label, answer, shrinkage=None):
    """
    Judge one answer.

    Parameters
    ----------
    label : dict
        As in the label file.
    answer : dict
        As in diagnosis.json.
    shrinkage : dict, optional
        ``{channel: true S}``.

    Returns
    -------
    dict
        One entry a question; None where it does not arise. `answered` and `hidden` are the
        column and the row of the confusion matrix.

    """
    truth = [effect['id'] for effect in label['effects']]
    kind, verdict = label['kind'], answer['verdict']
    names, open_set = named(answer), candidates(answer)
    block = (answer.get('where') or {}).get('block')
    one, two, absent = kind == 'one', kind == 'two', kind == 'absent'
    lookalikes = {name for effect in label['effects'] for name in effect['lookalikes']}
    ranked = first(answer)
    top = stated(answer)
    full, bare = len(label['channels']) == 3, label['channels'] == ['displacement']
    hit, right_block = names[:1] == tuple(truth), block in {BLOCK[name] for name in truth}
    row = {
        'kind': kind, 'hidden': truth, 'verdict': verdict,
        'channels': '+'.join(label['channels']), 'magnitude': magnitude(label),
        'balance': balance(label), 'unit': unit(label),
        'detected': verdict != 'NO_GAP' if truth else None,
        'false_alarm': verdict != 'NO_GAP' if not truth else None,
        'effect': hit if one else None,
        'effect_full': hit if one and full else None,
        'false_second': verdict == 'MULTIPLE' if one else None,
        'ranked_first': ranked[:1] == tuple(truth) if one else None,
        'block': right_block if truth else None,
        'block_full': right_block if one and full else None,
        'covered': truth[0] in open_set if one else None,
        'covered_bare': truth[0] in open_set if one and bare else None,
        'set_size': len(open_set) if one and open_set else None,
        'both': set(truth) <= (set(names) | set(answer.get('selected') or ())) if two else None,
        'both_open': set(truth) <= open_set | set(names) if two else None,
        'either': bool(set(truth) & open_set | set(truth) & set(names)) if two else None,
        'unknown': verdict == 'UNKNOWN' if absent else None,
        'unknown_or_lookalike': (verdict == 'UNKNOWN' or bool(lookalikes & open_set)
                                 if absent else None),
        'unknown_block': verdict == 'UNKNOWN' and right_block if absent else None,
        'false_unknown': verdict == 'UNKNOWN' if one or two else None,
        'right': right(kind, truth, verdict, names, open_set),
        'answered': names[0] if names else verdict,
        'probability': top.get('probability'),
        'probability_right': (set(top['effect'].split('+')) == set(truth) if top.get('effect')
                              else None),
        'confidence': answer.get('confidence'),
    }
    row['shrinkage'] = compare_shrinkage(answer, shrinkage or {})
    return row


def right(kind, truth, verdict, names, open_set):
    """Tell whether the verdict and what it names are right as a whole."""
    if kind == 'none':
        return verdict == 'NO_GAP'
    if kind == 'absent':
        return verdict == 'UNKNOWN'
    if verdict == 'AMBIGUOUS' or verdict == 'MULTIPLE' and kind == 'two':
        return set(truth) <= open_set | set(names)
    return set(truth) == set(names)


def compare_shrinkage(answer, true):
    """Return claimed and true S by channel, for the channels in which an answer claims any."""
    out = {}
    for channel, entry in (answer.get('shrinkage') or {}).items():
        if channel not in true or not isinstance(entry, dict) or entry.get('S') is None:
            continue
        low, high = entry.get('ci') or (None, None)
        bounded = low is not None and high is not None
        out[channel] = {'claimed': entry['S'], 'true': true[channel],
                        'inside': low <= true[channel] <= high if bounded else None}
    return out


def true_shrinkage(answer, truth, predictions, noise):
    """
    Return the true S by channel: noise-free errors before and after, of what was predicted.

    Parameters
    ----------
    answer : dict
        Names under ``shrinkage.withheld`` the recordings to judge by; all when it names none.
    truth, predictions : mapping of str to (n,) array
        ``true/<recording>/<channel>`` and ``before/...``, ``after/...``, the same rows.
    noise : dict of str to float
        Noise rms by channel. Where the gap is less than half of it there is nothing to remove.

    """
    withheld = (answer.get('shrinkage') or {}).get('withheld') or []
    recordings = sorted({key.split('/')[1] for key in truth})
    chosen = [name for name in recordings if name in withheld] or recordings
    errors = {}
    for key in truth:
        kind, recording, channel = key.split('/')
        if kind != 'true' or recording not in chosen:
            continue
        before = predictions.get(f'before/{recording}/{channel}')
        after = predictions.get(f'after/{recording}/{channel}')
        if before is None or after is None:
            continue
        real = np.asarray(truth[key], dtype=float)
        sums = errors.setdefault(channel, [0.0, 0.0, 0])
        sums[0] += float(np.sum((real - before) ** 2))
        sums[1] += float(np.sum((real - after) ** 2))
        sums[2] += real.size
    return {channel: 1.0 - after / before for channel, (before, after, rows) in errors.items()
            if before > 0.25 * rows * noise[channel] ** 2}
