# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Bags into recordings: many topics, each with its own times, become rows.

The rows are the messages of one topic: a stamped one if there is one (`~/state`), else the
measured topic with the most messages; the commands when they come half as often again, or when
nothing was measured. A device applies a command when it arrives, so a row's command is the last
one that arrived before the next row's message: the one in force when the device went from this
sample to the next. That needs no clocks to agree and is exact for a device that is stepped by its
commands. Other measured topics of the same rate are joined message by message, those of other
rates are interpolated.
"""

from array import array
from dataclasses import dataclass, field

import numpy as np

from piezo_stack_sim.errors import InputError
from piezo_stack_sim.recording.assemble import (
    assemble, checked_drive, INPUTS, MAX_VALUES, thinned)
from piezo_stack_sim.recording.bag_file import damaged_is_input_error, open_bag
from piezo_stack_sim.recording.finding import Finding, NOTE, REPAIRED
from piezo_stack_sim.recording.grid import find_grid
from piezo_stack_sim.recording.recording import MEASURED
from piezo_stack_sim.recording.topics import choose_topics

DRIVE_KEY = 'piezo_stack_sim.drive'
# Columns beside the channels: 1 in rows that lie between the messages of a slower one.
_BETWEEN = 'between: '
_SLOWER = 0.8
# Before the first command the device is at rest; longer rest says nothing more.
_REST = 0.1
# Messages that tell a topic which is sent all the time; part of a recording without any.
_OFTEN, _SILENT = 20, 0.1
# Part of a channel's range that counts as none.
_MOVES = 0.05


@dataclass
class _Stream:
    """
    What is kept of what arrived for one channel: arrival (s), stamp (ns or None), value.

    Beside rows that are thinned out that is the last message before each kept row and the first
    two after it, so that a lost one shifts nothing.
    """

    arrival: array = field(default_factory=lambda: array('d'))
    stamp: list = field(default_factory=list)
    value: array = field(default_factory=lambda: array('d'))
    count: int = 0
    _last: tuple | None = None
    _wanted: int = 0

    def append(self, arrival, stamp, value):
        self.arrival.append(arrival)
        self.stamp.append(stamp)
        self.value.append(value)

    def pass_by(self, message):
        """Keep a message that follows a kept row closely, remember any other."""
        if self._wanted:
            self.append(*message)
            self._wanted -= 1
            self._last = None
        else:
            self._last = message

    def mark(self):
        """Keep the last message, and the next two: a row that is kept has arrived."""
        if self._last is not None:
            self.append(*self._last)
        self._last, self._wanted = None, 2


def _base_channel(source, sources):
    """Return the channel whose messages become the rows."""
    commands = [name for name in INPUTS[:2] if name in sources]
    measured = [name for name in MEASURED if name in sources]
    if not measured:
        if not commands:
            raise InputError(f'{source}: no topic of a command or a measurement with messages')
        return max(commands, key=lambda name: sources[name].count)
    base = max(measured, key=lambda name: (sources[name].stamped, sources[name].count))
    faster = [name for name in commands if sources[name].count > 1.5 * sources[base].count]
    return faster[0] if faster else base


class _Collector:
    """
    Rows built while the messages stream by, so that memory holds only what is kept.

    Of every `step` messages of the base topic one is kept, and of the others those around it. The
    inputs of a row are closed when the base topic's next message arrives; those of a kept row are
    the mean of its own and of the rows after it that are not kept, as they all act before the
    next kept row is sampled.

    """

    def __init__(self, sources, base, step):
        self.base, self.step = base, step
        self.by_topic = {}
        for each in sources.values():
            self.by_topic.setdefault(each.field.topic, []).append(each)
        for group in self.by_topic.values():
            # The base closes the row before anything else of the same message is taken in.
            group.sort(key=lambda each: each.channel != base)
        self.held = dict.fromkeys((name for name in INPUTS if name in sources), float('nan'))
        self.inputs = {name: array('d') for name in self.held}
        self.sums = dict.fromkeys(self.held, 0.0)
        self.streams = {name: _Stream() for name in sources if name in MEASURED or name == base}
        self.first_held = {}
        self.ends = {}  # of inputs: number of messages, first and last arrival, row of the last
        self.start, self.last = None, 0.0

    def take(self, topic, arrival, raw, unpack):
        """Take one message in."""
        self.start = arrival if self.start is None else self.start
        seconds = self.last = (arrival - self.start) / 1e9
        for each in self.by_topic[topic]:
            value, stamp = each.value(raw, unpack)
            if each.channel == self.base:
                self._close()
                if not self.streams[self.base].count:
                    self.first_held = dict(self.held)
            if each.channel in self.held:
                self.held[each.channel] = value
                count, first, *_ = self.ends.get(each.channel, (0, seconds))
                self.ends[each.channel] = (count + 1, first, seconds,
                                           self.streams[self.base].count)
            if each.channel in self.streams:
                self._keep_measured(each.channel, (seconds, stamp, value))

    def _keep_measured(self, channel, message):
        stream = self.streams[channel]
        if channel != self.base and self.step > 1:
            stream.pass_by(message)
        elif stream.count % self.step == 0:
            stream.append(*message)
            for name, other in self.streams.items():
                if name != self.base and self.step > 1:
                    other.mark()
        stream.count += 1

    def _close(self):
        """Give the last row the inputs that are in force now."""
        count = self.streams[self.base].count
        if count:
            for name, value in self.held.items():
                self.sums[name] += value
            if count % self.step == 0:
                self._keep(self.step)

    def _keep(self, rows):
        """Give the last kept row the mean of the inputs since."""
        for name, values in self.inputs.items():
            values.append(self.sums[name] / rows)
            self.sums[name] = 0.0

    def finish(self):
        """Close the last row."""
        self._close()
        rest = self.streams[self.base].count % self.step
        if rest:
            self._keep(rest)


def _died(source, collector):
    """Return notes of inputs that came again and again and end long before the rows do."""
    findings = []
    for name, (count, first, last, row) in collector.ends.items():
        silent = collector.last - last
        if (count > _OFTEN and silent * (count - 1) > _OFTEN * (last - first)
                and silent > _SILENT * collector.last):
            findings.append(Finding(
                source, max(row, 1), NOTE, f'{name} ends there, {silent:.4g} s before the '
                'recording does', 'its last value counts as held; cut the rest off, if whoever '
                'sent it died'))
    return findings


def _rate(stream):
    """Return messages a second."""
    span = stream.arrival[-1] - stream.arrival[0] if len(stream.arrival) > 1 else 0.0
    return (stream.count - 1) / span if span > 0.0 else 0.0


def _stamps(stream):
    """Return the stamps in ns, or None when there are none or all are zero."""
    if not stream.stamp or None in stream.stamp or not any(stream.stamp):
        return None
    return np.array(stream.stamp, dtype=np.int64)


def _same_ticks(first, second):
    """Return whether two topics of equally many messages were sent in pairs all along."""
    apart = second - first
    period = max(np.median(np.diff(first)), 1e-9) if len(first) > 1 else 1.0
    thirds = np.array_split(apart, 3) if len(apart) >= 3 else [apart]
    return all(abs(np.median(each)) < 0.6 * period for each in thirds)


def _nearest(base, other, period):
    """Return for each base row the index of the message within 0.6 periods, or -1."""
    after = np.clip(np.searchsorted(other, base), 1, len(other) - 1) if len(other) > 1 \
        else np.zeros(len(base), dtype=int)
    before = np.maximum(after - 1, 0)
    nearer = np.where(np.abs(other[before] - base) <= np.abs(other[after] - base), before, after)
    return np.where(np.abs(other[nearer] - base) <= 0.6 * period, nearer, -1)


def _phase(base, other, period):
    """Return how long after a base row its message comes, s, between - and + half a period."""
    near = _nearest(base, other, period)
    turns = (other[near[near >= 0]] - base[near >= 0]) / period
    return float(np.angle(np.sum(np.exp(2j * np.pi * turns)))) / (2.0 * np.pi) * period


def _by_grid(base, other):
    """Return for each base row the index of the message of the same period, or -1; or None."""
    grids = find_grid(base), find_grid(other)
    if None in grids or abs(grids[0].period / grids[1].period - 1.0) > 1e-3:
        return None
    slot = np.rint((grids[1].times - grids[0].origin) / grids[0].period).astype(np.int64)
    place = np.searchsorted(slot, grids[0].index)
    found = (place < len(slot)) & (slot[np.minimum(place, len(slot) - 1)] == grids[0].index)
    return np.where(found, place, -1)


def _join(source, name, base, other):
    """Return the other channel's values on the base rows, and Findings."""
    arrival, value = np.array(other.arrival), np.array(other.value)
    rows = np.array(base.arrival)
    findings = []
    if not len(arrival):
        raise InputError(f'{source}: {name} has no messages')
    whole = len(rows) == base.count
    if whole and len(arrival) == len(rows) and _same_ticks(rows, arrival):
        return value, findings
    stamps, own = _stamps(base), _stamps(other)
    if stamps is not None and own is not None:
        place = np.clip(np.searchsorted(own, stamps), 0, len(own) - 1)
        found = own[place] == stamps
        if np.mean(found) > 0.5 and np.all(np.diff(own) > 0):
            return np.where(found, value[place], np.nan), findings
        period = 1.0 / (_rate(base) or 1.0)
        offset = np.median(np.interp(rows, arrival, own * 1e-9) - stamps * 1e-9)
        if abs(offset) > period:
            findings.append(Finding(
                source, None, NOTE, f'the clock of {name} is {offset:.6g} s ahead of the others',
                'joined by the times of arrival'))
    rates = _rate(base), _rate(other)
    if rates[0] and 0.8 < rates[1] / rates[0] < 1.25:
        index = _by_grid(rows, arrival) if whole else None
        if index is None:
            period = 1.0 / rates[0]
            late = 0.0 if whole else _phase(rows, arrival, period)
            index = _nearest(rows + late, arrival, period)
        return np.where(index >= 0, value[index], np.nan), findings
    findings.append(Finding(
        source, None, NOTE, f'{name} came at {rates[1]:.4g} Hz, the rows at {rates[0]:.4g} Hz',
        f'{name} is interpolated between its messages'))
    return np.interp(rows, arrival, value), findings


