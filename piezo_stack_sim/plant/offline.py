# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Whole recordings at once: one on one core, many over all cores.

Rows at a constant rate go through :class:`~piezo_stack_sim.plant.stack.Plant`
itself.  Irregular rows are laid on a grid of ticks of about 60 ns without
accumulating an error.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
import os

import numpy as np

from piezo_stack_sim.errors import InputError
from piezo_stack_sim.plant import layout
from piezo_stack_sim.plant.parameters import Device
from piezo_stack_sim.plant.samples import PlantState, Response
from piezo_stack_sim.plant.stack import Plant
from piezo_stack_sim.plant.tables import Tables, TICK

MAX_CLASSES = 8  # different row lengths treated exactly; more are laid on the tick grid


def simulate(device: Device, time, command, external_force=None, drive: str | None = None,
             state: PlantState | None = None, seed: int | None = None,
             noise: bool = False, start: tuple[float, float] = (0.0, 0.0),
             before: Sequence[float] = ()) -> Response:
    """
    Replay commands and forces through a device (Eqs. 11 to 17 and its effects).

    Parameters
    ----------
    device : Device
        Actuator, load and effects.
    time : array_like, shape (n,)
        Strictly increasing times of the rows (s); any spacing.
    command : array_like, shape (n,)
        Voltage (V) or charge (C), held from its row to the next.
    external_force : array_like, shape (n,), optional
        Force (N) in the direction of extension, held likewise.
    drive : str, optional
        ``voltage``, ``charge``, ``open`` or ``shorted``; the device's own if not given.
    state : PlantState, optional
        Where to start; relaxed if not given.
    seed : int, optional
        Seed of the sensor noise.
    noise : bool
        Whether the sensors are noisy and quantised.
    start : tuple of float
        Voltage command (V) and external force (N) under which the device rests before the
        first row, its sensors zeroed there.
    before : sequence of float
        Voltages (V) that it had been led to before that.

    Returns
    -------
    Response
        n rows, each sampled just before its command takes effect.

    Raises
    ------
    InputError
        If lengths differ, times do not increase or a number is not finite.

    """
    return replay(device, Timeline.of(time, command, external_force, start, before), drive,
                  state, seed, noise)


@dataclass(frozen=True, eq=False)
class Timeline:
    """
    Commands and forces in time, checked: for whoever replays them more than once.

    Attributes
    ----------
    time, command, external_force : ndarray, shape (n,)
        As for :func:`simulate`.
    period : float or None
        Length of every row (s); None if they differ.
    start, before : tuple of float
        As for :func:`simulate`.

    """

    time: np.ndarray
    command: np.ndarray
    external_force: np.ndarray
    period: float | None
    start: tuple[float, float] = (0.0, 0.0)
    before: tuple[float, ...] = ()

    @classmethod
    def of(cls, time, command, external_force=None,
           start: tuple[float, float] = (0.0, 0.0), before: Sequence[float] = ()
           ) -> Timeline:
        """
        Return the timeline of what :func:`simulate` takes.

        Raises
        ------
        InputError
            If lengths differ, times do not increase or a number is not finite.

        """
        time = np.ascontiguousarray(time, dtype=float)
        command = np.ascontiguousarray(command, dtype=float)
        force = (np.zeros_like(command) if external_force is None
                 else np.ascontiguousarray(external_force, dtype=float))
        _check(time, command, force)
        period = float(time[-1] - time[0]) / max(time.size - 1, 1)
        grid = time[0] + period * np.arange(time.size)
        even = time.size > 1 and np.abs(time - grid).max() < max(5e-7, 1e-6 * period)
        return cls(time, command, force, period if even else None, start,
                   tuple(before))


def replay(device: Device, timeline: Timeline, drive: str | None = None,
           state: PlantState | None = None, seed: int | None = None,
           noise: bool = False) -> Response:
    """Do what :func:`simulate` does with a timeline that was checked before."""
    if seed is not None:
        device = device.replace(noise={'seed': seed})
    time, n = timeline.time, timeline.time.size
    period = timeline.period or (
        (time[-1] - time[0]) / (n - 1) if n > 1 else 1.0 / device.rate)
    plant = Plant(device, period, drive, noise, timeline.start, timeline.before)
    if state is not None:
        plant.restore(state)
    if timeline.period is not None or n == 1:
        return replace(plant.record(timeline.command[:-1], timeline.external_force[:-1]),
                       time=time)
    first = plant.sample_noisy()
    rest = _run_irregular(plant, time, timeline.command, timeline.external_force)
    columns = {name: np.concatenate([[value], getattr(rest, name)])
               for name, value in first.items()}
    return replace(rest, time=time, **columns)


