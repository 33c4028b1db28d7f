# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""All effects, in the order in which a signal meets them."""

from __future__ import annotations

from collections.abc import Mapping
import difflib
import importlib

from piezo_stack_sim.effects.base import Effect
from piezo_stack_sim.errors import InputError

# One line an effect, in the order in which they are applied.
_IDS = (
    # drive
    'command_delay',
    'amplifier_bandwidth',
    'amplifier_current_limit',
    'amplifier_gain',
    'amplifier_saturation',
    # electrical
    'creep',
    'rate_dependent_hysteresis',
    'asymmetric_hysteresis',
    'leakage',
    'initial_polarisation',
    # transducer
    'transducer_nonlinearity',
    'transducer_ratio',
    # mechanical
    'added_mass',
    'series_compliance',
    'parallel_stiffness',
    'stiffness_hardening',
    'friction',
    'mechanical_resonance',
    'contact',
    'mount_creep',
    # environment
    'thermal_drift',
    'periodic_disturbance',
    # sensor
    'sensor_lag',
    'sensor_delay',
    'sensor_gain',
    'sensor_nonlinearity',
    'sensor_drift',
)

EFFECTS: dict[str, Effect] = {
    name: importlib.import_module(f'piezo_stack_sim.effects.{name}').EFFECT for name in _IDS}


def find(name: str) -> Effect:
    """
    Return the effect with this id.

    Raises
    ------
    InputError
        If there is none; names the nearest id.

    """
    if name not in EFFECTS:
        near = difflib.get_close_matches(name, EFFECTS, 1)
        hint = f'did you mean {near[0]!r}?' if near else 'piezo_stack effects lists them'
        raise InputError(f'effect {name!r} is unknown; {hint}')
    return EFFECTS[name]


def apply_effects(model, effects: Mapping[str, Mapping[str, float]]) -> None:
    """Add every effect that is not neutral to a model, in the order of the registry."""
    for name in effects:
        find(name)
    for name, effect in EFFECTS.items():
        given = effects.get(name)
        if given is not None and not effect.is_neutral(given):
            effect.apply(model, **effect.values(given))
