# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""The page that shows the figures beside what the paper says, made from figures.json."""

from __future__ import annotations

from piezo_stack_sim.gap.quantities import quantity, significant

HEAD = """# The paper's figures

Simulated counterparts of the figures of M. Goldfarb and N. Celanovic, *Modeling Piezoelectric
Stack Actuators for Control of Micromanipulation*, IEEE Control Systems Magazine, June 1997, for
{model}. This page and its pictures are made by

    piezo_stack figures --out {folder} --page {page}

Each figure stands beside what the paper says of it and the numbers that prove it, computed in the
same run and kept in `figures.json`. Figures 1, 5, 6 and 9 of the paper are drawings without data.
"""


def shown(value: float, unit: str, digits: int) -> str:
    """Return a number of `figures.json` as the page writes it."""
    if unit == '%':
        return f'{significant(100.0 * value, digits)} %'
    if unit == 'deg':
        return f'{significant(value, digits)}°'
    if unit == 'N/m':
        return f'{significant(1e-6 * value, digits)} N/µm'
    return quantity(value, unit, digits)


def page(result: dict, pictures: str, name: str) -> str:
    """
    Return the page as Markdown.

    Parameters
    ----------
    result : dict
        The contents of ``figures.json``.
    pictures : str
        Path from the page to the folder of the pictures.
    name : str
        Path of the page, as the command was given it.

    """
    parts = [HEAD.format(model=result['model'], folder=result['folder'], page=name)]
    for figure in result['figures']:
        label = figure['name'].removeprefix('figure_').lstrip('0').replace('_0', ' and ')
        lines = [f'## Figure{"s" if " and " in label else ""} {label}: {figure["title"]}', '',
                 f'**The paper:** {figure["says"]}', '']
        if figure['note']:
            lines += [f'**Here:** {figure["note"]}', '']
        lines += [f'![Figure {label}]({pictures}/{figure["name"]}.png)', '',
                  '| number | value | what it is |', '|---|---|---|']
        lines += [f'| {row["name"]} | {row["shown"]} | {row["proves"]} |'
                  for row in figure['numbers']]
        parts.append('\n'.join(lines) + '\n')
    return '\n'.join(parts)
