# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
How often do the intervals cover the truth?  Identification repeated with fresh noise.

``python -m piezo_stack_sim.identify.repeats SET --params TRUE.yaml --repeats 50``
replays the commands and forces of a recording set through a known device, adds
noise, identifies, and compares with what is known.
"""

from __future__ import annotations

import click
import numpy as np

from piezo_stack_sim.identify.identification import identify
from piezo_stack_sim.plant import load_device, simulate
from piezo_stack_sim.plant.parameters import Device
from piezo_stack_sim.recording.read import read_set
from piezo_stack_sim.recording.recording import RecordingSet

NOISE = {'displacement': 2e-9, 'charge': 5e-9, 'voltage': 5e-3}  # m, C, V


def replayed(recordings, device: Device) -> list:
    """Return the recordings with what a device answers, the channels they measured."""
    result = []
    for each in recordings:
        answer = simulate(device, each.time, each.command, each.external_force, each.drive,
                          start=each.start, before=each.before)
        result.append(each.replace(measured={c: getattr(answer, c) for c in each.measured}))
    return result


def noisy(recordings, seed: int, noise=None) -> RecordingSet:
    """Return the recordings with white noise on every measured channel."""
    noise = NOISE if noise is None else noise
    random = np.random.default_rng(seed)
    return RecordingSet('noisy', tuple(
        each.replace(measured={c: values + noise[c] * random.standard_normal(values.size)
                               for c, values in each.measured.items()})
        for each in recordings))


def known(device: Device) -> dict[str, float]:
    """Return what a device is known by, under the names of the estimates."""
    actuator = device.actuator
    T, C, k = actuator.transformer_ratio, actuator.linear_capacitance, actuator.stiffness
    values = {name: getattr(actuator, name) for name in (
        'mass', 'stiffness', 'damping', 'linear_capacitance', 'transformer_ratio')}
    for name in ('maxwell_stiffness', 'maxwell_break_voltage'):
        values |= {f'{name}[{i}]': v for i, v in enumerate(getattr(actuator, name))}
    return values | {'T/C': T / C, 'k + T^2/C': k + T * T / C,
                     '1/C + maxwell_stiffness[-1]': 1.0 / C + actuator.maxwell_stiffness[-1]}


@click.command()
@click.argument('recordings', metavar='SET...', nargs=-1, required=True)
@click.option('--params', required=True, metavar='YAML', help='The device taken for the truth.')
@click.option('--repeats', default=50, show_default=True, help='How many.')
@click.option('--elements', type=int, help='Number of elements; chosen if not given.')
@click.option('--first-seed', default=0, show_default=True, help='Seed of the first.')
def main(recordings, params, repeats, elements, first_seed):
    """Print, for each repeat and at the end, errors and how many intervals cover the truth."""
    device = load_device(params)
    exact, truth = replayed(read_set(list(recordings)), device), known(device)
    covered = asked = 0
    for seed in range(first_seed, first_seed + repeats):
        found = identify(noisy(exact, seed), elements=elements)
        if found.fit.layout.n != len(device.actuator.maxwell_stiffness):
            click.echo(f'{seed}: {found.fit.layout.n} elements; element by element there is '
                       'nothing to compare')
        rows = [(e, truth[e.name]) for e in found.estimates if e.determined and (
            found.fit.layout.n == len(device.actuator.maxwell_stiffness)
            or 'maxwell' not in e.name)]
        inside = [e.low <= value <= e.high for e, value in rows]
        covered, asked = covered + sum(inside), asked + len(inside)
        worst, value = max(rows, key=lambda row: abs(row[0].value / row[1] - 1.0))
        missed = ' '.join(f'{e.name}({np.log(e.value / v) / e.half_width:+.1f})'
                          for (e, v), held in zip(rows, inside) if not held)
        click.echo(f'{seed}: {len(rows)} determined, worst {worst.name} '
                   f'{100.0 * (worst.value / value - 1.0):+.2f} %, {sum(inside)} covered '
                   f'{missed}')
    click.echo(f'covered {covered} of {asked}: {100.0 * covered / max(asked, 1):.1f} %')


if __name__ == '__main__':
    main()
