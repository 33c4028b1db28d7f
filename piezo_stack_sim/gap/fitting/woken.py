# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What mends the form of an effect, free once the effect is believed.

A few numbers say most of what an effect does, and are found without help.
Others say the rest: they cost a simulation each, and from nowhere they would
fit anything.
"""

from __future__ import annotations

from collections.abc import Callable
import math

import numpy as np

from piezo_stack_sim.effects.registry import EFFECTS
from piezo_stack_sim.gap.cores import parallel
from piezo_stack_sim.gap.fitting.descent import sum_of_squares
from piezo_stack_sim.gap.fitting.fit import Fit, Fitter, free_parameters
from piezo_stack_sim.gap.fitting.starts import LADDER
from piezo_stack_sim.gap.measured.forward import followed, settling_time, simulate_set
from piezo_stack_sim.plant import Plant

STEPS, DESCENTS = 2, 8  # Gauss-Newton steps between two derivatives, and how often those are taken
ARRIVED = 0.98  # part of the cost above which a descent has arrived
WORTH = 0.1  # part of the cost by which it must fall for them
BEYOND = 2  # elements beyond the last that slipped that may have, too
MOVED, LEAST = 0.02, 0.1  # by which each is moved, to see if that changes what is left, squared
APART = 1.15  # ratio of the frequencies of two modes
SLIGHT = 0.1  # part of a reading by which a second mode is looked for
OTHERS = (1.2, -0.24, 0.6), (1.45, -0.29, 0.73)  # swings to set out from, too, of the first found


def has_late(name: str) -> bool:
    """Tell whether an effect has numbers that mend its form, and there is a way to them."""
    effect = EFFECTS[name]
    return (effect.swings or effect.answer is not None) and any(p.late for p in effect.parameters)


def woken(fitter: Fitter, fit: Fit) -> Fit:
    """
    Return a fit with what mends the form of its effects free.

    Parameters
    ----------
    fitter : Fitter
        Where it was fitted.
    fit : Fit
        Effects as they were found without.

    Returns
    -------
    Fit
        The same if nothing mends it.

    """
    def led(effects):
        return _descended(fitter, fitter.fit(
            _told(fitter, fit, effects), fit.phi, STEPS, anew=True))

    best = min(parallel(led, _places(fitter, fit)), key=lambda there: there.cost)
    return best if best.cost < (1.0 - WORTH) * fit.cost else fit


def _descended(fitter: Fitter, fit: Fit) -> Fit:
    """Return a fit led downhill by derivatives that are taken again and again."""
    for _ in range(DESCENTS):
        there = fitter.fit(fit.effects, fit.phi, STEPS, anew=True)
        arrived = there.cost > ARRIVED * fit.cost
        fit = min(fit, there, key=lambda each: each.cost)
        if arrived:
            break
    return fit


def _told(fitter: Fitter, fit: Fit, effects: dict[str, dict[str, float]]
          ) -> dict[str, dict[str, float]]:
    """Return effects with those late numbers neutral that the recordings do not tell of."""
    late = [free for name, values in effects.items() for free in free_parameters(name, values)
            if free.parameter.late]
    before = fitter.residual_of(effects, fit.phi, fit)

    def is_told(free):
        name, parameter = free.effect, free.parameter
        value = effects[name][parameter.name]
        step = MOVED * (value if parameter.scale == 'log' else 1.0)
        step = step if value + step <= parameter.upper else -step
        there = {**effects, name: {**effects[name], parameter.name: value + step}}
        return sum_of_squares(fitter.lens(
            fitter.residual_of(there, fit.phi, fit) - before)) > LEAST

    effects = {name: dict(values) for name, values in effects.items()}
    for free, told in zip(late, parallel(is_told, late)):
        if not told:
            effects[free.effect][free.parameter.name] = free.parameter.neutral
    return effects


def _places(fitter: Fitter, fit: Fit) -> list[dict[str, dict[str, float]]]:
    """Return effects of a fit with late numbers that were neutral where they set out."""
    places = [dict(fit.effects)]
    for name, values in fit.effects.items():
        if not has_late(name) or any(f.parameter.late for f in free_parameters(name, values)):
            continue
        follows = EFFECTS[name].answer
        if follows is not None:
            places = [{**fit.effects, name: {**values, **_second_mode(
                fitter, fit, name, follows)}}]
            continue
        swings = [p.name for p in EFFECTS[name].parameters if not p.late]
        found = values[swings[0]]
        others = [{**values, **dict(zip(swings, (found * np.array(parts)).tolist()))}
                  for parts in OTHERS]
        # The strains say all: the swings would only be in the way of who reads them.
        places = [{**fit.effects, name: {**values, **dict.fromkeys(swings, 0.0), **_as_left(
            fitter, fit, {**fit.effects, name: swung}, name)}} for swung in (values, *others)]
    return places


def _second_mode(fitter: Fitter, fit: Fit, name: str, follows: Callable) -> dict[str, float]:
    """
    Return where a second mode would explain most of what is left.

    It follows the same motion, so that no new simulation is needed to look at it.
    """
    others = {other: values for other, values in fit.effects.items() if other != name}
    moves = simulate_set(fitter.device_with(others, fit.phi),
                         [track.recording for track in fitter.evidence.tracks])
    settles = settling_time(fitter.device)
    first, ratio = (fit.effects[name][number] for number in ('frequency', 'damping_ratio'))

    def look(frequency):
        added = followed(fitter.evidence, moves, follows(SLIGHT, frequency, ratio), settles)
        gain, (factor,) = fitter.linear_gain(
            added[:, None], fit, lambda factors: np.clip(factors, -1.0 / SLIGHT, 1.0 / SLIGHT))
        return gain, frequency, factor

    _, frequency, factor = max(parallel(look, [
        each for each in LADDER if abs(math.log(each / first)) > math.log(APART)]))
    return {'second_participation': SLIGHT * float(factor), 'second_frequency': frequency,
            'second_damping_ratio': ratio}


def _as_left(fitter: Fitter, fit: Fit, effects: dict[str, dict[str, float]], name: str
             ) -> dict[str, float]:
    """Return how strained swings left the elements, by name, and the next few."""
    plant = Plant(fitter.device_with(effects, fit.phi))
    slipped = np.flatnonzero(plant.state.blocks)
    last = slipped.max() + 1 if slipped.size else 0
    late = [parameter for parameter in EFFECTS[name].parameters if parameter.late]
    return {parameter.name: float(np.clip(value, parameter.lower, parameter.upper))
            for parameter, value in zip(late, plant.strains[:last + BEYOND])}
