# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Which effects these recordings can see, and which they cannot tell apart.

Asked before anything is believed: every effect moves the simulated channels in
some direction; what is left of it after the nominal parameters have done their
best to imitate it must stand above the noise, and must not point where another
effect points.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
import itertools

import numpy as np

from piezo_stack_sim.gap.cores import parallel
from piezo_stack_sim.gap.fitting.candidates import Search
from piezo_stack_sim.gap.fitting.fit import Fitter

SEEN = 5.0  # length of a direction, in standard deviations, that counts as seen
LINEAR = 1e-3  # part of a direction that a linear look at re-tuning may wrongly leave of it
KIN = 0.9  # part of a direction that lies among those of another effect, its kin
FINE, SPARSE = 50, 4  # of so many places of an effect one in so many tells what it can do
ALIKE = 0.985  # cosine between directions from which two effects count as one


@dataclass(frozen=True)
class Alike:
    """
    What recordings cannot see or tell apart.

    ``classes`` of effects that look alike, ``unseen`` ones, and ``kin``: pairs that
    resemble each other, so that what the form of one misses the other may fill in.
    ``single`` tells that one channel was measured: no other checks what the form tells.
    """

    classes: list[list[str]]
    unseen: list[str]
    kin: set[frozenset[str]]
    single: bool = False

    @property
    def resembling(self) -> set[frozenset[str]]:
        """Return the effects that look alike or resemble each other, by twos."""
        return self.kin.union(*(map(frozenset, itertools.combinations(group, 2))
                                for group in self.classes))

    @property
    def groups(self) -> list[Collection[str]]:
        """Return the groups in which hardly anything but the form tells effects apart."""
        return [*self.classes, *(self.kin if self.single else ())]


def isolability(fitter: Fitter, search: Search) -> Alike:
    """
    Return which effects a set of recordings cannot see or tell apart.

    Directions are those of a typical strength of each effect, cleared of what
    re-tuning the nominal parameters can imitate.
    """
    single = len(fitter.evidence.channels) == 1
    fitter.view(search.nominal)  # once, before all cores ask for it

    def looked(probes):
        probes = [probe for probe in probes if not probe.look.dense]
        if len(probes) >= FINE:  # resonances as dense as they are sharp could do anything
            probes = sorted(probes, key=lambda probe: tuple(probe.look.shape.items()))[::SPARSE]
        whole = [direction for probe in probes if probe.direction is not None
                 for direction in probe.direction.T]
        clear = [direction for probe in probes if probe.direction is not None
                 for direction in fitter.cleared(probe.direction, search.nominal).T]
        least = max([SEEN, *(LINEAR * np.linalg.norm(each) for each in whole)])
        longest = max(clear, key=np.linalg.norm, default=None)
        if longest is None or np.linalg.norm(longest) < least:
            return None
        space = np.column_stack([each / np.linalg.norm(each) for each in clear
                                 if np.linalg.norm(each) > SEEN]).astype(np.float32)
        return ((longest / np.linalg.norm(longest)).astype(np.float32), space,
                np.linalg.svd(space, full_matrices=False)[0])

    found = dict(zip(search.probes, parallel(looked, search.probes.values())))
    names = [name for name in found if found[name] is not None]
    unseen = [name for name in found if found[name] is None]
    if not names:
        return Alike([], unseen, set(), single)
    directions, spaces, bases = zip(*(found[name] for name in names))
    cosine = np.abs(np.array(directions) @ np.array(directions).T)
    classes, left = [], set(range(len(names)))
    while left:
        group, grow = set(), [min(left)]
        while grow:
            i = grow.pop()
            if i in group:
                continue
            group.add(i)
            grow += [j for j in left if cosine[i, j] > ALIKE and j not in group]
        left -= group
        if len(group) > 1:
            classes.append([names[i] for i in sorted(group)])
    kin = set()
    for i, a in enumerate(names):
        for j in range(i):
            # How much of what one can do lies in what the other can do.
            shared = max(np.linalg.norm(bases[i].T @ spaces[j], axis=0).max(),
                         np.linalg.norm(bases[j].T @ spaces[i], axis=0).max())
            if shared > KIN:
                kin.add(frozenset((a, names[j])))
    return Alike(classes, unseen, kin, single)
