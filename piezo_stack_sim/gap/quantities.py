# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Numbers as a reader wants them: SI prefixes, intervals, per cent, the names of things."""

import math

UNITS = {'displacement': 'm', 'charge': 'C', 'voltage': 'V', 'force': 'N', 'velocity': 'm/s'}
UNKNOWN = '–'

_PREFIXES = {-15: 'f', -12: 'p', -9: 'n', -6: 'µ', -3: 'm', 0: '', 3: 'k', 6: 'M', 9: 'G'}
# Units that take no prefix: a milli-per-cent or a kilo-second helps nobody.
_PLAIN = {'', '%', '1', '-', 'K', 'rad', 'deg'}


def unit_of(channel, diagnosis):
    """Return the unit of a channel: the SI unit unless the diagnosis says otherwise."""
    return diagnosis.get('units', {}).get(channel, UNITS.get(channel, ''))


def quantity(value, unit='', digits=3):
    """Return a value with its unit and a prefix: ``38.0 nm`` for 3.8e-8 m."""
    if value is None:
        return UNKNOWN
    if not math.isfinite(value):
        return str(value)
    factor, name = scale(abs(value), unit)
    return f'{significant(value / factor, digits)} {name}'.rstrip()


def scale(size, unit):
    """Return the factor and the prefixed unit in which ``size`` reads as 1 to 999."""
    # A power (1/m, m^2) does not take the prefix of its unit
    if size == 0 or unit in _PLAIN or '^' in unit.split('/')[0] or unit.startswith('1/'):
        return 1.0, '' if unit in {'1', '-'} else unit
    base = 1.0
    if unit == 'kg' or unit.startswith(('kg ', 'kg/')):
        base, unit = 1e-3, unit[1:]
    # 999.96 rounds to 1000, which belongs to the next prefix
    exponent = 3 * math.floor(math.log10(size / base * 1.0005) / 3)
    exponent = min(max(exponent, min(_PREFIXES)), max(_PREFIXES))
    if unit == 's' and exponent > 0:
        exponent = 0
    return base * 10.0 ** exponent, f'{_PREFIXES[exponent]}{unit}'


def significant(value, digits=3):
    """Return a number with that many significant digits, in plain notation where it is short."""
    if value == 0:
        return '0'
    size = math.floor(math.log10(abs(float(f'{value:.{digits - 1}e}'))))
    if -4 <= size < 6:
        return f'{value:.{max(digits - 1 - size, 0)}f}'.replace('-', '−')
    mantissa, exponent = f'{value:.{digits - 1}e}'.split('e')
    return f'{mantissa}e{int(exponent)}'.replace('-', '−')


def interval(ci, unit='', digits=3, factor=None):
    """
    Return ``[1.20, 1.40]`` in the prefixed unit of the larger end, without the unit.

    ``factor`` fixes the scale instead, to stand beside a value that has been scaled.

    """
    if ci is None or ci == [None, None]:
        return ''
    ends = [end for end in ci if end is not None]
    if factor is None:
        factor, _ = scale(max(map(abs, ends)), unit)
    low, high = (('−∞', '∞')[side] if end is None else significant(end / factor, digits)
                 for side, end in enumerate(ci))
    return f'[{low}, {high}]'


def with_interval(value, ci, unit='', digits=3):
    """
    Return ``1.30 [1.20, 1.40] mm``, value and interval in one scale.

    With up to seven digits where fewer would show a narrow interval as a point.

    """
    if value is None:
        return UNKNOWN
    if ci is not None and None not in ci and value != 0.0 and ci[1] > ci[0]:
        digits = min(max(digits, 1 + math.ceil(math.log10(abs(value) / (ci[1] - ci[0])))), 7)
    factor, name = scale(abs(value), unit)
    parts = [significant(value / factor, digits), interval(ci, unit, digits, factor), name]
    return ' '.join(part for part in parts if part)


def percent(fraction, digits=0):
    """Return a fraction in per cent; what lies between 0 and 1 never reads as 0 % or 100 %."""
    if fraction is None:
        return UNKNOWN
    edge = 10.0 ** -digits
    if -edge / 200 < fraction <= 0:
        return '0 %'
    if 0 < fraction < 1 and not edge / 200 <= fraction < 1 - edge / 200:
        return f'< {edge:g} %' if fraction < 0.5 else f'> {100 - edge:g} %'
    return f'{100 * fraction:.{digits}f} %'.replace('-', '−')


def percent_with_interval(fraction, ci, digits=0):
    """
    Return ``98 %`` and ``[97, 99]``, as many decimals in both, '' where there is no interval.

    With ``digits`` decimals, and up to two more where a number would read as 100 % and is not, or
    where all are small.

    """
    shown = [value for value in (fraction, *(ci or ())) if value is not None]
    most = digits + 2
    while digits < most and any(1.0 - 0.005 / 10 ** digits <= value < 1.0 for value in shown):
        digits += 1
    if shown and max(map(abs, shown)) < 0.1:
        digits = max(digits, 1)
    figure = percent(fraction, digits)
    if ci is None or ci == [None, None]:
        return figure, ''
    low, high = (('−∞', '∞')[side] if end is None else _rounded(100 * end, digits)
                 for side, end in enumerate(ci))
    return figure, f'[{low}, {high}]'


def _rounded(value, digits):
    """Return a number with so many decimals, and none of them where it is whole, as 100."""
    text = f'{value:.{digits}f}'.replace('-', '−')
    return '100' if float(value) == 100.0 else text


def probability(value, digits=0):
    """Return a probability in per cent; one that was rounded to certainty does not read so."""
    return percent(None if value is None else min(value, 0.99999), digits)


def in_order(channels):
    """Return channels as a reader looks for them: what the user wants to move first."""
    order = ('displacement', 'charge', 'voltage')
    return sorted(channels, key=lambda channel: (
        order.index(channel) if channel in order else len(order), channel))


def times_noise(ratio):
    """Return a gap in multiples of the noise: ``12.4``, ``132``, ``1.03``."""
    if ratio is None:
        return UNKNOWN
    return f'{ratio:.2f}' if ratio < 2 else f'{ratio:.1f}' if ratio < 100 else f'{ratio:.0f}'


def words(identifier):
    """Return an id as words: ``rate_dependent_hysteresis`` without the underscores."""
    return ' + '.join(part.replace('_', ' ') for part in identifier.split('+'))


def listing(items, last='and'):
    """Return ``a, b and c``."""
    items = list(items)
    if len(items) < 2:
        return ''.join(items)
    return f'{", ".join(items[:-1])} {last} {items[-1]}'
