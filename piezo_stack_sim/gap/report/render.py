# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
From the diagnosis to one HTML file that needs nothing else.

What a file, a name or a user contributed reaches the page in two ways only: through templates that
escape everything, and as JSON inside a script element that is data, not code. A content policy in
the page lets the browser run the one script whose hash it names and load nothing from anywhere.

"""

from base64 import b64encode
from hashlib import sha256
from importlib.resources import files
import re

from piezo_stack_sim.atomic import write_text
from piezo_stack_sim.gap import quantities
from piezo_stack_sim.gap.report.sections import HEADLINE, SECTIONS
from piezo_stack_sim.plotting import LINES

PACKAGE = 'piezo_stack_sim.gap.report'
SCRIPTS = ('axes.js', 'plot.js', 'report.js')


def render_report(diagnosis):
    """
    Return the report as HTML.

    Parameters
    ----------
    diagnosis : dict
        Of the shape that :func:`piezo_stack_sim.gap.schema.validate` accepts.

    Returns
    -------
    str
        A page with its style, scripts and data inside; nothing is loaded when it is opened.

    """
    script = '\n'.join(_static(name) for name in SCRIPTS)
    sections = [(section, view) for section in SECTIONS
                if (view := section.view(diagnosis)) is not None]
    return _templates().get_template('page.html').render(
        diagnosis=diagnosis,
        headline=HEADLINE(diagnosis),
        sections=sections,
        style=_static('report.css'),
        colours=dict(zip(('measured', 'before', 'after'), (colour for colour, _ in LINES))),
        script=script,
        script_hash=b64encode(sha256(script.encode()).digest()).decode(),
        data=_data(diagnosis),
    )


def write_report(diagnosis, path):
    """
    Write the report; a reader finds the old file or the whole new one.

    Raises
    ------
    InputError
        When the file cannot be written.

    """
    write_text(path, render_report(diagnosis))


def _data(diagnosis):
    """Return what the plots draw."""
    traces = diagnosis.get('traces')
    if not traces:
        return None
    channels = quantities.in_order({channel for recording in traces['recordings']
                                    for channel in recording['views']['overview']['channels']})
    return {
        'recordings': traces['recordings'],
        'channels': channels,
        'units': {channel: quantities.unit_of(channel, diagnosis) for channel in channels},
        'noise': {channel: row['noise_rms'] for channel, row in diagnosis['gap'].items()},
    }


def _nobreak(text):
    """Return the text with numbers and their units tied together."""
    unit = r'(?:%|times|×|[fpnµmkMG]?(?:m|C|V|N|s|Hz|g))(?!\w)'
    return re.sub(rf'(?<=\d) (?={unit})', '\N{NO-BREAK SPACE}', text)


def _static(name):
    return files(PACKAGE).joinpath('static', name).read_text('utf-8')


def _templates():
    from jinja2 import Environment, FunctionLoader, StrictUndefined

    def source(name):
        return files(PACKAGE).joinpath('templates', name).read_text('utf-8')

    environment = Environment(loader=FunctionLoader(source), autoescape=True, trim_blocks=True,
                              lstrip_blocks=True, undefined=StrictUndefined)
    environment.policies['json.dumps_kwargs'] = {'separators': (',', ':'), 'allow_nan': False}
    environment.filters.update(
        quantity=quantities.quantity, percent=quantities.percent, words=quantities.words,
        times_noise=quantities.times_noise, listing=quantities.listing,
        nobreak=_nobreak)
    return environment
