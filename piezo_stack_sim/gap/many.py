# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Many diagnoses: over processes of this machine, or over a Dask cluster."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import as_completed, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
import multiprocessing
from pathlib import Path

from piezo_stack_sim.errors import InputError


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
    names = ', '.join(diagnosis['ambiguity_set'] or diagnosis['selected'])
    return f'{diagnosis["verdict"]} {names}'.rstrip()


def diagnose_many(jobs: list[Job], workers: int = 1, scheduler: str | None = None
                  ) -> Iterator[tuple[Job, str]]:
    """
    Diagnose many devices; yield each with a line about it as it is done.

    A job whose diagnosis.json exists already is passed over, so that an
    interrupted run is resumed by the same command.

    Raises
    ------
    InputError
        If Dask is asked for and not installed, or does not answer.

    """
    todo = []
    for job in jobs:
        if (Path(job.out) / 'diagnosis.json').exists():
            yield job, 'done before'
        else:
            todo.append(job)
    if scheduler:
        yield from _over_dask(todo, scheduler)
    elif workers == 1:
        for job in todo:
            yield job, run_job(job)
    else:
        yield from _over_processes(todo, workers)


def _over_processes(todo: list[Job], workers: int) -> Iterator[tuple[Job, str]]:
    left = list(todo)
    # A worker that dies breaks its pool: what it had finished is on disk, the rest goes on once.
    for attempt in range(2):
        context = multiprocessing.get_context('spawn')
        with ProcessPoolExecutor(workers, mp_context=context) as pool:
            futures = {pool.submit(run_job, job): job for job in left}
            for future in as_completed(futures):
                job = futures[future]
                try:
                    line = future.result()
                except BrokenProcessPool:
                    if attempt:
                        yield job, 'failed: its worker died twice'
                    continue
                left.remove(job)
                yield job, line
        if not left:
            return


def _over_dask(todo: list[Job], address: str) -> Iterator[tuple[Job, str]]:
    try:
        from distributed import as_completed as completed, Client
    except ImportError:
        raise InputError('--scheduler needs Dask: pip install "piezo_stack_sim[dask]"') from None
    try:
        client = Client(address, timeout=10)
    except (OSError, TimeoutError, ValueError) as error:
        raise InputError(f'--scheduler {address}: no Dask scheduler answers there ({error}); '
                         'start one with `dask scheduler`') from None
    with client:
        futures = {client.submit(run_job, job, pure=False, retries=2): job for job in todo}
        for future in completed(list(futures)):
            try:
                line = future.result()
            except Exception as error:  # whatever killed the worker, the other answers stand
                line = f'failed: {error}'
            yield futures[future], line
