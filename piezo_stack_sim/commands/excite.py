# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""``piezo_stack excite``: play a test programme to a device and record what it does."""

from pathlib import Path
import re
import sys

import click

from piezo_stack_sim.commands.options import not_empty, single
from piezo_stack_sim.terminal import tell_findings

PROFILES = ('triangle', 'decay', 'steps', 'multisine', 'force')
# Settings of the programmes, what they mean, and whether they are lists of numbers.
SETTINGS = {
    'peaks': ('V', 'peaks of the triangles', float, True),
    'levels': ('V', 'levels of the steps', float, True),
    'band': ('Hz', 'lowest and highest line of the multisine', float, True),
    'bias': ('V', 'voltage about which decay, multisine and force play', float, False),
    'amplitude': ('V', 'amplitude of the decaying sine', float, False),
    'peak': ('V', 'largest deviation of the multisine', float, False),
    'squeeze': ('N', 'largest squeezing force', float, False),
    'frequency': ('Hz', 'of triangle, decay or force', float, False),
    'cycles': ('N', 'of each triangle, or of the force', int, False),
    'time_constant': ('S', 'of the decay', float, False),
    'duration': ('S', 'of the decay', float, False),
    'hold': ('S', 'from step to step', float, False),
    'transition': ('S', 'duration of each step', float, False),
    'period': ('S', 'of the multisine', float, False),
    'periods': ('N', 'of the multisine', int, False),
    'lines': ('N', 'of the multisine', int, False),
    'seed': ('N', "of the multisine's phases", int, False),
    'rest_before': ('S', 'before the force begins', float, False),
}
# A full test in a few seconds of device time, for a first look and for lockstep.
QUICK: dict[str, dict] = {
    'triangle': {'cycles': 1},
    'decay': {'frequency': 50.0, 'duration': 0.2},
    'steps': {'levels': (0.0, 60.0, 20.0), 'hold': 1.0, 'transition': 0.1},
    'multisine': {'lines': 20, 'periods': 2},
    'force': {'cycles': 2},
}


_NAME = re.compile(r'(?=.{1,200}$)/?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*')


class _ListCommand(click.Command):
    """A command whose options for lists take numbers one after the other: --peaks 30 60 90."""

    def parse_args(self, ctx, args):
        """Join the numbers that follow an option for a list; what is none is named as such."""
        lists = {f'--{name}' for name, (_, _, _, many) in SETTINGS.items() if many}
        joined = []
        collecting = False
        for argument in args:
            first = collecting and not joined[-1] and not argument.startswith('-')
            if first or collecting and _is_number(argument):
                joined[-1] += f'{"," if joined[-1] else ""}{argument}'
                continue
            collecting = argument in lists
            joined += [argument, ''] if collecting else [argument]
        return super().parse_args(ctx, joined)


def _is_number(text):
    try:
        float(text.split(',')[0])
    except ValueError:
        return False
    return True


class _Numbers(click.ParamType):
    name = 'numbers'

    def convert(self, value, param, ctx):
        """Split at commas."""
        if not isinstance(value, str):
            return value
        try:
            return tuple(float(part) for part in value.split(','))
        except ValueError:
            given = repr(value) if value else 'nothing after it'
            self.fail(f'{given}: expected numbers, such as {param.opts[0]} 30 60 90', param, ctx)


def _settings(command):
    for name, (unit, text, kind, many) in reversed(SETTINGS.items()):
        metavar = f'{unit}...' if many else unit
        command = click.option(
            f'--{name.replace("_", "-")}', name, type=_Numbers() if many else kind,
            metavar=metavar, default=None, help=f'{text[0].upper()}{text[1:]}.')(command)
    return command


@click.command('excite', cls=_ListCommand)
@click.argument('profile', metavar='PROFILE')
@click.option('--out', required=True, metavar='SET', callback=not_empty,
              help='Folder of the recording set; each programme adds NAME.csv.')
@click.option('--node', default='piezo_stack_node', show_default=True, metavar='NAME',
              help='Node of the device, such as /stack.')
@click.option('--namespace', default='', metavar='NS', help='Namespace in front of the name.')
@click.option('--drive', type=click.Choice(['voltage', 'charge', 'open', 'shorted']),
              default='voltage', show_default=True,
              help='How the device is driven; a virtual one is switched to it meanwhile.')
