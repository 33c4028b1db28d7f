# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What charge and displacement together tell of the block, whatever the cause.

A stack is a sensor of force, too: under voltage drive, a force that moves the
end by dx moves the charge by T dx less what the hysteresis gives back (Eqs. 11
to 15 of the paper).  So with the gaps of both against the *measured* voltage,

- a displacement that is wrong without its share of charge was moved by nothing
  that the stack feels: by the sensor,
- one that is wrong with part of it was moved by a force,
- charge that is wrong without displacement was measured wrong (or leaked past the
  ceramic, but that the library has),

and one that is wrong as its charge is follows it: the gap is before the
transducer.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np

KNOWN = 0.35  # noise of the charge against the displacement, from which nothing is told
STANDS_OUT = 0.5  # part of the noise that a gap must reach
FEW = 0.12  # share of charge up to which the stack felt nothing, either way
FORCED = 0.4  # correlation of charge and displacement that a force makes
FOLLOWS = 0.3  # gap behind the charge, against that before it, that is none
ASTRAY = 0.4  # gap of the displacement, against that of the charge, that does not follow it


@dataclass(frozen=True)
class Suspect:
    """A block, and in words why it is suspected."""

    block: str
    reason: str


_MISREAD_CHARGE = Suspect('sensor', 'the charge is wrong and the displacement does not follow it: '
                          'it was measured wrong')
NOT_FELT = Suspect('sensor', 'the displacement is wrong without the charge that a force on the '
                   'stack would move')
_FORCED = Suspect('mechanical', 'displacement and charge are wrong together, as a force on the '
                  'stack makes them')


def suspect_block(cuts: Sequence[dict]) -> Suspect | None:
    """
    Return the block that charge and displacement point to, or None.

    Parameters
    ----------
    cuts : sequence of dict
        Of each track, from :func:`~piezo_stack_sim.gap.where.block_residuals`; those that
        hold ``electrical``, ``through`` and ``behind`` count.

    """
    powers, rows, driven = np.zeros(6), 0, True
    for cut in cuts:
        if not {'electrical', 'through', 'behind'} <= set(cut):
            continue
        (charge, quiet), (moved, still) = cut['electrical'], cut['through']
        behind, between = cut['behind']
        driven = driven and 'drive' in cut
        powers += charge.size * np.array([
            np.mean(charge ** 2) - quiet ** 2, np.mean(moved ** 2) - still ** 2,
            np.mean(behind ** 2) - between ** 2, np.mean(charge * moved),
            quiet ** 2, still ** 2])
        rows += charge.size
    if not rows:
        return None
    common = powers[3] / rows
    before, through, after, quiet, still = (
        math.sqrt(max(power, 0.0)) for power in powers[[0, 1, 2, 4, 5]] / rows)
    if max(before / quiet, through / still) < STANDS_OUT:
        return None
    if through < ASTRAY * min(before, after):
        return _MISREAD_CHARGE
    if after < FOLLOWS * before or quiet > KNOWN * through:
        return None
    if abs(common) < FEW * through ** 2:
        return NOT_FELT
    # A slow driver whose voltage nobody measured looks like a force.
    if driven and common > FORCED * before * through and after > FOLLOWS * through:
        return _FORCED
    return None
