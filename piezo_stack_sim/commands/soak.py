# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""``piezo_stack soak``: long runs and faults done to running nodes, and what they survived."""

import json
import sys

import click

from piezo_stack_sim.atomic import write_text
from piezo_stack_sim.commands.options import not_empty
from piezo_stack_sim.terminal import console


@click.command('soak')
@click.option('--device-time', type=float, default=3600.0, show_default=True, metavar='S',
              help='Device time of the long run in lockstep.')
@click.option('--wall-time', type=float, default=600.0, show_default=True, metavar='S',
              help='Length of the long run by wall time.')
@click.option('--scale', type=float, default=1.0, show_default=True, metavar='N',
              help='Length of the other faults; 0.05 for a look within a minute.')
@click.option('--only', multiple=True, metavar='FAULT',
              help='Only this fault; may be given several times.')
@click.option('--list', 'as_list', is_flag=True, help='List the faults and stop.')
@click.option('--json', 'as_json', is_flag=True, help='Print JSON in SI units.')
@click.option('--out', metavar='FILE', callback=not_empty,
              help='Write the JSON to a file besides.')
@click.option('--markdown', is_flag=True, help='Print the table as Markdown, for doc/soak.md.')
def command(device_time, wall_time, scale, only, as_list, as_json, out, markdown):
    """
    Leave two nodes running, do to them what may happen, and see what they survive.

    One runs by wall time, one in lockstep. The long runs come first, then floods, silence, dying
    publishers, foreign clocks, stopped processes, storms of parameters and calls, extremes. After
    each the device is held to the simulation without ROS. Exit status: 1 if something broke.

    """
    from piezo_stack_sim.errors import InputError
    for name, value in (('device-time', device_time), ('wall-time', wall_time), ('scale', scale)):
        if not 0.0 < value < float('inf'):
            raise InputError(f'--{name} {value:g}: expected a positive number')
    from piezo_stack_sim.node.soak.run import choose, FAULTS, run
    from piezo_stack_sim.progress import Bars

    if as_list:
        for fault in FAULTS:
            click.echo(f'{fault.name:13} {fault.stepping:9} {fault.done}')
        return
    with Bars() as bar:
        outcomes = list(run(choose(only), device_time, wall_time, scale, bar))
    text = json.dumps([_plain(outcome) for outcome in outcomes], indent=2)
    if as_json:
        click.echo(text)
    elif markdown:
        _print_markdown(outcomes)
    else:
        _print_table(outcomes)
    if out:
        write_text(out, text + '\n')
    if not all(outcome.held for outcome in outcomes):
        sys.exit(1)


def _plain(outcome):
    from dataclasses import asdict
    return {**asdict(outcome), 'held': outcome.held}


def _print_table(outcomes):
    from rich.table import Table
    from rich.text import Text

    rows = Table(title='What was done to the nodes', title_justify='left')
    for column in ('fault', 'what had to hold', 'measured', ''):
        rows.add_column(column)
    for outcome in outcomes:
        done = Text.assemble((outcome.name, 'bold'), f' ({outcome.stepping})\n{outcome.done}')
        for check in outcome.checks:
            rows.add_row(done, check.must, check.measured,
                         Text('held', 'green') if check.held else Text('BROKE', 'red'),
                         end_section=check is outcome.checks[-1])
            done = Text()
    console().print(rows)


def _print_markdown(outcomes):
    click.echo('| fault | device | what had to hold | measured | |\n|---|---|---|---|---|')
    for outcome in outcomes:
        done, stepping = f'**{outcome.name}**: {outcome.done}', outcome.stepping
        for check in outcome.checks:
            click.echo(f'| {done} | {stepping} | {check.must} | {check.measured} | '
                       f'{"held" if check.held else "**broke**"} |')
            done = stepping = ''
