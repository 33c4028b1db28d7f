# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The sections of the report, in reading order: for each a template and what it is told.

A view is a plain dict of finished words and numbers; the templates only arrange them. A view that
is None leaves its section out.
"""

from collections import namedtuple

from piezo_stack_sim.gap.quantities import (
    listing, percent, percent_with_interval, probability, quantity, times_noise, unit_of, UNKNOWN,
    with_interval, words)
from piezo_stack_sim.gap.report import wording
from piezo_stack_sim.gap.report.chain import chain_view
from piezo_stack_sim.gap.report.ranking import isolability_view, ranking_view
from piezo_stack_sim.gap.report.scales import Scale

# As report.js draws them
LOOPS = (('voltage', 'charge'), ('charge', 'displacement'), ('voltage', 'displacement'))

Section = namedtuple('Section', 'id short title template view')


def headline_view(diagnosis):
    """Return the verdict, its sentence and the figures beside it."""
    selected, tied = diagnosis['selected'], diagnosis['ambiguity_set']
    named = [words(each) for each in (tied if diagnosis['verdict'] == 'AMBIGUOUS' else selected)]
    if diagnosis['verdict'] == 'MULTIPLE':
        named = [f'({listing(map(words, group), "or")})' if len(group) > 1 else words(group[0])
                 for group in wording.alternatives(diagnosis)]
    what = {'NO_GAP': 'nothing is missing', 'UNKNOWN': 'not in the library',
            'NOT_IDENTIFIABLE': 'cannot be said'}.get(diagnosis['verdict'])
    joint = ' or ' if diagnosis['verdict'] == 'AMBIGUOUS' else ' + '
    experiment = diagnosis['next_experiment']
    return {
        'name': diagnosis.get('name'),
        'actuator': diagnosis.get('inputs', {}).get('actuator'),
        'badge': wording.VERDICTS[diagnosis['verdict']],
        'sentence': wording.verdict_sentence(diagnosis),
        'reason': wording.as_sentence(diagnosis.get('reason')),
        'what': what or joint.join(named),
        'block': wording.blocks(diagnosis),
        'sure': probability(wording.confidence(diagnosis)),
        'smaller': _smaller(diagnosis),
        'next': wording.next_sentence(experiment) if experiment else None,
        'refused': sum(row['severity'] == 'refused' for row in diagnosis.get('preflight', ())),
    }


def _smaller(diagnosis):
    """Return from what to what the lead channel's error shrinks, or its gap where it does not."""
    channel = wording.lead_channel(diagnosis)
    if channel is None:
        return None
    unit = unit_of(channel, diagnosis)
    row = wording.shrinkage_channels(diagnosis).get(channel)
    if not diagnosis['selected'] or row is None or row['after'] is None or row['S'] is None:
        ratio = diagnosis['gap'][channel]['over_noise']
        return {'label': 'Gap', 'figure': f'{times_noise(ratio)} × noise',
                'note': f'{quantity(diagnosis["gap"][channel]["rms"], unit)} rms {words(channel)}'}
    before, after = (quantity(row[key] ** 0.5, unit) for key in ('before', 'after'))
    return {'label': 'How much smaller', 'figure': f'{before} → {after}',
            'note': f'{words(channel)} rms; {percent(row["S"])} of what is removable'}


def traces_view(diagnosis):
    """Return the recordings to choose from, the one with most of the gap first in view."""
    recordings = diagnosis.get('traces', {}).get('recordings')
    if not recordings:
        return None
    shares = diagnosis['where']['records']
    return {
        'names': [recording['name'] for recording in recordings],
        'columns': max(len(recording['views']['overview']['channels'])
                       for recording in recordings),
        'chosen': max(range(len(recordings)),
                      key=lambda index: shares.get(recordings[index]['name'], 0.0)),
        'after': any(signals.get('simulated_after') is not None for recording in recordings
                     for signals in recording['views']['overview']['channels'].values()),
    }


def loops_view(diagnosis):
    """Return whether there are two to draw against each other: channels, or the command."""
    recordings = diagnosis.get('traces', {}).get('recordings', ())
    return {} if any(map(_has_loop, recordings)) else None


def _has_loop(recording):
    overview = recording['views']['overview']
    known = {*overview['channels'], *([recording['drive']] if overview['command'] else ())}
    return any(x in known and y in overview['channels'] for x, y in LOOPS)