def _between(rows, arrival):
    """Return which base rows (times, s) lie between messages of a slower topic: none is theirs."""
    if len(arrival) > _SLOWER * len(rows):
        return np.zeros(len(rows), dtype=bool)
    after = np.clip(np.searchsorted(rows, arrival), 1, len(rows) - 1)
    nearest = after - (arrival - rows[after - 1] < rows[after] - arrival)
    between = np.ones(len(rows), dtype=bool)
    between[nearest] = False
    return between


def _times(source, stream):
    """Return the rows' times from zero, s, and a Finding when they are times of arrival."""
    stamps = _stamps(stream)
    if stamps is not None:
        return (stamps - stamps[0]) / 1e9, []
    arrival = np.array(stream.arrival)
    return arrival - arrival[0], [Finding(
        source, None, NOTE, 'the messages carry no stamp', 'their times of arrival are used')]


def _rest(source, columns, rows, command, units):
    """
    Return the columns from shortly before the first command.

    Where it counts as zero, unless something else was held there, as the measured one tells.
    """
    waiting = np.flatnonzero(~np.isnan(columns[command]))
    first = int(waiting[0]) if waiting.size else len(rows)
    if first == 0:
        return columns, rows, []
    if first == len(rows):
        raise InputError(f'{source}: no {command} before the last row')
    start = int(np.searchsorted(columns['time'][:first], columns['time'][first] - _REST))
    what = f'{first} rows before the first {command}'
    port = command.removesuffix('_command')
    level = _held_level(columns.get(port), slice(start, first))
    if level is None:
        columns = {name: values[first:] for name, values in columns.items()}
        return columns, rows[first:], [Finding(
            source, int(rows[0]), REPAIRED, what,
            'left out: what was measured moves there, and nobody knows by which command')]
    columns = {name: values[start:] for name, values in columns.items()}
    level *= units.get(port, 1.0) / units.get(command, 1.0)
    columns[command] = np.concatenate(
        (np.full(first - start, level), columns[command][first - start:]))
    held = f'of {level:.6g}, as was measured' if level else 'of zero'
    return columns, rows[start:], [Finding(
        source, int(rows[0]), NOTE, what,
        f'the last {first - start} of them are kept, with a command {held}')]


