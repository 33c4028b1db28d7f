# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""The documentation page of an effect, from what its file says."""

from __future__ import annotations

from collections.abc import Iterable
import inspect
from itertools import groupby
import math
import sys

from piezo_stack_sim.effects.base import Effect, Parameter

BY = 'piezo_stack effects --all --out doc/effects'


def explanation(effect: Effect) -> str:
    """Return what the file of an effect says about it: equations, look-alikes, source."""
    return inspect.cleandoc(sys.modules[effect.apply.__module__].__doc__ or effect.summary)


def number(value: float) -> str:
    """Return a number for people: short, and infinity as a parameter file writes it."""
    if math.isinf(value):
        return '.inf' if value > 0.0 else '-.inf'
    text = f'{value:.4g}'
    return text if 'e' not in text else text.replace('e-0', 'e-').replace('e+0', 'e+')


def rows(effect: Effect) -> Iterable[tuple[str, ...]]:
    """
    Yield a row for each parameter: name, unit, neutral, bounds, typical, run time, meaning.

    Those that differ by a number in their name alone share one.
    """
    for (_, *rest), alike in groupby(map(_row, effect.parameters), key=_unnumbered):
        names = [name for name, *_ in alike]
        yield (names[0] if len(names) == 1 else f'{names[0]} … {names[-1]}', *rest)


def _row(parameter: Parameter) -> tuple[str, ...]:
    start = (f'{number(parameter.neutral)}' if parameter.magnitude
             else f'default {number(parameter.start)}')
    return (parameter.name, parameter.unit, start,
            f'{number(parameter.lower)} … {number(parameter.upper)}',
            number(parameter.typical), 'yes' if parameter.runtime else 'read-only',
            parameter.description)


def _unnumbered(row: tuple[str, ...]) -> tuple[str, ...]:
    return (row[0].rstrip('0123456789'), *row[1:])


def setting(effect: Effect) -> str:
    """Return the typical effect as it stands in a parameter file."""
    late = {parameter.name for parameter in effect.parameters if parameter.late}
    inside = ', '.join(f'{name}: {_yaml(value)}' for name, value in effect.typical().items()
                       if name not in late)
    return f'effects:\n  {effect.id}: {{{inside}}}'


def page(effect: Effect) -> str:
    """Return the page as Markdown."""
    title, _, text = explanation(effect).partition('\n')
    text = text.strip('\n').replace('``', '`')
    for word in ('Look-alikes:', 'Source:'):
        text = text.replace(f'\n{word}', f'\n\n**{word}**').replace('\n\n\n', '\n\n')
    lines = [
        f'# {effect.id}', '', f'*{effect.block}* · {effect.summary}', '', title, '', text, '',
        '| parameter | unit | neutral | bounds | typical | while running | |',
        '|---|---|---|---|---|---|---|',
        *('| ' + ' | '.join((f'`{row[0]}`', *row[1:])) + ' |' for row in rows(effect)), '',
        f'It moves: {", ".join(effect.channels)}.', '', '```yaml', setting(effect), '```', '',
        f'![The same tests with and without {effect.id}]({effect.id}.png)', '',
        f'<!-- Written by `{BY}`. -->', '']
    return '\n'.join(lines)


def index(effects: Iterable[Effect]) -> str:
    """Return the page that lists all effects."""
    lines = [
        '# Effects', '',
        'What a real set-up adds to the ideal stack, in the order in which a signal meets it. '
        'An effect that', 'is not named in the parameter file is neutral. Each page has the '
        'equations, the parameters and a', 'picture of the same tests with and without it; '
        '[adding one](adding.md) takes a small file.', '',
        '| block | effect | |', '|---|---|---|',
        *(f'| {effect.block} | [{effect.id}]({effect.id}.md) | {effect.summary} |'
          for effect in effects), '', f'<!-- Written by `{BY}`. -->', '']
    return '\n'.join(lines)


def _yaml(value: float) -> str:
    text = number(value)
    return text if '.' in text or 'e' not in text else text.replace('e', '.0e')
