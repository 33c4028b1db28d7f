# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Preflight of the times: order, duplicates, unit, jitter, lost rows."""

import numpy as np

from piezo_stack_sim.recording.finding import found, NOTE, refuse, REPAIRED
from piezo_stack_sim.recording.grid import find_grid

# Rows that may be missing in one place, and altogether, to be filled in.
_SHORT_GAP = 5
_FILLED = 0.1
_MISPLACED = 0.05
# Rows in a row that come equally far apart are no chance.
_ANOTHER_RATE = 20
# Part of the rows from which rows that share a time, but not their values, tell of few digits.
_COARSE = 0.02
# Times since 1970 in ns, us and ms are beyond these; no run of a device in seconds is.
_EPOCHS = ((1e17, 1e-9, 'ns'), (1e14, 1e-6, 'us'), (1e11, 1e-3, 'ms'))
_SLOWEST, _FASTEST = 10.0, 1e-8
_SLOW = 0.5


def _columns(recording):
    return (recording.command, recording.external_force, *recording.measured.values())


def check_inputs_complete(recording):
    """
    Take out rows without a time or an input; empty input cells may also mean "unchanged".

    Returns
    -------
    tuple of (Recording, list of Finding)

    Raises
    ------
    RefusedError
        More than every fifth row has no time.

    """
    findings = []
    filled = {}
    for name in ('command', 'external_force'):
        values = getattr(recording, name)
        missing = ~np.isfinite(values)
        if np.mean(missing) > 0.2 and not missing.all():
            # Written when it changes only: it holds until the next one, as commands do.
            last = np.maximum.accumulate(np.where(missing, -1, np.arange(values.size)))
            filled[name] = np.where(last < 0, 0.0, values[np.maximum(last, 0)])
            what = recording.command_name if name == 'command' else name
            findings.append(found(
                recording, int(np.argmax(missing)), REPAIRED,
                f'{what} is empty in {missing.sum()} rows', 'it holds there until its next value'))
    if not np.isfinite(recording.external_force).any():
        filled['external_force'] = np.zeros(len(recording))
        findings.append(found(recording, None, NOTE, 'external_force is empty throughout',
                              'none counts as applied'))
    recording = recording.replace(**filled)
    bad = ~(np.isfinite(recording.time) & np.isfinite(recording.command)
            & np.isfinite(recording.external_force))
    if not bad.any():
        return recording, findings
    if np.mean(bad) > 0.2:
        raise refuse(recording, int(np.argmax(bad)),
                     f'{bad.sum()} of {bad.size} rows lack a time or an input',
                     'record them again')
    findings.append(found(
        recording, int(np.argmax(bad)), REPAIRED, f'{bad.sum()} rows lack a time or an input',
        'they count as lost rows'))
    return recording.take(~bad), findings


def check_order(recording):
    """
    Drop rows that are there twice and put rows in order that were swapped.

    Returns
    -------
    tuple of (Recording, list of Finding)

    Raises
    ------
    RefusedError
        When the time goes back otherwise: several runs, or a clock that was set.

    """
    findings = []
    order = np.argsort(recording.time, kind='stable')
    twice = np.zeros(len(recording), dtype=bool)
    equal = np.diff(recording.time[order]) == 0.0
    same = equal.copy()
    for values in _columns(recording):
        step = values[order][1:] - values[order][:-1]
        same &= (step == 0.0) | np.isnan(step)
    # Of times with too few digits many rows share one, and those at rest share their values, too.
    coarse = (np.count_nonzero(equal & ~same) > max(_COARSE * equal.size, 2)
              and find_grid(recording.time[order]) is not None)
    if not coarse:
        twice[order[1:][same]] = True
    if twice.any():
        findings.append(found(recording, int(np.argmax(twice)), REPAIRED,
                              f'{twice.sum()} rows are there twice', 'the second one is dropped'))
        recording = recording.take(~twice)
    back = np.flatnonzero(np.diff(recording.time) < 0.0)
    if back.size:
        order = np.argsort(recording.time, kind='stable')
        moved = np.count_nonzero(order != np.arange(order.size))
        swapped = recording.take(order)
        grid = find_grid(swapped.time)
        fits = grid is not None and grid.kind == 'regular'
        if not fits or moved > max(_MISPLACED * order.size, 2):
            jump = recording.time[back[0]] - recording.time[back[0] + 1]
            raise refuse(recording, back[0] + 1, f'the time goes back by {jump:.6g} s',
                         'split the file there if it holds two runs')
        findings.append(found(recording, back[0] + 1, REPAIRED, f'{moved} rows are out of order',
                              'sorted by time, which then is regular'))
        recording = swapped
    equal = np.concatenate(([False], np.diff(recording.time) == 0.0))
    # Equal times that belong to a grid arrived together, or have too few digits; check_grid
    # spreads them out.
    if equal.any() and np.mean(equal) < 0.02 and find_grid(recording.time) is None:
        findings.append(found(
            recording, int(np.argmax(equal)), REPAIRED,
            f'{equal.sum()} rows have the time of the row before, but other values',
            'the first of each is kept'))
        recording = recording.take(~equal)
    return recording, findings


