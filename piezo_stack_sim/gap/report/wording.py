# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""The diagnosis in sentences: said once here, shown by the report and by the terminal."""

import math

from piezo_stack_sim.gap.quantities import (
    in_order, listing, percent, percent_with_interval, probability, quantity, times_noise,
    unit_of, words)

VERDICTS = {
    'NO_GAP': 'No gap',
    'CAUSE': 'Cause found',
    'MULTIPLE': 'Several causes found',
    'AMBIGUOUS': 'Causes tie',
    'UNKNOWN': 'Cause unknown',
    'NOT_IDENTIFIABLE': 'Not identifiable',
}

LITTLE = 1.2  # times the noise up to which a simulation agrees as it is
APART = 1.0  # times the noise by which causes must differ in an experiment to be told apart
WORSE = 1.2  # times what was wrong, or the noise, from which what is switched on does harm
HIDDEN = 1.05  # times the noise below which a channel as a whole does not stand out of it
SEEN = 1.1  # times the noise from which the displacement has a gap to speak of
QUIET = 'no recording stands out of the noise'  # as a reason begins where that is so


def verdict_sentence(diagnosis):
    """Return what the gap is, how sure that is and how much smaller it gets, in one sentence."""
    verdict = diagnosis['verdict']
    sure = confidence(diagnosis)
    sure = '' if sure is None else f' ({probability(sure)} sure)'
    smaller = _shrinks(diagnosis)
    if verdict == 'NO_GAP':
        given = diagnosis['gap']
        tuned = diagnosis.get('remaining', {}).get('gap') or given
        if all(round(row['over_noise'] or 0.0, 1) < LITTLE for row in given.values()):
            return ('The simulation agrees with the recordings to within the noise'
                    f'{sure}{_sizes(given)}.')
        return ('Re-tuned within the uncertainty of its parameters, the simulation agrees with '
                f'the recordings to within the noise{sure}{_sizes(tuned)}'
                f'{_sizes(given, "; as the file has them")}.')
    if verdict == 'CAUSE':
        effect = diagnosis['selected'][0]
        return _capital(f'{words(effect)}{_in_block(diagnosis, effect)} causes the gap{sure}'
                        f'{smaller}.')
    if verdict == 'MULTIPLE':
        effects = listing(_exchangeable(diagnosis, group)
                          for group in alternatives(diagnosis))
        return _capital(f'{effects} together cause the gap{sure}{smaller}.')
    if verdict == 'AMBIGUOUS':
        effects = listing(map(words, diagnosis['ambiguity_set']), 'and')
        return (f'These recordings cannot tell {effects} apart, one of which causes the gap{sure}'
                f'{smaller}.')
    if verdict == 'UNKNOWN' and _is_hidden(diagnosis):
        return (f'All in all the simulation agrees with the recordings to within the noise'
                f'{_sizes(diagnosis["gap"])}; but{_hides(diagnosis)} that nothing in the library '
                f'explains{sure}.')
    if verdict == 'UNKNOWN':
        return f'Nothing in the library explains the gap{sure}{_lies(diagnosis)}{smaller}.'
    if shows_no_gap(diagnosis):
        return f'These recordings ask the device nothing, so that no gap could show{sure}.'
    return f'These recordings cannot say what causes the gap{sure}{_lies(diagnosis)}{smaller}.'


def shows_no_gap(diagnosis):
    """Tell whether no gap was seen, for there is none or because nothing was asked."""
    return diagnosis['verdict'] == 'NO_GAP' or (
        diagnosis['verdict'] == 'NOT_IDENTIFIABLE' and not diagnosis['ambiguity_set'])


def confidence(diagnosis):
    """
    Return the probability that the verdict is right, or None where none was computed.

    It is the file's ``confidence``; in a file without one, what the candidates' probabilities say.

    """
    if diagnosis.get('confidence') is not None:
        return diagnosis['confidence']
    by_effect = {cause['effect']: cause['probability'] for cause in diagnosis['causes']}
    if diagnosis['verdict'] == 'CAUSE':
        return by_effect.get(diagnosis['selected'][0])
    if diagnosis['verdict'] == 'MULTIPLE':
        together = set(diagnosis['selected'])
        return next((probability for effect, probability in by_effect.items()
                     if set(effect.split('+')) == together), None)
    if diagnosis['verdict'] == 'AMBIGUOUS':
        return min(1.0, sum(by_effect.get(effect, 0.0) for effect in diagnosis['ambiguity_set']))
    return None


