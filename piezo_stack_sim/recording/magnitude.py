# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Preflight of sizes: units that are wrong by powers of a thousand, and what else is far off."""

from itertools import product
import math

import numpy as np

from piezo_stack_sim.errors import InputError
from piezo_stack_sim.recording.finding import found, NOTE, refuse, REPAIRED
from piezo_stack_sim.recording.mapping import UNITS
from piezo_stack_sim.recording.samples import without

# Powers of ten by which a channel may be too large: displacement in mm, um or nm, and so on.
_PLAUSIBLE = {'voltage': (-3, 3, 6), 'charge': (3, 6, 9), 'displacement': (3, 6, 9)}
_COMMAND = {'voltage': (0, -3, 3), 'charge': (0, -3, -6, -9)}
_NAMES = {-3: 'k', 0: '', 3: 'm', 6: 'u', 9: 'n', 12: 'p'}
# Nobody excites a stack with less of its range than this.
_LEAST = 0.01
_SURE = 0.7
# Decades by which what is driven may be away from its command.
_GAIN = 0.3
_TURNS = 8
# Decades that a device may be away from its data sheet: an effect, not a unit.
_WIDE = 1.0
_ODD = 2.0
# Without a device, what no piezo stack reaches: V, C, m, N.
_LIMITS = {'voltage': 1e4, 'charge': 0.1, 'displacement': 5e-3}
_FORCE_LIMIT = 1e6
_KILOGRAM = 9.80665  # its weight, N
# Smaller in whatever unit than any sensor sees.
_NOTHING = 1e-30
# Decades away from a unit from which a factor is none.
_NO_UNIT = 0.3
# Part of the whole range that the middle 98 per cent of rows have where the rest is a pulse.
_PULSE = 0.05


def spread(values):
    """Return the range of values without the outermost per cent on either side."""
    low, high = np.percentile(values, (1.0, 99.0))
    return float(high - low) or float(np.ptp(values))


def _spreads(expected, measured):
    """Return the ranges of both by one measure: of a pulse in a long rest the whole ones."""
    whole = float(np.ptp(expected))
    low, high = np.percentile(expected, (1.0, 99.0))
    if high - low < _PULSE * whole:
        return whole, float(np.ptp(measured))
    return spread(expected), spread(measured)


def check_limits(recording):
    """Refuse numbers that no piezo stack reaches; all that can be done without a device."""
    sizes = dict(recording.measured, external_force=recording.external_force)
    limits = dict(_LIMITS, external_force=_FORCE_LIMIT)
    if recording.command_name:
        sizes[recording.command_name] = recording.command
        limits[recording.command_name] = _LIMITS[recording.drive]
    for name, values in sizes.items():
        size = float(np.max(np.abs(values)))
        if size > limits[name]:
            raise refuse(
                recording, int(np.argmax(np.abs(values))),
                f'{name} reaches {size:.4g} {UNITS[name]}: hardly in {UNITS[name]}',
                f'give its unit, as in --unit {name}=u{UNITS[name]}')
    return recording, []


def arbitrary_factor(recordings, expected):
    """
    Return how many metres a unit of an arbitrary displacement is, on the whole of a set.

    Parameters
    ----------
    recordings : sequence of Recording
        Those whose displacement is not arbitrary do not count.
    expected : iterable of dict
        Channel to (n,) array for each: what the device should do; its stroke is the measure.

    Returns
    -------
    float
        Of either sign; 1 where nothing is arbitrary or nothing moves.

    """
    above = below = 0.0
    for each, answer in zip(recordings, expected):
        if each.arbitrary and 'displacement' in each.measured:
            wanted = answer['displacement'] - np.mean(answer['displacement'])
            given = each.measured['displacement'] - np.nanmean(each.measured['displacement'])
            above += float(np.nansum(wanted * given))
            below += float(np.nansum(given * given))
    return above / below if above and below else 1.0


