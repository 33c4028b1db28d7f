# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Many independent pieces of work: here, over processes, or over a Dask cluster."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import as_completed, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
import multiprocessing
import os
import threading
from typing import Any

from piezo_stack_sim.errors import InputError


def spread(function: Callable, tasks: Sequence[tuple], jobs: int | None = None,
           scheduler: str | None = None) -> Iterator[tuple[int, Any]]:
    """
    Call a function with every tuple of arguments; yield each result as it comes.

    A worker that dies costs nothing that is finished: the rest is tried again.

    Parameters
    ----------
    function : callable
        Importable by name; keeps its result on disk.
    tasks : sequence of tuple
        What is to be done.
    jobs : int, optional
        Processes on this machine, as many as there are cores by default; 1 is this process.
    scheduler : str, optional
        Address of a Dask scheduler whose workers see the same files; takes the place of `jobs`.

    Yields
    ------
    tuple of int and object
        Number of the task, and what it returned: an Exception if it failed, or if its
        workers die again and again.

    Raises
    ------
    InputError
        When no scheduler answers, or Dask is missing.

    """
    if not tasks:
        return
    if scheduler:
        yield from _over_dask(function, tasks, scheduler)
    elif jobs == 1:
        for i, task in enumerate(tasks):
            yield i, _outcome(lambda task=task: function(*task))
    else:
        yield from _over_processes(function, tasks, jobs)


def _outcome(call: Callable) -> Any:
    """Return what a call returns, or the exception it ends with."""
    try:
        return call()
    except Exception as error:  # one piece of work must not cost the others
        return error


def _over_processes(function, tasks, jobs) -> Iterator[tuple[int, Any]]:
    context = multiprocessing.get_context('spawn')
    waiting, deaths = dict(enumerate(tasks)), 0
    while waiting and deaths < 2:
        done = 0
        with ProcessPoolExecutor(jobs, context, _end_with_parent) as pool:
            futures = {pool.submit(function, *task): i for i, task in waiting.items()}
            for future in as_completed(futures):
                result = _outcome(future.result)
                if not isinstance(result, BrokenProcessPool):
                    done += 1
                    del waiting[futures[future]]
                    yield futures[future], result
        deaths = 0 if done else deaths + 1
    for i in waiting:
        yield i, InputError('its process dies again and again, perhaps for lack of memory; '
                            'try fewer --jobs')


def _end_with_parent() -> None:
    """Have this worker end when its parent does: killed, that tells nobody."""
    def watch():
        parent = multiprocessing.parent_process()
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _over_dask(function, tasks, address) -> Iterator[tuple[int, Any]]:
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
        futures = {client.submit(function, *task, pure=False, retries=2): i
                   for i, task in enumerate(tasks)}
        for future in completed(list(futures)):
            yield futures[future], _outcome(future.result)
