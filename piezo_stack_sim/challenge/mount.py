# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The mount beside the stack that yields slowly, as the challenge hides it.

Who writes the library of the diagnosis does not read this module.

Glue that is loaded relaxes in many ways at once, of which the slowest are the most and have an end
(Davidson and Cole 1951, Dielectric relaxation in glycerol: the spectrum of moduli of a polymer
about its glass transition)::

    share of what relaxes faster than s time = I_s(broad, 1 - broad), s from 1/SPAN to 1

and the faster the more it is loaded, as its segments are pushed over their barriers (Eyring 1936;
Ward, Mechanical properties of solid polymers, chapter on yield)::

    force = stiffness load,  load = sum_i share_i (x - y_i)
    y_i' = (x - y_i) sinh(u)/u/time_i,  u = load/way

The factor is at least 1 and the same for all, so that energy is only lost.

"""

from numba import njit
import numpy as np
from scipy.special import betainc

DENSITY = 6  # branches a decade: no ripple that could be seen
MEMBERS = 24
SPAN = 10.0 ** (MEMBERS / DENSITY)


def mount_of(time, broad):
    """
    Return the share of each branch and how long it takes when hardly loaded (s): both (MEMBERS,).

    Parameters
    ----------
    time : float
        Of the slowest, in s.
    broad : float
        The smaller, the broader: power of time with which it begins.

    """
    edges = 10.0 ** (np.arange(-MEMBERS, 1) / DENSITY)
    shares = np.diff(betainc(broad, 1.0 - broad, edges))
    return shares / shares.sum(), time * np.sqrt(edges[1:] * edges[:-1])


def kept_after(shares, times, since):
    """Return what is left of a small load so long (s) after a step, as a part of it."""
    return float((shares * np.exp(-since / times)).sum())


@njit(cache=True)
def hurried(load, way):
    """Return how much faster everything relaxes under a load (m)."""
    u = load / way
    if abs(u) < 1e-3:
        return 1.0 + u * u / 6.0
    return np.sinh(u) / u


@njit(cache=True)
def yields_to(shares, times, way, yielded, x, h):
    """Return where the branches will be, in the mean (m), if a place is kept for a time (s)."""
    load = 0.0
    for i in range(shares.size):
        load += shares[i] * (x - yielded[i])
    passed = h * hurried(load, way)
    mean = 0.0
    for i in range(shares.size):
        mean += shares[i] * (yielded[i] - (x - yielded[i]) * np.expm1(-passed / times[i]))
    return mean


@njit(cache=True)
def relax(shares, times, way, yielded, x, h):
    """Move the branches towards a place (m) for a time (s), in place: as hurried as halfway."""
    passed = h * hurried(x - yields_to(shares, times, way, yielded, x, 0.5 * h), way)
    for i in range(shares.size):
        yielded[i] -= (x - yielded[i]) * np.expm1(-passed / times[i])


def speeds(shares, times, way, yielded, x):
    """Return how fast the branches yield (m/s) where the mount is held: the law itself."""
    return (x - yielded) * hurried(shares @ (x - yielded), way) / times
