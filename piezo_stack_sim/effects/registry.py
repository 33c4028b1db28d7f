"""All effects, in the order in which a signal meets them."""

from __future__ import annotations

from collections.abc import Mapping
import difflib
import importlib

from piezo_stack_sim.effects.base import Effect
from piezo_stack_sim.errors import InputError

# One line an effect; the order is that of the block picture, and effects are
# applied in it.
_IDS = (
    'amplifier_gain',
    'creep',
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