def spectra_view(diagnosis):
    """Return whether there is a spectrum to draw."""
    recordings = diagnosis.get('traces', {}).get('recordings', ())
    return {} if any(recording['spectra'] for recording in recordings) else None


def shrinkage_view(diagnosis):
    """Return for each channel the errors before and after, and the score by its references."""
    channels = wording.shrinkage_channels(diagnosis)
    if not channels:
        return None
    return {
        'channels': [_shrinkage(channel, row, diagnosis) for channel, row in channels.items()],
        'withheld': diagnosis['shrinkage']['withheld'],
        'remaining': _remaining(diagnosis.get('remaining', {})),
    }


def _remaining(remaining):
    """Return a sentence on what is left, or None."""
    parts = [part for part in (
        f'in the {remaining["block"]} block' if remaining.get('block') else None,
        remaining.get('note')) if part]
    if parts:
        return wording.as_sentence(f'what remains: {"; ".join(parts)}')
    if remaining.get('structured') is not None:
        return ('What remains has structure: it is more than noise.' if remaining['structured']
                else 'What remains looks like noise.')
    return None


def _shrinkage(channel, row, diagnosis):
    unit = unit_of(channel, diagnosis)
    errors = {key: None if row[key] is None else row[key] ** 0.5
              for key in ('before', 'after', 'noise')}
    bars = Scale(0.0, max(error for error in errors.values() if error is not None))
    span = row.get('span')
    references = {name: wording.reference_score(diagnosis, name, channel)
                  for name in ('placebo', 'ceiling')}
    ci = row['ci'] or (None, None)
    shown = [value for value in (row['S'], *ci, *references.values()) if value is not None]
    # The usual scale is 0 to 1; an effect that makes it worse needs room on the left
    score = Scale(min(0.0, max(-1.0, min(shown, default=0.0))), 1.0)
    figure, interval = percent_with_interval(row['S'], row['ci'], 1)
    return {
        'channel': channel,
        'worse': wording.times_worse(row) is not None,
        'errors': [{'key': key, 'width': bars.place(error), 'figure': quantity(error, unit),
                    'span': percent(error / span, 2) if span and error is not None else ''}
                   for key, error in errors.items()],
        'score': None if row['S'] is None else {
            'figure': _equals(figure), 'ci': interval,
            'from': score.place(0.0), 'to': score.place(row['S']),
            'low': score.place(ci[0]), 'high': score.place(ci[1])},
        'references': [{'name': name, 'figure': percent(value, 1), 'at': score.place(value)}
                       for name, value in references.items() if value is not None],
    }


def _equals(figure):
    """Return the right-hand side of S: the figure with its sign of relation."""
    return figure if figure[0] in '<>' else f'= {figure}'


def parameters_view(diagnosis):
    """Return the fitted parameters of what was switched on and of what ties with it."""
    selected = set(diagnosis['selected'])
    members = {cause['effect']: set(cause['effect'].split('+')) for cause in diagnosis['causes']}
    # Beside another an effect has other numbers than alone: where a pair is on, those of the pair.
    whole = selected in members.values()
    ties = wording.tied(diagnosis)

    def is_on(cause):
        effects = members[cause['effect']]
        return effects == selected if whole else effects <= selected

    fitted = [cause for cause in diagnosis['causes']
              if cause['parameters'] and (is_on(cause) or cause['effect'] in ties)]
    if not fitted:
        return None
    return {'causes': [{
        'effect': cause['effect'], 'on': is_on(cause),
        'rows': [_parameter(name, row) for name, row in cause['parameters'].items()],
    } for cause in fitted]}


def _parameter(name, row):
    low, high = row.get('lower'), row.get('upper')
    ci = row['ci'] or (None, None)
    scale = Scale.between(low, high)
    return {
        'name': name,
        'figure': with_interval(row['value'], row['ci'], row['unit']),
        'bound': {True: 'at a bound', 'lower': 'at its lower bound',
                  'upper': 'at its upper bound'}.get(row['at_bound']),
        'range': None if scale is None or row['value'] is None else {
            'value': scale.place(row['value']), 'low': scale.place(ci[0]),
            'high': scale.place(ci[1]), 'neutral': scale.place(row.get('neutral')),
            'lower': quantity(low, row['unit']), 'upper': quantity(high, row['unit'])},
    }


def calibration_view(diagnosis):
    """Return each nominal parameter, what it was tuned to and where that lies in its allowance."""
    if not diagnosis['calibration']:
        return None
    rows = diagnosis['calibration'].items()
    return {'rows': [_calibration(name, row) for name, row in rows],
            'corrected': any(row.get('corrected') is not None for _, row in rows)}


