# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Lets a diagnosis answer every set of a batch, without the labels; resumable, in parallel."""

import hashlib
import io
import json
from pathlib import Path
import time
import traceback

from piezo_stack_sim.atomic import atomic_path, write_text
from piezo_stack_sim.errors import InputError
from piezo_stack_sim.spread import spread

#: Folders whose code has no say in an answer.
NO_SAY = ('challenge', 'commands', 'examples', 'node')


def code_version():
    """Return a hash of all code and data of the package that can influence an answer."""
    package = Path(__file__).resolve().parents[1]
    total = hashlib.sha256()
    for path in sorted(package.rglob('*')):
        inside = path.relative_to(package)
        if path.suffix in {'.py', '.json', '.npz', '.yaml'} and inside.parts[0] not in NO_SAY:
            total.update(inside.as_posix().encode() + b'\0' + path.read_bytes())
    return total.hexdigest()


def set_names(public):
    """Return the sets of a public folder; raises InputError when it is none."""
    path = Path(public) / 'challenge.json'
    if not path.is_file():
        raise InputError(f'{path}: no such file; expected a folder made by `challenge make`')
    return json.loads(path.read_text())['sets']


def answer(public, diagnose, jobs=None, scheduler=None, again=False, progress=None, first=None):
    """
    Write ``answers/<set>.json`` for every set of a public folder.

    Parameters
    ----------
    public : str or Path
        Folder of the batch.
    diagnose : callable
        ``diagnose(set_folder, parameter_file) -> (diagnosis, predictions)``, importable by
        worker processes: a dict in the form of diagnosis.json, and a dict of thinned traces to
        compare with the truth (may be empty).
    jobs, scheduler : int and str, optional
        As `spread` takes them.
    again : bool
        Replace answers that other code has given.
    progress : callable, optional
        Called with the number of finished sets.
    first : int, optional
        Only so many sets of the batch, which are in a random order.

    Returns
    -------
    str
        The version of the code that answered.

    Raises
    ------
    InputError
        When there are answers of other code.

    """
    public = Path(public)
    names = set_names(public)[:first]
    version = code_version()
    waiting = []
    for name in names:
        run = run_of(public, name)
        if run is None or again and run['code'] != version:
            waiting.append(name)
        elif run['code'] != version:
            raise InputError(f'{public}/answers/{name}.json: given by other code '
                             f'({run["code"][:12]}, now {version[:12]}); --again replaces it')
    finished = len(names) - len(waiting)
    if progress:
        progress(finished)
    tasks = [(public.resolve(), name, diagnose, version) for name in waiting]
    for _, result in spread(answer_set, tasks, jobs, scheduler):
        if isinstance(result, Exception):
            raise result
        finished += 1
        if progress:
            progress(finished)
    return version


def run_of(public, name):
    """Return the record of an answer (dict), or None when there is none yet."""
    path = Path(public) / 'answers' / f'{name}.run.json'
    return json.loads(path.read_text()) if path.is_file() else None


def answer_set(public, name, diagnose, version):
    """Diagnose one set and write answer, predictions and record; a failure is an answer too."""
    import numpy as np
    folder = public / 'answers'
    started = time.perf_counter()
    failure, predictions = None, {}
    try:
        diagnosis, predictions = diagnose(public / name, public / 'devices' / f'{name}.yaml')
    except Exception as error:  # one broken set must not cost the others
        failure = f'{type(error).__name__}: {error}'
        diagnosis = {'verdict': 'NOT_IDENTIFIABLE', 'error': failure,
                     'traceback': traceback.format_exc()}
    seconds = time.perf_counter() - started
    text = json.dumps(diagnosis, indent=1) + '\n'
    write_text(folder / f'{name}.json', text)
    if predictions:
        stream = io.BytesIO()
        np.savez_compressed(stream, **predictions)
        with atomic_path(folder / f'{name}.npz') as partial:
            partial.write_bytes(stream.getvalue())
    write_text(folder / f'{name}.run.json', json.dumps({
        'code': version, 'seconds': seconds, 'failure': failure,
        'sha256': hashlib.sha256(text.encode()).hexdigest()}) + '\n')


def read_answers(public, first=None):
    """
    Return the answers of a public folder: dict of set name to (diagnosis, record).

    Parameters
    ----------
    public : str or Path
        Folder of the batch.
    first : int, optional
        Only those to so many of its sets.

    Raises
    ------
    InputError
        When an answer is missing, was changed after it was given, or is from other code than
        the rest.

    """
    public = Path(public)
    out = {}
    for name in set_names(public)[:first]:
        run, path = run_of(public, name), public / 'answers' / f'{name}.json'
        if run is None or not path.is_file():
            raise InputError(f'{path}: no answer yet; run `challenge answer` first')
        content = path.read_bytes()
        if hashlib.sha256(content).hexdigest() != run['sha256']:
            raise InputError(f'{path}: changed after it was given (hash differs); '
                             'delete its .run.json and answer again')
        out[name] = (json.loads(content), run)
    versions = {run['code'] for _, run in out.values()}
    if len(versions) > 1:
        raise InputError(f'{public}/answers: given by {len(versions)} versions of the code; '
                         'answer with --again')
    return out
