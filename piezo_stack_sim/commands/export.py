# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""``piezo_stack export``: the device in the language of other programs."""

import click

from piezo_stack_sim.commands.options import not_empty, params_option
from piezo_stack_sim.errors import InputError
from piezo_stack_sim.terminal import tell_findings


@click.group('export')
def command():
    """Write the device for other programs."""


@command.command('spice')
@params_option
@click.option('--out', metavar='FILE', callback=not_empty,
              help='File to write; printed if not given.')
@click.option('--recording', metavar='FILE',
              help='Play the commands and forces of this recording instead of a triangle.')
@click.option('--subcircuit', is_flag=True, help='Only the subcircuit, without a test bench.')
def spice(params, out, recording, subcircuit):
    """
    Write the netlist of the whole device for a SPICE simulator.

    The subcircuit has five pins: the two leads, the external force (1 V is 1 N), displacement
    (1 V is 1 um) and charge (1 V is 1 uC). Run it with "ngspice -b FILE".

    """
    from piezo_stack_sim.atomic import write_text
    from piezo_stack_sim.plant import load_device
    from piezo_stack_sim.plant import spice as circuit

    if subcircuit and recording:
        raise InputError('--subcircuit: expected no --recording beside it; leave one out')
    device = load_device(params)
    if device.effects:
        click.echo(f'left out of the circuit: the effects {", ".join(device.effects)}',
                   err=True)
    if subcircuit:
        text = circuit.subcircuit(device)
    elif recording:
        text = _played(circuit, device, recording)
    else:
        text = _triangle(circuit, device)
    if out is None:
        click.echo(text, nl=False)
    else:
        write_text(out, text)
        click.echo(f'{out}: {text.count(chr(10))} lines')


def _triangle(circuit, device):
    """Return three cycles of a 100 Hz triangle to 90 V, or as far as the actuator goes."""
    low, high = device.actuator.voltage_range
    peak = min(90.0, high) if high > 0.0 else low
    time = [0.005 * k for k in range(7)]
    return circuit.netlist(device, time, [peak * (k % 2) for k in range(7)], held=False)


def _played(circuit, device, path):
    """Return the test bench that replays a recording."""
    from piezo_stack_sim.recording.playable import check_played, require_playable
    from piezo_stack_sim.recording.read import read_set

    found = read_set(path)
    if len(found.recordings) != 1:
        names = ', '.join(each.name for each in found.recordings)
        raise InputError(f'--recording {path}: expected one recording, found {names}; name a file')
    recording = found.recordings[0]
    require_playable(recording)
    tell_findings(found)
    recording, findings = check_played(recording, device)
    for finding in findings:
        click.echo(str(finding), err=True)
    return circuit.netlist(device, recording.time - recording.time[0], recording.command,
                           recording.external_force, recording.drive)
