# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""``piezo_stack compare``: the gap and where it lies, without causes."""

import json

import click

from piezo_stack_sim.commands.options import map_option, params_option, unit_option
from piezo_stack_sim.terminal import console


@click.command('compare')
@click.argument('recordings', metavar='SET...', nargs=-1, required=True)
@params_option
@map_option
@unit_option
@click.option('--json', 'as_json', is_flag=True, help='Print JSON instead of tables.')
def command(recordings, params, maps, units, as_json):
    """Compare recordings with the simulation: how large the gap is, and where it lies."""
    from piezo_stack_sim.gap.compare import compare_set
    from piezo_stack_sim.plant import load_device
    from piezo_stack_sim.recording.read import read_set

    device = load_device(params)
    result = compare_set(read_set(list(recordings), mapping=maps, units=units), device)
    if as_json:
        click.echo(json.dumps(result, indent=1))
        return
    out = console()
    for table in _tables(result):
        out.print(table)


def _tables(result):
    from rich import box
    from rich.table import Table

    from piezo_stack_sim.gap.quantities import percent, quantity, times_noise, UNITS
    from piezo_stack_sim.gap.report.wording import cut

    gap = Table(title=f'Gap of {result["name"]}', box=box.SIMPLE_HEAD)
    for name in ('channel', 'rms', 'of the span', 'noise', 'over noise'):
        gap.add_column(name, justify='left' if name == 'channel' else 'right')
    for channel, row in result['gap'].items():
        unit = UNITS[channel]
        gap.add_row(channel, quantity(row['rms'], unit), percent(row['nrmse'], 2),
                    quantity(row['noise_rms'], unit), times_noise(row['over_noise']))
    yield gap
    place = Table(title='Where', box=box.SIMPLE_HEAD)
    for name in ('', 'share of the gap', 'over noise'):
        place.add_column(name, justify='left' if not name else 'right')
    where = result['where']
    for block, row in where['blocks'].items():
        of = f'blocks {cut(block, where)}, in one cut' if row.get('spans') else f'block {block}'
        place.add_row(of, percent(where['shares'].get(block, 0.0)),
                      times_noise(row['over_noise']))
    for record, share in where['records'].items():
        place.add_row(f'recording {record}', percent(share), '')
    for band in where['bands']:
        top = 'up' if band['high'] is None else f'{band["high"]:g} Hz'
        place.add_row(f'{band["low"]:g} Hz to {top}', percent(band['share']), '')
    for regime in sorted(where['regimes'], key=lambda r: -(r['ratio'] or 0.0))[:4]:
        place.add_row(regime['name'], percent(regime['share']),
                      f'{regime["ratio"]:.1f} of the mean')
    yield place
    for finding in result['preflight']:
        row = '' if finding['row'] is None else f', row {finding["row"]}'
        mend = f': {finding["mend"]}' if finding['mend'] else ''
        yield f'{finding["severity"]}: {finding["file"]}{row}: {finding["what"]}{mend}'