def check_unit(recording):
    """
    Bring times since 1970 in ms, us or ns to seconds, and count from the first row.

    Returns
    -------
    tuple of (Recording, list of Finding)

    Raises
    ------
    RefusedError
        Rows so far apart that the unit must be another one.

    """
    recording, findings = check_scale(recording)
    time = recording.time
    if time[0] != 0.0:
        findings.append(found(recording, 0, NOTE, f'time begins at {time[0]:.9g} s',
                              'counted from the first row'))
    return recording.replace(time=time - time[0]), findings


def check_scale(recording):
    """
    Bring times since 1970 in ms, us or ns to seconds; others are kept as they are.

    Returns
    -------
    tuple of (Recording, list of Finding)

    Raises
    ------
    RefusedError
        Rows so far apart that the unit must be another one.

    """
    time, findings = recording.time, []
    for limit, scale, unit in _EPOCHS:
        if abs(time[0]) > limit:
            findings.append(found(recording, 0, REPAIRED, f'time begins at {time[0]:.6g}',
                                  f'taken as {unit} since 1970'))
            time = (time - time[0]) * scale
            break
    step = float(np.median(np.diff(time))) if time.size > 1 else 0.0
    mend = 'give its unit, as in --unit time=ms (or time=s)'
    if (step > _SLOWEST and not recording.timed) or 0.0 < step < _FASTEST:
        raise refuse(recording, 0, f'rows are {step:.6g} s apart: time is hardly in s', mend)
    if step > _SLOW and not recording.timed:
        findings.append(found(recording, 0, NOTE, f'rows are {step:.6g} s apart',
                              f'if time is not in s, {mend}'))
    return recording.replace(time=time), findings


def check_grid(recording):
    """
    Undo the jitter of times of arrival and fill in the few rows that were lost.

    Returns
    -------
    tuple of (Recording, list of Finding)

    Raises
    ------
    RefusedError
        Too many rows lost, or so many in one place that what the device did there is unknown.

    """
    grid = find_grid(recording.time)
    if grid is None:
        return _irregular(recording)
    findings = []
    change = _change_of_rate(grid)
    if change is not None:
        steps = np.diff(recording.time)[[change - 1, change]]
        return recording, [found(
            recording, change, NOTE, f'the sampling changes there, from rows {steps[0]:.6g} s '
            f'apart to {steps[1]:.6g} s', 'the times are kept; split the file there to have each '
            'rate by itself')]
    off = np.abs(recording.time - grid.times)
    if grid.kind == 'jittered':
        findings.append(found(
            recording, 0, REPAIRED,
            f'the times jitter by {grid.jitter:.3g} s about rows {grid.period:.6g} s apart',
            'put back on that grid'))
        recording = recording.replace(time=grid.times - grid.times[0])
    elif off.max() > 0.01 * grid.period and np.diff(grid.index).max() == 1:
        findings.append(found(
            recording, int(np.argmax(off)), NOTE,
            f'the times are rounded by up to {off.max():.3g} s',
            f'put on a grid of {grid.period:.9g} s'))
        recording = recording.replace(time=grid.times - grid.times[0])
    recording, index, more = _cut(recording, grid.index)
    recording, last = _filled(recording, index, grid.period)
    return recording, [*findings, *more, *last]


def _change_of_rate(grid):
    """Return the first row after which rows come at another rate for good; None without one."""
    steps = np.diff(grid.index)
    bounds = np.flatnonzero(np.diff(steps)) + 1
    runs = list(zip([0, *bounds], [*bounds, steps.size]))
    # What is lost by chance is not lost alike for long.
    if not any(steps[start] > 1 and end - start >= _ANOTHER_RATE for start, end in runs):
        return None
    long = [start for start, end in runs if end - start >= _ANOTHER_RATE]
    return next((int(b) for a, b in zip(long, long[1:]) if steps[a] != steps[b]), None)


def _irregular(recording):
    step = np.diff(recording.time)
    if step.size and step.min() <= 0.0:
        raise refuse(recording, int(np.argmin(step)) + 1,
                     f'{np.count_nonzero(step <= 0)} rows have the time of the row before',
                     'write the time with more digits')
    if not step.size or step.max() < 1.05 * step.min():
        return recording, []
    return recording, [found(
        recording, int(np.argmax(step)) + 1, NOTE,
        f'sampled irregularly, {step.min():.3g} to {step.max():.3g} s apart',
        'the times are kept')]


