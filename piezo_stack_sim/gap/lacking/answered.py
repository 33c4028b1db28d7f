# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Whether charge is wrong as if the command had gone through a filter that nobody knows.

Where nobody measured the voltage, a driver that rings and a ceramic that takes other charge look
alike to charge and displacement.  But what a driver makes of a change of the command within a few
milliseconds is the same wherever and whenever that comes: it is linear, and soon over.  Hysteresis
is neither; but where a command moves at one speed it goes by the direction, as a lag does.  So
what the speed of the moment tells is a sign of neither, and only what is beyond it counts.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from piezo_stack_sim.gap.cores import parallel
from piezo_stack_sim.gap.fitting.blackbox import answers_to, predict
from piezo_stack_sim.gap.lacking.back_coupling import FOLLOWS, Suspect
from piezo_stack_sim.gap.measured.evidence import Evidence, Track

LOUD = 1.0  # power beyond that of the noise from which a recording counts
SOON = 3e-3  # s in which a change of the command is answered
ROWS = 20, 200  # that this may take
TOLD = 0.6  # part of what the speed leaves of the charge's gap that such an answer tells

_FILTERED = Suspect('drive', 'charge, and displacement with it, are wrong as if the command had '
                    'gone through a filter that nobody knows: the driver rings')


def suspect_filter(evidence: Evidence, simulated: Sequence[dict], cuts: Sequence[dict]
                   ) -> Suspect | None:
    """
    Return the drive if a linear, short answer to the command is what is wrong, or None.

    Parameters
    ----------
    evidence : Evidence
        The recordings.
    simulated : sequence of dict
        Channel to (n,) array for each track, from the re-tuned device.
    cuts : sequence of dict
        Of each track, from :func:`~piezo_stack_sim.gap.measured.where.block_residuals`.

    """
    through = behind = 0.0
    asked = []
    for track, answer, cut in zip(evidence.tracks, simulated, cuts):
        if ('drive' in cut or not {'electrical', 'through', 'behind'} <= set(cut)
                or np.ptp(track.recording.command) <= 0.0):
            continue
        (charge, quiet), (moved, still), (left, between) = (
            cut[key] for key in ('electrical', 'through', 'behind'))
        through += max(float(moved @ moved) - moved.size * still ** 2, 0.0)
        behind += max(float(left @ left) - left.size * between ** 2, 0.0)
        if float(charge @ charge) > (1.0 + LOUD) * charge.size * quiet ** 2:
            asked.append((track, answer['charge']))
    if not asked or behind > FOLLOWS ** 2 * through:
        return None
    whole, rest = np.sum(parallel(lambda pair: _answered(*pair), asked), axis=0)
    return _FILTERED if rest < (1.0 - TOLD) * whole else None


def _answered(track: Track, charge: np.ndarray) -> tuple[float, float]:
    """
    Return what the speed leaves of the charge's gap on withheld rows, and what the answer leaves.

    Both are powers in units of that of the noise, added up over the rows.
    """
    recording = track.recording
    wrong = recording.measured['charge'] - charge
    wrong = wrong - wrong.mean()
    change = np.diff(recording.command, prepend=recording.command[0])
    rows = min(int(np.clip(round(SOON / recording.period), *ROWS)), max(wrong.size // 4, 1))
    answers = answers_to(change, rows)
    fitted = np.zeros(wrong.size, dtype=bool)
    averaged = np.repeat(track.fitted, track.factor)
    fitted[:averaged.size] = averaged
    beside, left = ((wrong - predict(told, wrong, fitted))[~fitted]
                    for told in (answers[:, :1], answers))
    noise = track.sigma['charge'] ** 2 * track.factor  # of one row, or more where it is no white
    return tuple(max(float(power @ power) / noise - power.size, 0.0)
                 for power in (beside, left))
