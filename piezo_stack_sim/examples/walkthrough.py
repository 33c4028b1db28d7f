# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
From a gap to its cause and back, with two nodes on topics.

One node plays a real actuator that has an effect which its simulation lacks; which one, only the
seed knows. The other node is the simulation. Both are excited, the gap is diagnosed, the
simulation is started again from what the diagnosis wrote, and the gap is gone.

"""

from __future__ import annotations

import argparse
import os
from pathlib import Path
import sys
import time

import numpy as np
from piezo_stack_sim.commands.excite import QUICK
from piezo_stack_sim.effects.registry import EFFECTS
from piezo_stack_sim.errors import InputError
from piezo_stack_sim.examples import options as kinds
from piezo_stack_sim.plant.parameters import Device, save_device

RATE = 2000.0  # Hz
# Effects that a few seconds at this rate tell apart; what they change differs.
SECRETS = ('creep', 'mount_creep', 'stiffness_hardening', 'leakage', 'friction')
NOISE = {'displacement': 2e-9, 'charge': 5e-9, 'voltage': 5e-3}
CHANNELS = {'voltage': ('mV', 1e3), 'charge': ('nC', 1e9), 'displacement': ('nm', 1e9)}


def secret_device(seed: int) -> Device:
    """
    Return the actuator that plays the real one.

    Its effect and the size of it are drawn with the seed; so is the scatter of its parameters,
    within their uncertainty, and the noise of its sensors.

    """
    random = np.random.default_rng(seed)
    nominal = Device.nominal()
    name = SECRETS[random.integers(len(SECRETS))]
    values = {p.name: p.typical * (float(random.uniform(0.8, 1.5)) if p.magnitude else 1.0)
              for p in EFFECTS[name].parameters}
    actuator = nominal.actuator
    scatter = {key: getattr(actuator, key) * (1.0 + 0.3 * actuator.relative_uncertainty
                                              * float(random.uniform(-1.0, 1.0)))
               for key in ('stiffness', 'linear_capacitance', 'transformer_ratio')}
    return nominal.replace(actuator=scatter, effects={name: values},
                           noise={**NOISE, 'seed': int(random.integers(1, 1000))},
                           rate=RATE, stepping='lockstep')


def node(namespace: str, params: Path):
    """Run a `piezo_stack_node` called stack in a namespace for as long as the context lasts."""
    from piezo_stack_sim.node.process import device_process
    return device_process('-r', f'__ns:=/{namespace}', '-r', '__node:=stack',
                          '-r', f'/clock:=/{namespace}/clock', '--params-file', str(params))


def play(namespace: str, profile: str, out: Path, *options: str) -> None:
    """Excite a device, as ``piezo_stack excite`` does, and record what it answers."""
    from piezo_stack_sim.commands.excite import command
    from piezo_stack_sim.examples.stack_client import FIRST_START
    command.main([profile, '--node', f'/{namespace}/stack', '--reset',
                  '--patience', f'{FIRST_START:g}', '--out', str(out), *options],
                 standalone_mode=False)


def powers(real: Path, simulated: Path, nominal: Device) -> dict[str, float]:
    """
    Return the gap between two recording sets as the diagnosis counts it.

    Parameters
    ----------
    real, simulated : Path
        Recording sets of the same programmes.
    nominal : Device
        What the simulation began with.

    Returns
    -------
    dict of str to float
        Mean square of the difference on the rows that are withheld from fits, by channel
        (V^2, C^2, m^2), without the mean of a recording, which the zero of a sensor hides.

    """
    from piezo_stack_sim.gap.deciding.score import channel_power
    from piezo_stack_sim.gap.measured.evidence import prepare
    from piezo_stack_sim.recording.preflight import preflight
    from piezo_stack_sim.recording.read import read_set

    checked, _ = preflight(read_set(str(real)), nominal)
    answers = read_set(str(simulated))
    said = [answers[recording.name].measured for recording in checked]
    evidence = prepare(checked.recordings, said)
    residual = np.concatenate([
        evidence.tracks[i].weighted(c, said[i][c]) for i, c in evidence.keys])
    return channel_power(evidence, residual, centred=True)


def table(before: dict, after: dict, shrinkage: dict) -> str:
    """Return the gap before and after, as the nodes showed it and as the diagnosis claimed it."""
    lines = [f'{"gap, RMS":<14}{"before":>12}{"after":>12}{"noise":>12}'
             f'{"claimed before":>18}{"claimed after":>16}']
    for channel, (unit, factor) in CHANNELS.items():
        claim = shrinkage[channel]
        numbers = [factor * np.sqrt(power) for power in (
            before[channel], after[channel], claim['noise'], claim['before'], claim['after'])]
        cells = [f'{number:.1f} {unit}' for number in numbers]
        lines.append(f'{channel:<14}' + ''.join(
            f'{cell:>{width}}' for cell, width in zip(cells, (12, 12, 12, 18, 16))))
    return '\n'.join(lines)


def picture(folder: Path, out: Path, title: str) -> list[Path]:
    """Draw what the real device did against the simulation before and after."""
    from piezo_stack_sim import plotting
    from piezo_stack_sim.recording.read import read_set
    sets = [read_set(str(folder / name)) for name in ('real', 'before', 'after')]
    labels = ('real device', 'simulation before', 'simulation after')
    with plotting.style():
        figure, axes = plotting.new_figure(2, 3, height=4.6, height_ratios=[1.5, 1.0])
        for column, name in enumerate(('triangle', 'steps', 'force')):
            above, below = axes[:, column]
            real, *others = (each[name] for each in sets)
            loop = name == 'triangle'
            for i, recording in enumerate((real, *others)):
                plotting.plot(above, recording.command if loop else recording.time,
                              recording.measured['displacement'],
                              x='voltage_command' if loop else 'time', y='displacement',
                              label=labels[i], **plotting.line(i))
            for i, recording in enumerate(others, 1):
                error = recording.measured['displacement'] - real.measured['displacement']
                plotting.plot(below, real.time, error, x='time', y='displacement_nm',
                              **{**plotting.line(i), 'linestyle': '-', 'linewidth': 0.7})
            above.set_title({'triangle': 'Triangles', 'steps': 'Steps with holds',
                             'force': 'Squeezing force'}[name])
            below.set_ylabel('Error (nm)' if not column else '')
            if column:
                above.set_ylabel('')
        figure.suptitle(title, fontweight='bold', fontsize=10.0)
        plotting.legend_below(figure)
        return plotting.save(figure, out)


def bars(before: dict, after: dict, shrinkage: dict, out: Path) -> list[Path]:
    """Draw the gap of each channel in multiples of its noise, before and after."""
    from piezo_stack_sim import plotting
    with plotting.style():
        figure, axes = plotting.new_figure(1, 1, height=2.2)
        places = np.arange(len(CHANNELS))
        least = 0.5
        for i, (label, power) in enumerate((('before', before), ('after', after)), 1):
            ratio = [np.sqrt(power[c] / shrinkage[c]['noise']) for c in CHANNELS]
            least = min(least, 0.7 * max(min(ratio), 0.01))
            drawn = axes.barh(places + (0.2 if i == 2 else -0.2), ratio, 0.36, label=label,
                              color=plotting.LINES[i][0])
            axes.bar_label(drawn, [f'{value:.1f}' for value in ratio], padding=3, bbox={
                'facecolor': 'white', 'edgecolor': 'none', 'pad': 0.5})
        axes.axvline(1.0, **plotting.line(0), linewidth=1.0, label='noise', zorder=0.9)
        axes.set_xscale('log')
        axes.set_xlim(least, 2.0 * max(before[c] / shrinkage[c]['noise'] for c in CHANNELS) ** 0.5)
        axes.set_yticks(places, list(CHANNELS))
        axes.invert_yaxis()
        axes.set_xlabel('RMS gap in multiples of the noise')
        plotting.legend_below(figure)
        return plotting.save(figure, out)


def prepare_files(folder: Path, seed: int) -> tuple[Device, Device, Path, Path]:
    """Write the parameters of the two nodes; return both devices and both files."""
    secret, nominal = secret_device(seed), Device.nominal().replace(rate=RATE, stepping='lockstep')
    real_params, nominal_params = folder / 'real.yaml', folder / 'nominal.yaml'
    save_device(secret, real_params, 'Plays the real device. No peeking before the diagnosis.')
    save_device(nominal, nominal_params, 'What the simulation takes the device to be.')
    return secret, nominal, real_params, nominal_params


def walk(folder: Path, seed: int, say=print) -> dict:
    """
    Take the whole way once.

    Parameters
    ----------
    folder : Path
        Where everything goes; its recording sets must not exist yet.
    seed : int
        Chooses the secret.
    say : callable
        Takes a line about every step.

    Returns
    -------
    dict
        ``secret`` (the effect), ``diagnosis``, and the gap that the nodes showed, ``before`` and
        ``after`` (mean squares by channel).

    Raises
    ------
    InputError
        If a node or a file is in the way.

    """
    from piezo_stack_sim.gap.write import diagnose_to_folder
    secret, nominal, real_params, nominal_params = prepare_files(folder, seed)
    real, before, after = (folder / name for name in ('real', 'before', 'after'))
    with node('real', real_params):
        say(f'1  exciting the real device: {", ".join(QUICK)}')
        play('real', 'all', real, '--quick')
    with node('simulation', nominal_params):
        say('2  exciting the simulation with the same commands')
        play('simulation', str(real), before)
    began = time.monotonic()
    say('3  diagnosing the gap')
    diagnosis = diagnose_to_folder([str(real)], str(nominal_params), str(folder / 'diagnosis'))
    found = ', '.join(diagnosis['selected']) or 'nothing'
    say(f'   {diagnosis["verdict"]}: {found} ({time.monotonic() - began:.0f} s)')
    with node('simulation', folder / 'diagnosis' / 'corrected.yaml'):
        say('4  exciting the simulation started from corrected.yaml')
        play('simulation', str(real), after)
    return {'secret': next(iter(secret.effects)), 'diagnosis': diagnosis,
            'before': powers(real, before, nominal), 'after': powers(real, after, nominal)}


def main() -> int:
    """Run the example."""
    parser = argparse.ArgumentParser(
        prog='piezo_stack_walkthrough', description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--out', type=kinds.folder, default=Path('walkthrough'), metavar='DIR',
                        help='where everything goes (default ./%(default)s)')
    parser.add_argument('--seed', type=kinds.seed, default=11, metavar='N',
                        help='chooses the secret (default %(default)s)')
    parser.add_argument('--prepare', action='store_true',
                        help='only write real.yaml and nominal.yaml, to go the way by hand')
    options = parser.parse_args()
    # Its own domain, so that a device or a controller already running is not disturbed.
    os.environ.setdefault('ROS_DOMAIN_ID', str(1 + os.getpid() % 100))
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    try:
        if options.prepare:
            print(*prepare_files(options.out, options.seed)[2:], sep='\n')
            return 0
        told = walk(options.out, options.seed)
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    shrinkage = told['diagnosis']['shrinkage']
    print(table(told['before'], told['after'], shrinkage))
    print(f'the secret was: {told["secret"]}')
    found = ', '.join(told['diagnosis']['selected'])
    paths = picture(options.out, options.out / 'traces', f'Diagnosed: {found or "nothing"}')
    paths += bars(told['before'], told['after'], shrinkage, options.out / 'gap')
    print(f'pictures: {paths[0]}, {paths[2]}; report: {options.out}/diagnosis/report.html')
    return 0


if __name__ == '__main__':
    sys.exit(main())
