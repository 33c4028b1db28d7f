# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""The diagnosis on a terminal: at most 25 lines, plain in a pipe."""

import textwrap

from piezo_stack_sim.gap.quantities import (
    in_order, listing, percent, probability, quantity, times_noise, unit_of, UNKNOWN, words)
from piezo_stack_sim.gap.report.wording import (
    as_sentence, blocks, cut, next_sentence, reference_score, shows_no_gap, shrinkage_channels,
    tied, verdict_sentence, VERDICTS)

LINES = 25
SURE = 0.75  # confidence from which nobody asks what makes it less
WORTH = 0.01  # share of the gap's power from which a block is worth a word
_COLOURS = {'NO_GAP': 'green', 'CAUSE': 'cyan', 'MULTIPLE': 'cyan', 'AMBIGUOUS': 'yellow',
            'UNKNOWN': 'red', 'NOT_IDENTIFIABLE': 'yellow'}
# For terminals and pipes that take no UTF-8
_PLAIN = str.maketrans({'µ': 'u', '×': 'x', '−': '-', '–': '-', '→': '>', '±': '+-', '∞': 'inf',
                        '…': '~', '█': '#', '·': '.'})


def terminal_summary(diagnosis, console=None):
    """
    Print the verdict, the gap, where it lies, the causes, how far it shrinks and what to do next.

    Parameters
    ----------
    diagnosis : dict
        Of the shape that :func:`piezo_stack_sim.gap.schema.validate` accepts.
    console : rich.console.Console, optional
        Where to print; by default standard output, coloured only if it is a terminal.

    """
    from rich.console import Console
    from rich.text import Text

    console = console or Console()
    width = max(console.width, 40)
    narrow = not console.encoding.lower().startswith('utf')
    for line, style in summary_lines(diagnosis, width):
        line = line.translate(_PLAIN).encode('ascii', 'replace').decode() if narrow else line
        # Text, not markup: a file called [red] stays [red]
        console.print(Text(line, style=style), soft_wrap=True, highlight=False)


def summary_lines(diagnosis, width=80):
    """Return the summary as at most 25 pairs of a line and its style."""
    verdict = diagnosis['verdict']
    name = f': {diagnosis["name"]}' if diagnosis.get('name') else ''
    lines = [(_cut(f'{VERDICTS[verdict]}{name}', width), f'bold {_COLOURS[verdict]}')]
    lines += [(line, '') for line in _wrapped(verdict_sentence(diagnosis), width, 4)]
    lines += [(_cut(line, width), style) for line, style in
              [('', ''), *_gap(diagnosis), *_where(diagnosis)]]
    doubtful = verdict == 'UNKNOWN' or diagnosis['selected'] and diagnosis['confidence'] < SURE
    if doubtful and diagnosis.get('reason'):
        lines += [(line, '') for line in _wrapped(
            f'Why     {as_sentence(diagnosis["reason"])}', width, 3, ' ' * 8)]
    last = []
    if diagnosis['next_experiment']:
        text = next_sentence(diagnosis['next_experiment'])
        last += [(line, '') for line in _wrapped(f'Next    {text}', width, 2, ' ' * 8)]
    for word, texts in ('Data', _data(diagnosis)), ('Warning', diagnosis['warnings']):
        last += [(line, 'yellow') for line in _first(word, texts, width)]
    # Paths are for copying: never cut
    last += [(f'Wrote   {_printable(path)}', 'dim')
             for path in list(diagnosis.get('files', {}).values())[:3]]
    causes = [(_cut(line, width), style) for line, style in _causes(diagnosis, width)]
    return [*lines, *causes[:max(LINES - len(lines) - len(last), 0)], *last][:LINES]


def _data(diagnosis):
    """Return what was refused, repaired or noted in the recordings, the worst first."""
    grave = ('refused', 'repaired', 'note')
    rows = sorted(diagnosis.get('preflight', ()), key=lambda row: grave.index(row['severity']))
    return [f'{row["severity"]}: {row["file"]}: {row["what"]}' for row in rows
            if row['severity'] != 'note' or row['mend']]


def _first(word, texts, width):
    """Return the first of some texts on at most two lines, and how many more there are."""
    if not texts:
        return []
    more = f' ({len(texts) - 1} more in the report)' if len(texts) > 1 else ''
    text = f'{word:<7} {texts[0]}'
    whole = _wrapped(text + more, width, 2, ' ' * 8)
    if whole[-1].endswith('…'):  # the count comes last, and is not to be lost
        whole = _wrapped(text, width, 2, ' ' * 8)
        whole[-1] = _cut(whole[-1], width - len(more)) + more
    return whole


