# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The shape of ``diagnosis.json``: the schema that is shipped, and the checks it cannot express.

The schema (``diagnosis.schema.json`` beside this module) carries a description of every field.
Conventions that hold throughout:

* SI units, unless ``units`` names another one for a channel (displacement in sensor volts, say).
* ``ci`` is a 95 % interval ``[low, high]``: of ``over_noise`` in ``gap``, of ``S`` in
  ``shrinkage``, of ``fitted`` in ``calibration``, of ``value`` in a cause's ``parameters``. An
  open end is null, and so is an interval that was not computed. NaN and infinity are refused.
* ``over_noise`` is rms over noise rms: 1 is nothing but noise.
* ``nrmse`` and every share are fractions, not per cent.
* ``before``, ``after`` and ``noise`` in ``shrinkage`` are powers (mean squares), so that
  ``S = 1 - (after - noise) / (before - noise)`` can be recomputed from the file; ``span`` is the
  measured peak-to-peak.
* ``placebo`` and ``ceiling`` are the S of an effect that exists in no device and of a flexible
  correction: one number for all channels, or ``{channel: S}``, or null.
* A candidate that is a pair has ``effect`` ``"creep+friction"`` and parameters named
  ``creep.gain_per_decade``.
* A row of ``preflight`` is ``dataclasses.asdict`` of a
  :class:`piezo_stack_sim.recording.finding.Finding`.
* ``separation`` is an rms over noise, simulated, of the two closest of the tied causes.

``traces`` is what the report draws, made by :func:`piezo_stack_sim.gap.traces.build_traces`::

    {"recordings": [{
        "name", "drive", "rows",
        "views": {"overview": VIEW, "detail": VIEW},      # detail is absent from short recordings
        "spectra": {"<channel>": {"frequency", "before", "after", "noise"}}}]}

    VIEW = {"time": [...], "command": [...] or null, "external_force": [...] or null, "error",
            "channels": {"<channel>": {"measured", "simulated_before", "simulated_after"}}}