def tied(diagnosis):
    """
    Return the candidates, ids of single effects or of pairs, between which nothing decides.

    Of two causes, ``ambiguity_set`` holds what may be exchanged for what.
    """
    effects = diagnosis['ambiguity_set']
    if diagnosis['verdict'] != 'MULTIPLE':
        return effects if len(effects) > 1 else []
    among = {*effects, *diagnosis['selected']}
    pairs = [cause['effect'] for cause in diagnosis['causes']
             if '+' in cause['effect'] and cause['probability'] > 0.0
             and among.issuperset(cause['effect'].split('+'))]
    return pairs if len(pairs) > 1 else []


def alternatives(diagnosis):
    """Return the selected effects, each in a list with those that would do in its place."""
    selected = set(diagnosis['selected'])
    groups = {effect: [effect] for effect in diagnosis['selected']}
    for pair in tied(diagnosis):
        members = set(pair.split('+'))
        if len(members - selected) == len(selected - members) == 1:
            groups[min(selected - members)].append(min(members - selected))
    return list(groups.values())


def lead_channel(diagnosis):
    """
    Return the channel to speak of first: displacement, or where that has no gap the widest.

    Of leakage, say, only the charge tells.
    """
    gap, shrinkage = diagnosis['gap'], shrinkage_channels(diagnosis)
    if not gap:
        return None

    def times(channel):
        return gap[channel]['over_noise'] or 0.0

    told = [channel for channel in gap if shrinkage.get(channel, {}).get('S') is not None]
    if 'displacement' in gap and (
            not told or 'displacement' in told and times('displacement') >= SEEN):
        return 'displacement'
    return max(told or gap, key=times)


def blocks(diagnosis):
    """Return the block of the gap, or those in question, in words, or ''."""
    named = blocks_in_question(diagnosis)
    if diagnosis['verdict'] == 'AMBIGUOUS':
        return f'{listing(named, "or")} block' if named else ''
    return f'{listing(named)} block{"s" * (len(named) > 1)}' if named else ''


def blocks_in_question(diagnosis):
    """Return the block of the gap, or those of all effects that together cause it, or may."""
    named = [diagnosis['where']['block']] if diagnosis['where']['block'] else []
    effects = {'MULTIPLE': [effect for group in alternatives(diagnosis) for effect in group],
               'AMBIGUOUS': diagnosis['ambiguity_set']}.get(diagnosis['verdict'], [])
    lives = {cause['effect']: cause['block'] for cause in diagnosis['causes']}
    return list(dict.fromkeys(lives[effect] for effect in effects if effect in lives)) or named


def cut(block, where):
    """Return what was cut out with a block: itself, or all from one block to another."""
    spans = where.get('blocks', {}).get(block, {}).get('spans')
    return f'{spans[0]} to {spans[-1]}' if spans else block


def shrinkage_channels(diagnosis):
    """Return the channels of ``shrinkage``, without what stands beside them."""
    return {channel: diagnosis['shrinkage'][channel] for channel in in_order(
        set(diagnosis['shrinkage']) - {'placebo', 'ceiling', 'withheld'})}


def times_worse(row):
    """Return how many times as wrong as before a channel is, None where it is not more."""
    if None in (row['before'], row['after'], row['noise']):
        return None
    # What is less than the noise is not known.
    times = math.sqrt(row['after'] / max(row['before'], row['noise']))
    return times if times > WORSE else None


def reference_score(diagnosis, name, channel):
    """Return the S of the ``placebo`` or the ``ceiling`` for a channel, or None."""
    value = diagnosis['shrinkage'][name]
    return value.get(channel) if isinstance(value, dict) else value


def instruction(experiment):
    """Return what to do in an experiment, without what it would gain."""
    profile, settings = experiment['profile'], experiment['settings']
    parts = []
    if profile:
        tuned = listing(f'{words(key)} {_setting(value)}' for key, value in settings.items())
        parts.append(f'play {words(profile)}' + (f' with {tuned}' if tuned else ''))
    if experiment['add_channel']:
        parts.append(f'measure {words(experiment["add_channel"])} as well')
    return _capital(' and '.join(parts) or 'record more')


def next_sentence(experiment):
    """Return the next experiment as an instruction, with what it would gain."""
    text = instruction(experiment)
    if experiment['separation'] is not None and experiment['separation'] < APART:
        told = listing(map(words, experiment['separates']))
        return (f'No programme tells {told} apart with these channels: {text} makes them differ '
                f'by {times_noise(experiment["separation"])} times the noise, the most of all.')
    if experiment['separates']:
        text += f': it sets {listing(map(words, experiment["separates"]))} apart'
        if experiment['separation'] is not None:
            text += f' by {times_noise(experiment["separation"])} times the noise'
    return f'{text}.'


