# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the examples share: arguments, the loop over the reference, table and picture."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
import sys

import numpy as np
from piezo_stack_sim.errors import InputError
from piezo_stack_sim.examples.stack_client import in_ros, StackClient
from piezo_stack_sim.examples.tracking import reference, Run, SWING, table, WAVES
from piezo_stack_sim.node.process import device_process
from piezo_stack_sim.plant.parameters import Device, load_device
from piezo_stack_sim.resources import config_file

# A controller: called with the displacement (m) wanted now, the one wanted when the command will
# show, and the measured one; returns the command (V or C).
Controller = Callable[[float, float, float], float]


def arguments(description: str, name: str) -> tuple[argparse.Namespace, list[str]]:
    """Read the command line; ROS arguments pass through."""
    from rclpy.utilities import remove_ros_args
    parser = argparse.ArgumentParser(
        prog=name, description=description,
        formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--device', default='/piezo_stack_node', metavar='NAME',
                        help='the node to control (default %(default)s)')
    parser.add_argument('--params', default=str(config_file('ae0505d16.yaml')), metavar='YAML',
                        help='what the controller believes the stack to be')
    parser.add_argument('--start', action='store_true',
                        help='start a device with these parameters, in lockstep, for this run')
    parser.add_argument('--out', default=name, metavar='PICTURE', type=Path,
                        help='where the picture goes, .png and .svg (default ./%(default)s)')
    parser.add_argument('--waves', type=int, default=WAVES, metavar='N',
                        help='length of the reference in waves (default %(default)s)')
    options = parser.parse_args(remove_ros_args(sys.argv)[1:])
    if options.waves < 2:
        raise InputError(f'--waves {options.waves}: expected 2 or more')
    if options.out.suffix in ('.png', '.svg'):
        options.out = options.out.with_suffix('')
    return options, sys.argv


def track(client: StackClient, name: str, controller: Controller, waves: int) -> Run:
    """
    Let a controller lead the device, from its initial state, along the reference.

    Returns
    -------
    Run
        Row k holds sample k and the command that answered it; a sample that was
        missed by wall time counts as the next one.

    """
    wanted = reference(client.rate, waves)
    ahead = np.append(wanted[client.delay:], [wanted[-1]] * client.delay)
    command, displacement = np.zeros_like(wanted), np.zeros_like(wanted)
    client.reset()
    k, last = 0, wanted.size - 1
    while k < last:
        value = controller(wanted[k], ahead[k], displacement[k])
        after, measured = client.exchange(value)
        command[k:] = value
        displacement[k + 1:] = measured
        k = max(k, min(after, last))
    return Run(name, client.rate, client.delay, wanted, command, displacement)


def picture(runs: list[Run], path: Path, drive: str, title: str) -> list[Path]:
    """Draw displacement and error over time, and the loops over the command."""
    from piezo_stack_sim import plotting
    with plotting.style():
        figure, axes = plotting.new_figure(2, 2, height=4.4, width_ratios=[1.6, 1.0],
                                           height_ratios=[1.4, 1.0])
        (above, upper), (below, lower) = axes
        upper.remove()
        lower.remove()
        loop = figure.add_subplot(above.get_gridspec()[:, 1])
        plotting.plot(above, runs[0].time, runs[0].reference, x='time', y='displacement',
                      label='reference', **plotting.line(0))
        for i, run in enumerate(runs, 1):
            plotting.plot(above, run.time, run.displacement, x='time', y='displacement',
                          label=run.name, **plotting.line(i))
            plotting.plot(below, run.time, run.error, x='time', y='displacement_nm',
                          **plotting.line(i))
            part = slice(round(run.rate * SWING), round(3 * run.rate * SWING))
            plotting.plot(loop, run.command[part], run.displacement[run.delay:][part],
                          x=f'{drive}_command', y='displacement', **plotting.line(i))
        above.set_xlabel('')
        above.set_title('Tracking')
        loop.set_title('First loop')
        # A hundred nanometres and a micrometre in one picture.
        below.set_yscale('symlog', linthresh=10.0, linscale=0.5)
        below.set_ylabel('Error (nm)')
        figure.suptitle(title, fontweight='bold', fontsize=10.0)
        plotting.legend_below(figure)
        return plotting.save(figure, path)


def perform(name: str, description: str, drive: str,
            controllers: Callable[[Device, int], dict[str, Controller]],
            conclude: Callable[[list[Run]], str]) -> int:
    """
    Run an example: every controller in turn, then table, conclusion and picture.

    Parameters
    ----------
    name : str
        Of the command.
    description : str
        For ``--help`` and the title.
    drive : str
        ``voltage`` or ``charge``.
    controllers : callable
        Takes what the stack is believed to be, and the samples until a command shows; returns
        the controllers by name.
    conclude : callable
        Takes the runs, returns the claim that they show, with numbers.

    Returns
    -------
    int
        Exit status.

    """
    def task():
        start = (device_process('--params-file', options.params, '-p', 'stepping:=lockstep')
                 if options.start else nullcontext())
        with start as process:
            client = StackClient(options.device, drive, process)
            try:
                runs = [track(client, label, controller, options.waves)
                        for label, controller in controllers(device, client.delay).items()]
            finally:
                client.close()
        print(table(runs))
        print(conclude(runs))
        written = picture(runs, options.out, drive, description.splitlines()[0].rstrip('.'))
        print(f'picture: {written[0]}')

    try:
        options, ros_arguments = arguments(description, name)
        device = load_device(options.params)
        in_ros(ros_arguments, task)
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    return 0
