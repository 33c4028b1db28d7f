# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a hidden effect is: a block, a functional form, random magnitudes, and a changed device."""

from dataclasses import dataclass, field

import numpy as np

BLOCKS = ('drive', 'electrical', 'transducer', 'mechanical', 'environment', 'sensor')


@dataclass(frozen=True)
class Hidden:
    """
    One effect in the form in which the challenge hides it.

    Attributes
    ----------
    key, block : str
        Id and block as in the library, where the library has it.
    form : str
        The functional form, in words.
    channels : tuple of str
        Channels that it can alter.
    apply : callable
        ``apply(unit, **parameters) -> Unit``.
    ranges : dict
        Parameter name to a function ``(random, context) -> value``.
    recordings, needs : tuple of str
        Recordings and measured channels without which it cannot be seen.
    lookalikes : tuple of str
        Library effects that explain it as well, for effects that the library does not have.
    without : dict
        Parameters with which only what goes along with it is left, and nothing of what it is named
        for: the resistance of a driver whose current has no limit.

    """

    key: str
    block: str
    form: str
    channels: tuple
    apply: object
    ranges: dict
    recordings: tuple = ()
    needs: tuple = ()
    lookalikes: tuple = ()
    without: dict = field(default_factory=dict)

    def draw(self, random, context):
        """Return random parameters, as plain numbers."""
        return {name: choose(random, context) for name, choose in self.ranges.items()}


@dataclass(frozen=True)
class Context:
    """What magnitudes scale with: highest commanded voltage (V) and stroke there (m)."""

    top: float
    stroke: float


def register(table, block, form, channels, *, recordings=(), needs=(), lookalikes=(), without=None,
             **ranges):
    """Return a decorator that enters a function of a device as hidden effect of its name."""
    def enter(function):
        name = function.__name__
        table[name] = Hidden(name, block, form, tuple(channels.split()), function, ranges,
                             tuple(recordings), tuple(needs), tuple(lookalikes), without or {})
        return function
    return enter


@dataclass(frozen=True)
class Range:
    """
    Where a parameter is drawn from.

    Attributes
    ----------
    low, high : float
        Its ends.
    logarithmic, signed : bool
        Uniform in the logarithm; with a random sign.
    of : str
        The `Context` that the ends are shares of, if any.

    """

    low: float
    high: float
    logarithmic: bool = False
    signed: bool = False
    of: str = ''

    def __call__(self, random, context):
        """Return a value."""
        if self.logarithmic:
            value = float(np.exp(random.uniform(np.log(self.low), np.log(self.high))))
        else:
            value = float(random.uniform(self.low, self.high))
        if self.signed:
            value *= float(random.choice([-1.0, 1.0]))
        return value * getattr(context, self.of) if self.of else value


def log(low, high):
    """Return a log-uniform choice."""
    return Range(low, high, logarithmic=True)


def either_sign(low, high):
    """Return a log-uniform choice with a random sign."""
    return Range(low, high, logarithmic=True, signed=True)


def uniform(low, high):
    """Return a uniform choice."""
    return Range(low, high)


def of_top(low, high):
    """Return a uniform share of the highest commanded voltage."""
    return Range(low, high, of='top')


def of_stroke(low, high):
    """Return a uniform share of the stroke at the highest commanded voltage."""
    return Range(low, high, of='stroke')


def whole(high):
    """Return a whole number below `high`, as a seed."""
    return lambda random, context: int(random.integers(high))
