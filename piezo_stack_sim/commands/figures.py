# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""``piezo_stack figures``: the paper's figures, simulated, with the numbers that prove them."""

import json
import os
from pathlib import Path

import click

from piezo_stack_sim.commands.options import out_folder_option, single


@click.command('figures')
@out_folder_option
@click.option('--params', metavar='YAML', multiple=True, callback=single,
              help="Parameter file; the paper's if not given.")
@click.option('--only', multiple=True, metavar='ID',
              help='Draw this one only, such as figure_10. Repeatable.')
@click.option('--page', 'page_path', metavar='FILE',
              help='Write the Markdown page that shows them beside what the paper says.')
def command(out, params, only, page_path):
    """
    Draw the paper's figures as PNG and SVG and write their numbers to figures.json.

    The figures are of the ideal model: effects of the parameter file are left out.

    """
    from piezo_stack_sim import figures
    from piezo_stack_sim.atomic import write_text
    from piezo_stack_sim.errors import InputError
    from piezo_stack_sim.figures.page import page

    for name in only:
        if name not in figures.IDS:
            raise InputError(f'--only {name}: expected one of {", ".join(figures.IDS)}')
    result = draw(out, params, only or figures.IDS)
    write_text(Path(out, 'figures.json'), json.dumps(result, indent=2) + '\n')
    if page_path:
        folder = Path(os.path.relpath(out, Path(page_path).parent)).as_posix()
        write_text(page_path, page(result, folder, page_path))
    click.echo(f'{len(result["figures"])} figures: {out}')


def draw(out, params, names):
    """
    Draw figures into a folder.

    Parameters
    ----------
    out : path
        The folder.
    params : path or None
        Parameter file.
    names : sequence of str
        Ids.

    Returns
    -------
    dict
        What ``figures.json`` holds.

    """
    from piezo_stack_sim import figures, plotting
    from piezo_stack_sim.figures.base import Setting
    from piezo_stack_sim.figures.page import shown
    from piezo_stack_sim.plant import Device, load_device
    from piezo_stack_sim.progress import track

    device = load_device(params) if params else Device.nominal()
    setting = Setting.of(device.replace(effects={}, load={'clamped': False}))
    entries = []
    for name in track(names, 'Drawing'):
        figure = figures.load(name)
        with plotting.style():
            drawing, numbers = figure.draw(setting)
            plotting.save(drawing, Path(out, name))
        entries.append({
            'name': figure.name, 'title': figure.title, 'says': figure.says, 'note': figure.note,
            'numbers': [{
                'name': number.name, 'value': float(number.value), 'unit': number.unit,
                'shown': shown(float(number.value), number.unit, number.digits),
                'proves': number.proves,
            } for number in numbers]})
    return {'model': device.actuator.model, 'folder': str(out), 'figures': entries}