def as_sentence(text):
    """Return a text with a capital and a full stop; None for none."""
    return f'{_capital(text.rstrip(" ."))}.' if text else None


def _setting(value):
    if isinstance(value, bool):
        return 'on' if value else 'off'
    if isinstance(value, (int, float)):
        return f'{value:g}'
    if isinstance(value, (list, tuple)):
        return '/'.join(map(_setting, value))
    return str(value)


def _shrinks(diagnosis):
    """Return the clause on how much smaller the lead channel's error gets."""
    channel, shrinkage = lead_channel(diagnosis), shrinkage_channels(diagnosis)
    row = shrinkage.get(channel) if diagnosis['selected'] else None
    if row is None or row['after'] is None or row['S'] is None:
        return ''
    unit = unit_of(channel, diagnosis)
    before, after = (quantity(row[key] ** 0.5, unit) for key in ('before', 'after'))
    part, ci = percent_with_interval(row['S'], row['ci'])
    change = 'shrinks' if row['after'] < row['before'] else 'changes'
    return (f'; with {_switched(diagnosis)} on, the {words(channel)} error {change} from '
            f'{before} to {after} rms, {part}'
            f'{f" {ci}" if ci else ""} of what is removable')


def _exchangeable(diagnosis, effects):
    """Return effects of which any would do, with their block, once if it is the same."""
    blocks = [_in_block(diagnosis, effect, brief=True) for effect in effects]
    if len(set(blocks)) == 1:
        return f'{listing(map(words, effects), "or")}{blocks[0]}'
    return listing((f'{words(effect)}{block}' for effect, block in zip(effects, blocks)), 'or')


def _switched(diagnosis):
    """Return 'it', 'both', or the name where the sentence has not made it plain."""
    selected = diagnosis['selected']
    if diagnosis['verdict'] == 'CAUSE':
        return 'it switched'
    if diagnosis['verdict'] == 'MULTIPLE':
        return 'both switched' if len(selected) == 2 else 'all of them switched'
    return f'{listing(map(words, selected))} switched'


def _sizes(gap, head=''):
    ordered = [(channel, gap[channel]) for channel in in_order(gap)]
    sizes = [f'{words(channel)} {times_noise(row["over_noise"])}'
             for channel, row in ordered if row['over_noise'] is not None]
    return f'{head}: {listing(sizes)} times the noise' if sizes else ''


def _is_hidden(diagnosis):
    """Tell whether no channel as a whole stands out of its noise."""
    ratios = [row['over_noise'] for row in diagnosis['gap'].values()]
    return bool(ratios) and all(ratio is not None and ratio < HIDDEN for ratio in ratios)


def _hides(diagnosis):
    """Return where something stands out of the noise, or what tells of it if it does not."""
    if (diagnosis.get('reason') or '').startswith(QUIET):
        return ' a flexible correction finds something in them'
    return f'{_in_recording(diagnosis)} something stands out of it'


def _in_recording(diagnosis):
    """Return where most of a gap lies, as a clause."""
    records = diagnosis['where']['records']
    name = max(records, key=lambda record: records[record], default=None)
    if name is None or not records[name]:
        return ''
    return f', most of all in {name}' if records[name] < 1.0 else f' in {name}'


def _lies(diagnosis):
    where, channel = diagnosis['where'], lead_channel(diagnosis)
    parts = []
    if where['block']:
        share = where['shares'].get(where['block'])
        most = share and share == max(where['shares'].values())
        power = f' with {percent(share)} of its power' if most else ''
        own = where.get('blocks', {}).get(where['block'], {})
        if own.get('spans') and own.get('note'):
            parts.append(f'lies between {words(own["from"][0])} and {words(own["to"])}{power}, '
                         f'perhaps in the {where["block"]} block')
        else:
            parts.append(f'lies in the {where["block"]} block{power}')
    if channel and diagnosis['gap'][channel]['over_noise'] is not None:
        ratio = times_noise(diagnosis['gap'][channel]['over_noise'])
        parts.append(f'is {ratio} times the noise in {words(channel)}')
    return f', which {" and ".join(parts)}' if parts else ''


def _in_block(diagnosis, effect, brief=False):
    """Return where the effect lives, as a clause, from its own candidate or from a pair."""
    for cause in diagnosis['causes']:
        if cause['effect'] == effect:
            return f' ({cause["block"]})' if brief else f' in the {cause["block"]} block'
    return ''


def _capital(text):
    return text[:1].upper() + text[1:]
