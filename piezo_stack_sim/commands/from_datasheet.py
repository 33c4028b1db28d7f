# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""``piezo_stack from-datasheet``: a first parameter file from the numbers of a catalogue."""

import click

from piezo_stack_sim.commands.options import not_empty

POSITIVE = click.FloatRange(min=0.0, min_open=True)
#: What a stack without a load may have, in SI units, and the powers of ten by which others differ.
SIZES = {
    'free_stroke': (1e-8, 5e-3, 'm', (-6, -3)),
    'blocking_force': (1e-2, 1e6, 'N', (3,)),
    'capacitance': (1e-11, 1e-2, 'F', (-6, -9, -12)),
    'resonance': (300.0, 1e7, 'Hz', (3, 6)),
    'length': (1e-4, 1.0, 'm', (-3,)),
    'area': (1e-8, 0.1, 'm2', (-6, -4)),
    'mass': (1e-7, 10.0, 'kg', (-3, -6)),
    'hysteresis': (1e-4, 1.0, 'a part of 1', (-2,)),
}
HIGHEST = 1e4  # V


@click.command('from-datasheet')
@click.option('--free-stroke', type=POSITIVE, required=True, metavar='M',
              help='Stroke without load over the voltage range, m.')
@click.option('--blocking-force', type=POSITIVE, required=True, metavar='N',
              help='Force against a wall at the highest voltage, N.')
@click.option('--capacitance', type=POSITIVE, required=True, metavar='F',
              help='Capacitance for large signals, F.')
@click.option('--voltage-range', type=(float, float), required=True, metavar='LOW HIGH',
              help='Lowest and highest voltage, V.')
@click.option('--resonance', type=POSITIVE, metavar='HZ',
              help='Resonance with one end held, Hz; half of that of a stack free at both ends.')
@click.option('--length', type=POSITIVE, metavar='M', help='Length of the stack, m.')
@click.option('--area', type=POSITIVE, metavar='M2', help='Cross-section of the stack, m2.')
@click.option('--mass', type=POSITIVE, metavar='KG', help='Mass of the stack, kg.')
@click.option('--hysteresis', type=POSITIVE, metavar='SHARE',
              help='Loop width over stroke, such as 0.15.')
@click.option('--model', default='from data sheet', show_default=True, help='Name to write.')
@click.option('--out', required=True, metavar='YAML', callback=not_empty,
              help='Parameter file to write.')
def command(out, model, **numbers):
    """Estimate the parameters of an actuator from its data sheet."""
    from piezo_stack_sim.errors import InputError
    from piezo_stack_sim.identify.datasheet import actuator_from, DataSheet
    from piezo_stack_sim.plant.parameters import Device, device_from_mapping, save_device

    for name, number in numbers.items():
        if name in SIZES and number is not None:
            wrong = _odd(name, number)
            if wrong:
                raise InputError(wrong)
    low, high = numbers['voltage_range']
    if not low < high or max(abs(low), abs(high)) > HIGHEST:
        turned = f'; write {high:g} {low:g}' if high < low else ''
        raise InputError(f'--voltage-range {low:g} {high:g}: expected the lowest and the highest '
                         f'voltage, V, such as -20 120{turned}')
    actuator, assumed = actuator_from(DataSheet(**numbers), model)
    device = device_from_mapping(Device(actuator).to_mapping(), 'the data sheet')
    given = ', '.join(f'{name} {value}' for name, value in numbers.items() if value is not None)
    lines = ['Estimated by piezo_stack from-datasheet, not measured. Given (SI units):',
             f'  {given}.', 'Assumed:', *(f'  {line}.' for line in assumed)]
    save_device(device, out, '\n'.join(lines))
    click.echo('\n'.join([*lines[2:], f'{out}: written']))


def _odd(name, number):
    """Return what is wrong with a number that no stack has, and which it may stand for, or ''."""
    least, most, unit, powers = SIZES[name]
    if least <= number <= most:
        return ''
    likely = next((power for power in powers if least <= number * 10.0 ** power <= most), None)
    mend = '' if likely is None else (
        f'; if that is in another unit, write {number * 10.0 ** likely:g}')
    return (f'--{name.replace("_", "-")} {number:g}: expected {unit}, from {least:g} to '
            f'{most:g}{mend}')
