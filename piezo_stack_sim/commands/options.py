# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Arguments and options that several subcommands take."""

import click

from piezo_stack_sim.errors import InputError


def single(context, parameter, values):
    """Return the one value of an option that may be given once, None without any."""
    if len(values) > 1:
        raise InputError(f'{parameter.opts[0]}: given {len(values)} times: expected it once; '
                         'leave the others out')
    return values[0] if values else None


def not_empty(context, parameter, value):
    """Return a path to write to; '' would be the folder that one happens to be in."""
    if value is not None and not value.strip():
        raise InputError(f'{parameter.opts[0]} {value!r}: expected a path to write to; name it, '
                         'or write . for this folder')
    return value


params_option = click.option(
    '--params', required=True, multiple=True, callback=single, metavar='YAML',
    help='Parameter file of the device, such as config/ae0505d16.yaml.')

out_folder_option = click.option(
    '--out', required=True, metavar='DIR', callback=not_empty,
    help='Folder to write to; made if missing.')

map_option = click.option(
    '--map', 'maps', multiple=True, metavar='CHANNEL=NAME',
    help='Column or topic field of a channel, such as '
         'displacement=/stage/joint_states.position[0]. May be given several times.')

unit_option = click.option(
    '--unit', 'units', multiple=True, metavar='CHANNEL=UNIT',
    help='Unit in which a channel was recorded, such as displacement=um, or arbitrary for a '
         'displacement whose scale is not known. '
         'May be given several times.')
