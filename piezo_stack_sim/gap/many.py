# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Many diagnoses: over processes of this machine, or over a Dask cluster."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
import json
from pathlib import Path

from piezo_stack_sim.errors import InputError
from piezo_stack_sim.spread import spread


@dataclass(frozen=True)
class Job:
    """One device to diagnose and the folder for its answer."""

    paths: tuple[str, ...]
    params: str
    out: str
    mapping: tuple[str, ...] = ()
    units: tuple[str, ...] = ()


def run_job(job: Job) -> str:
    """Diagnose one device and return one line about it; what is wrong with it is the line."""
    from piezo_stack_sim.gap.write import diagnose_to_folder

    try:
        diagnosis = diagnose_to_folder(job.paths, job.params, job.out, job.mapping, job.units)
    except InputError as error:
        return f'failed: {error}'
    names = ', '.join(dict.fromkeys(
        [*diagnosis['selected'], *diagnosis['ambiguity_set']]))
    return f'{diagnosis["verdict"]} {names}'.rstrip()


def diagnose_many(jobs: list[Job], workers: int = 1, scheduler: str | None = None
                  ) -> Iterator[tuple[Job, str]]:
    """
    Diagnose many devices; yield each with a line about it as it is done.

    A job whose diagnosis.json exists already is passed over, so that an
    interrupted run is resumed by the same command, unless what it was made from
    has changed since.

    Raises
    ------
    InputError
        If Dask is asked for and not installed, or does not answer; if a
        diagnosis.json is there that was made from something else.

    """
    done = [_is_done(job) for job in jobs]  # of all, before the first is begun
    yield from ((job, 'done before') for job, over in zip(jobs, done) if over)
    todo = [job for job, over in zip(jobs, done) if not over]
    for i, line in spread(run_job, [(job,) for job in todo], workers, scheduler):
        yield todo[i], f'failed: {line}' if isinstance(line, Exception) else line


def _is_done(job: Job) -> bool:
    """Tell whether a job has its answer, made from what is given now."""
    from piezo_stack_sim.gap.write import inputs_of
    file = Path(job.out) / 'diagnosis.json'
    if not file.exists():
        return False
    try:
        answer = json.loads(file.read_text(encoding='utf-8'))
        made_from = dict(answer['inputs'])
    except (OSError, ValueError, TypeError, KeyError):
        answer, made_from = {}, {}
    for name, now in inputs_of(job.paths, job.params, job.mapping, job.units).items():
        if made_from.get(name) != now:
            raise InputError(f'{file}: made from other {name} ({made_from.get(name)}) than given '
                             f'now ({now}): remove it or choose another --out')
    return 'verdict' in answer and file.stat().st_mtime >= max(
        _changed(Path(path), Path(job.out)) for path in (*job.paths, job.params))


def _changed(place: Path, without: Path) -> float:
    """Return when a file, or the newest in a folder, was changed (s); 0 if nobody can tell."""
    times = [0.0]
    for each in place.rglob('*') if place.is_dir() else (place,):
        try:
            if each.is_file() and without not in each.parents:
                times.append(each.stat().st_mtime)
        except OSError:
            continue  # reading it will tell
    return max(times)
