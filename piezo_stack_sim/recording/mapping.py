# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Names and units other than the project's own, as they are given on the command line.

``--map CHANNEL=SOURCE`` says where a channel is found. SOURCE is the name of a column of a CSV
file, or, beginning with a slash, a topic of a bag with an optional path into its message::

    --map displacement=stage_um
    --map displacement=/stage/joint_states.position[0]
    --map external_force=/cell/wrench.wrench.force.z

``--unit CHANNEL=UNIT`` says what its numbers mean: a unit (``um``, ``mV``, ``uC``, ``ms``), a
factor to the SI unit (``20`` for the volts of an amplifier of gain 20), a factor and a unit
(``2.5*um``), each with an optional sign (``-um``, ``-1``). Common words are units, too
(``microns``, ``seconds``, ``min``).

Nothing here is evaluated: both are matched against a grammar.
"""

from dataclasses import dataclass
import difflib
import re
import unicodedata

from piezo_stack_sim.errors import InputError
from piezo_stack_sim.recording.finding import shown
from piezo_stack_sim.recording.recording import UNITS

CHANNELS = tuple(UNITS)
ARBITRARY = 'arbitrary'
_PREFIXES = {'': 1.0, 'k': 1e3, 'm': 1e-3, 'u': 1e-6, 'µ': 1e-6, 'μ': 1e-6, 'n': 1e-9, 'p': 1e-12}
_HUGE = 1e30  # no factor between units is as large
_TOPIC = re.compile(r'/[A-Za-z0-9_~]+(?:/[A-Za-z0-9_]+)*')
_FIELD = re.compile(r'\.([A-Za-z][A-Za-z0-9_]*)|\[([0-9]{1,6})\]')
_UNIT = re.compile(
    r'(?P<sign>[+-])?\s*(?:(?P<factor>\d+(?:\.\d*)?(?:[eE][+-]?\d{1,3})?)\s*\*?)?'
    r'\s*(?P<unit>[^\W\d_]*)'
)
# What people write in place of a symbol, in any case: its SI unit and its size in that.
_WORDS = {
    **{f'{prefix}{word}{plural}': (base, size)
       for prefix, size in (('', 1.0), ('kilo', 1e3), ('milli', 1e-3), ('micro', 1e-6),
                            ('nano', 1e-9), ('pico', 1e-12))
       for word, base in (('meter', 'm'), ('metre', 'm'), ('second', 's'), ('volt', 'V'),
                          ('coulomb', 'C'), ('newton', 'N'))
       for plural in ('', 's')},
    **dict.fromkeys(('micron', 'microns'), ('m', 1e-6)),
    **dict.fromkeys(('å', 'ångström', 'angstrom', 'angstroms'), ('m', 1e-10)),
    **dict.fromkeys(('sec', 'secs'), ('s', 1.0)),
    **dict.fromkeys(('min', 'mins', 'minute', 'minutes'), ('s', 60.0)),
    **dict.fromkeys(('h', 'hr', 'hour', 'hours'), ('s', 3600.0)),
    'msec': ('s', 1e-3), 'usec': ('s', 1e-6),
}
# What looks like a unit and is none of a channel, or none of the SI.
_OTHER_UNITS = {
    'min', 'h', 'sec', 'msec', 'usec', 'A', 'mA', 'uA', 'W', 'K', 'C/V', 'Hz', 'kHz', 'Pa', 'kPa',
    'MPa', 'bar', 'psi', 'deg', 'rad', 'kg', 'g', 'mg', 't', 'kgf', 'gf', 'kp', 'p', 'lbf', 'lb',
    'lbs', 'oz', 'ozf', 'dyn', 'MN', 'in', 'inch', 'mil', 'mils', 'thou', 'ft', 'cm', 'dm', 'F',
    'nF', 'uF', 'pF', 'Ohm', '%', 'm/s', 'N/m', 'N/um', '°C', 'LSB', 'counts', 'ticks', 'steps'}
_HEADER_UNIT = re.compile(
    r'(?P<name>.+?)(?:\s*[\[(](?P<boxed>[^\])]+)[\])]|[ _/](?P<tail>[^ _/()\[\]]+))'
)


def suggestion(name, known):
    """Return ' (did you mean ...?)' for the known name nearest to a misspelt one, else ''."""
    near = difflib.get_close_matches(str(name), [str(each) for each in known], n=1, cutoff=0.6)
    return f' (did you mean {shown(near[0])}?)' if near else ''


@dataclass(frozen=True)
class TopicField:
    """
    A number in the messages of a topic.

    Attributes
    ----------
    topic : str
        The topic's full name.
    path : tuple of str and int
        Field names and indices, outermost first; empty for the only number of the message.

    """

    topic: str
    path: tuple

    def __str__(self):
        """Return it as it is written on the command line."""
        path = ''.join(f'[{x}]' if isinstance(x, int) else f'.{x}' for x in self.path)
        return f'{self.topic}{path}'


def parse_topic_field(text):
    """
    Read ``/topic/name.field.other[0]``.

    Raises
    ------
    InputError
        When `text` has another form.

    """
    topic = _TOPIC.match(text)
    path, position = [], topic.end() if topic else 0
    while topic and position < len(text):
        step = _FIELD.match(text, position)
        if not step:
            break
        path.append(step[1] if step[2] is None else int(step[2]))
        position = step.end()
    if not topic or position != len(text):
        raise InputError(
            f'--map: {shown(text, 80)} is no topic with a field: '
            'expected a form like /stage/joint_states.position[0]'
        )
    return TopicField(topic[0], tuple(path))


def _pairs(texts, option):
    """Return {channel: text} of ``channel=text`` items, or of a mapping given as such."""
    if isinstance(texts, str):
        texts = (texts,)
    if not hasattr(texts, 'items'):
        items = [tuple(str(text).partition('=')[::2]) for text in texts or ()]
    else:
        items = [(str(name), str(value)) for name, value in texts.items()]
    pairs = {}
    for name, value in items:
        name, value = name.strip(), value.strip()
        if name not in UNITS:
            raise InputError(
                f'{option} {shown(name)}: no such channel{suggestion(name, CHANNELS)}: '
                f'expected one of {", ".join(CHANNELS)}'
            )
        if not value:
            raise InputError(f'{option} {name}: expected {name}=..., got nothing after it')
        if name in pairs:
            raise InputError(f'{option} {name}: given twice')
        pairs[name] = value
    return pairs


def parse_mapping(texts):
    """
    Read what ``--map`` says.

    Parameters
    ----------
    texts : sequence of str, mapping of str to str, or None
        Items ``channel=source``.

    Returns
    -------
    dict of str to str or TopicField
        Column names, and topics for sources that begin with a slash.

    Raises
    ------
    InputError
        Unknown or repeated channel, or a source that is neither.

    """
    mapping = {}
    for name, source in _pairs(texts, '--map').items():
        if source.startswith('/') and name == 'time':
            raise InputError('--map time: the time of a bag is in its messages; map a column only')
        mapping[name] = parse_topic_field(source) if source.startswith('/') else source
    return mapping


def unit_scale(quantity, text):
    """
    Return the factor from a unit to the SI unit of a channel.

    Parameters
    ----------
    quantity : str
        A channel, such as 'displacement'.
    text : str
        Sign, factor and unit, such as 'um', '-1', '2.5*um'.

    Returns
    -------
    float
        Neither zero nor beyond reason.

    Raises
    ------
    InputError
        When `text` is no unit of that channel.

    """
    base = UNITS[quantity]
    # Composed, for the one letter that stands in a unit and has a ring.
    match = _UNIT.fullmatch(unicodedata.normalize('NFC', text.strip()))
    scale = None
    if match and (match['unit'] or match['factor']):
        unit = match['unit'] or base
        scale = _PREFIXES.get(unit[:-len(base)]) if unit.endswith(base) else None
        of, size = _WORDS.get(unit.lower(), (None, None))
        scale = size if scale is None and of == base else scale
    if match and scale:
        scale *= float(match['factor'] or 1.0) * (-1.0 if match['sign'] == '-' else 1.0)
    if not scale or not 1.0 / _HUGE <= abs(scale) <= _HUGE:
        raise InputError(
            f'--unit {quantity}: {shown(text)} is no unit of it: expected {base} with a prefix of '
            'k, m, u, n, p, or a factor, or both as in 2.5*um, and a sign'
            + (f', between {1.0 / _HUGE:g} and {_HUGE:g}' if scale is not None else '')
            + (f'; or {ARBITRARY}' if quantity == 'displacement' else '')
        )
    return scale


def parse_units(texts):
    """
    Read what ``--unit`` says.

    Parameters
    ----------
    texts : sequence of str, mapping of str to str, or None
        Items ``channel=unit``.

    Returns
    -------
    dict of str to float
        Factors to the SI unit; none for what is in units of its own.

    Raises
    ------
    InputError
        See `unit_scale`.

    """
    return {name: unit_scale(name, text) for name, text in _pairs(texts, '--unit').items()
            if (name, text) != ('displacement', ARBITRARY)}


def is_displacement_arbitrary(texts):
    """Tell whether ``--unit displacement=arbitrary`` says that only its shape counts."""
    return _pairs(texts, '--unit').get('displacement') == ARBITRARY


def header_unit(header):
    """
    Take a header such as ``displacement [um]``, ``displacement_um`` or ``time(ms)`` apart.

    Parameters
    ----------
    header : str
        The name of a column.

    Returns
    -------
    tuple of (str, str, float) or None
        Channel, unit and the factor to SI; None when it is no channel with a unit of its own.

    """
    match = _HEADER_UNIT.fullmatch(header.strip()[:80])
    if not match or match['name'].strip().lower() not in UNITS:
        return None
    return _tagged(match['name'].strip().lower(), match['boxed'] or match['tail'])


def boxed(header):
    """Return what stands in the brackets behind the name of a column, '' without any."""
    match = _HEADER_UNIT.fullmatch(header.strip()[:80])
    return (match['boxed'] or '').strip() if match else ''


def boxed_channel(header):
    """Return the channel before the brackets of ``displacement [anything]``, None if none is."""
    match = _HEADER_UNIT.fullmatch(header.strip()[:80])
    name = match['name'].strip().lower() if match and match['boxed'] else None
    return name if name in UNITS else None


def boxed_unit(channel, header):
    """
    Take the brackets of a column of any name that is mapped to a channel: ``x [um]``.

    Returns
    -------
    tuple of (str, float) or None
        Unit and factor to SI; None when there is no unit in brackets.

    Raises
    ------
    InputError
        When there is the unit of something else in the brackets.

    """
    word = boxed(header)
    tagged = _tagged(channel, word)
    if tagged is None and (word in _OTHER_UNITS or any(_tagged(name, word) for name in UNITS)):
        unit_scale(channel, word)
    return tagged and tagged[1:]


def _tagged(channel, unit):
    """Return the channel, unit and factor; None if it is none."""
    unit = unicodedata.normalize('NFC', unit.strip())
    # Letters alone: 'displacement_2' is a second sensor, not a displacement in units of 2 m.
    if not unit.isalpha():
        return None
    try:
        return channel, unit, unit_scale(channel, unit)
    except InputError:
        return None
