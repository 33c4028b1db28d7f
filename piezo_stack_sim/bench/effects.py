# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""What each effect costs: the five test programmes with it and without, turn by turn."""

from __future__ import annotations

import time as clock

from piezo_stack_sim.effects.registry import EFFECTS
from piezo_stack_sim.plant import Device, simulate
from piezo_stack_sim.progress import track
from piezo_stack_sim.recording.programmes import PROGRAMMES

TURNS = 9  # the fastest counts
TURNS_NEUTRAL = 60  # for a difference of a few per cent


def measure(device: Device | None = None) -> dict:
    """
    Measure what effects cost.

    Parameters
    ----------
    device : Device, optional
        The AE0505D16 of the paper if not given; its own effects are left out.

    Returns
    -------
    dict
        ``rows`` of all programmes together, ``absent`` (s of processor time), ``neutral`` with
        every effect listed at its neutral value, ``effects`` by id with typical values, ``all``
        of them on; each a dict of ``time`` (s) and ``ratio`` to the device without effects,
        measured in turn with it.

    """
    plain = (device or Device.nominal()).replace(effects={})
    neutral = {name: {each.name: each.neutral for each in effect.parameters}
               for name, effect in EFFECTS.items()}
    typical = {name: effect.typical() for name, effect in EFFECTS.items()}
    recordings = [make() for make in PROGRAMMES.values()]
    cases = {'neutral': neutral, **{name: {name: values} for name, values in typical.items()},
             'all': typical}
    found, without = {}, []
    for name, effects in track(list(cases.items()), 'Measuring effects'):
        turns = TURNS_NEUTRAL if name == 'neutral' else TURNS
        absent, present = _in_turn(plain, plain.with_effects(effects), recordings, turns)
        found[name] = {'time': present, 'ratio': present / absent}
        without.append(absent)
    return {'rows': sum(each.time.size for each in recordings), 'absent': min(without),
            'neutral': found.pop('neutral'), 'all': found.pop('all'), 'effects': found}


def _in_turn(plain, device, recordings, turns) -> tuple[float, float]:
    """Return the least processor time (s) of either."""
    taken: tuple[list[float], list[float]] = ([], [])
    for turn in range(turns + 1):
        for times, each in zip(taken, (plain, device)):
            began = clock.process_time()
            for recording in recordings:
                simulate(each, recording.time, recording.command, recording.external_force,
                         recording.drive)
            if turn:  # the first warms up
                times.append(clock.process_time() - began)
    return min(taken[0]), min(taken[1])