def _gap(diagnosis):
    """Return a row a channel: the gap, and what is left of it where something was switched on."""
    rows = [('Gap', 'rms', 'of stroke', 'noise', '× noise', 'after', 'S', 'ceiling')]
    shrinkage = shrinkage_channels(diagnosis)
    for channel in in_order(diagnosis['gap'])[:4]:
        gap = diagnosis['gap'][channel]
        unit = unit_of(channel, diagnosis)
        shrunk = shrinkage.get(channel) if diagnosis['selected'] else None
        left = shrunk and shrunk['after']
        ceiling = None
        if not shows_no_gap(diagnosis):
            ceiling = reference_score(diagnosis, 'ceiling', channel)
        rows.append((
            f'  {words(channel)}', quantity(gap['rms'], unit), percent(gap['nrmse'], 2),
            quantity(gap['noise_rms'], unit), times_noise(gap['over_noise']),
            UNKNOWN if left is None else quantity(left ** 0.5, unit),
            percent(shrunk and shrunk['S'], 1),
            percent(ceiling, 1)))
    return [(f'{row[0]:<15}' + ''.join(f'{cell:>{size}}' for cell, size in
                                       zip(row[1:], (9, 10, 9, 9, 9, 9, 9))),
             'bold' if row is rows[0] else '') for row in rows]


def _where(diagnosis):
    """Return a line on the block and what each cut has, and one on recordings, bands, regimes."""
    where = diagnosis['where']
    if shows_no_gap(diagnosis):
        return []
    block, by_cuts = blocks(diagnosis), _largest(
        {cut(name, where): share for name, share in where['shares'].items()}, 3)
    parts = [part for part in (
        block,
        f'by the cuts {by_cuts}' if block and by_cuts else by_cuts) if part]
    lines = [f'Where   {"; ".join(parts) or "cannot be said"}']
    details = [part for part in (
        _largest(where['records'], 1, plain=True), _largest_band(where['bands']),
        _largest_regime(where['regimes'])) if part]
    if details:
        lines.append(f'        {"; ".join(details)}')
    return [(line, '') for line in lines]


def _largest_band(bands):
    """Return the band with most of the gap, '' if none has any."""
    band = max(bands, key=lambda row: row['share'], default=None)
    if not band or not band['share']:
        return ''
    if band['high'] is None:
        return f'above {band["low"]:g} Hz {percent(band["share"])}'
    return f'{band["low"]:g} to {band["high"]:g} Hz {percent(band["share"])}'


def _largest_regime(regimes):
    """Return the regime with most of the gap, '' if none has any."""
    regime = max(regimes, key=lambda row: row['share'], default=None)
    return f'{regime["name"]} {percent(regime["share"])}' if regime and regime['share'] else ''


def _largest(shares, count, plain=False):
    """Return the largest shares; less than one per cent only if nothing is more."""
    ordered = sorted(((key, share) for key, share in shares.items() if share > 0.0),
                     key=lambda item: -item[1])[:count]
    ordered = [row for row in ordered if row[1] >= WORTH] or ordered[:1]
    return listing((f'{key if plain else words(key)} {percent(share)}' for key, share in ordered),
                   last='and')


def _causes(diagnosis, width):
    """Return the five best candidates that explain anything, with a bar where there is room."""
    causes = [cause for cause in diagnosis['causes'] if cause['delta_log_score'] > 0.0][:5]
    if not causes:
        return []
    alike = tied(diagnosis)
    lines = [('Causes', 'bold')]
    for rank, cause in enumerate(causes, 1):
        effects = cause['effect'].split('+')
        on = all(effect in diagnosis['selected'] for effect in effects)
        marks = [mark for mark, wanted in (
            ('on', on), ('tie', cause['effect'] in alike),
            ('at bound', any(row['at_bound'] for row in cause['parameters'].values()))) if wanted]
        bar = '█' * round(min(20, max(width - 68, 0)) * cause['probability'])
        chance = probability(cause['probability'])
        # Two effects take the place of one and its block.
        name = words(cause['effect'])
        name = name if len(effects) > 1 else f'{name:<28} {cause["block"]}'
        line = f'  {rank} {name:<41} {chance:>6}  {", ".join(marks):<12} {bar}'
        lines.append((line.rstrip(), 'bold' if on else ''))
    return lines


def _printable(text):
    """Return the text without what a terminal would obey instead of show."""
    return ''.join(character if character.isprintable() else '?' for character in str(text))


def _cut(text, width):
    text = _printable(text)
    return text if len(text) <= width else f'{text[:max(width - 1, 1)]}…'


def _wrapped(text, width, most, indent=''):
    return textwrap.wrap(_printable(text), width, subsequent_indent=indent, max_lines=most,
                         placeholder=' …')
