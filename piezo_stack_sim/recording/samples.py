# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Preflight of single samples: missing values, dead, clipped and standing channels, zeros."""

from itertools import combinations

import numpy as np

from piezo_stack_sim.recording.finding import found, NOTE, refuse, REPAIRED

_SHORT_RUN = 5
_FILLED = 0.1
_FEWEST_ROWS = 20
# A run of equal values this long, while the command moves the channel by this part of its range.
_CLIPPED_RUN = 8
_STANDING_RUN = 25
_MOVED = 0.03
# Part of a channel's range by which it comes and goes during a force that only seems to be held.
_WENT_ON = 0.01
# No unit makes a quantity of a stack that large.
_ABSURD = 1e30
_SPIKE = 10.0
# Part of the range from which jumps to and fro are noise, and part of them that two channels with
# the same numbers may differ by: the last digits that were written.
_ROUGH, _ALIKE = 1e-6, 1e-2
# A constant that stands for no answer is there so often, and in less than this part of the rows.
_REPEATED, _STAND_INS = 3, 0.2
# What no stack is given: a force (N), a voltage (V), a charge (C).
_CRUSHING, _IMPOSSIBLE = 1e5, {'voltage': 2e3, 'charge': 0.1}
# Part of a channel's range that is a jump.
_LEAP = 0.3
# Part of the rows up to which an input that leaves its rest is a pulse.
_RARE = 0.05
# An offset that is no noise, disturbance or drift, as a part of the channel's range.
_OFFSET = 0.02
# Rows after which a jump of the command or the force has shown, times the noise from which it
# would, and the part of their range that counts as none.
_JUMPED, _SEEN, _ZERO = 5, 10.0, 0.01


def runs_of(flags):
    """Return (start, end) of each run of True values, shape (runs, 2)."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], flags, [False])).astype(np.int8)))
    return edges.reshape(-1, 2)


def without(recording, channel):
    """Return the recording without a measured channel."""
    return recording.replace(
        measured={name: x for name, x in recording.measured.items() if name != channel})


def check_numbers(recording):
    """
    Count as missing what is no measurement: infinities, absurd sizes, lone spikes.

    Drivers write such numbers (inf, 1e38, -9999) where a sensor did not answer.

    Returns
    -------
    tuple of (Recording, list of Finding)

    """
    findings, changes, measured = [], {}, dict(recording.measured)
    excited, jumps = _excited(recording), _jumps(recording)
    for name in ('time', 'command', 'external_force', *measured):
        values = measured[name] if name in measured else getattr(recording, name)
        absurd = np.isinf(values) | (np.abs(values) > _ABSURD)
        finite = np.where(absurd, np.nan, values)
        jumped = jumps & _within_reach(finite)
        if name in measured:
            absurd |= (_spikes(finite) | _stand_ins(finite)) & ~excited & ~jumped
        elif name != 'time':
            impossible = _unanswered(recording, name, finite) & ~jumped
            absurd |= _lone((_spikes(finite) | (np.abs(finite) > _CRUSHING)) & impossible)
        if not absurd.any():
            continue
        first = int(np.argmax(absurd))
        shown = recording.command_name or name if name == 'command' else name
        findings.append(found(
            recording, first, REPAIRED,
            f'{shown} has impossible values in {absurd.sum()} rows, here {values[first]:.6g}',
            'they count as missing'))
        (measured if name in measured else changes)[name] = np.where(absurd, np.nan, values)
    return recording.replace(measured=measured, **changes), findings


def _spikes(values):
    """Return which values lie ten times the channel's range away, if they are few."""
    finite = values[np.isfinite(values)]
    if finite.size < _FEWEST_ROWS:
        return np.zeros(values.size, dtype=bool)
    low, high = np.percentile(finite, (1.0, 99.0))
    far = np.nan_to_num(np.abs(values - 0.5 * (low + high))) > _SPIKE * (high - low)
    return far & (high > low) & (np.mean(far) < 0.01)


