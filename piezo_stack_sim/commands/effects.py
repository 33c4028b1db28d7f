# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""``piezo_stack effects``: what a real set-up adds to the ideal stack."""

from pathlib import Path

import click

from piezo_stack_sim.atomic import make_folder
from piezo_stack_sim.commands.options import not_empty, single
from piezo_stack_sim.errors import InputError
from piezo_stack_sim.terminal import console


@click.command('effects')
@click.argument('name', metavar='[ID]', required=False)
@click.option('--all', 'everything', is_flag=True, help='Pages and pictures of all effects.')
@click.option('--params', metavar='YAML', multiple=True, callback=single,
              help="Parameter file of the device without the effect; the paper's if not given.")
@click.option('--set', 'settings', multiple=True, metavar='PARAMETER=VALUE',
              help='A value instead of the typical one. May be given several times.')
@click.option('--test', metavar='TEST', help='What to show over time: triangle, sine, step, hold, '
              'push, rest or wait; the most telling one if not given.')
@click.option('--out', default='.', metavar='DIR', callback=not_empty,
              help='Folder for pictures; here if not given.')
def command(name, everything, params, settings, test, out):
    """
    List the effects, or explain one and save a picture of its signature.

    The picture shows the same tests with and without the effect: one over time, and the loops from
    command to voltage, to charge, to displacement.

    """
    from piezo_stack_sim.effects.registry import EFFECTS, find

    if everything and name:
        raise InputError(f'{name} --all: give one effect or --all')
    if everything and settings:
        raise InputError('--all --set: --set needs the id of an effect; all are shown as typical')
    if not everything and not name:
        for option, given in (('--set', settings), ('--test', test)):
            if given:
                raise InputError(f'{option} needs the id of an effect')
        _list(EFFECTS.values())
        return
    device = _device(params)
    if everything:
        _write_all(EFFECTS, device, test, Path(out))
        return
    effect = find(name)
    values = {**effect.typical(), **_values(effect, settings)}
    _explain(effect, values)
    path = Path(out) / f'{effect.id}.png'
    _picture(effect, device, values, test, path)
    click.echo(f'picture: {path}')


def _device(params):
    from piezo_stack_sim.plant import Device, load_device

    device = load_device(params) if params else Device.nominal()
    return device.replace(drive='voltage')


def _values(effect, settings):
    """Return what ``--set`` says, checked like a parameter file."""
    from piezo_stack_sim.plant.parameters import parameter_specs
    from piezo_stack_sim.plant.parameters.validation import check_value

    values = {}
    for setting in settings:
        key, equals, text = setting.partition('=')
        known = [parameter.name for parameter in effect.parameters]
        if not equals or key not in known:
            raise InputError(f'--set {setting}: expected PARAMETER=VALUE with one of '
                             f'{", ".join(known)}')
        try:
            value = float(text.replace('.inf', 'inf'))
        except ValueError:
            raise InputError(f'--set {setting}: {text!r} is not a number') from None
        values[key] = check_value(parameter_specs()[f'effects.{effect.id}.{key}'], value)
    return values


def _picture(effect, device, values, test, path):
    from piezo_stack_sim import plotting
    from piezo_stack_sim.signature.experiment import experiments
    from piezo_stack_sim.signature.picture import draw, save

    if test is not None and test not in experiments():
        raise InputError(f'--test {test}: expected one of {", ".join(experiments())}')
    make_folder(path.parent)
    with plotting.style():
        save(draw(effect, device, values, test), path)


def _write_all(effects, device, test, folder):
    from piezo_stack_sim.atomic import atomic_path
    from piezo_stack_sim.progress import track
    from piezo_stack_sim.signature.page import index, page

    make_folder(folder)
    pages = {'README': index(effects.values())}
    for effect in track(list(effects.values()), 'Drawing'):
        _picture(effect, device, effect.typical(), test, folder / f'{effect.id}.png')
        pages[effect.id] = page(effect)
    for name, text in pages.items():
        with atomic_path(folder / f'{name}.md') as partial:
            partial.write_text(text, encoding='utf-8')
    click.echo(f'{len(effects)} effects: {folder}')


def _list(effects):
    from rich.table import Table

    table = Table()
    for column in ('block', 'effect', 'what it is', 'moves'):
        table.add_column(column)
    block = None
    for effect in effects:
        if effect.block != block and block is not None:
            table.add_section()
        table.add_row(effect.block if effect.block != block else '', effect.id, effect.summary,
                      ', '.join(effect.channels))
        block = effect.block
    screen = console()
    screen.print(table)
    screen.print('piezo_stack effects ID explains one.')


def _explain(effect, values):
    from rich.table import Table
    from rich.text import Text

    from piezo_stack_sim.signature.page import explanation, number, rows, setting

    screen = console()
    screen.print(Text.assemble((effect.id, 'bold'), f' ({effect.block}): {effect.summary}\n'))
    screen.print(explanation(effect) + '\n')
    table = Table()
    for column in ('parameter', 'unit', 'neutral', 'bounds', 'typical', 'while running', ''):
        table.add_column(column)
    for row in rows(effect):
        table.add_row(*row)
    screen.print(table)
    screen.print(f'Moves: {", ".join(effect.channels)}. Typical, in a parameter file:\n')
    screen.print(setting(effect) + '\n')
    if values != effect.typical():
        shown = ', '.join(f'{key} = {number(value)}' for key, value in values.items())
        screen.print(f'Shown with {shown}.')
