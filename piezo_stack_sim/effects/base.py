# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""What an effect is: a name, a block, parameters, and its piece of the dynamics."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from piezo_stack_sim.errors import InputError

BLOCKS = ('drive', 'electrical', 'transducer', 'mechanical', 'environment', 'sensor')


@dataclass(frozen=True)
class Parameter:
    """
    One number of an effect.

    ``neutral`` is the value at which the effect is absent, ``typical`` one that
    a catalogue-class set-up shows; ``scale`` tells an optimiser whether to walk
    the number in proportion (``log``, never through zero) or in equal steps
    (``linear``).  ``magnitude`` marks the parameter that says how strong the
    effect is; the others shape it and have a sensible default of their own.
    ``tries`` are values from which an optimiser should set out where those that
    follow from the rest would not do: where the effect is far from linear.
    ``late`` marks what an optimiser leaves alone until the effect is believed: it mends the form.
    """

    name: str
    unit: str
    neutral: float
    lower: float
    upper: float
    typical: float
    description: str
    scale: str = 'linear'
    magnitude: bool = True
    default: float | None = None
    runtime: bool = True
    tries: tuple[float, ...] = ()
    late: bool = False

    @property
    def start(self) -> float:
        """Return the value of a parameter that a file does not give."""
        return self.neutral if self.default is None else self.default


@dataclass(frozen=True)
class Effect:
    """
    One physical effect that the ideal stack lacks.

    ``apply(model, **values)`` adds the effect to a
    :class:`piezo_stack_sim.plant.assembly.Model`, with every parameter by name.
    ``channels`` are the measured channels it moves under voltage drive,
    ``shown_in`` the test of :mod:`piezo_stack_sim.signature.experiment` for its
    picture, if not the one in which it shows most.  ``each_time`` names a
    parameter that is new in every recording, since nothing synchronises it.
    ``swings`` tells an optimiser that its parameters are swings that were made
    before, the first the largest: no derivative with respect to them leads far.
    ``becomes`` names the effect that it is where its strength is at its other end:
    a stop without a gap is a spring.  ``before_its_time`` names its time constant and the effect
    that it cannot be told from before that has passed.  ``form_like`` names effects that
    resemble what its form leaves out.  ``told_by`` names, by another effect, what that tells in
    its place where both are: a driver has one resistance.  Of an effect that follows the
    displacement and never acts on it ``answer(**values)``, of what is not late, returns the
    transfer function, numerator and denominator in falling powers of s, from the displacement to
    what it adds to the reading.
    """

    id: str  # noqa: A003
    block: str
    summary: str
    parameters: tuple[Parameter, ...]
    apply: Callable
    channels: tuple[str, ...] = ('displacement',)
    shown_in: str = ''
    each_time: str = ''
    swings: bool = False
    becomes: str = ''
    before_its_time: tuple[str, str] | None = None
    form_like: tuple[str, ...] = ()
    told_by: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    answer: Callable | None = None

    def values(self, given: Mapping[str, float]) -> dict[str, float]:
        """
        Return every parameter: the given ones, defaults for the rest.

        Raises
        ------
        InputError
            If a name is none of its parameters.

        """
        unknown = given.keys() - {parameter.name for parameter in self.parameters}
        if unknown:
            raise InputError(f'effects.{self.id}.{min(unknown)}: expected one of '
                             f'{", ".join(parameter.name for parameter in self.parameters)}')
        return {parameter.name: float(given.get(parameter.name, parameter.start))
                for parameter in self.parameters}

    def is_neutral(self, given: Mapping[str, float]) -> bool:
        """Tell whether these values leave the ideal stack as it is."""
        # Asked of every effect each time a plant is made.
        for parameter in self.parameters:
            if parameter.magnitude:
                value = given.get(parameter.name)
                if (parameter.start if value is None else float(value)) != parameter.neutral:
                    return False
        return True

    @property
    def is_time(self) -> bool:
        """Tell whether one time says how strong it is, and nothing else does: like a delay."""
        return [p.unit for p in self.parameters if p.magnitude] == ['s']

    @property
    def is_late(self) -> bool:
        """Tell whether a time is what says how strong it is: a lag or a delay."""
        return any(p.magnitude and p.unit == 's' for p in self.parameters)

    def typical(self) -> dict[str, float]:
        """Return the values of a catalogue-class set-up."""
        return {parameter.name: parameter.typical for parameter in self.parameters}
