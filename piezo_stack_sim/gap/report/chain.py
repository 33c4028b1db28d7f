# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Where the gap lies: the blocks, and the shares by channel, recording, band and regime."""

from piezo_stack_sim.gap.quantities import (
    in_order, interval, percent, quantity, times_noise, unit_of, UNKNOWN, words)
from piezo_stack_sim.gap.report.wording import blocks_in_question, shows_no_gap
from piezo_stack_sim.gap.schema import BLOCKS

# What flows into each block of the chain; the environment acts on the mechanical block from below
INPUTS = {'drive': 'command', 'electrical': 'voltage', 'transducer': 'charge',
          'mechanical': 'force', 'sensor': 'displacement', 'environment': 'load, temperature'}
# From these shares of the gap's power on, a block is shaded one step darker
STEPS = (0.02, 0.10, 0.30, 0.60)


def chain_view(diagnosis):
    """Return the blocks, the gap of each channel, and the shares of the gap's power."""
    where = diagnosis['where']
    return {
        'blocks': {block: _block(block, diagnosis) for block in BLOCKS},
        'channels': [_channel(channel, diagnosis['gap'][channel], diagnosis)
                     for channel in in_order(diagnosis['gap'])],
        'no_gap': shows_no_gap(diagnosis),
        'misread': where['block'] == 'sensor' and max(
            where['shares'], key=where['shares'].get, default='sensor') in ('drive', 'electrical'),
        'groups': [(title, rows) for title, rows in (
            ('Channel', _shares(where['channels'])),
            ('Recording', _shares(where['records'], names=True)),
            ('Frequency band', [_band(row) for row in where['bands']]),
            ('Regime', [_regime(row) for row in sorted(
                where['regimes'], key=lambda row: -row['share'])[:8]]),
        ) if rows],
    }


def _block(block, diagnosis):
    where = diagnosis['where']
    cuts, named = where.get('blocks', {}), where['block']
    own = cuts.get(block, {})
    # A tie of effects in several blocks of one cut lies in any of them.
    tied = (block not in cuts and block in cuts.get(named, {}).get('spans', ())
            and block in blocks_in_question(diagnosis))
    share = where['shares'].get(named if tied else block)
    level = 0 if shows_no_gap(diagnosis) else sum((share or 0.0) >= s for s in STEPS)
    note = own.get('note') or next((f'in one cut with {other}' for other, row in cuts.items()
                                    if block not in cuts and block in row.get('spans', ())), '')
    paths = ''
    if own.get('from') and own.get('to'):
        paths = f'{", ".join(map(words, own["from"]))} → {words(own["to"])}'
    return {
        'level': level, 'guilty': tied or named == block, 'input': INPUTS[block],
        'share': None if share is None or tied else percent(share), 'tied': tied,
        'ratio': times_noise(own.get('over_noise')) if own.get('over_noise') is not None else None,
        'ci': interval(own.get('ci')), 'paths': paths, 'note': note,
    }


def _channel(channel, row, diagnosis):
    unit = unit_of(channel, diagnosis)
    return {
        'channel': channel, 'rms': quantity(row['rms'], unit), 'span': percent(row['nrmse'], 2),
        'noise': quantity(row['noise_rms'], unit), 'ratio': times_noise(row['over_noise']),
        'ci': interval(row['ci']) or UNKNOWN,
    }


def _row(label, share, note=''):
    return {'label': label, 'width': round(100 * share, 1), 'share': percent(share), 'note': note}


def _shares(shares, names=False):
    """Return rows, largest first; names of recordings stay as they are."""
    return [_row(key if names else words(key), share)
            for key, share in sorted(shares.items(), key=lambda item: -item[1])[:12]]


def _band(row):
    low, high = (None if end is None else quantity(end, 'Hz', 2).replace('.0 ', ' ')
                 for end in (row['low'], row['high']))
    label = f'from {low}' if high is None else f'{low} to {high}' if row['low'] else f'to {high}'
    ratio = row.get('over_noise')
    note = '' if ratio is None else f'{times_noise(ratio)} × noise'
    if row.get('channel'):
        label = f'{words(row["channel"])}, {label}'
    return _row(label, row['share'], note)


def _regime(row):
    label = f'{row["name"]}, {words(row["channel"])}' if row.get('channel') else row['name']
    ratio = row.get('ratio')
    return _row(label, row['share'], '' if ratio is None else f'{ratio:.1f} × mean power')