def _calibration(name, row):
    unit, nominal = row.get('unit', ''), row['nominal']
    change = (row['fitted'] - nominal) / abs(nominal) if nominal else None
    allowed = row.get('allowed')
    ci = row['ci'] or (None, None)
    scale = Scale(-1.5, 1.5)
    reach = None
    if allowed and nominal:
        def place(value):
            return None if value is None else scale.place((value / nominal - 1.0) / allowed)
        reach = {'value': place(row['fitted']), 'low': place(ci[0]), 'high': place(ci[1]),
                 'start': scale.place(-1.0), 'end': scale.place(1.0)}
    return {
        'name': name, 'nominal': quantity(nominal, unit, 4),
        'fitted': with_interval(row['fitted'], row['ci'], unit, 4),
        'corrected': quantity(row.get('corrected'), unit, 4),
        'change': UNKNOWN if change is None else
        f'{"+" if change > 0 else ""}{percent(change, 2)}',
        'allowed': f'± {percent(allowed, 1)}' if allowed else UNKNOWN,
        'bound': bool(row.get('at_bound')), 'reach': reach,
    }


def next_view(diagnosis):
    """Return the next experiment and the ones it was preferred to."""
    experiment = diagnosis['next_experiment']
    if experiment is None:
        return None
    choices = [experiment, *experiment.get('alternatives', ())]
    scale = Scale(0.0, max((choice['separation'] or 0.0 for choice in choices), default=0.0))
    return {'best': {'sentence': wording.next_sentence(experiment),
                     'why': wording.as_sentence(experiment.get('why')),
                     'command': experiment.get('command')}, 'choices': [
        {'name': wording.instruction(choice), 'figure': times_noise(choice['separation']),
         'width': scale.place(choice['separation'])} for choice in choices]}


def how_view(diagnosis):
    """Return what a reader needs to repeat the computation."""
    how = diagnosis.get('how', {})
    inputs = diagnosis.get('inputs', {})
    facts = [('recording sets', ', '.join(inputs.get('sets', []))),
             ('parameter file', inputs.get('params')), ('actuator', inputs.get('actuator')),
             ('command', how.get('command')), ('version', how.get('version')),
             ('seed', how.get('seed'))]
    known = {'version', 'command', 'seed', 'settings', 'steps'}
    settings = {**how.get('settings', {}),
                **{key: value for key, value in how.items() if key not in known}}
    return {
        'facts': [(name, str(value)) for name, value in facts if value not in (None, '')],
        'settings': [(words(key), str(value)) for key, value in settings.items()
                     if value is not None],
        'steps': [wording.as_sentence(step) for step in how.get('steps', [])],
        'records': [{**row, 'length': quantity(row['duration'], 's'),
                     'speed': quantity(row['rate'], 'Hz')}
                    for row in diagnosis.get('records', ())],
    }


def findings_view(diagnosis):
    """Return the warnings and what the preflight found."""
    preflight, warnings = diagnosis.get('preflight', []), diagnosis['warnings']
    return {'warnings': warnings, 'preflight': preflight} if warnings or preflight else None


HEADLINE = headline_view
SECTIONS = (
    Section('where', 'Where', 'Where the gap lies', 'chain.html', chain_view),
    Section('traces', 'Signals', 'Measured and simulated', 'traces.html', traces_view),
    Section('loops', 'Loops', 'Loops', 'loops.html', loops_view),
    Section('spectra', 'Spectra', 'Spectra of what is left over', 'spectra.html', spectra_view),
    Section('ranking', 'Causes', 'Which effect causes it', 'ranking.html', ranking_view),
    Section('shrinkage', 'Shrinkage', 'How far the gap shrinks', 'shrinkage.html', shrinkage_view),
    Section('parameters', 'Parameters', 'Fitted parameters', 'parameters.html', parameters_view),
    Section('isolability', 'Look-alikes', 'What these recordings can tell apart',
            'isolability.html', isolability_view),
    Section('calibration', 'Nominals', 'Nominal parameters', 'calibration.html', calibration_view),
    Section('next', 'Next', 'What to measure next', 'next.html', next_view),
    Section('how', 'Method', 'How it was computed', 'how.html', how_view),
    Section('findings', 'Findings', 'Warnings and preflight', 'findings.html', findings_view),
)