@click.option('--charge-per-volt', type=float, metavar='F', default=None,
              help='With --drive charge: what turns the volts of a programme into coulombs.')
@click.option('--voltage-limits', type=(float, float), metavar='LO HI', default=None,
              help='Lowest and highest command, V; by default what a virtual device allows.')
@click.option('--slew', type=float, metavar='V/S', default=None,
              help='Greatest change of the command in a second.')
@click.option('--current', type=float, metavar='A', default=None,
              help='Greatest current; needs --params or --capacitance.')
@click.option('--params', metavar='YAML', multiple=True, callback=single,
              help='Parameter file that tells the capacitance for --current.')
@click.option('--capacitance', type=float, metavar='F', default=None,
              help='Greatest capacitance of the device, for --current.')
@click.option('--clip', is_flag=True, help='Clip a programme that exceeds the limits; '
              'without it such a programme is refused.')
@click.option('--rate', type=float, metavar='HZ', default=None,
              help='Commands a second; by default the rate of the device.')
@click.option('--reset', is_flag=True, help='Relax a virtual device before each programme.')
@click.option('--rest', type=float, default=0.0, metavar='S',
              help='Time at the safe voltage before each programme.')
@click.option('--quick', is_flag=True, help='Shorter programmes: seconds instead of a minute.')
@click.option('--patience', type=float, default=10.0, show_default=True, metavar='S',
              help='Time without an answer until the device counts as absent.')
@_settings
def command(profile, out, node, namespace, drive, charge_per_volt, voltage_limits, slew, current,
            params, capacitance, clip, rate, reset, rest, quick, patience, **settings):
    """
    Play a test programme to the device behind the topics, real or virtual, and record it.

    PROFILE is triangle, decay, steps, multisine or force; all for these five; or a recording set,
    whose commands are played again. The device is brought to a programme by a ramp and left at
    the voltage nearest to zero by a ramp, after Ctrl-C too. A device in lockstep is led tick by
    tick, the same each time; another one at --rate, and recorded by its stamps.
    """
    from piezo_stack_sim.errors import InputError
    from piezo_stack_sim.node.excite import excite, Session
    from piezo_stack_sim.node.excite_limits import Limits
    from piezo_stack_sim.progress import Bars

    if profile in (*PROFILES, 'all'):
        if (drive == 'charge') != (charge_per_volt is not None):
            raise InputError('--drive charge and --charge-per-volt F: expected both or none')
    elif drive == 'charge':
        _refuse_volts(charge_per_volt=charge_per_volt, voltage_limits=voltage_limits, slew=slew,
                      current=current)
    _check_positive(rate=rate, patience=patience, charge_per_volt=charge_per_volt)
    if not 0.0 <= rest < float('inf'):
        raise InputError(f'--rest {rest:g}: expected zero or more, finite')
    if current is not None and capacitance is None and params is not None:
        capacitance = _capacitance(params)
    limits = Limits(voltage_limits, slew, current, capacitance)
    node = _full_name(node, namespace)
    names, make = _programmes(profile, quick, settings, drive)
    session = Session(node, drive, charge_per_volt or 1.0, limits, clip, reset, rest, rate,
                      patience)
    with Bars() as bar:
        outcome = excite(make, names, out, session, bar)
    for remark in outcome.remarks:
        click.echo(f'clipped: {remark}', err=True)
    rows = sum(outcome.files.values())
    click.echo(f'{len(outcome.files)} recordings, {rows} rows: {out}')
    if outcome.interrupted:
        unit = 'C' if drive == 'charge' else 'V'
        click.echo(f'interrupted: what was recorded is kept, the device is left at '
                   f'{outcome.left_at:g} {unit}', err=True)
        sys.exit(130)


def _full_name(node, namespace):
    """Return the name of a node with its namespace."""
    from piezo_stack_sim.errors import InputError
    whole = f'/{namespace.strip("/")}/{node.strip("/")}' if namespace.strip('/') else node
    for option, name in (('node', node), ('namespace', namespace.rstrip('/')), ('node', whole)):
        if not _NAME.fullmatch(name) and not (option == 'namespace' and not name):
            raise InputError(
                f'--{option} {name!r}: expected a name of ROS 2, letters, digits and _ with / '
                'between them, no digit first, at most 200 in all')
    return whole


