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
- one that is wrong the other way was moved by another ratio between voltage and force: a larger
  one takes more charge for less displacement,
- charge that is wrong without displacement was measured wrong (or leaked past the
  ceramic, but that the library has),

and one that is wrong as its charge is follows it: the gap is before the
transducer.

The share of charge, in multiples of what would move the end as far, is told by
many rows even where the noise of one hides it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np

PARTS = 20  # of each recording, by which the error of the share of charge is known
STANDS_OUT = 0.5  # part of the noise that a gap must reach
FEW = 0.16  # share up to which, with its error, the stack felt nothing, either way
FORCED = 0.1, 0.8  # what a force moves, twice the error included: hysteresis gives back more
RATIO = -0.45, -0.09  # what another ratio moves, the error included: -0.3 to -0.15 in a stack
LEADS = 0.8  # and from which, less twice the error, the charge is not moved by the end
STEADY = 1.3  # mean square of the voltage's gap over that of its noise up to which it has none
FOLLOWS = 0.3  # gap behind the charge, against that before it, that is none
ASTRAY = 0.4  # gap of the displacement, against that of the charge, that does not follow it


@dataclass(frozen=True)
class Suspect:
    """A block, and in words why it is suspected."""

    block: str
    reason: str


MISREAD_CHARGE = Suspect('sensor', 'the charge is wrong and the displacement does not follow it: '
                         'it was measured wrong')
NOT_FELT = Suspect('sensor', 'the displacement is wrong without the charge that a force on the '
                   'stack would move')
_FORCED = Suspect('mechanical', 'displacement and charge are wrong together, as a force on the '
                  'stack makes them')
OTHER_RATIO = Suspect('transducer', 'displacement and charge are wrong in opposite ways, as '
                      'another ratio between voltage and force makes them')
_LED = Suspect('electrical', 'the displacement is wrong as the charge is, which the measured '
               'voltage should not have moved')


def suspect_block(cuts: Sequence[dict]) -> Suspect | None:
    """
    Return the block that charge and displacement point to, or None.

    Parameters
    ----------
    cuts : sequence of dict
        Of each track, from :func:`~piezo_stack_sim.gap.measured.where.block_residuals`; those that
        hold ``electrical``, ``through`` and ``behind`` count.

    """
    ports = ('electrical', 'through', 'behind')
    told = [cut for cut in cuts if set(ports) <= set(cut)]
    if not told:
        return None
    driven, driver, parts = all('drive' in cut for cut in told), 0.0, []
    for cut in told:
        (charge, _), (moved, still) = cut['electrical'], cut['through']
        if driven:
            wrong, noise = cut['drive']
            driver = max(driver, float(np.mean(wrong ** 2)) / noise ** 2)
        parts += [(np.sum(q * x), np.sum(x ** 2 - still ** 2)) for q, x in zip(
            np.array_split(charge, PARTS), np.array_split(moved, PARTS))]
    (before, through, after), (quiet, still, _) = np.sqrt(np.maximum(_powers(told, ports), 0.0))
    if max(before / quiet, through / still) < STANDS_OUT:
        return None
    if through < ASTRAY * min(before, after):
        return MISREAD_CHARGE
    share, error = ratio_of_sums(np.array(parts))
    if after < FOLLOWS * before:
        return None
    if driven and RATIO[0] < share < RATIO[1] - error:
        return OTHER_RATIO
    if abs(share) + error < FEW:
        return NOT_FELT
    # A slow driver whose voltage nobody measured looks like a force.
    if (driven and FORCED[0] < share - 2.0 * error and share + 2.0 * error < FORCED[1]
            and after > FOLLOWS * through):
        return _FORCED
    # And a driver that is wrong by less than the noise moves both as they belong together.
    return _LED if driven and driver < STEADY and share - 2.0 * error > LEADS else None


def is_behind(cuts: Sequence[dict]) -> bool:
    """
    Tell whether what is wrong is known to lie behind the charge, or without that the terminals.

    Parameters
    ----------
    cuts : sequence of dict
        Of each track, from :func:`~piezo_stack_sim.gap.measured.where.block_residuals`.

    """
    return not is_led(cuts) and any(
        {'behind', name} <= set(cut) for cut in cuts for name in ('electrical', 'drive'))


def is_led(cuts: Sequence[dict]) -> bool:
    """
    Tell whether more is known to be wrong with the charge than behind it.

    Parameters
    ----------
    cuts : sequence of dict
        Of each track, from :func:`~piezo_stack_sim.gap.measured.where.block_residuals`.

    """
    ports = ('electrical', 'behind')
    told = [cut for cut in cuts if set(ports) <= set(cut)]
    if not told:
        return False
    (before, after), (noise, _) = _powers(told, ports)
    return bool(before > max(after, (STANDS_OUT ** 2) * noise))


def _powers(cuts: Sequence[dict], ports: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
    """Return the mean square of each port beyond its noise, and of its noise, over all rows."""
    rows = [cut[ports[0]][0].size for cut in cuts]
    wrong = [[np.mean(cut[port][0] ** 2) for port in ports] for cut in cuts]
    noise = np.average([[cut[port][1] ** 2 for port in ports] for cut in cuts], 0, rows)
    return np.average(wrong, 0, rows) - noise, noise


def ratio_of_sums(parts: np.ndarray) -> tuple[float, float]:
    """Return a ratio of sums, and its error by leaving out one row of (n, 2) at a time."""
    total = parts.sum(axis=0)
    without = total - parts
    if total[1] <= 0.0 or not (without[:, 1] > 0.0).all():
        return 0.0, math.inf
    ratios = without[:, 0] / without[:, 1]
    n = len(parts)
    return float(total[0] / total[1]), float(math.sqrt((n - 1) * np.var(ratios)))
