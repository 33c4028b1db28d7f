# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""The picture of an effect: time traces and loops of the same tests with and without it."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np

from piezo_stack_sim import plotting
from piezo_stack_sim.atomic import atomic_path
from piezo_stack_sim.effects.base import Effect
from piezo_stack_sim.plant import Device
from piezo_stack_sim.signature.experiment import Experiment, experiments, run, telling

RESOLUTION = 120  # dots an inch: a page shows it at its own size
COLOURS = 64  # of the palette; lines on white need no more
LOOPS = (('voltage_command', 'voltage', 'command → voltage'),
         ('voltage', 'charge', 'voltage → charge'),
         ('charge', 'displacement', 'charge → displacement'))
SPAN = {'voltage': 0.1, 'charge': 0.1, 'displacement_nm': 2.0}  # V, uC, nm


def draw(effect: Effect, device: Device, values: dict[str, float], test: str | None = None
         ) -> Any:
    """
    Draw the signature of an effect.

    Parameters
    ----------
    effect : Effect
        What is drawn.
    device : Device
        The device without it.
    values : dict of str to float
        Parameters of the effect.
    test : str, optional
        Name of the test to show over time; the most telling one if not given.

    Returns
    -------
    matplotlib figure
        To be saved inside :func:`piezo_stack_sim.plotting.style`.

    """
    shown, channel = telling(effect, device, values, test)
    tests = experiments()
    chosen = tests[shown]
    devices = (('without', device), (effect.id, device.with_effects({effect.id: values})))
    figure, axes = plotting.new_figure(height=4.6)
    axes.remove()
    above, below = figure.subfigures(2, 1, height_ratios=[1.1, 1.0])
    _over_time(above, chosen, channel, devices)
    _loops(below, chosen if chosen.cyclic else tests[chosen.loops], devices)
    return figure


def _over_time(figure: Any, test: Experiment, channel: str, devices: Any) -> None:
    fast = test.time[-1] < 0.5 and not test.log_time
    clock, first = ('time_ms' if fast else 'time'), int(test.log_time)
    figure.suptitle(_capital(test.title), fontsize=9.5, x=0.01, ha='left', weight='bold')
    traces, change = figure.subplots(1, 2, width_ratios=[1.6, 1.0])
    values = [getattr(run(device, test), channel)[first:] for _, device in devices]
    for index, (name, _) in enumerate(devices):
        plotting.plot(traces, test.time[first:], values[index], x=clock, y=channel, label=name,
                      **plotting.line(index))
    traces.legend(loc='best')
    unit = 'displacement_nm' if channel == 'displacement' else channel
    plotting.plot(change, test.time[first:], values[1] - values[0], x=clock, y=unit,
                  **plotting.line(2))
    change.set_ylabel('Change ' + _unit(unit))
    _at_least(change, unit)
    if test.log_time:
        traces.set_xscale('log')
        change.set_xscale('log')


def _loops(figure: Any, test: Experiment, devices: Any) -> None:
    figure.suptitle(f'{_capital(test.title)}: departure of the loops from a straight line',
                    fontsize=9.5, x=0.01, ha='left', weight='bold')
    panels = figure.subplots(1, 3)
    # A row is sampled just before its command takes effect: the one before it rules there.
    command = np.concatenate([test.command[:1], test.command[:-1]])
    last = slice(-(test.time.size // 2) - 1, None)
    lines: dict[str, Any] = {}
    for index, (_, device) in enumerate(devices):
        response = run(device, test)
        for panel, (x, y, title) in zip(panels, LOOPS):
            across = (command if x == 'voltage_command' else getattr(response, x))[last]
            up = getattr(response, y)[last]
            slope = lines.setdefault(y, np.polyfit(across, up, 1))  # that of the first device
            unit = 'displacement_nm' if y == 'displacement' else y
            plotting.plot(panel, across, up - np.polyval(slope, across), x=x, y=unit,
                          **plotting.line(index))
            panel.set_ylabel(_unit(unit))
            panel.set_title(title, weight='normal')
    for panel, unit in zip(panels, SPAN):
        _at_least(panel, unit)


def _unit(quantity: str) -> str:
    return plotting.QUANTITIES[quantity][0].rpartition(' ')[2]


def _at_least(axes: Any, quantity: str) -> None:
    """Keep an axis from magnifying what no instrument can see."""
    low, high = axes.get_ylim()
    missing = SPAN[quantity] - (high - low)
    if missing > 0.0:
        axes.set_ylim(low - 0.5 * missing, high + 0.5 * missing)


def _capital(text: str) -> str:
    return text[0].upper() + text[1:]


def save(figure: Any, path: Path) -> None:
    """Write a picture as a small PNG: with a palette, at the size of the page."""
    from PIL import Image

    raw = io.BytesIO()
    figure.savefig(raw, format='png', dpi=RESOLUTION, metadata={'Software': None})
    image = Image.open(raw).convert('RGB').quantize(COLOURS, dither=Image.Dither.NONE)
    with atomic_path(path) as partial:
        image.save(partial, format='PNG', optimize=True)