def _refuse_volts(**values):
    """Refuse what is meant in volts where coulombs that were recorded are played again."""
    from piezo_stack_sim.errors import InputError
    for name, value in values.items():
        if value is not None:
            raise InputError(f'--{name.replace("_", "-")}: with --drive charge a recording set is '
                             'played in its own coulombs, and limits are in volts; leave it out')


def _check_positive(**values):
    from piezo_stack_sim.errors import InputError
    for name, value in values.items():
        if value is not None and not 0.0 < value < float('inf'):
            raise InputError(f'--{name.replace("_", "-")} {value:g}: expected a positive number')


def _capacitance(params):
    """Return a function: the greatest slope of charge over voltage up to a peak, F."""
    from functools import lru_cache
    import numpy as np
    from piezo_stack_sim.plant import load_device, simulate
    device = load_device(params).replace(effects={})

    @lru_cache
    def up_to(peak):
        # Slow enough for the mechanics to follow: 2 s from end to end.
        rise = np.linspace(0.0, max(peak, 1.0), 400)
        charge = simulate(device, np.arange(400) / 200.0, rise, drive='voltage').charge
        return float(np.max(np.diff(charge)[2:]) / (rise[1] - rise[0]))

    return up_to


def _programmes(profile, quick, settings, drive):
    """Return the names of the programmes and a function that makes them for a rate."""
    from piezo_stack_sim.errors import InputError
    given = {name: value for name, value in settings.items() if value is not None}
    if profile in PROFILES or profile == 'all':
        chosen = PROFILES if profile == 'all' else (profile,)
        if drive in ('open', 'shorted'):
            if profile == 'all':
                chosen = ('force',)
            elif profile != 'force':
                raise InputError(f'--drive {drive}: only the programme force makes sense')
        return list(chosen), _maker(chosen, quick, given, drive)
    if not Path(profile).exists():
        from difflib import get_close_matches
        close = get_close_matches(profile, (*PROFILES, 'all'), 1)
        hint = f'did you mean {close[0]}?' if close else 'or the folder of a recording set'
        raise InputError(f'PROFILE {profile}: expected {", ".join(PROFILES)}, all; {hint}')
    if given or quick:
        name = next(iter(given), 'quick').replace('_', '-')
        raise InputError(f'--{name}: a recording set is played as it is; leave it out')
    from piezo_stack_sim.recording.playable import require_finite
    from piezo_stack_sim.recording.read import read_set
    given_set = read_set(profile)
    recordings = given_set.recordings
    for recording in recordings:
        require_finite(recording)
        if recording.drive != drive:
            raise InputError(f'{recording.source}: recorded with drive {recording.drive}: '
                             f'expected {drive}; use --drive {recording.drive}')
    tell_findings(given_set)
    return ([recording.name for recording in recordings],
            lambda rate: [recording.replace(measured={}) for recording in recordings])


def _option(setting):
    """Return the option of a setting of a programme."""
    return '--rest-before' if setting == 'rest' else f'--{setting.replace("_", "-")}'


def _maker(chosen, quick, given, drive):
    """Return a function of the rate that makes the programmes, settings checked already."""
    from inspect import signature
    from piezo_stack_sim.errors import InputError
    from piezo_stack_sim.recording.programmes import check_settings, PROGRAMMES

    given = {('rest' if name == 'rest_before' else name): v for name, v in given.items()}
    check_settings('', _option, **given)
    accepted = {name: set(signature(PROGRAMMES[name]).parameters) for name in chosen}
    for setting in given:
        if not any(setting in names for names in accepted.values()):
            known = sorted(set().union(*accepted.values()) - {'rate', 'ramp'})
            shown = ', '.join(map(_option, known))
            raise InputError(f'{_option(setting)}: {", ".join(chosen)} has no such '
                             f'setting; it has {shown}')
    if 'band' in given and len(given['band']) != 2:
        raise InputError(f'--band: expected two numbers, got {len(given["band"])}')

    def make(rate):
        made = []
        for name in chosen:
            own: dict = dict(QUICK[name]) if quick else {}
            if name == 'multisine':
                own['band'] = (20.0, min(5000.0, 0.25 * rate))
            own.update({k: v for k, v in given.items() if k in accepted[name]})
            recording = PROGRAMMES[name](rate=rate, **own)
            if drive in ('open', 'shorted'):
                recording = recording.replace(drive=drive)
            made.append(recording)
        return made

    return make
