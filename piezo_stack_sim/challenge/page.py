# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""The score for readers: a Markdown page and the confusion matrix as a picture."""

from pathlib import Path
import re

import jinja2
import numpy as np

from piezo_stack_sim import plotting
from piezo_stack_sim.atomic import write_text
from piezo_stack_sim.challenge.judge import BLOCK
from piezo_stack_sim.challenge.known import KNOWN
from piezo_stack_sim.challenge.score import BRIEF, QUESTIONS

OTHER_ANSWERS = ('NO_GAP', 'UNKNOWN', 'NOT_IDENTIFIABLE')

TEMPLATE = """\
# Score of the blind benchmark

{{ score.sets }} devices: {% for kind, words in kinds.items() if kind in score.kinds -%}
{{ score.kinds[kind] }} {{ words }}{{ ', ' if not loop.last }}{% endfor %}.
{% for batch in score.batches -%}
{{ 'Labels' if loop.first else 'labels' }} `{{ batch.labels_sha256[:16] }}`, \
code `{{ batch.code[:16] }}`\
{{ ' (%d)' | format(batch.sets) if score.batches | length > 1 else '' }}\
{{ '. ' if loop.last else '; ' }}
{%- endfor %}Rates with 95 % Wilson
intervals. Made by `piezo_stack challenge score`.

| question | rate | interval | sets | bar |
|---|---|---|---|---|
{% for name, (text, bar) in questions.items() -%}
{% set r = score.rates[name] -%}
| {{ text }} | {{ r | percent }} | {{ r | interval }} | {{ r.of }} | \
{{ ('≤ ' if name == 'false_alarm' else '≥ ') ~ '%.0f %%' | format(100 * bar) if bar else '' }} |
{% endfor %}
| figure | value |
|---|---|
| effects left open, median (displacement alone) | {{ score.ambiguity.all.median | number }} \
({{ score.ambiguity.displacement_alone.median | number }}) |
{% for who in ('first_cause', 'verdict') -%}
{% set found = score.calibration[who] -%}
| expected calibration error of the {{ who | replace('_', ' ') }} \
(without any error: mean, 95 %), Brier score | \
{{ found.ece | number }} ({{ found.ece_by_chance.mean | number }}, \
{{ found.ece_by_chance.p95 | number }}), {{ found.brier | number }} |
{% endfor -%}
| true S, median (one effect) | {{ score.shrinkage.true_one_effect.median | number }} |
| claimed S less true S, median and median size | \
{{ score.shrinkage.claimed_minus_true.median | number }}, \
{{ score.shrinkage.absolute_difference.median | number }} |
| intervals of S that hold the true S | {{ score.shrinkage.interval_coverage | percent }} \
{{ score.shrinkage.interval_coverage | interval }} |
| seconds a set, median and longest | {{ score.seconds.median | number }}, \
{{ score.seconds.maximum | number }} |
{%- if score.failures %}
| sets that made the diagnosis fail | {{ score.failures | length }} |
{%- endif %}

## Against simpler answers

| | {% for name in brief %}{{ heads[name] }} | {% endfor %}false alarm | absent: UNKNOWN |
|---|{% for name in brief %}---|{% endfor %}---|---|
| **diagnosis** | {% for name in brief %}{{ score.rates[name] | percent }} | {% endfor -%}
{{ score.rates.false_alarm | percent }} | {{ score.rates.unknown | percent }} |
{% for name, rates in simpler.items() -%}
| {{ baselines[name] }} | {% for key in brief %}{{ rates[key] | percent }} | {% endfor -%}
{{ rates.false_alarm | percent }} | {{ rates.unknown | percent }} |
{% endfor %}
{%- if ablations %}

## Without a part of the method

| | {% for name in brief %}{{ heads[name] }} | {% endfor %}false alarm | absent: UNKNOWN \
| absent: block |
|---|{% for name in brief %}---|{% endfor %}---|---|---|
| **all parts** | {% for name in brief %}{{ score.rates[name] | percent }} | {% endfor -%}
{{ score.rates.false_alarm | percent }} | {{ score.rates.unknown | percent }} | \
{{ score.rates.unknown_block | percent }} |
{% for name, rates in ablations.items() -%}
| {{ without[name] }} | {% for key in brief %}{{ rates[key] | percent }} | {% endfor -%}
{{ rates.false_alarm | percent }} | {{ rates.unknown | percent }} | \
{{ rates.unknown_block | percent }} |
{% endfor %}
{%- endif %}
{% for title, table in tables %}
## By {{ title }}

| | sets | {% for name in brief %}{{ heads[name] }} | {% endfor %}UNKNOWN | how many |
|---|---|{% for name in brief %}---|{% endfor %}---|---|
{% for name, group in table.items() -%}
| {{ name }} | {{ group.sets }} | {% for key in brief %}{{ group[key] | percent }} | {% endfor -%}
{{ group.unknown | percent }} | {{ group.set_size | number }} |
{% endfor %}{% endfor %}
Noticed, named first, block, left open, right: shares of the sets. How many: the median number of
effects left open.
{%- if score.pairs_by_balance %}

## Two effects
{% for title, table in pairs %}
| {{ title }} | sets | both named | interval | at least one |
|---|---|---|---|---|
{% for name, group in table.items() -%}
| {{ name }} | {{ group.sets }} | {{ group.both | percent }} | {{ group.both | interval }} | \
{{ group.either | percent }} |
{% endfor %}{% endfor %}
What the form of the stronger misses is some per cent of it: a second effect below that is seen
only where and when the first does not act.
{%- endif %}

## Confusion

![What was hidden, and what was answered](confusion.png)

Rows: what was hidden, alone. Columns: what was answered first. An ambiguous answer counts under
the effect that it ranks first.
"""

