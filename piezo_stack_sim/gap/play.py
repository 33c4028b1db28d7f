# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What the course of the displacement tells of the block, whatever the cause: play.

Where a part has play or rubs, what is wrong with the displacement depends on which way it
last moved and how far, however fast: on the plays of a Prandtl-Ishlinskii operator.  No
reading of a sensor remembers that, however late it comes.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from piezo_stack_sim.gap.back_coupling import Suspect
from piezo_stack_sim.gap.blackbox import lagged, predict
from piezo_stack_sim.gap.evidence import Evidence

LOUD = 0.2  # power beyond that of the noise from which a recording counts
WIDTHS = (0.002, 0.01, 0.05, 0.15, 0.4)  # half widths of plays, parts of the stroke
DELAYS = (1, 3, 10, 30, 300)  # rows
REMEMBERS = 0.45  # part that plays may leave of what everything without such memory leaves
WITHOUT, WITH = 0.15, 0.25  # part of the gap that this leaves at least, and plays at most

_PLAY = Suspect('mechanical', 'what is wrong with the displacement depends on which way it last '
                'moved, however fast: something has play or rubs')


def suspect_play(evidence: Evidence, simulated: Sequence[dict], cuts: Sequence[dict]
                 ) -> Suspect | None:
    """
    Return the mechanics if the displacement is wrong by which way it last moved, or None.

    Parameters
    ----------
    evidence : Evidence
        The recordings.
    simulated : sequence of dict
        Channel to (n,) array for each track, from the re-tuned device.
    cuts : sequence of dict
        Of each track, from :func:`~piezo_stack_sim.gap.where.block_residuals`.

    """
    gap = plain = played = 0.0
    for track, answer, cut in zip(evidence.tracks, simulated, cuts):
        wrong, noise = cut.get('through', cut.get('behind', (np.empty(0), 1.0)))
        x = track.average(answer['displacement'])
        stroke = np.ptp(x)
        withheld = ~track.fitted
        if wrong.size != x.size or stroke <= 0.0 or not withheld.any():
            continue

        def left(features):
            error = (wrong - predict(np.column_stack(features), wrong, track.fitted))[withheld]
            return withheld.sum() * (np.mean(error ** 2) / noise ** 2 - 1.0)

        excess = withheld.sum() * (np.var(wrong[withheld]) / noise ** 2 - 1.0)
        if excess < LOUD * withheld.sum():
            continue
        known = [x, x ** 2, x ** 3, np.gradient(x), *(x - lagged(x, rows) for rows in DELAYS),
                 track.average(track.recording.command), track.average(answer['voltage']),
                 track.average(answer['charge'])]
        gap += excess
        plain += left(known)
        played += left([*known, *(_play(x, width * stroke) for width in WIDTHS)])
    if gap > 0.0 and plain > WITHOUT * gap and played < min(WITH * gap, REMEMBERS * plain):
        return _PLAY
    return None


def _play(x: np.ndarray, half: float) -> np.ndarray:
    """Return what a play of a half width (m) makes of displacements (n,)."""
    follower, out = float(x[0]), []
    for place in x.tolist():
        follower = min(max(follower, place - half), place + half)
        out.append(follower)
    return np.array(out)