def _stand_ins(values):
    """Return which values are a constant far beyond all others: what stands for no answer."""
    none = np.zeros(values.size, dtype=bool)
    for extreme in (np.nanmin, np.nanmax):
        finite = np.isfinite(values) & ~none
        if np.count_nonzero(finite) < _FEWEST_ROWS:
            break
        same = finite & (values == extreme(values[finite]))
        others = values[finite & ~same]
        if others.size < _FEWEST_ROWS or not (
                _REPEATED <= np.count_nonzero(same) < _STAND_INS * others.size):
            continue
        low, high = np.percentile(others, (1.0, 99.0))
        away = abs(float(values[same][0]) - 0.5 * (low + high))
        if high > low and away > _SPIKE * (high - low):
            none |= same
    return none


def _lone(far):
    """Return those of some rows that stand alone, or by twos."""
    for start, end in runs_of(far):
        if end - start > 2:
            far[start:end] = False
    return far


def _unanswered(recording, name, values):
    """Return at which rows an input that far off cannot have been."""
    if name == 'external_force':
        return np.abs(values) > _CRUSHING
    answer = recording.measured.get(recording.drive)
    if answer is None:
        return np.abs(values) > _IMPOSSIBLE.get(recording.drive, np.inf)
    # Rows are sampled before their command takes effect.
    seen = np.maximum(np.abs(answer), np.abs(np.append(answer[1:], answer[-1])))
    return (values != 0.0) & ~(seen > 0.1 * np.abs(values))


def _jumps(recording):
    """
    Return the rows until the first input has shown, and those about lone ones far from the others.

    Row 0 is sampled before its command takes effect: where that is a bias, the device jumps from
    rest to it, and nothing comes back to where it began.
    """
    jumps = np.zeros(len(recording), dtype=bool)
    away = np.zeros(len(recording), dtype=bool)
    for values in (recording.command, recording.external_force):
        finite = np.where(np.abs(values) < _ABSURD, values, np.nan)
        size = np.nan_to_num(np.abs(finite))
        away |= size > _ZERO * np.max(size)
        for start, end in runs_of(_spikes(finite)):
            jumps[start:end + _FEWEST_ROWS] = True
    jumps[:int(np.argmax(away)) + _FEWEST_ROWS if away.any() else 1] = True
    return jumps


def _within_reach(values):
    """Return which values lie between rest and the overshoot of what follows."""
    finite = values[np.isfinite(values)]
    return np.abs(values) <= 2.0 * np.abs(np.median(finite)) if finite.size else values > np.inf


def _excited(recording):
    """Return the rows about a pulse of an input that rests otherwise: what answers is no spike."""
    excited = np.zeros(len(recording), dtype=bool)
    for values in (recording.command, recording.external_force):
        finite = np.where(np.abs(values) < _ABSURD, values, np.nan)
        if np.isnan(finite).all():
            continue
        rest = np.nanmedian(finite)
        away = np.nan_to_num(np.abs(finite - rest)) > _ZERO * np.ptp(finite[~np.isnan(finite)])
        if 0.0 < np.mean(away) < _RARE:
            for start, end in runs_of(away):
                # It may come late, and last as long again.
                after = max(end - start, _FEWEST_ROWS)
                excited[max(start - _FEWEST_ROWS, 0):end + after] = True
    return excited