def give_size(recording, factor):
    """
    Give an arbitrary displacement the size that the device should have.

    What is told of it counts how often that was done before.
    """
    if not recording.arbitrary or 'displacement' not in recording.measured:
        return recording, []
    measured = {**recording.measured, 'displacement': factor * recording.measured['displacement']}
    scale = factor * recording.scale
    return recording.replace(measured=measured, scale=scale), [found(
        recording, None, NOTE, 'displacement is in units of its own: its scale tells nothing',
        f'multiplied by {scale:.4g} m, as the stroke of the device tells')]


def _explain(channel, ratio):
    """
    Return (power of ten, cost, distance) that explains a channel's size best.

    The power is 0 for a channel that is right, None for one that no unit explains.

    """
    decades = math.log10(ratio)
    if abs(decades) <= _WIDE:
        return 0, 0.0, abs(decades)
    power = 3 * round(decades / 3.0)
    if power in _PLAUSIBLE[channel] and abs(decades - power) <= _WIDE:
        return power, 1.0, abs(decades - power)
    # Up to a factor of a hundred it may be an effect; more than that must be explained.
    return (0, 0.5, abs(decades)) if abs(decades) <= _ODD else (None, 3.0, abs(decades))


class _Reading:
    """One way to read the units of a recording, and how much it asks one to believe."""

    def __init__(self, recording, statics, command_power, force_power):
        self.command_power, self.force_power = command_power, force_power
        answer = statics.answer(
            recording.drive, recording.command * 10.0**command_power,
            recording.external_force * 10.0**force_power)
        self.powers, self.ratios = {}, {}
        self.cost = float(command_power != 0) + float(force_power != 0)
        self.distance = 0.0
        for channel, values in recording.measured.items():
            expected, measured = _spreads(answer[channel], values)
            if min(expected, measured) < _NOTHING:
                continue
            power, cost, distance = _explain(channel, measured / expected)
            self.powers[channel], self.ratios[channel] = power, measured / expected
            self.cost += cost
            self.distance += distance

    @property
    def complete(self):
        """Return whether it explains every channel."""
        return None not in self.powers.values()


def _command_powers(recording, statics):
    """Return the powers of ten that bring the command into the device's range."""
    if recording.drive not in _COMMAND:
        return (0,)
    size = float(np.max(np.abs(recording.command))) / statics.limit(recording.drive)
    return tuple(
        power for power in _COMMAND[recording.drive]
        if size * 10.0**power <= 3.0 and (power == 0 or size * 10.0**power >= _LEAST))


def _force_powers(recording, statics):
    size = float(np.max(np.abs(recording.external_force)))
    return (0, -3) if size > 3.0 * statics.blocking_force else (0,)


def check_units(recording, statics):
    """
    Bring channels whose unit is unmistakably another one to SI.

    Every reading of the units is compared with what the device should answer; the one that
    changes fewest things is taken, if it stands out.

    Returns
    -------
    tuple of (Recording, list of Finding)

    Raises
    ------
    RefusedError
        No reading explains the sizes, or two do.

    """
    powers = _command_powers(recording, statics)
    if not powers:
        raise _far_beyond(recording)
    readings = sorted(
        (_Reading(recording, statics, *each)
         for each in product(powers, _force_powers(recording, statics))),
        key=lambda each: (each.cost, each.distance))
    best = readings[0]
    as_is = next((x for x in readings if x.command_power == 0 and x.force_power == 0), None)
    if as_is and as_is.cost < 1.0:
        return recording, _odd(recording, as_is, statics)
    if as_is:
        _check_gain(recording, as_is, statics)
    rivals = [each for each in readings[1:] if each.complete and each.cost < best.cost + 0.5
              and each.distance < best.distance + 0.5]
    if not best.complete or rivals:
        raise _unexplained(recording, as_is or best)
    return _scaled(recording, best, statics)


def check_reach(recording, statics):
    """
    Refuse a command far beyond the device's range, where nothing measured tells its unit.

    Returns
    -------
    tuple of (Recording, list of Finding)

    Raises
    ------
    RefusedError
        As `check_units` refuses what no unit explains.

    """
    if 0 not in _command_powers(recording, statics):
        raise _far_beyond(recording)
    return recording, []


