# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""``piezo_stack analyse``: what follows from the parameters of a device."""

import json
import math

import click

from piezo_stack_sim.commands.options import params_option
from piezo_stack_sim.errors import InputError
from piezo_stack_sim.terminal import console


@click.command('analyse')
@params_option
@click.option('--voltage', 'voltages', type=float, multiple=True, metavar='V',
              help='Peak voltage of a row; ten steps of the range if not given. Repeatable.')
@click.option('--force', 'forces', type=float, multiple=True, metavar='N',
              help='Squeezing force of a row; 50, 100, 200, 400 if not given. Repeatable.')
@click.option('--json', 'as_json', is_flag=True, help='Print JSON in SI units.')
def command(params, voltages, forces, as_json):
    """
    Print stiffness, resonance, capacitance, stroke, blocked force, loops and responses.

    Everything is of the ideal model with its load: the effects of the parameter file are left out.

    """
    from piezo_stack_sim.plant import load_device
    from piezo_stack_sim.plant.analysis import analyse
    from piezo_stack_sim.plant.response import compare

    for name, values in (('--voltage', voltages), ('--force', forces)):
        for value in values:
            if not math.isfinite(value) or value == 0.0 or (name == '--force' and value < 0.0):
                raise InputError(f'{name} {value:g}: expected a number other than zero'
                                 + (', positive' if name == '--force' else ''))
    device = load_device(params)
    result = {'params': str(params), 'model': device.actuator.model,
              **analyse(device, voltages or None, forces or None)}
    result['response'] = [] if device.load.clamped else compare(
        device, [10.0, 100.0, 1e3, 3e3, 1e4, 2e4, 2.5e4, 3e4, 5e4])
    if as_json:
        click.echo(json.dumps(_finite(result), indent=2, allow_nan=False))
        return
    _print(device, result)


def _print(device, result):
    from rich.table import Table

    screen = console()

    def table(title, columns):
        made = Table(title=title, title_justify='left')
        for column in columns:
            made.add_column(column, justify='left' if column in ('', 'source') else 'right')
        return made

    rows = table(result['model'], ['', 'value', 'source'])
    for name, entry in result['summary'].items():
        rows.add_row(name.replace('_', ' '), _shown(entry['value'], entry['unit']),
                     entry['source'])
    screen.print(rows)

    rows = table('Led slowly, free and on a wall', [
        'voltage', 'first rise', 'cycled stroke', 'remains', 'loop width', 'of stroke',
        'capacitance', 'loss/cycle', 'tan δ', 'blocked force', ''])
    for row in result['voltage']:
        rows.add_row(
            f'{row["voltage"]:.4g} V', _shown(row['rise'], 'm'), _shown(row['stroke'], 'm'),
            _shown(row['remaining'], 'm'), _shown(row['loop_width'], 'm'),
            f'{100.0 * row["loop_width_share"]:.1f} %', _shown(row['capacitance'], 'F'),
            _shown(row['loss'], 'J'), f'{row["loss_tangent"]:.3f}',
            _shown(row['blocked_force'], 'N'), '' if row['in_range'] else 'beyond')
    screen.print(rows)
    if not all(row['in_range'] for row in result['voltage']):
        n = len(device.actuator.maxwell_stiffness)
        screen.print(f'beyond: element {n}, the last one, slips there; no real stack does. Make '
                     'its break voltage .inf to use these voltages.')

    rows = table('Squeezed from 0 to a force, leads shorted', [
        'force', 'first squeeze', 'cycled travel', 'stiffness', 'loop width', 'loss/cycle',
        'travel, leads open'])
    for row in result['force']:
        rows.add_row(f'{row["force"]:.4g} N', _shown(row['first'], 'm'),
                     _shown(row['travel'], 'm'), f'{row["stiffness"] * 1e-6:.2f} N/µm',
                     _shown(row['loop_width'], 'm'), _shown(row['loss'], 'J'),
                     _shown(row['open_travel'], 'm'))
    screen.print(rows)

    rows = table('Small-signal responses, closed form; deviation of the simulated device', [
        'frequency', 'X/Q', 'phase', 'deviation', 'impedance', 'phase', 'deviation'])
    for row in result['response']:
        rows.add_row(_shown(row['frequency'], 'Hz'), _shown(row['gain'], 'm/C'),
                     f'{row["gain_phase"]:.1f}°', f'{100.0 * row["gain_deviation"]:.2f} %',
                     _shown(row['impedance'], 'Ω'), f'{row["impedance_phase"]:.1f}°',
                     f'{100.0 * row["impedance_deviation"]:.2f} %')
    if result['response']:
        screen.print(rows)
    if device.effects:
        screen.print(f'Left out: the effects {", ".join(device.effects)}.')


def _shown(value, unit):
    """Return a number with its unit and the prefix that suits it."""
    from piezo_stack_sim.gap.quantities import quantity

    if math.isinf(value):
        return 'no limit'
    if unit == 'N/m':  # as catalogues do
        value, unit = value * 1e-6, 'N/µm'
    return f'{value:.5g} {unit}' if unit == 'N/µm' else quantity(value, unit, 5)


def _finite(value):
    """Return plain data in which JSON's missing infinities are null."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