def check_missing(recording):
    """
    Fill in missing measured values where they are few, else leave the channel out.

    Rows at the ends in which a few are missing are left out.

    Returns
    -------
    tuple of (Recording, list of Finding)

    Raises
    ------
    RefusedError
        Too many are missing of the only channel.

    """
    findings = []
    for channel in recording.measured:
        values = recording.measured[channel]
        bad = ~np.isfinite(values)
        if not bad.any():
            continue
        first = int(np.argmax(bad))
        what = f'{channel} is missing in {bad.sum()} of {bad.size} rows'
        stride = _stride(bad)
        runs = runs_of(bad)
        longest = int((runs[:, 1] - runs[:, 0]).max())
        if stride or (longest <= _SHORT_RUN and bad.sum() <= _FILLED * bad.size):
            how = f'measured every {stride}th row only: ' if stride else ''
            filled, mend = _filled_in(recording, channel, bad)
            findings.append(found(recording, first, REPAIRED, what, how + mend))
            recording = filled
        elif bad.all() or len(recording.measured) > 1:
            findings.append(found(recording, first, REPAIRED, what,
                                  f'{channel} of this recording is not used'))
            recording = without(recording, channel)
        elif runs[-1][1] == bad.size and 2 * runs[-1][0] > bad.size \
                and not bad[:runs[-1][0]].any():
            findings.append(found(recording, first, REPAIRED, what,
                                  f'only the {first} rows before are used'))
            recording = recording.take(slice(0, first))
        else:
            raise refuse(recording, first, what, 'record it again')
    return recording, findings


def _filled_in(recording, channel, bad):
    """
    Return the recording with lines through missing samples, and what was done, in words.

    Nothing tells of the samples before the first one that is there and after the last: these rows
    are left out, unless something else jumps in the first of them, as from rest to a bias.
    """
    rows = np.arange(bad.size)
    good = rows[~bad]
    values = np.interp(rows, good, recording.measured[channel][good])
    start, end = int(good[0]), int(good[-1]) + 1
    mend = [] if bad[start:end].sum() == 0 else ['filled in by straight lines']
    if start and any(abs(x[start] - x[0]) > _LEAP * np.ptp(x)
                     for name, x in recording.measured.items() if name != channel):
        mend.append(f'the first {start} rows, in which others jump, hold the value that follows')
        start = 0
    left_out = [f'the {which} {count} rows are left out' for which, count in
                (('first', start), ('last', bad.size - end)) if count]
    recording = recording.replace(
        measured={**recording.measured, channel: values},
        filled={**recording.filled, channel: bad | recording.filled.get(channel, False)})
    if left_out:
        recording = recording.take(slice(start, end))
        recording = recording.replace(time=recording.time - recording.time[0])
    return recording, ', '.join([*mend, *left_out])


def _stride(bad):
    """Return m when a channel has a value every m-th row throughout, else 0."""
    good = np.flatnonzero(~bad)
    if good.size < 4 or good.size > 0.6 * bad.size:
        return 0
    step = np.diff(good)
    stride = int(np.median(step))
    whole = np.mean(step == stride) > 0.95 and step.max() <= 3 * stride
    return stride if whole and 2 <= stride <= 50 else 0


def check_length(recording):
    """Refuse a recording with too few rows to say anything."""
    if len(recording) < _FEWEST_ROWS:
        raise refuse(recording, None, f'only {len(recording)} rows',
                     f'at least {_FEWEST_ROWS} are needed')
    return recording, []


def check_own(recording):
    """
    Refuse two channels that hold the same numbers: no two sensors have one noise.

    Raises
    ------
    RefusedError
        With the two names.

    """
    quiet = max(map(_roughness, (recording.command, recording.external_force)))
    for one, other in combinations(recording.measured, 2):
        a, b = recording.measured[one], recording.measured[other]
        rough = _roughness(a)
        # What the inputs shake, shakes all that follows them alike.
        noisy = rough > max(_ROUGH, _SEEN * quiet)
        if np.ptp(a) and (np.array_equal(a, b) or (noisy and _left_of(b, a) < _ALIKE * rough)):
            raise refuse(recording, None, f'{other} is {one}, row by row, but for a factor: the '
                         'noise is the same', 'map the right column, as in '
                         f'--map {other}=..., or take one of them out')
    return recording, []


def _roughness(values):
    """Return how far values jump to and fro from row to row, of their range; 0 if smooth."""
    bend = np.diff(values, 2)
    to_and_fro = np.mean(bend[1:] * bend[:-1] < 0.0) > 0.5
    return float(np.median(np.abs(bend)) / np.ptp(values)) if to_and_fro else 0.0


