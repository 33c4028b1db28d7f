# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The last element, which slips only at charges beyond the rising curve, if at all.

While it sticks, its stiffness and 1/C are one number, and k + T^2/C does not
show its parts.  Recordings that make it slip, such as steps that overshoot,
tell all of them; but only from near by, so that the place is searched first.
"""

from __future__ import annotations

import math

import numpy as np

from piezo_stack_sim.gap.cores import parallel
from piezo_stack_sim.gap.measured.forward import simulate_channels
from piezo_stack_sim.identify.refine import cost_of, descend
from piezo_stack_sim.identify.vector import Layout, LINEAR, OPEN, RATIO, SPLIT

BEYOND = 1.02  # of the charge that the rising curve reaches
SHARES = np.geomspace(0.004, 0.6, 20)  # of k in k + T^2/C, tried
BREAKS = 14  # break charges tried
BETTER = 0.5  # of the cost: slipping must explain that much
TRIED = 3  # places that are followed to their minimum


def reaching_beyond(layout: Layout, vector, tracks, reach: float) -> list[int]:
    """Return the tracks in which the charge (C) exceeds what the rising curve reached."""
    def largest(track):
        return np.abs(_charge(layout, vector, track)).max()

    return [i for i, charge in enumerate(parallel(largest, tracks))
            if charge > BEYOND * reach]


def let_last_slip(layout: Layout, vector, tracks, beyond, reach: float
                  ) -> tuple[Layout, np.ndarray]:
    """
    Let the last element slip if recordings that reach beyond the rising curve ask for it.

    Parameters
    ----------
    layout, vector
        The device whose last element sticks, fitted to the other recordings.
    tracks : list of Track
        The recordings, prepared.
    beyond : list of int
        As `reaching_beyond` returns them.
    reach : float
        Largest charge of the rising curve (C).

    Returns
    -------
    layout, vector
        As they were if slipping explains nothing.

    """
    chosen = [tracks[i] for i in beyond]
    n, place = layout.n, LINEAR + layout.n + layout.breaks
    slips = Layout(layout.device, n, True, layout.polarised)
    top = max(np.abs(_charge(layout, vector, track)).max() for track in chosen)
    stiff, ratio = math.exp(vector[OPEN]), math.exp(vector[RATIO])
    total = math.exp(vector[LINEAR + n - 1])  # 1/C + k_n
    trials = []
    for share in SHARES:
        if ratio ** 2 / ((1.0 - share) * stiff) > 0.98 * total:
            continue  # 1/C alone
        for charge in np.linspace(reach, 1.02 * top, BREAKS):
            trial = np.insert(vector, place, math.log(charge))
            trial[SPLIT] = math.log(share / (1.0 - share))
            trials.append(trial)
    costs = parallel(lambda trial: cost_of(slips, trial, chosen), trials)
    free = [SPLIT, place]
    ends = [descend(slips, trials[i], chosen, free=free, steps=20)
            for i in np.argsort(costs)[:TRIED]]
    found = min(ends, key=lambda end: cost_of(slips, end, chosen))
    if cost_of(slips, found, chosen) > BETTER * cost_of(layout, vector, chosen):
        return layout, vector
    return slips, found


def _charge(layout, vector, track) -> np.ndarray:
    return simulate_channels(layout.device_for(vector, track.number), track.recording)['charge']
