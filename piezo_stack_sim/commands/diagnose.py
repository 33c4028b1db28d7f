# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""``piezo_stack diagnose``: which effect causes the gap, and how far it shrinks."""

from pathlib import Path
import sys

import click

from piezo_stack_sim.commands.options import (
    map_option, out_folder_option, params_option, unit_option)
from piezo_stack_sim.errors import InputError
from piezo_stack_sim.progress import Bars, Stage


@click.command('diagnose')
@click.argument('recordings', metavar='SET...', nargs=-1, required=True)
@params_option
@out_folder_option
@map_option
@unit_option
@click.option('--separate', is_flag=True,
              help='Every SET is a device of its own; its answer goes to DIR/NAME. '
              'Answers that are there already are kept.')
@click.option('--jobs', type=click.IntRange(min=1), default=1, show_default=True,
              help='With --separate: sets at a time on this machine.')
@click.option('--scheduler', metavar='ADDRESS', default=None,
              help='With --separate: a Dask scheduler to spread the sets over.')
def command(recordings, params, out, maps, units, separate, jobs, scheduler):
    """
    Diagnose the gap between recordings and the simulation.

    Writes diagnosis.json, report.html and corrected.yaml to DIR. With several SETs they are
    recordings of one device, unless --separate is given.
    """
    from piezo_stack_sim.gap.many import diagnose_many, Job
    from piezo_stack_sim.gap.report.summary import terminal_summary
    from piezo_stack_sim.gap.write import diagnose_to_folder

    if not separate:
        if jobs > 1 or scheduler:
            given = f'--scheduler {scheduler}' if scheduler else f'--jobs {jobs}'
            raise InputError(f'{given} spreads devices, and several SETs are recordings of one: '
                             'add --separate if every SET is a device of its own')
        with Stage() as say:
            diagnosis = diagnose_to_folder(list(recordings), params, out, maps, units, say)
        terminal_summary(diagnosis)
        return
    todo = [Job((path,), params, str(Path(out) / Path(path).resolve().name), tuple(maps),
                tuple(units)) for path in recordings]
    folders = [Path(job.out).name for job in todo]
    for name in folders:
        if folders.count(name) > 1:
            raise InputError(f'{name}: expected SETs of different names with --separate, for '
                             f'answers go to {out}/NAME; rename a folder or answer it by itself')
    failed = 0
    with Bars() as bar:
        bar('diagnosing', 0, len(todo))
        for done, (job, line) in enumerate(diagnose_many(todo, jobs, scheduler), 1):
            print(f'{Path(job.out).name}: {line}')  # click.echo would write through the bar
            bar('diagnosing', done, len(todo))
            failed += line.startswith('failed')
    if failed:
        click.echo(f'{failed} of {len(todo)} sets failed; the others are in {out}', err=True)
        sys.exit(2)