def _left_of(values, guide):
    """Return the rms of what a line along a guide leaves of values, of their range."""
    if not np.ptp(values):
        return np.inf
    values, guide = ((each - np.mean(each)) / np.ptp(each) for each in (values, guide))
    rest = values - guide * (guide @ values) / (guide @ guide)
    return float(np.sqrt(np.mean(rest**2)))


def check_alive(recording, expected):
    """
    Leave out channels that never move although the inputs should move them.

    Parameters
    ----------
    recording : Recording
        To check.
    expected : dict of str to ndarray
        What a model without memory expects of each channel; {} when there is no device.

    Returns
    -------
    tuple of (Recording, list of Finding)

    """
    findings = []
    for channel, values in list(recording.measured.items()):
        moved = np.ptp(expected[channel]) if channel in expected else max(
            np.ptp(recording.command), np.ptp(recording.external_force))
        if moved > 0.0 and np.ptp(values) == 0.0:
            findings.append(found(
                recording, 0, REPAIRED, f'{channel} is {values[0]:.6g} in every row',
                f'not connected? {channel} of this recording is not used'))
            recording = without(recording, channel)
    return recording, findings


def check_clipped(recording, expected):
    """
    Note where a channel stands still while it should move: at its extremes, or in between.

    An amplifier at its rail looks like that too, so that nothing is repaired.

    """
    findings = []
    for channel, values in recording.measured.items():
        guide = expected.get(channel, recording.command)
        span = np.ptp(guide)
        equal = runs_of(np.diff(values) == 0.0)
        equal = equal[equal[:, 1] - equal[:, 0] >= _CLIPPED_RUN - 1]
        if not span or not equal.size:
            continue
        low, high = values.min(), values.max()
        clipped, standing = [], []
        for start, end in equal:
            # The last row is sampled before its inputs take effect.
            if np.ptp(guide[start:end]) < _MOVED * span:
                continue
            if values[start] in (low, high):
                clipped.append((start, end))
            elif end - start >= _STANDING_RUN:
                standing.append((start, end))
        for places, what, mend in (
            (clipped, 'is cut off at', 'the range of the sensor, or the rail of the amplifier'),
            (standing, 'stands still at', 'samples repeated by the recorder, or friction'),
        ):
            if places:
                rows = sum(end - start + 1 for start, end in places)
                findings.append(found(
                    recording, places[0][0], NOTE,
                    f'{channel} {what} {values[places[0][0]]:.6g} in {rows} rows', mend))
    return recording, findings + _clipped_force(recording)


def _clipped_force(recording):
    """
    Return a note of a force that stands at its extreme while what it moves rises and falls.

    A force that is held is followed by creep, which does not come back.
    """
    force, clipped = recording.external_force, []
    equal = runs_of(np.diff(force) == 0.0)
    for start, end in equal[equal[:, 1] - equal[:, 0] >= _CLIPPED_RUN - 1]:
        extreme = force[start] and force[start] in (force.min(), force.max())
        if extreme and np.ptp(recording.command[start:end]) == 0.0 and any(
                _bulge(values[start:end + 1]) > _WENT_ON * np.ptp(values)
                for values in recording.measured.values()):
            clipped.append((start, end))
    if not clipped:
        return []
    rows = sum(end - start + 1 for start, end in clipped)
    return [found(recording, clipped[0][0], NOTE, 'external_force is cut off at '
                  f'{force[clipped[0][0]]:.6g} in {rows} rows, in which what it moves goes on',
                  'the range of the force sensor')]


def _bulge(values):
    """Return how far the middle third of values lies beyond both outer ones, on one side."""
    first, middle, last = (np.mean(each) for each in np.array_split(values, 3))
    up, down = middle - first, middle - last
    return min(abs(up), abs(down)) if up * down > 0.0 else 0.0