def simulate_many(jobs: Iterable[tuple[Device, object]], workers: int | None = None
                  ) -> list[Response]:
    """
    Simulate many (device, recording) pairs over all cores.

    The kernel releases the interpreter lock, so threads share the work and the
    arrays.  The order of the answers is the order of the jobs.
    """
    def one(job):
        device, recording = job
        return simulate(device, recording.time, recording.command, recording.external_force,
                        recording.drive, start=recording.start, before=recording.before)

    jobs = list(jobs)
    with ThreadPoolExecutor(workers or os.cpu_count() or 1) as pool:
        return list(pool.map(one, jobs))


def _check(time, command, force) -> None:
    if time.ndim != 1 or time.size == 0:
        raise InputError(f'time has shape {time.shape}: expected one column with at least a row')
    for name, column in (('command', command), ('external_force', force)):
        if column.shape != time.shape:
            raise InputError(f'{name} has shape {column.shape}: expected {time.shape} as time')
    for name, column in (('time', time), ('command', command), ('external_force', force)):
        bad = np.flatnonzero(~np.isfinite(column))
        if bad.size:
            raise InputError(f'{name}, row {bad[0] + 1}: {column[bad[0]]} is not a finite number')
    bad = np.flatnonzero(np.diff(time) <= 0.0)
    if bad.size:
        raise InputError(f'time, row {bad[0] + 2}: {time[bad[0] + 1]} s does not come after '
                         f'{time[bad[0]]} s; sort the rows and drop duplicates')


def _run_irregular(plant: Plant, time, command, force) -> Response:
    """Rows of unequal length: a timeline of commands and readings, cut at each of them."""
    given, time = time, time - time[0]
    source = plant.source_values(command)
    lag, delay = plant.delays
    n = time.size
    moments = np.unique(np.concatenate([time, time + lag, time[1:] - delay]))
    # A delay as long as the first row reads the start, but for rounding.
    moments = moments[(moments > 1e-12) & (moments <= time[-1])]
    ends = moments[np.concatenate([np.diff(moments) > 1e-12, [True]])]
    starts = np.concatenate([[time[0]], ends[:-1]])
    tolerance = 1e-11
    ruling = np.searchsorted(time + lag, starts + tolerance, side='right') - 1
    u = np.where(ruling >= 0, source[np.maximum(ruling, 0)], plant.held_source)
    f = force[np.searchsorted(time, starts + tolerance, side='right') - 1]
    rows = _index_of(time[1:], ends, tolerance)
    reads = _index_of(time[1:] - delay, ends, tolerance)
    durations = ends - starts
    known = np.unique(np.round(durations, 12))
    if known.size <= MAX_CLASSES:
        tables = Tables(plant.system, known)
        seg_class = np.searchsorted(known, np.round(durations, 12)).astype(np.int64)
        seg_ticks = tables.ticks[seg_class]
    else:
        unit = float(np.median(durations))
        tables = Tables(plant.system, [unit])
        tick = tables.tick[0]
        marks = np.rint((ends - time[0]) / tick).astype(np.int64)
        seg_ticks = np.diff(np.concatenate([[0], marks]))
        seg_class = np.zeros(ends.size, np.int64)
    out, read = np.empty((n - 1, layout.N_OUTPUTS)), np.full(n - 1, np.nan)
    plant.run_segments(tables, seg_class, seg_ticks, u, f, rows, reads, out, read)
    read[np.isnan(read)] = plant.zero[0]  # what a delayed sensor shows of the time before
    return plant.finish(given, out, read)


def _index_of(moments, ends, tolerance) -> np.ndarray:
    """For each segment end the index of the moment it belongs to, or -1."""
    index = np.searchsorted(ends, moments - tolerance)
    rows = np.full(ends.size, -1, dtype=np.int64)
    inside = (moments > 0) & (index < ends.size)
    inside &= np.abs(ends[np.minimum(index, ends.size - 1)] - moments) < 10 * TICK
    rows[index[inside]] = np.flatnonzero(inside)
    return rows
