# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""``piezo_stack identify``: the parameters of an actuator from recordings."""

import click

from piezo_stack_sim.commands.options import map_option, not_empty, unit_option
from piezo_stack_sim.terminal import console


@click.command('identify')
@click.argument('recordings', metavar='SET...', nargs=-1, required=True)
@click.option('--out', required=True, metavar='YAML', callback=not_empty,
              help='Parameter file to write.')
@click.option('--elements', type=click.IntRange(1, 30), metavar='N',
              help='Number of Maxwell elements; chosen by held-out error if not given.')
@click.option('--start', metavar='YAML',
              help='Parameter file, of a data sheet for instance, for what recordings do not '
                   'show; the actuator of the paper if not given.')
@map_option
@unit_option
def command(recordings, out, elements, start, maps, units):
    """Find the parameters of an actuator from recordings of it."""
    from piezo_stack_sim.atomic import check_file
    from piezo_stack_sim.identify.identification import identify
    from piezo_stack_sim.identify.write import write_actuator
    from piezo_stack_sim.plant import load_device
    from piezo_stack_sim.progress import Stage
    from piezo_stack_sim.recording.read import read_set

    check_file(out)
    begin = load_device(start) if start else None
    given = read_set(list(recordings), mapping=maps, units=units)
    with Stage('Identifying: ') as stage:
        found = identify(given, begin, elements, stage)
    write_actuator(found, out)
    screen = console(110)
    for part in _tables(found):
        screen.print(part)
    screen.print(f'{out}: written')


def _tables(found):
    from rich import box
    from rich.table import Table

    from piezo_stack_sim.identify.write import unit_of

    table = Table(title=f'Actuator identified from {found.name}', box=box.SIMPLE_HEAD)
    for name in ('parameter', 'value', 'unit', '95 % interval', ''):
        table.add_column(name, justify='right' if name in ('value', '95 % interval') else 'left')
    for each in found.estimates:
        table.add_row(
            each.name, f'{each.value:.5g}', unit_of(each.name),
            f'+- {100.0 * each.half_width:.2g} %' if each.half_width < 1.0 else 'any',
            '' if each.determined else 'kept, not determined' if each.kept else 'not determined')
    yield table
    fits = Table(title='Misfit', box=box.SIMPLE_HEAD)
    for name in ('recording', 'channel', 'rms', 'of the span'):
        fits.add_column(name, justify='left' if name in ('recording', 'channel') else 'right')
    for name, channel, rms, share in found.misfit():
        fits.add_row(name, channel, f'{rms:.3g}', f'{100.0 * share:.3g} %')
    yield fits
    for name, peak in found.polarised.items():
        yield f'{name} did not begin relaxed: as after {peak:.3g} V and back'
    if not found.fit.layout.last_slips:
        yield 'The last element never slips in these recordings.'
    if found.kept:
        yield (f'Kept as in {found.started_from}, for these recordings do not show it: '
               f'{", ".join(found.kept)}.')
    for advice in dict.fromkeys(each.advice for each in found.undetermined):
        names = ', '.join(e.name for e in found.undetermined
                          if e.advice == advice)
        yield f'Not determined by these recordings: {names}. What would: {advice}.'
    for finding in found.findings:
        if finding.mend or finding.severity != 'note':
            yield str(finding)
