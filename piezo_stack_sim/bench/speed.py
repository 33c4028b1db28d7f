# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The speed table: the plant and its peers on the same commands in one run, each with its accuracy.

The plant computes the five test programmes whole. Peers are slow, so each computes a slice of
every programme and its cost is extrapolated to the whole. All times are processor time of one
core, so that other work on the machine does not count.

"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
import os
import platform
import resource
import time as clock
from typing import Any

import numpy as np

from piezo_stack_sim.bench import fixed_step, ngspice, ode
from piezo_stack_sim.plant import Device, simulate
from piezo_stack_sim.progress import track
from piezo_stack_sim.recording.programmes import PROGRAMMES

# First and last time (s) of the peers' slices; each begins with the device relaxed.
SLICES = {'triangle': (0.0, 0.06), 'decay': (0.0, 0.03), 'steps': (6.0, 6.2),
          'multisine': (0.0, 0.012), 'force': (0.0, 0.13)}
QUICK = 0.1  # share of the slices in a quick run
REFERENCE_STEP = 5e-8  # s
REPEATS = 20


def measure(device: Device | None = None, quick: bool = False) -> dict:
    """
    Measure speed and accuracy of the plant and of its peers.

    Parameters
    ----------
    device : Device, optional
        The AE0505D16 of the paper if not given; effects and a clamp are left out.
    quick : bool
        Short slices and a coarser reference: for a look, not for a claim.

    Returns
    -------
    dict
        ``plant`` by programme and in all, ``peers`` as a list of rows, ``reference`` with its own
        error, ``machine``. Times in s of processor time, errors in m and C against the reference.

    """
    # Peers know neither effects nor a clamp.
    device = (device or Device.nominal()).replace(effects={}, load={'clamped': False})
    recordings = {name: make() for name, make in PROGRAMMES.items()}
    slices = {name: _rows(recordings[name], *SLICES[name], QUICK if quick else 1.0)
              for name in recordings}
    step = 4.0 * REFERENCE_STEP if quick else REFERENCE_STEP
    # The whole programmes are the plant's test; the long one has nothing but rest in it outside
    # its slice, and would take the reference minutes.
    tested = dict(slices) if quick else {**recordings, 'steps': slices['steps']}

    names = [('numba loop, 1 µs', partial(fixed_step.run, device, step=1e-6)),
             ('scipy LSODA', partial(ode.run, device, method='LSODA')),
             ('scipy RK45', partial(ode.run, device, method='RK45'))]
    if ngspice.available():
        names.append(('ngspice, 1 µs', partial(ngspice.run, device, step=1e-6)))
    jobs: list[Callable[[], Any]] = [
        partial(_reference, device, tested, step), partial(_plant, device, recordings),
        *(partial(_peer, run, recordings, slices) for _, run in names)]
    done = [job() for job in track(jobs, 'Measuring')]

    (truth, own_error), (cost, by_programme, answers), *peers = done
    rows: list[dict[str, Any]] = []
    for (name, _), (taken, answer) in zip(names, peers):
        worst = _worst([_error(answer[key], truth[key]) for key in slices])
        rows.append({
            'name': name, 'time': taken, 'real_time_factor': _duration(recordings) / taken,
            'simulated': _duration(slices), 'extrapolated': True, **worst})
    errors = {}
    for key, recording in tested.items():
        first = int(np.searchsorted(recordings[key].time, recording.time[0]))
        # A slice starts at rest where the whole programme rests too.
        errors[key] = _error({name: values[first:] for name, values in answers[key].items()},
                             truth[key])
        by_programme[key].update(_worst([errors[key]]))
    own = {'name': 'plant', 'time': cost, 'real_time_factor': _duration(recordings) / cost,
           'simulated': _duration(recordings), 'extrapolated': False,
           **_worst(list(errors.values()))}
    for row in rows:
        row['plant_is_faster_by'] = own['real_time_factor'] / row['real_time_factor']
    return {
        'machine': _machine(), 'quick': quick, 'plant': {**own, 'programmes': by_programme},
        'peers': rows, 'reference': {'method': 'trapezoidal rule', 'step': step, **own_error},
        'missing': [] if ngspice.available() else ['ngspice'],
    }


def _rows(recording, begin, end, share):
    inside = (recording.time >= begin - 1e-9) & (
        recording.time <= begin + share * (end - begin) + 1e-9)
    return recording.take(inside)


def _duration(recordings):
    return sum(recording.duration for recording in recordings.values())


def _reference(device, tested, step):
    """Compute the truth, and how far it moves when its step is doubled."""
    _warm(partial(fixed_step.run, device))
    truth, moved = {}, []
    for key, each in tested.items():
        made = [fixed_step.run(device, each.time, each.command, each.external_force, h)
                for h in (step, 2.0 * step)]
        truth[key] = made[0]
        moved.append(_error(made[1], made[0]))
    return truth, _worst(moved)


def _plant(device, recordings):
    """Time the plant on the whole programmes, warm: the best of several repeats of each."""
    _warm(partial(simulate, device))
    rows, answers, cost = {}, {}, 0.0
    for key, each in recordings.items():
        times = []
        for _ in range(REPEATS):
            begin = clock.process_time()
            response = simulate(device, each.time, each.command, each.external_force)
            times.append(clock.process_time() - begin)
        best = min(times)
        cost += best
        answers[key] = {'displacement': response.displacement, 'charge': response.charge}
        rows[key] = {'rows': len(each), 'duration': each.duration, 'time': best,
                     'real_time_factor': each.duration / best}
    return cost, rows, answers


def _peer(run, recordings, slices):
    """Time one peer on the slices; its cost is extrapolated by duration."""
    _warm(run)
    cost, answers = 0.0, {}
    for key, each in slices.items():
        begin = _processor_time()
        answers[key] = run(time=each.time - each.time[0], command=each.command,
                           external_force=each.external_force)
        cost += (_processor_time() - begin) * recordings[key].duration / each.duration
    return cost, answers


def _warm(run):
    """Compile, load and start up outside the measurement."""
    run(time=np.array([0.0, 1e-5, 2e-5]), command=np.array([0.0, 1.0, 2.0]),
        external_force=np.zeros(3))


def _processor_time():
    """Return the processor time of this process and of the children that have ended, s."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return clock.process_time() + children.ru_utime + children.ru_stime


def _error(answer, truth):
    return tuple(
        float(np.abs(answer[name][:truth[name].size] - truth[name][:answer[name].size]).max())
        for name in ('displacement', 'charge'))


def _worst(errors):
    return {'displacement_error': max(e[0] for e in errors),
            'charge_error': max(e[1] for e in errors)}


def _machine():
    model = platform.processor() or platform.machine()
    try:
        with open('/proc/cpuinfo', encoding='utf-8') as lines:
            model = next(line.split(':', 1)[1].strip() for line in lines
                         if line.startswith('model name'))
    except (OSError, StopIteration):
        pass
    return {'processor': model, 'cores': os.cpu_count(), 'python': platform.python_version()}
