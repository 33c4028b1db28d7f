# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""``piezo_stack challenge``: the blind benchmark, made, answered and scored."""

import os

import click
from piezo_stack_sim.commands.options import not_empty
from piezo_stack_sim.errors import InputError
from piezo_stack_sim.progress import counted

jobs_option = click.option(
    '--jobs', type=click.IntRange(min=1), default=os.cpu_count(), show_default='all cores',
    metavar='N', help='Processes.')


scheduler_option = click.option(
    '--scheduler', metavar='ADDRESS',
    help='Dask scheduler whose workers see the same files; instead of --jobs.')


first_option = click.option(
    '--first', type=click.IntRange(min=1), metavar='N',
    help='Only the first N sets: they are in a random order.')


@click.group('challenge')
def command():
    """
    Make, answer and score a blind benchmark.

    A batch is a folder of recording sets of devices with hidden effects. Its labels lie beside the
    folder, which itself holds only their salted hash. Interrupted work goes on where it stopped.

    """


@command.command('make')
@click.option('--sets', required=True, type=click.IntRange(min=1), metavar='N',
              help='How many devices.')
@click.option('--seed', required=True, type=click.IntRange(min=0), metavar='S',
              help='Same seed, same devices. Keep it to yourself: it is as good as the labels.')
@click.option('--out', required=True, metavar='DIR', callback=not_empty,
              help='Public folder; labels go to DIR.labels.json and DIR.truth beside it.')
@click.option('--unforeseen', is_flag=True,
              help='Only effects that no rule of the diagnosis was made for.')
@click.option('--patchy', is_flag=True,
              help='Sensors slower than the command, lost messages: the same devices, with holes.')
@jobs_option
@scheduler_option
def make_command(sets, seed, out, unforeseen, patchy, jobs, scheduler):
    """Make recording sets of devices with hidden effects."""
    from piezo_stack_sim.challenge.make import make

    with counted('Making devices', sets) as progress:
        labels = make(sets, seed, out, jobs, scheduler, progress, unforeseen, patchy)
    click.echo(f'{sets} devices: {out}; labels: {labels}')


@command.command('answer')
@click.argument('folder', metavar='DIR')
@click.option('--again', is_flag=True, help='Replace answers that other code has given.')
@first_option
@jobs_option
@scheduler_option
def answer_command(folder, again, first, jobs, scheduler):
    """Diagnose every set in DIR with the defaults; answers go to DIR/answers."""
    from piezo_stack_sim.challenge.answer import answer, set_names

    with counted('Diagnosing', len(set_names(folder)[:first])) as progress:
        version = answer(folder, diagnose, jobs, scheduler, again, progress, first)
    complete = 'complete' if first is None else f'the first {first}'
    click.echo(f'{folder}/answers: {complete}; code {version[:16]}')


@command.command('score')
@click.argument('folders', metavar='DIR...', nargs=-1, required=True)
@click.option('--labels', metavar='FILE', multiple=True,
              help='Label file, once for each DIR.  [default: DIR.labels.json]')
@click.option('--out', metavar='DIR', callback=not_empty,
              help='Folder for score.json, score.md and confusion.png.'
              '  [default: DIR/score, of the first]')
@click.option('--floors', metavar='FILE', help='JSON of question to the fewest hits (of false '
              'alarms: the most); the status is 2 below them.')
@first_option
def score_command(folders, labels, out, floors, first):
    """Prove the hashes of labels and answers in each DIR, and score all answers together."""
    import json
    from pathlib import Path

    from piezo_stack_sim.atomic import write_text
    from piezo_stack_sim.challenge import page, score

    result = score.score(folders, labels, first)
    out = Path(out) if out else Path(folders[0]) / 'score'
    write_text(out / 'score.json', json.dumps(result, indent=1) + '\n')
    page.write(result, out)
    for name, (text, _) in score.QUESTIONS.items():
        rate = result['rates'][name]
        if rate['of']:
            click.echo(f'{page.percent(rate):>6}  {page.interval(rate):>10}  '
                       f'{rate["hits"]:>4}/{rate["of"]:<4}  {text}')
    click.echo(out / 'score.md')
    if floors:
        missed = score.missed(result, score.read_floors(floors))
        if missed:
            raise InputError(f'{floors}: ' + '; '.join(missed))


def diagnose(recordings, parameter_file):
    """
    Return the diagnosis of a set and what it predicts: both models, thinned as the truth is.

    Parameters
    ----------
    recordings, parameter_file : Path
        The set and the file of its nominal device.

    Returns
    -------
    diagnosis : dict
        In the form of diagnosis.json.
    predictions : dict of str to ndarray
        ``before/<recording>/<channel>`` with the parameter file, ``after/...`` as corrected.

    """
    import numpy as np

    from piezo_stack_sim.challenge.make import KEPT_ROWS
    from piezo_stack_sim.gap import diagnose_set
    from piezo_stack_sim.plant import load_device, simulate
    from piezo_stack_sim.recording.read import read_set

    device = load_device(parameter_file)
    given = read_set(recordings)
    found = diagnose_set(given, device, traces=False, ablate=True)
    predictions = {}
    for kind in ('before', 'after'):
        for recording in given.recordings:
            model = found.devices.get(recording.name, found.device)
            model = device if kind == 'before' else model
            response = simulate(model, recording.time, recording.command,
                                recording.external_force, drive=recording.drive,
                                start=recording.start, before=recording.before)
            for channel in recording.measured:
                values = getattr(response, channel)
                if channel != 'voltage':
                    values = values - values[0]
                predictions[f'{kind}/{recording.name}/{channel}'] = (
                    values[::KEPT_ROWS].astype(np.float32))
    return found.document, predictions
