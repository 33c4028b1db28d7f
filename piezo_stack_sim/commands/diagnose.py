# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""``piezo_stack diagnose``: which effect causes the gap, and how far it shrinks."""

from pathlib import Path
import sys

import click

from piezo_stack_sim.commands.options import (
    map_option, out_folder_option, params_option, unit_option)


@click.command('diagnose')
@click.argument('recordings', metavar='SET...', nargs=-1, required=True)
@params_option
@out_folder_option
@map_option
@unit_option
@click.option('--separate', is_flag=True,
              help='Every SET is a device of its own; its answer goes to DIR/NAME.')
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
    from piezo_stack_sim.gap.summary import terminal_summary
    from piezo_stack_sim.gap.write import diagnose_to_folder

    if not separate:
        with _progress() as say:
            diagnosis = diagnose_to_folder(list(recordings), params, out, maps, units, say)
        terminal_summary(diagnosis)
        return
    todo = [Job((path,), params, str(Path(out) / Path(path).resolve().name), tuple(maps),
                tuple(units)) for path in recordings]
    failed = 0
    for job, line in diagnose_many(todo, jobs, scheduler):
        click.echo(f'{Path(job.out).name}: {line}')
        failed += line.startswith('failed')
    if failed:
        click.echo(f'{failed} of {len(todo)} sets failed; the others are in {out}', err=True)
        sys.exit(2)


class _progress:
    """A spinner with the present stage on a terminal, nothing in a pipe."""

    def __enter__(self):
        self._status = None
        if sys.stderr.isatty():
            from rich.console import Console
            self._status = Console(stderr=True).status('starting')
            self._status.start()
        return self._say

    def _say(self, message):
        if self._status:
            self._status.update(message)

    def __exit__(self, *_):
        if self._status:
            self._status.stop()