def _far_beyond(recording):
    name, size = recording.command_name, np.abs(recording.command)
    return refuse(recording, int(np.argmax(size)), f'{name} reaches {np.max(size):.4g} '
                  f'{UNITS[name]}, far beyond the device',
                  f'give its unit, as in --unit {name}=m{UNITS[name]}')


def _check_gain(recording, reading, statics):
    """Refuse a command that all channels answer as one that is larger by a factor, and no unit."""
    factor = reading.ratios.get(recording.drive, 1.0)
    decades = math.log10(factor)
    if len(reading.ratios) < 2 or abs(decades - 3 * round(decades / 3.0)) < _NO_UNIT:
        return
    larger = _Reading(recording.replace(command=recording.command * factor), statics, 0, 0)
    if all(abs(math.log10(ratio)) < _NO_UNIT for ratio in larger.ratios.values()):
        raise refuse(recording, None, f'all channels answer {recording.command_name} as if '
                     f'it were {factor:.4g} times as large',
                     'if an amplifier lies between, give its gain, as in --unit '
                     f'{recording.command_name}={factor:.3g}')


def _odd(recording, reading, statics):
    """Note channels that are far off, but by no unit: all by one factor, it is the command's."""
    driven = recording.drive
    far = {channel: ratio for channel, ratio in reading.ratios.items()
           if not reading.powers[channel] and abs(math.log10(ratio)) > (
               _GAIN if channel == driven else _WIDE)}
    if _beyond_blocking(recording, statics) and driven not in far:
        return []  # `check_force` tells of it; who would ask for a gain before?
    alike = len(far) > 1 and max(far.values()) < 3.0 * min(far.values())
    if driven in far or alike:
        told = [driven] if driven in far else list(far)
        factor = _gain(recording, statics, told)
        mend = ('if an amplifier lies between, give its gain, as in '
                f'--unit {recording.command_name}={factor:.3g}')
        if driven in far and _is_monitor(recording, reading, statics, factor):
            mend = ('the others do what the command says: if it was read behind a divider, give '
                    f'its factor, as in --unit {driven}={1.0 / factor:.3g}')
        return [found(recording, None, NOTE, f'{" and ".join(told)}: {factor:.4g} times what '
                      f'{recording.command_name} should do', mend)]
    mend = 'check its gain; --unit takes factors too'
    if not np.ptp(recording.command) and np.ptp(recording.external_force):
        mend = ('check the unit of external_force, which alone moves it, or its gain; --unit '
                'takes factors too')
    return [
        found(recording, None, NOTE,
              f'{channel} moves {ratio:.2g} times as far as the device should', mend)
        for channel, ratio in far.items()
    ]


def _is_monitor(recording, reading, statics, factor):
    """Tell whether what was not driven does as the command says, and not that times a factor."""
    def distance(ratios):
        apart = [abs(math.log(ratio)) for channel, ratio in ratios.items()
                 if channel != recording.drive]
        return sum(apart) / len(apart) if apart else math.inf

    scaled = _Reading(recording.replace(command=recording.command * factor), statics, 0, 0)
    return distance(reading.ratios) < distance(scaled.ratios)


def _gain(recording, statics, channels):
    """Return the factor of the command with which some channels move as far as they should."""
    factor = 1.0
    for _ in range(_TURNS):  # with hysteresis, twice the command does more than twice as much
        ratios = _Reading(recording.replace(command=recording.command * factor), statics, 0,
                          0).ratios
        factor *= math.exp(np.mean([math.log(ratios[channel]) for channel in channels]))
    return factor


def check_amplified(recording):
    """
    Ask that what is driven is what was commanded, and no multiple of it.

    Raises
    ------
    InputError
        If it moves more than twice or less than half as far.

    """
    values = recording.measured.get(recording.drive)
    moved = recording.command[:-1] - np.mean(recording.command[:-1])
    if values is None or not np.any(moved):
        return
    factor = float(moved @ values[1:] / (moved @ moved))
    if factor > 0.0 and abs(math.log10(factor)) > _GAIN:
        name = recording.command_name
        raise InputError(str(refuse(
            recording, None, f'{recording.drive} moves {factor:.4g} times as far as {name}',
            f'if an amplifier lies between, give its gain, as in --unit {name}={factor:.3g}; if '
            f'a divider does, its factor, as in --unit {recording.drive}={1.0 / factor:.3g}')))


