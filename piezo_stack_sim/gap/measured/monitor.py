# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The zero of the voltage: of the instrument that reads it, or of a driver that had it before.

Charge and displacement are zeroed where a recording begins; a voltage is not, since its zero is
that of the command.  Where all recordings read one and the same voltage too much in every row,
from the first on, and nothing else is wrong with it, that is no answer to a command.  Whether the
device stood at it shows in charge and displacement: if these do not follow better from there, it
is taken off.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from piezo_stack_sim.gap.measured.filled import series
from piezo_stack_sim.gap.measured.forward import simulate_set
from piezo_stack_sim.gap.measured.noise import white_level
from piezo_stack_sim.plant import Device
from piezo_stack_sim.recording.finding import Finding, found, REPAIRED
from piezo_stack_sim.recording.recording import Recording

NOTHING_ELSE = 1.1  # times the noise that the voltage may be wrong beside its offset
COUNTS = 0.5  # times the noise of a row from which an offset counts
ALIKE = 0.2  # part by which the offsets of recordings may differ
FOLLOWS = 0.97  # part of their error that charge and displacement leave which follow an offset


def without_offset(recordings: Sequence[Recording], device: Device,
                   simulated: Sequence[dict[str, np.ndarray]]
                   ) -> tuple[tuple[Recording, ...], list[Finding]]:
    """
    Return recordings without an offset that only the reading of the voltage has, and what it was.

    Parameters
    ----------
    recordings : sequence of Recording
        After preflight.
    device : Device
        The simulation.
    simulated : sequence of dict
        Channel to (n,) array for each of them.

    """
    same = tuple(recordings), []
    read = [i for i, each in enumerate(recordings)
            if each.drive == 'voltage' and 'voltage' in each.measured]
    if not read:
        return same
    wrong = [series(recordings[i], 'voltage', simulated[i]['voltage'])[0] for i in read]
    noise = [white_level(each) for each in wrong]
    offset = float(np.mean([each.mean() for each in wrong]))
    steady = all(
        each.std() < NOTHING_ELSE * level and abs(each.mean() - offset) < ALIKE * abs(offset)
        for each, level in zip(wrong, noise))
    if not steady or abs(offset) < COUNTS * max(noise) or _is_driven(
            recordings, device, simulated, offset):
        return same
    taken = [each.replace(measured={**each.measured, 'voltage': each.measured['voltage'] - offset})
             if i in read else each for i, each in enumerate(recordings)]
    much = f'{abs(offset):.3g} V too {"much" if offset > 0.0 else "little"}'
    return tuple(taken), [found(
        recordings[i], None, REPAIRED, f'voltage reads {much} in every row',
        'taken off: an offset of what reads it, or of a driver that had it before the recording')
        for i in read]


def _is_driven(recordings, device: Device, simulated, offset: float) -> bool:
    """Tell whether charge and displacement are less wrong for a stack that stands at an offset."""
    moved = [each.replace(command=each.command + offset,
                          start=(each.start[0] + offset, each.start[1]))
             if each.drive == 'voltage' else each for each in recordings]
    return _error(recordings, simulate_set(device, moved)) < FOLLOWS * _error(
        recordings, simulated)


def _error(recordings, simulated) -> float:
    """Return the power of what is wrong with charge and displacement, in parts of their range."""
    return sum(float(np.var(values - answer[channel])) / (float(np.ptp(values)) ** 2 or 1.0)
               for each, answer in zip(recordings, simulated)
               for channel, values in each.measured.items() if channel != 'voltage')