def _rest(recording):
    """Return how many rows at the beginning have the inputs of the first row, up to 200."""
    moved = (recording.command != recording.command[0]) | (
        recording.external_force != recording.external_force[0])
    # The row at which the input changes is sampled just before the change.
    return min(int(np.argmax(moved)) + 1 if moved.any() else len(recording), 200)


def _start_of(recording, command_range, statics):
    """
    Return the command (V) and the force (N) under which a device rested before the recording.

    Where it had been led to its first command, the voltage is there in the first row, before
    that takes effect.  And what follows command and force does not jump after it.
    """
    first = float(recording.command[0]) if recording.drive == 'voltage' else 0.0
    first = first if abs(first) > _ZERO * command_range else 0.0
    force = float(recording.external_force[0])
    force = force if abs(force) > _ZERO * np.max(np.abs(recording.external_force)) else 0.0
    if first and 'voltage' in recording.measured:
        there = abs(recording.measured['voltage'][0] - first) < 0.5 * abs(first)
        return (first, force) if there else (0.0, 0.0)
    if not (first or force) or statics is None:
        return 0.0, 0.0
    answer = statics.answer(recording.drive, np.array([first]), np.array([force]))
    row = min(_JUMPED, len(recording) - 1)
    for channel, values in recording.measured.items():
        wanted = abs(float(answer[channel][0]))
        if channel != recording.drive and wanted > _SEEN * np.median(np.abs(np.diff(values))):
            rests = abs(values[row] - values[0]) < 0.3 * wanted
            return (first, force) if rests else (0.0, 0.0)
    return 0.0, 0.0


def check_start(recording, command_range, statics=None):
    """
    Zero charge and displacement where the recording begins, if it begins at rest.

    Their origin is arbitrary, that of the voltage is not.  A device that was led to its first
    command before rests there, and is to be simulated from there.

    Parameters
    ----------
    recording : Recording
        To check.
    command_range : float
        The size of the command against which the first one counts as zero.
    statics : Statics, optional
        The device, whose answer to the first command and force tells whether it rested there.

    Returns
    -------
    tuple of (Recording, list of Finding)

    """
    findings, measured = [], {}
    resting = abs(recording.command[0]) <= _ZERO * command_range
    start = _start_of(recording, command_range, statics)
    led = any(start)
    if led:
        at = ' and '.join(f'{value:.4g} {unit}' for value, unit in zip(start, 'VN') if value)
        findings.append(found(
            recording, 0, NOTE, f'the device rests at {at} where it begins',
            'it is simulated from there: charge and displacement count from that row'))
        recording = recording.replace(start=start)
    # The first row is sampled before its command; only a command that rests rests after it.
    rows = _rest(recording) if resting or led else 1
    for channel, values in recording.measured.items():
        begins = float(np.mean(values[:rows]))
        if led and not resting and channel == 'voltage':
            continue
        if channel == 'displacement' and recording.arbitrary:
            least = 0.0  # a sensor of unknown scale has an unknown zero, too
        else:
            # Less may be noise, a disturbance or a drift, which are not for preflight to remove.
            noise = float(np.median(np.abs(np.diff(values)))) / rows**0.5
            least = max(_OFFSET * np.ptp(values), 10.0 * noise)
        if abs(begins) <= least:
            continue
        what = f'{channel} begins at {begins:.4g}, not at zero'
        if channel == 'voltage' or not (resting or led):
            if resting or recording.drive not in ('voltage', 'charge'):
                mend = 'an offset of the driver or of its monitor'
            else:
                mend = ('kept: the device was not at rest, a model that begins relaxed is wrong '
                        'at first')
            findings.append(found(recording, 0, NOTE, what, mend))
            continue
        measured[channel] = values - begins
        findings.append(found(recording, 0, REPAIRED, what,
                              f'the mean of the first {rows} rows is taken off'))
    return recording.replace(measured={**recording.measured, **measured}), findings