def _unexplained(recording, reading):
    wrong = {name: ratio for name, ratio in reading.ratios.items()
             if abs(math.log10(ratio)) > _WIDE}
    sizes = ', '.join(f'{name} moves {ratio:.2g} times as far as expected'
                      for name, ratio in (wrong or reading.ratios).items())
    name = next(iter(wrong), recording.command_name or 'displacement')
    unit = f'u{UNITS[name]}'
    if name in wrong and name in recording.stated:
        power = 3 * round(math.log10(wrong[name]) / 3.0)
        unit = _unit_of(name, recording.stated[name][1] * 10.0**-power) or unit
    return refuse(recording, None, f'{sizes}: the units cannot be told',
                  f'give them, as in --unit {name}={unit}')


def _scaled(recording, reading, statics):
    findings, changes = [], {}
    named = {channel: power for channel, power in reading.powers.items() if power}
    measured = {name: values * 10.0**-named.get(name, 0)
                for name, values in recording.measured.items()}
    named.update({'external_force': -reading.force_power} if reading.force_power else {})
    if reading.command_power:
        named[recording.command_name] = -reading.command_power
        changes['command'] = recording.command * 10.0**reading.command_power
    if reading.force_power:
        changes['external_force'] = recording.external_force * 10.0**reading.force_power
    for name, power in named.items():
        findings.append(_in_unit(recording, name, power, 'as its size tells'))
    scaled = recording.replace(measured=measured, **changes)
    return scaled, findings + _odd(scaled, _Reading(scaled, statics, 0, 0), statics)


def _in_unit(recording, name, power, why):
    """Return the Finding about a channel whose unit is another one than it was taken for."""
    said, factor = recording.stated.get(name, ('', 1.0))
    if not said:
        return found(recording, None, REPAIRED,
                     f'{name} is in {_NAMES.get(power, f"1e{-power} ")}{UNITS[name]}, {why}',
                     f'multiplied by 1e{-power}')
    # What is too large has been multiplied by that factor before.
    meant = factor * 10.0**-power
    is_in, given = (_unit_of(name, each) for each in (meant, factor))
    what = f'{name} is in {is_in}, {why}, and not in {given} as {said} says'
    if not is_in or not given:
        size = f'1e{abs(power)} times too {"large" if power > 0 else "small"}'
        what = f'{name} is {size}, {why}, with the factor {factor:g} of {said}'
    return found(recording, None, REPAIRED, what,
                 f'{said} is overruled: multiplied by {meant:g} instead of {factor:g}')


def _unit_of(name, factor):
    """Return the unit of a channel that has a factor to SI, of either sign; '' for none."""
    power = -math.log10(abs(factor))
    prefix = _NAMES.get(round(power)) if abs(power - round(power)) < 1e-9 else None
    return '' if prefix is None else prefix + UNITS[name]


def same_units(recording, powers, statics):
    """
    Give a recording the command's unit of its set, if its sizes do not speak against it.

    A recording that is moved by a force may look sound in either unit.

    Parameters
    ----------
    recording : Recording
        After `check_units`.
    powers : set of int
        The powers of ten by which the commands of other recordings were scaled.
    statics : Statics
        The device.

    Returns
    -------
    tuple of (Recording, list of Finding)

    """
    power = next(iter(powers), 0)
    if len(powers) != 1 or power not in _command_powers(recording, statics):
        return recording, []
    reading = _Reading(recording, statics, power, 0)
    if not reading.ratios or any(reading.powers.values()) or not reading.complete:
        return recording, []
    changed = recording.replace(command=recording.command * 10.0**power)
    return changed, [_in_unit(recording, recording.command_name, -power,
                              'as in the other recordings')]


