# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Recordings as they come from a laboratory: a stage whose charge nobody measured.

The controller's output in volts, an amplifier with a gain in between, a position sensor in volts
of unknown scale that drifts, everything at 10 kHz in one CSV per run. One thing is not as it
should be; --secret says which, or chance does. The stage is one of the blind benchmark's devices:
it shares no physics with the simulation.

"""

from __future__ import annotations

import argparse
from pathlib import Path
import sys

import numpy as np
from piezo_stack_sim.atomic import make_folder
from piezo_stack_sim.challenge.device import Programme, respond, Unit
from piezo_stack_sim.challenge.known import KNOWN
from piezo_stack_sim.errors import InputError
from piezo_stack_sim.examples import options as kinds
from piezo_stack_sim.recording import programmes
from piezo_stack_sim.recording.recording import Recording

RATE = 10e3  # Hz
AMPLIFIER = 15.0  # V/V
SENSOR = 3.1e5  # V/m
NOISE, DRIFT = 8e-4, 5e-4  # V rms, V/s: it warms up
BITS = 16  # over +-10 V
TABLE = {'m': 6.0, 'b': 2500.0, 'k': 3e6}  # kg, N s/m, N/m: resonance at some hundred hertz
SECRETS = {
    'sensor_lag': {'time_constant': 3e-4, 'quality': 0.57, 'head': 0.3},
    'rate_dependent_hysteresis': {'growth': 0.05, 'reference': 1e-2},
    'creep': {'per_decade': 0.015, 'onset': 3e-3},
}


def runs() -> dict[str, Recording]:
    """Return the programmes, by the name of their file, with commands at the stack (V)."""
    shapes = {'slow': programmes.triangle((30.0, 60.0, 90.0), 1.0, 1, RATE),
              'noise': programmes.multisine(40.0, 6.0, (10.0, 1500.0), rate=RATE),
              'steps': programmes.steps((0.0, 50.0, 15.0, 70.0), 1.5, rate=RATE)}
    for peak in (20.0, 80.0):
        for frequency in (5.0, 20.0, 50.0, 100.0):
            shapes[f'triangle_{frequency:.0f}Hz_{peak:.0f}V'] = programmes.triangle(
                (peak,), frequency, 4, RATE)
    return shapes


def stage(secret: str) -> Unit:
    """Return the stage with its secret: a stack unlike the paper's under a heavy table."""
    stack = Unit().stack
    unit = Unit().change(stack={
        'C': 0.93 * stack.C, 'K': 1.12 * stack.K, 'V': 1.07 * stack.V,
        **{name: getattr(stack, name) + value for name, value in TABLE.items()}})
    return KNOWN[secret].apply(unit, **SECRETS[secret]) if secret else unit


def write(folder: Path, secret: str = '', seed: int = 1) -> None:
    """
    Write the recordings of a stage.

    Parameters
    ----------
    folder : Path
        Gets one CSV a run: ``time`` (s), ``out`` (V, of the controller), ``sensor`` (V).
    secret : str
        What the stage has, one of `SECRETS`; '' for nothing.
    seed : int
        Of noise and drift.

    """
    random = np.random.default_rng(seed)
    make_folder(folder)
    step = 20.0 / 2 ** BITS
    for name, run in runs().items():
        moved = respond(stage(secret), Programme(
            name, run.time, run.command, run.external_force))['displacement']
        read = (SENSOR * moved + random.normal(0.0, 0.5) + NOISE * random.standard_normal(len(run))
                + DRIFT * run.time)
        np.savetxt(folder / f'{name}.csv', np.column_stack(
            [run.time, run.command / AMPLIFIER, step * np.round(read / step)]), '%.9g', ',',
            header='time,out,sensor', comments='')


def main() -> int:
    """Run the example."""
    parser = argparse.ArgumentParser(
        prog='python -m piezo_stack_sim.examples.laboratory', description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--out', type=kinds.folder, default=Path('laboratory'), metavar='DIR',
                        help='where the recordings go (default ./%(default)s)')
    parser.add_argument('--secret', choices=[*SECRETS, 'nothing'],
                        help='what the stage has; drawn with the seed if not given')
    parser.add_argument('--seed', type=kinds.seed, default=1, metavar='N',
                        help='of noise, drift and the draw (default %(default)s)')
    options = parser.parse_args()
    drawn = list(SECRETS)[int(np.random.default_rng(options.seed).integers(len(SECRETS)))]
    secret = options.secret or drawn
    try:
        write(options.out, '' if secret == 'nothing' else secret, options.seed)
    except (InputError, OSError) as error:
        print(error, file=sys.stderr)
        return 2
    print(f'{len(runs())} recordings: {options.out}')
    return 0


if __name__ == '__main__':
    sys.exit(main())
