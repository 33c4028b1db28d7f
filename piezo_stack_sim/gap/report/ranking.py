# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Which effect: the candidates in order, the ties among them and what ties on principle."""

from piezo_stack_sim.gap.quantities import percent, probability, significant, UNKNOWN, words
from piezo_stack_sim.gap.report.wording import tied

SHOWN = 8


def ranking_view(diagnosis):
    """Return the candidates, best first: those worth a look, and the rest folded away."""
    causes = diagnosis['causes']
    if not causes:
        return None
    rows = [_candidate(rank, cause, diagnosis) for rank, cause in enumerate(causes, 1)]
    first = max([SHOWN, *(row['rank'] for row in rows if row['tied'] or row['on'])])
    return {'first': rows[:first], 'rest': rows[first:], 'tie': any(row['tied'] for row in rows)}


def isolability_view(diagnosis):
    """Return the classes of effects that look alike, and what cannot be seen at all."""
    classes = [sorted(members) for members in diagnosis['isolability']['classes']
               if len(members) > 1]
    grouped = {effect for members in classes for effect in members}
    unseen = set(diagnosis['isolability']['undetectable'])
    alone = [cause['effect'] for cause in diagnosis['causes']
             if '+' not in cause['effect'] and cause['effect'] not in grouped | unseen]
    return {'classes': classes, 'undetectable': sorted(unseen), 'alone': sorted(alone)}


def _candidate(rank, cause, diagnosis):
    effects = cause['effect'].split('+')
    score = UNKNOWN
    if cause['delta_log_score'] is not None:
        score = significant(cause['delta_log_score'])
        if cause['se'] is not None:
            score += f' ± {significant(cause["se"], 2)}'
    return {
        'rank': rank, 'effect': cause['effect'], 'block': words(cause['block']),
        'summary': cause.get('summary', ''), 'note': cause.get('note', ''),
        'probability': probability(cause['probability'], 1 if cause['probability'] < 0.1 else 0),
        'width': round(100 * cause['probability'], 1), 'score': score,
        'S': percent(cause.get('S')),
        'on': all(effect in diagnosis['selected'] for effect in effects),
        'tied': cause['effect'] in tied(diagnosis),
        'bound': [name for name, row in cause['parameters'].items() if row['at_bound']],
    }