All series of a view stand on its ``time``, so that loops (v-q, q-x, v-x) are drawn from them as
they are; ``before`` is the parameter file as given, ``after`` is ``corrected.yaml``.
"""

from difflib import get_close_matches
from functools import lru_cache
from importlib.resources import files
import json
import math

from piezo_stack_sim.errors import InputError

SCHEMA_ID = 'piezo_stack_sim/diagnosis/1'
VERDICTS = ('NO_GAP', 'CAUSE', 'MULTIPLE', 'AMBIGUOUS', 'UNKNOWN', 'NOT_IDENTIFIABLE')
BLOCKS = ('drive', 'electrical', 'transducer', 'mechanical', 'environment', 'sensor')

_SERIES = '#/$defs/series'
_NUMBERS = {float, int, type(None)}


@lru_cache(maxsize=1)
def load_schema():
    """Return the JSON Schema of ``diagnosis.json`` (draft 2020-12) as a dict."""
    text = files('piezo_stack_sim.gap').joinpath('diagnosis.schema.json').read_text('utf-8')
    return json.loads(text)


def validate(diagnosis, source='diagnosis'):
    """
    Refuse a diagnosis that does not have the shape of ``diagnosis.json``.

    Parameters
    ----------
    diagnosis : dict
        As read from the file, or as about to be written.
    source : str
        What to call it in the message, usually the file's name.

    Raises
    ------
    InputError
        One line: the source, the key, the value and what was expected.

    """
    error = _first_error(diagnosis)
    if error is not None:
        raise InputError(f'{source}: {_explain(error)}')
    _refuse_non_finite(diagnosis, source)
    known = {effect for cause in diagnosis['causes'] for effect in cause['effect'].split('+')}
    for key in ('selected', 'ambiguity_set'):
        for effect in diagnosis[key]:
            if effect not in known:
                raise InputError(f'{source}: {key} names {effect!r}, which is not among causes: '
                                 'expected an effect that was a candidate')
    for index, recording in enumerate(diagnosis.get('traces', {}).get('recordings', ())):
        _check_lengths(recording, f'{source}: traces.recordings[{index}]')


def _first_error(diagnosis):
    from jsonschema.exceptions import best_match
    return best_match(_validator().iter_errors(diagnosis))


@lru_cache(maxsize=1)
def _validator():
    """Return the validator, with a short way through the long series of numbers."""
    from jsonschema import Draft202012Validator
    from jsonschema.exceptions import ValidationError
    from jsonschema.validators import extend

    ordinary = Draft202012Validator.VALIDATORS['$ref']

    def series_or_ordinary(validator, reference, instance, schema):
        if reference != _SERIES:
            yield from ordinary(validator, reference, instance, schema)
        elif not isinstance(instance, list):
            yield ValidationError('expected a list of numbers')
        else:
            # jsonschema descends into every item: a second for the traces of five recordings
            if not set(map(type, instance)) <= _NUMBERS:
                wrong = next(i for i, item in enumerate(instance) if type(item) not in _NUMBERS)
                yield ValidationError('expected a number or null', path=[wrong],
                                      instance=instance[wrong], validator='type',
                                      validator_value=['number', 'null'])

    return extend(Draft202012Validator, {'$ref': series_or_ordinary})(load_schema())


def _explain(error):
    """Put a jsonschema error into one line: key, value, expectation."""
    key = _dotted(error.absolute_path) or 'the file'
    value = _short(error.instance)
    rule, limit = error.validator, error.validator_value
    if rule == 'anyOf':
        # Something or null: what is wrong with it as the something tells more
        some = [inner for inner in error.context if inner.schema.get('type') != 'null']
        if some and value != 'None':
            return _explain(max(some, key=lambda inner: len(inner.absolute_path)))
    if rule == 'required':
        missing = next(name for name in limit if name not in error.instance)
        return f'{key}: {missing!r} is missing'
    if rule == 'additionalProperties' and isinstance(error.instance, dict):
        known = error.schema.get('properties', {})
        extra = next((name for name in error.instance if name not in known), '?')
        close = get_close_matches(extra, known, n=1)
        hint = f'did you mean {close[0]!r}?' if close else f'expected one of {", ".join(known)}'
        return f'{key}: unknown key {_short(extra)}: {hint}'
    expectation = {
        'type': lambda: f'expected {" or ".join([limit] if isinstance(limit, str) else limit)}',
        'enum': lambda: f'expected one of {", ".join(map(json.dumps, limit))}',
        'const': lambda: f'expected {json.dumps(limit)}',
        'minimum': lambda: f'expected at least {limit}',
        'maximum': lambda: f'expected at most {limit}',
        'minItems': lambda: f'expected at least {limit} items',
        'maxItems': lambda: f'expected at most {limit} items',
        'pattern': lambda: 'expected lower-case words joined by underscores',
        'uniqueItems': lambda: 'expected each item once',
    }.get(rule, lambda: ' '.join(error.message.split())[:160])
    return f'{key} is {value}: {expectation()}'


def _dotted(path):
    """Return ``causes[0].parameters`` for the path of keys and positions."""
    text = ''
    for part in path:
        text += f'[{part}]' if isinstance(part, int) else f'.{part}' if text else str(part)
    return text


def _short(value):
    text = repr(value)
    return text if len(text) <= 60 else f'{text[:57]}...'


def _refuse_non_finite(value, source, path=()):
    """Refuse NaN and infinity: Python writes them, no other JSON reader takes them."""
    if isinstance(value, float):
        if not math.isfinite(value):
            raise InputError(f'{source}: {_dotted(path)} is {value}: '
                             'expected a finite number, or null where it is not known')
    elif isinstance(value, dict):
        for key, item in value.items():
            _refuse_non_finite(item, source, (*path, key))
    elif isinstance(value, list):
        if all(type(item) is float and math.isfinite(item) for item in value):
            return
        for index, item in enumerate(value):
            _refuse_non_finite(item, source, (*path, index))


def _check_lengths(recording, where):
    """Refuse series that do not stand on the time or frequency they belong to."""
    for name, view in recording['views'].items():
        series = {'command': view['command'], 'external_force': view.get('external_force')}
        for channel, signals in view['channels'].items():
            series.update({f'channels.{channel}.{key}': row for key, row in signals.items()})
        _same_length(view['time'], series, f'{where}.views.{name}', 'time')
    for channel, spectrum in recording['spectra'].items():
        _same_length(spectrum['frequency'], spectrum, f'{where}.spectra.{channel}', 'frequency')


def _same_length(base, series, where, name):
    for key, row in series.items():
        if row is not None and len(row) != len(base):
            raise InputError(f'{where}.{key} has {len(row)} values: '
                             f'expected {len(base)}, as many as {name}')