def _held_level(measured, where):
    """Return at which command a device rests in some rows, None if it does not rest."""
    if measured is None or np.isnan(measured[where]).all():
        return 0.0
    span, before = np.nanmax(measured) - np.nanmin(measured), measured[where]
    if np.nanstd(before) > _MOVES * span:
        return None
    level = float(np.nanmedian(before))
    return level if abs(level) > _MOVES * span else 0.0


def _before_the_first(source, columns, rows, stream, held):
    """
    Put a row at rest before the answer to the very first command.

    A device that is stepped by its commands publishes nothing before the first of them: its first
    stamp is one period after zero.

    """
    stamps = _stamps(stream)
    command = next((name for name in INPUTS[:2] if held.get(name)), None)
    if stamps is None or len(stamps) < 2 or command is None or np.isnan(held[command]):
        return columns, rows, []
    period = float(np.median(np.diff(stamps))) * 1e-9
    if period <= 0.0 or abs(stamps[0] * 1e-9 - period) > 0.5 * period:
        return columns, rows, []
    row = {'time': columns['time'][0] - stamps[0] * 1e-9, **held}
    columns = {name: np.concatenate(([row.get(name, 0.0)], values))
               for name, values in columns.items()}
    return columns, np.concatenate(([0], rows)), [Finding(
        source, int(rows[1]), REPAIRED, 'the first message answers a command already',
        'a row at rest is put before it')]


