# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Fading memory: a slow response that is a convolution over everything that happened.

The library of the diagnosis adds up a few exponential relaxations. Here the past itself is kept,
cut into pieces with the mean of each, and weighed by a kernel that is no sum of exponentials:
the logarithm of elapsed time (ferroelectric creep). Pieces that are short compared with their age
are joined, which keeps the list short.

What is kept are values and not their changes: changes of opposite signs have no centre of gravity,
so that joining those of an oscillation would leave a rest at a wrong age.

"""

from numba import njit
import numpy as np

#: Pieces that together are shorter than this fraction of their age become one.
RESOLUTION = 0.04
CAPACITY = 1200
#: They are joined whenever so many have been added.
NEW = 64


@njit(cache=True)
def join(ends, means, count, begun, now, onset, resolution):
    """Join neighbouring pieces that the kernel can hardly tell apart; return the count."""
    kept = 0
    start = begun
    for i in range(1, count):
        if ends[i] - start < resolution * (now - ends[i] + onset):
            share = (ends[i] - ends[kept]) / (ends[i] - start)
            means[kept] += share * (means[i] - means[kept])
        else:
            start = ends[kept]
            kept += 1
            means[kept] = means[i]
        ends[kept] = ends[i]
    return kept + 1


@njit(cache=True)
def remember(ends, means, count, begun, now, mean, onset, resolution):
    """Append the piece that ends now, joining others every so often; return the count."""
    ends[count] = now
    means[count] = mean
    count += 1
    if count % NEW == 0:
        count = join(ends, means, count, begun, now, onset, resolution)
    while count == CAPACITY:
        # Only a very small resolution comes here.
        resolution *= 2.0
        count = join(ends, means, count, begun, now, onset, resolution)
    return count


@njit(cache=True)
def logarithmic_growth(ends, means, count, begun, latest, then, onset):
    """
    Return what follows the past with log10(1 + age/onset) of each change.

    Parameters
    ----------
    ends, means : (CAPACITY,) array
        The pieces of the past: time at the end of each (s), and mean in it, from rest.
    count : int
        Number of pieces.
    begun, then : float
        Time at the start of the first, and the one asked for, in s.
    latest : float
        From the last piece to then.
    onset : float
        In s.

    """
    total, before = 0.0, np.log(1.0 + (then - begun) / onset)
    for i in range(count):
        since = np.log(1.0 + (then - ends[i]) / onset)
        total += means[i] * (before - since)
        before = since
    return (total + latest * before) / np.log(10.0)