def command_power(before, after):
    """Return the power of ten by which `check_units` scaled a command."""
    sizes = [float(np.max(np.abs(each.command))) for each in (before, after)]
    return round(math.log10(sizes[1] / sizes[0])) if all(sizes) else 0


def _beyond_blocking(recording, statics):
    return bool(np.max(np.abs(recording.external_force)) > statics.blocking_force)


def check_force(recording, effect, statics):
    """
    Bring a force in kilonewton to newton, as the answer to it tells; note kilograms and grams.

    Parameters
    ----------
    recording : Recording
        After `check_units`, with the right signs.
    effect : dict of str to (float, float)
        Of each channel, how many times too large its answer to the force is, and how surely.
    statics : Statics
        The device.

    Returns
    -------
    tuple of (Recording, list of Finding)

    """
    sure = [size for size, likeness in effect.values() if likeness > _SURE]
    if not sure or not all(_ODD < math.log10(size) < 3.0 + _WIDE for size in sure):
        return recording, _weights(recording, sure, statics)
    return recording.replace(external_force=recording.external_force * 1e3), [
        _in_unit(recording, 'external_force', -3, 'as the answer to it tells')]


def _weights(recording, sizes, statics):
    """Return what to note of a force that is answered as one in kilograms or in grams."""
    findings = []
    if any(all(abs(math.log10(size / factor)) < _NO_UNIT for size in sizes) and sizes
           for factor in (_KILOGRAM, 1e-3 * _KILOGRAM)):
        findings.append(found(
            recording, None, NOTE, 'external_force is answered as if it were '
            f'{math.exp(np.mean(np.log(sizes))):.2g} times as large',
            f'if it is in kgf, give its unit, as in --unit external_force={_KILOGRAM}; if in g, '
            f'--unit external_force={_KILOGRAM}e-3'))
    if _beyond_blocking(recording, statics):
        row = int(np.argmax(np.abs(recording.external_force)))
        findings.append(found(
            recording, row, NOTE, f'external_force is {recording.external_force[row]:.4g} N '
            f'there, beyond the blocking force of {statics.blocking_force:.4g} N',
            'check its unit'))
    return findings


def check_range(recording, statics):
    """Note a command that hardly uses the device's range, or leaves it."""
    if not recording.command_name or not np.any(recording.command):
        return recording, []
    name, unit = recording.command_name, UNITS[recording.command_name]
    low, high = float(recording.command.min()), float(recording.command.max())
    limit = statics.limit(recording.drive)
    if max(-low, high) < _LEAST * limit:
        return recording, [found(
            recording, None, NOTE, f'{name} reaches {max(-low, high):.3g} {unit} of {limit:.3g}',
            f'if it is not in {unit}, give its unit, as in --unit {name}=k{unit}')]
    if low < statics.lowest(recording.drive) - 0.1 * limit or high > 1.1 * limit:
        worst = int(np.argmin(recording.command)) if -low > high - limit else int(
            np.argmax(recording.command))
        return recording, [found(
            recording, worst, NOTE, f'{name} is {recording.command[worst]:.4g} {unit} there, '
            f"outside the device's range", 'the model is not made for it')]
    return recording, []


def check_connected(recording, expected):
    """
    Leave out channels that hardly move, and not with the inputs, although they should.

    Parameters
    ----------
    recording : Recording
        To check.
    expected : dict of str to ndarray
        What each channel should do.

    """
    findings = []
    for channel, values in list(recording.measured.items()):
        wanted, moved = spread(expected[channel]), spread(values)
        if not wanted or moved > 0.01 * wanted or np.ptp(values) == 0.0:
            continue
        alike = abs(np.corrcoef(values, expected[channel])[0, 1])
        if alike < 0.2:
            findings.append(found(
                recording, 0, REPAIRED,
                f'{channel} is noise of {moved:.3g} {UNITS[channel]} where it should move by '
                f'{wanted:.3g}', f'not connected? {channel} of this recording is not used'))
            recording = without(recording, channel)
    return recording, findings