def read_bag(path, mapping=None, units=None, max_values=MAX_VALUES):
    """
    Read one rosbag2 folder, MCAP file or sqlite3 file as one recording.

    Parameters
    ----------
    path : str or Path
        The bag.
    mapping : dict, optional
        From `parse_mapping`; entries for columns are ignored. Channels that are not mapped are
        taken from the topics of that name in whatever namespace.
    units : dict of str to float, optional
        From `parse_units`.
    max_values : int
        Numbers to keep at most; of a larger bag every m-th row is kept.

    Returns
    -------
    Recording
        Not yet checked by preflight.

    Raises
    ------
    InputError
        A bag that is damaged, or topics that are missing, ambiguous or no numbers.

    """
    with open_bag(path) as bag:
        source = bag.source
        with damaged_is_input_error(source):
            sources, findings = choose_topics(source, bag.topics, mapping or {})
            base = _base_channel(source, sources)
            # Arrival, stamp and value of each message.
            total = 3 * sum(each.count for each in sources.values())
            step = max(1, -(-total // max_values))
            collector = _Collector(sources, base, step)
            for message in bag.messages(collector.by_topic):
                collector.take(*message)
            collector.finish()
        stated = bag.stated.get(DRIVE_KEY)
    findings = [*bag.findings, *findings]
    stream = collector.streams[base]
    if not stream.value:
        raise InputError(f'{source}: {sources[base].field.topic} has no messages')
    if step > 1:
        findings.append(thinned(source, len(stream.value), step, max_values))
    findings += _died(source, collector)
    time, more = _times(source, stream)
    findings += more
    columns = {'time': time}
    columns.update((name, np.array(values)) for name, values in collector.inputs.items())
    for name in (each for each in MEASURED if each in sources):
        columns[name], more = _join(source, name, stream, collector.streams[name])
        if not np.isnan(columns[name]).any():
            columns[_BETWEEN + name] = _between(
                np.array(stream.arrival), np.array(collector.streams[name].arrival)).astype(float)
        findings += more
    rows = 1 + step * np.arange(len(time))
    for name in (each for each in INPUTS[:2] if each in columns and _moves(columns[each])):
        columns, rows, more = _rest(source, columns, rows, name, units or {})
        findings += more
    columns, rows, more = _before_the_first(source, columns, rows, stream, collector.first_held)
    findings += more
    columns['time'] = columns['time'] - columns['time'][0]
    between = {name: columns.pop(_BETWEEN + name) > 0.0 for name in MEASURED
               if _BETWEEN + name in columns}
    # No force was published before the first one.
    if 'external_force' in columns:
        columns['external_force'] = np.nan_to_num(columns['external_force'], nan=0.0)
    for name, factor in (units or {}).items():
        if name in columns:
            columns[name] = columns[name] * factor
        if name in columns and factor != 1.0:
            findings.append(Finding(source, None, NOTE, f'{name} is multiplied by {factor:g}',
                                    'as --unit says'))
    recording = assemble(
        source, columns, stated and checked_drive(source, stated), rows, findings)
    stated = {name: ('--unit', factor) for name, factor in (units or {}).items()
              if name in columns}
    return recording.replace(timed=True, stated=stated, filled={
        name: rows for name, rows in between.items() if rows.any()})


def _moves(values):
    """Return whether a command was ever given."""
    return bool(np.any(~np.isnan(values)))
