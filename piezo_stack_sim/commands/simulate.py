# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""``piezo_stack simulate``: what the model says to the commands of a recording set."""

from dataclasses import replace
from pathlib import Path

import click

from piezo_stack_sim.commands.options import (
    map_option, out_folder_option, params_option, unit_option)
from piezo_stack_sim.errors import InputError
from piezo_stack_sim.terminal import tell_findings


@click.command('simulate')
@click.argument('recordings', metavar='SET')
@params_option
@out_folder_option
@map_option
@unit_option
@click.option('--noise', is_flag=True, help='Add the sensor noise of the parameter file.')
@click.option('--seed', type=click.IntRange(min=0), default=None,
              help='Seed of the noise instead of the one in the parameter file.')
def command(recordings, params, out, maps, units, noise, seed):
    """
    Replay the commands and external forces of SET through the plant.

    Writes a recording set with the same names, times and commands, and the voltage, charge and
    displacement that the model computes. Nothing is clamped: what leaves the device's range is
    noted, and refused if it is far beyond.

    """
    from piezo_stack_sim.atomic import check_file
    from piezo_stack_sim.plant import load_device, simulate
    from piezo_stack_sim.progress import track
    from piezo_stack_sim.recording.playable import check_played, require_playable
    from piezo_stack_sim.recording.read import read_set
    from piezo_stack_sim.recording.write import write_csv_set

    given_at = Path(recordings).resolve()
    if Path(out).resolve() in (given_at, given_at.parent if given_at.is_file() else given_at):
        raise InputError(f'--out {out}: expected another folder than that of SET; '
                         'the recordings would be overwritten')
    check_file(Path(out) / 'recording.csv.gz')
    device = load_device(params)
    given = read_set(recordings, mapping=maps, units=units)
    if seed is not None and not noise:
        raise InputError('--seed: there is no noise to seed; add --noise or leave it out')
    for recording in given.recordings:
        require_playable(recording)
    tell_findings(given)
    played = []
    for recording in given.recordings:
        recording, findings = check_played(recording, device)
        played.append(recording)
        for finding in findings:
            click.echo(str(finding), err=True)
    answers = []
    for recording in track(played, 'Simulating'):
        response = simulate(
            device, recording.time, recording.command, recording.external_force,
            drive=recording.drive, seed=seed, noise=noise)
        answers.append(replace(recording, measured={
            'voltage': response.voltage,
            'charge': response.charge,
            'displacement': response.displacement,
        }))
    write_csv_set(replace(given, recordings=tuple(answers)), out,
                  remark='simulated by piezo_stack simulate')
    rows = sum(len(answer) for answer in answers)
    click.echo(f'{len(answers)} recordings, {rows} rows: {out}')
