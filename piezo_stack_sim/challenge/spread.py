# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Many independent pieces of work: here, over processes, or over a Dask cluster."""

from concurrent.futures import as_completed, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
import multiprocessing

from piezo_stack_sim.errors import InputError


def spread(function, tasks, jobs=None, scheduler=None):
    """
    Call a function with every tuple of arguments; yield once after each.

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

    Raises
    ------
    InputError
        When no scheduler answers, Dask is missing, or a worker dies again and again.

    """
    if not tasks:
        return
    if scheduler:
        yield from over_dask(function, tasks, scheduler)
    elif jobs == 1:
        for task in tasks:
            function(*task)
            yield
    else:
        yield from over_processes(function, tasks, jobs)


def over_processes(function, tasks, jobs):
    """Call in worker processes; one that dies costs nothing that is finished."""
    context = multiprocessing.get_context('spawn')
    waiting, deaths = list(tasks), 0
    while waiting:
        done = set()
        with ProcessPoolExecutor(jobs, mp_context=context) as pool:
            futures = {pool.submit(function, *task): i for i, task in enumerate(waiting)}
            for future in as_completed(futures):
                try:
                    future.result()
                except BrokenProcessPool:
                    continue
                done.add(futures[future])
                yield
        waiting = [task for i, task in enumerate(waiting) if i not in done]
        deaths = 0 if done else deaths + 1
        if deaths == 2:
            raise InputError(f'a process dies in each of the {len(waiting)} sets left, perhaps '
                             'for lack of memory; try fewer --jobs')


def over_dask(function, tasks, address):
    """Call on the workers of a Dask cluster."""
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
        futures = [client.submit(function, *task, pure=False, retries=2) for task in tasks]
        for future in completed(futures):
            future.result()
            yield
