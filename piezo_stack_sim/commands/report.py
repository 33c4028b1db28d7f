# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""``piezo_stack report``: the report once more, from the diagnosis alone."""

from pathlib import Path

import click

from piezo_stack_sim.commands.options import not_empty


@click.command('report')
@click.argument('diagnosis', metavar='DIAGNOSIS.JSON')
@click.option('--out', metavar='HTML', callback=not_empty,
              help='File to write; by default report.html beside the diagnosis.')
def command(diagnosis, out):
    """
    Render report.html again from DIAGNOSIS.JSON, and print the summary.

    Nothing else is needed: not the recordings, not the parameter file.

    """
    from piezo_stack_sim.gap.report import write_report
    from piezo_stack_sim.gap.report.summary import terminal_summary
    from piezo_stack_sim.gap.storage import read_diagnosis

    found = read_diagnosis(diagnosis)
    out = Path(out) if out else Path(diagnosis).with_name('report.html')
    write_report(found, out)
    terminal_summary({**found, 'files': {'report': str(out)}})
