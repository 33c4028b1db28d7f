# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The guide that the moving end rubs in, as the challenge hides it.

Who writes the library of the diagnosis does not read this module.

Many small contacts side by side stick and give way one after the other, those of a break way w
with a density in a power of it (Iwan 1966; Segalman 2005, A four-parameter Iwan model for lap-type
joints); how far they go before grows with the 2/3 power of the force (Mindlin 1949).  What each
holds grows with the logarithm of its age, and a little with that of the speed (Dieterich 1979;
Ruina 1983)::

    held = 1 + DIRECT ageing ln(1 + v/PACE) + ageing ln(1 + PACE age/RENEWAL)
    age' = 1 - v age/RENEWAL

What is held is positive and each contact a spring that yields, so that energy is only lost.

"""

from numba import njit
import numpy as np

MEMBERS = 8
WIDTH = 40.0  # longest over shortest way before a contact gives way
DIRECT = 0.35
PACE = 1e-3  # m/s
RENEWAL = 5e-7  # m, after which the contacts are others
AT_FIRST = 10.0  # s, for which a device has been at rest


def guide_of(force, way, power):
    """
    Return what each contact holds (N) and its stiffness (N/m), both (MEMBERS,).

    Parameters
    ----------
    force : float
        Of all of them, in N.
    way : float
        Before the last gives way, in m at 1 N.
    power : float
        Of the force of the contacts up to a way, per unit of its logarithm.

    """
    places = WIDTH ** (np.arange(MEMBERS) / (MEMBERS - 1.0) - 1.0)
    shares = places ** power
    holds = force * shares / shares.sum()
    return holds, holds / (places * way * force ** (2.0 / 3.0))


@njit(cache=True)
def held(ageing, age, speed):
    """Return what the contacts hold, over what they hold when young and slow."""
    return 1.0 + ageing * (DIRECT * np.log(1.0 + abs(speed) / PACE)
                           + np.log(1.0 + PACE * age / RENEWAL))


@njit(cache=True)
def drag(holds, stiffness, ageing, strain, dx, h):
    """Return the force against the motion (N) that `rub` would with the same arguments."""
    level = held(ageing, strain[holds.size], dx / h)
    total = 0.0
    for i in range(holds.size):
        most = level * holds[i]
        total += min(max(strain[i] + stiffness[i] * dx, -most), most)
    return total


@njit(cache=True)
def rub(holds, stiffness, ageing, strain, dx, h):
    """
    Move the contacts by a travel `dx` in a time `h`, in place, and return their force (N).

    The last of `strain` is their age (s).

    """
    count = holds.size
    speed = abs(dx) / h
    level = held(ageing, strain[count], speed)
    total = 0.0
    for i in range(count):
        most = level * holds[i]
        strain[i] = min(max(strain[i] + stiffness[i] * dx, -most), most)
        total += strain[i]
    renewed = abs(dx) / RENEWAL
    if renewed > 1e-6:
        after = h / renewed
        strain[count] = after + (strain[count] - after) * np.exp(-renewed)
    else:
        strain[count] += h - strain[count] * renewed
    return total


def kept(stiffness, strain):
    """Return the energy that can be had back (J)."""
    return 0.5 * (strain[:-1] ** 2 / stiffness).sum()