def _held(recording, row):
    """Return whether the inputs rest before and after the gap that follows a row."""
    around = slice(max(row - 3, 0), row + 5)
    return all(np.ptp(values[around]) == 0.0
               for values in (recording.command, recording.external_force))


def _cut(recording, index):
    """End the recording at the first gap through which the inputs are unknown."""
    held = []
    for row in np.flatnonzero(np.diff(index) - 1 > _SHORT_GAP):
        lost = int(index[row + 1] - index[row] - 1)
        lasting = recording.time[row + 1] - recording.time[row]
        if _held(recording, row):
            held.append((row, lost, lasting))
            continue
        findings = _held_gaps(recording, held)
        what = f'{lost} rows are missing, {lasting:.3g} s'
        mend = 'what was commanded there is unknown'
        if 2 * (row + 1) < len(recording):
            raise refuse(recording, row + 1, what, f'{mend}: record it again, or cut the file so '
                         'that it begins with the device at rest')
        findings.append(found(recording, row + 1, REPAIRED, what,
                              f'{mend}: only the {row + 1} rows before it are used'))
        return recording.take(slice(0, row + 1)), index[:row + 1], findings
    return recording, index, _held_gaps(recording, held)


def _held_gaps(recording, gaps):
    """Return one note of gaps (row before, rows lost, duration) in which the inputs rest."""
    if not gaps:
        return []
    rows, lost, lasting = zip(*gaps)
    places, each = ('', 'it') if len(gaps) == 1 else (f' in {len(gaps)} places', 'each')
    return [found(recording, rows[0] + 1, NOTE, f'{sum(lost)} rows are missing{places}, '
                  f'{"up to " * bool(places)}{max(lasting):.3g} s',
                  f'the inputs rest before and after {each} and count as held')]


def _is_smooth(values, gaps):
    """
    Tell of gaps after rows ``gaps`` whether a cubic or a line fills them.

    Whichever tells the rows around them better, each left out in turn: beside a jump or a corner,
    and in mere noise, that is a line.
    """
    if values.size < 5:
        return np.zeros(gaps.size, dtype=bool)
    near, far = values[3:-1] + values[1:-3], values[4:] + values[:-4]
    wrong = np.full((2, values.size), np.inf)
    wrong[0, 2:-2] = np.abs(values[2:-2] - near / 2.0)
    wrong[1, 2:-2] = np.abs(values[2:-2] - (4.0 * near - far) / 6.0)
    around = np.clip(gaps[:, None] + np.arange(-2, 4), 0, values.size - 1)
    line, curve = wrong[:, around].max(axis=-1)
    return curve < line


def _filled(recording, index, period):
    """Put in the rows that are missing in short gaps: by a curve where that tells its likes."""
    gaps = np.diff(index) - 1
    short = np.flatnonzero((gaps > 0) & (gaps <= _SHORT_GAP))
    lost = int(gaps[short].sum())
    if not lost:
        return recording, []
    if lost > _FILLED * len(recording):
        raise refuse(recording, short[0] + 1, f'{lost} rows are missing in {short.size} places, '
                     f'of {len(recording) + lost}', 'record it again without losing rows')
    missing = np.concatenate([np.arange(index[k] + 1, index[k + 1]) for k in short])
    every = np.sort(np.concatenate((index, missing)))
    place = np.searchsorted(every, index)

    def fill(values):
        line = np.interp(every, index, values)
        smooth = short[_is_smooth(values, short)]
        if not smooth.size or not np.isfinite(values).all():
            return line
        from scipy.interpolate import CubicSpline
        gap = np.searchsorted(index, missing) - 1
        curved = np.zeros(every.size, dtype=bool)
        curved[np.searchsorted(every, missing[np.isin(gap, smooth)])] = True
        return np.where(curved, CubicSpline(index, values)(every), line)

    known = np.zeros(every.size, dtype=np.int64)
    known[place] = np.arange(1, index.size + 1) if recording.rows is None else recording.rows
    filled = {}
    for name in recording.measured:
        filled[name] = np.ones(every.size, dtype=bool)
        filled[name][place] = recording.filled.get(name, False)
    more = found(recording, short[0] + 1, REPAIRED,
                 f'{lost} rows were lost in {short.size} places', 'filled in by those around')
    return recording.replace(
        time=fill(recording.time),
        command=fill(recording.command),
        external_force=fill(recording.external_force),
        measured={name: fill(values) for name, values in recording.measured.items()},
        rows=known,
        filled=filled,
    ), [more]