KINDS = {'none': 'with nothing hidden', 'one': 'with one effect', 'two': 'with two',
         'absent': 'with one that the library lacks'}
HEADS = {'detected': 'noticed', 'effect': 'named first', 'block': 'block',
         'covered': 'left open', 'right': 'right'}
BASELINES = {'commonest': 'always the commonest effect', 'lowest_error': 'lowest training error',
             'bic': 'BIC alone', 'whiteness': 'whiteness test alone'}
WITHOUT = {'no_cutting': 'the block taken from the best effect, not from the cuts',
           'no_calibration': 'nominal parameters held',
           'no_correlation': 'rows counted as independent',
           'no_withheld': 'judged on the rows that were fitted'}


def percent(rate):
    """Return a Wilson rate as per cent, a dash when the question never arose."""
    return '–' if rate['rate'] is None else f'{100 * rate["rate"]:.0f} %'


def interval(rate):
    """Return the interval of a Wilson rate."""
    return '–' if rate['rate'] is None else f'{100 * rate["low"]:.0f}–{100 * rate["high"]:.0f} %'


def number(value):
    """Return a number to three digits, a dash for none."""
    return '–' if value is None else f'{value:.3g}'.replace('-', '−')


def page(score):
    """Return the Markdown page of a score."""
    environment = jinja2.Environment(undefined=jinja2.StrictUndefined, keep_trailing_newline=True)
    environment.filters.update(percent=percent, interval=interval, number=number)
    effects = {name + ('' if name in KNOWN else ' (absent)'): score['by_effect'][name]
               for name in BLOCK if name in score['by_effect']}
    tables = [('magnitude over noise, after calibration', score['by_magnitude']),
              ('channels', score['by_channels']),
              ('how far the unit is from its file', score['by_unit']),
              ('what was hidden', score['by_kind']),
              ('effect', effects)]
    pairs = [('the weaker against the stronger', score['pairs_by_balance']),
             ('the weaker over the noise', score['pairs_by_magnitude']),
             ('channels', score['pairs_by_channels'])]
    text = environment.from_string(TEMPLATE).render(
        score=score, pairs=pairs, questions=QUESTIONS, brief=BRIEF, kinds=KINDS, heads=HEADS,
        baselines=BASELINES, without=WITHOUT, tables=tables,
        simpler={k: v for k, v in score['baselines'].items() if k in BASELINES},
        ablations={k: v for k, v in score['baselines'].items() if k in WITHOUT})
    return re.sub(r'\n{3,}', '\n\n', text)


def draw_confusion(score):
    """Return the confusion matrix as a figure."""
    columns = [*sorted(KNOWN, key=lambda name: list(KNOWN).index(name)), *OTHER_ANSWERS]
    counts = score['confusion']
    strange = sorted({answered for row in counts.values() for answered in row} - set(columns))
    columns += strange
    order = ['nothing', *BLOCK]
    rows = sorted(counts, key=order.index)
    matrix = np.array([[counts[row].get(column, 0) for column in columns] for row in rows])
    share = matrix / np.maximum(matrix.sum(axis=1, keepdims=True), 1)
    with plotting.style():
        figure, axes = plotting.new_figure(width=10.0, height=2.0 + 0.2 * len(rows))
        axes.imshow(share, cmap='Greys', vmin=0.0, vmax=1.0, aspect='auto')
        for i, line in enumerate(matrix):
            for j, count in enumerate(line):
                if count:
                    axes.text(j, i, str(count), ha='center', va='center', fontsize=7,
                              color='white' if share[i, j] > 0.5 else 'black')
        axes.set_xticks(range(len(columns)), [name.replace('_', ' ') for name in columns],
                        rotation=90)
        axes.set_yticks(range(len(rows)), [
            name.replace('_', ' ') + ('' if name in KNOWN or name == 'nothing' else ' (absent)')
            for name in rows])
        axes.set_xlabel('Answered first')
        axes.set_ylabel('Hidden')
        axes.grid(False)
    return figure


def write(score, out):
    """Write ``score.md`` and ``confusion.png`` into a folder."""
    out = Path(out)
    write_text(out / 'score.md', page(score))
    with plotting.style():
        plotting.save(draw_confusion(score), out / 'confusion', ('png',))
