# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Fading memory: a slow response that is a convolution over everything that happened.

The library of the diagnosis adds up a few exponential relaxations. Here the past itself is kept,
as a list of increments with their times, and weighed by a kernel that is no sum of exponentials:
the logarithm of elapsed time (ferroelectric creep) or a power law (polymers). Increments that lie
close together compared with their age are merged, which keeps the list short.

"""

from numba import njit
import numpy as np

#: Increments closer than this fraction of their age count as one.
RESOLUTION = 0.08
CAPACITY = 1200


@njit(cache=True)
def forget(times, amounts, count, now, onset):
    """Merge neighbouring increments that the kernel can no longer tell apart; return the count."""
    kept = 0
    for i in range(1, count):
        age = now - times[i] + onset
        if times[i] - times[kept] < RESOLUTION * age:
            total = amounts[kept] + amounts[i]
            # Weighing by size keeps the centre of gravity; opposite signs have none.
            weight = abs(amounts[kept]) + abs(amounts[i])
            if weight > 0.0:
                times[kept] += (times[i] - times[kept]) * abs(amounts[i]) / weight
            amounts[kept] = total
        else:
            kept += 1
            times[kept] = times[i]
            amounts[kept] = amounts[i]
    return kept + 1 if count else 0


@njit(cache=True)
def remember(times, amounts, count, now, amount, onset):
    """Append one increment, making room first when the list is full; return the count."""
    if count >= CAPACITY - 1:
        count = forget(times, amounts, count, now, onset)
        if count >= CAPACITY - 1:
            # Hundreds of decades of time would be needed to come here; drop nothing silently.
            amounts[count - 1] += amount
            return count
    times[count] = now
    amounts[count] = amount
    return count + 1


@njit(cache=True)
def logarithmic_growth(times, amounts, count, now, ahead, onset):
    """Return how much a sum of increments times log10(1 + age/onset) grows until now + ahead."""
    total = 0.0
    for i in range(count):
        age = now - times[i] + onset
        total += amounts[i] * np.log(1.0 + ahead / age)
    return total / np.log(10.0)


@njit(cache=True)
def power_law_decay(times, amounts, count, now, ahead, onset, exponent):
    """Return how much a sum of increments times (1 + age/onset)**-exponent falls meanwhile."""
    total = 0.0
    for i in range(count):
        age = 1.0 + (now - times[i]) / onset
        total += amounts[i] * (age ** -exponent - (age + ahead / onset) ** -exponent)
    return total
