# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""CSV files, plain or gzipped, into recordings: fast for good files, exact about bad ones."""

import csv
import gzip
import io
from itertools import chain
import math
import re
import zlib

import numpy as np

from piezo_stack_sim.atomic import note_input
from piezo_stack_sim.errors import InputError
from piezo_stack_sim.recording.assemble import (
    assemble, checked_drive, COMMANDS, INPUTS, MAX_VALUES, thinned,
)
from piezo_stack_sim.recording.finding import Finding, NOTE, REPAIRED, shown
from piezo_stack_sim.recording.mapping import (
    boxed, boxed_channel, boxed_unit, CHANNELS, header_unit, suggestion, unit_scale)
from piezo_stack_sim.recording.recording import MEASURED, UNITS

_BLOCK = 1 << 22
_LOT = 1 << 16  # rows, which any step divides
_SPREADSHEET = re.compile(r'"?sep=.?"?', re.IGNORECASE)  # what tells Excel the separator
_LONGEST_LINE = 1 << 20
MINUS = '\u2212'
_MISSING = {'', 'nan', '-nan', '+nan', 'na', 'n/a', 'null', 'none'}
_PREAMBLE = 200  # lines below the first in which a header is looked for
_BROKEN = (EOFError, gzip.BadGzipFile, zlib.error)


def _raw_blocks(path):
    """Yield the bytes of a file, unpacked, in blocks; InputError for whatever goes wrong."""
    try:
        with open(note_input(path), 'rb') as file:
            magic = file.read(2)
            file.seek(0)
            packed = magic == b'\x1f\x8b'
            if not packed and str(path).lower().endswith('.gz'):
                what = 'is empty' if not magic else 'is not gzipped, whatever its name says'
                raise InputError(f'{path}: {what}')
            stream = gzip.GzipFile(fileobj=file) if packed else file
            while block := stream.read(_BLOCK):
                yield block
    except _BROKEN as error:
        raise InputError(
            f'{path}: damaged or truncated gzip ({error}): copy it again, or save its good part '
            'with gzip -dc FILE > PART.csv'
        ) from error
    except OSError as error:
        raise InputError(f'{path}: cannot be read: {error.strerror or error}') from error


class _Lines:
    """The whole lines of a file in blocks; `cut` tells whether the last line had no end."""

    def __init__(self, path):
        self.path = path
        self.cut = False

    def __iter__(self):
        """Yield bytes that end with a line end."""
        rest = b''
        for number, block in enumerate(_raw_blocks(self.path)):
            if not number:
                block = self._decoded_start(block)
            end = block.rfind(b'\n') + 1
            if end:
                whole = rest + block[:end]
                yield whole.replace(b'\r\n', b'\n') if b'\r' in whole else whole
                rest = block[end:]
            else:
                rest += block
            if len(rest) > _LONGEST_LINE:
                raise InputError(f'{self.path}: a line of more than 1 MB: not a CSV file')
        self.cut = bool(rest.strip())

    def _decoded_start(self, block):
        if block.startswith((b'\xff\xfe', b'\xfe\xff')) or b'\0' in block[:4096]:
            raise InputError(f'{self.path}: not UTF-8 text: save it as UTF-8 (it may be UTF-16)')
        if b'\r' in block and b'\n' not in block:
            raise InputError(f'{self.path}: its lines end with CR alone, expected LF or CR LF: '
                             "convert it, as with tr '\\r' '\\n'")
        return block[3:] if block.startswith(b'\xef\xbb\xbf') else block


def _split(path, line, number, delimiter):
    """Return the cells of one line."""
    try:
        return next(csv.reader([line], delimiter=delimiter, strict=True), [])
    except csv.Error as error:
        raise InputError(f'{path}: row {number}: {error}') from error


class _Header:
    """The comment lines, the header and where the data begin."""

    def __init__(self, path, block):
        self.path = path
        self.drive = None
        number, position = 0, 0
        line = ''
        while position < len(block):
            end = block.index(b'\n', position)
            try:
                line = block[position:end].decode('utf-8').strip()
            except UnicodeDecodeError as error:
                raise InputError(f'{path}: row {number + 1}: not UTF-8 text: save it as '
                                 'UTF-8') from error
            position, number = end + 1, number + 1
            if line.startswith('#'):
                key, _, value = line[1:].partition(':')
                if key.strip().lower() == 'drive':
                    self._state(number, checked_drive(path, value))
            elif line and not _SPREADSHEET.fullmatch(line):
                break
        else:
            raise InputError(f'{path}: empty: expected a header and rows')
        self.delimiter = next((x for x in ',;\t' if x in line), ',')
        self.names = [cell.strip() for cell in _split(path, line, number, self.delimiter)]
        if all(_number(name) is not None for name in self.names):
            raise InputError(
                f'{path}: row {number}: numbers where the names of the columns should be: '
                'put a header there, such as time,voltage_command,displacement'
            )
        self.row = self._first = number
        self.rest = self._below = block[position:]
        self.decimal = None  # how fractions are written, from the first that is met
        self.units = self._take_units()

    def _state(self, number, drive):
        """Take what a comment says of the drive."""
        if self.drive not in (None, drive):
            raise InputError(f'{self.path}: row {number}: drive {drive}, after drive {self.drive} '
                             'above: a recording has one drive: remove the wrong line')
        self.drive = drive

    def misplaced(self):
        """Return what to say of a header that is none: lines above it, or another separator."""
        remove = 'remove the lines above it, or begin each of them with #'
        for number, line in enumerate(self._below.split(b'\n', _PREAMBLE)[:_PREAMBLE]):
            text = line.decode('utf-8', 'replace').strip()
            if sum(map(_is_channel, re.split(r'[,;\t]', text))) > 1:
                return f'the header seems to be row {self._first + 1 + number}: {remove}'
        if len(self.names) > 1:
            return ''
        words = re.split(r'[\s|]+', self.names[0])
        if any(map(_is_channel, words)) and len(words) > 1:
            return ('its columns seem to be separated by '
                    f'{"|" if "|" in self.names[0] else "spaces"}: expected commas, semicolons or '
                    'tabs: put them there')
        return f'if its header stands below row {self._first}, {remove}'

    def _take_units(self):
        """Return the cells of a row of units below the names, and go past it; none if not so."""
        line, _, rest = self.rest.partition(b'\n')
        cells = [cell.strip(' \t[]()') for cell in _split(
            self.path, line.decode('utf-8', 'replace'), self.row + 1, self.delimiter)]
        letters = [cell for cell in cells if cell]
        if len(cells) != len(self.names) or not letters or any(
                map(str.isdigit, ''.join(letters))) or all(map(_is_missing, letters)):
            return [''] * len(self.names)
        self.rest, self.row = rest, self.row + 1
        return cells


def _is_channel(name):
    """Tell whether the name of a column is one of a channel, with a unit or without."""
    name = name.strip().strip('"')
    return bool(name.lower() in CHANNELS or header_unit(name) or boxed_channel(name))


def _is_missing(text):
    return text.strip(' \t').lower() in _MISSING


def _number(text):
    """Return the float of a cell, NaN for a missing one, None for anything else."""
    text = text.strip(' \t')
    if _is_missing(text):
        return math.nan
    # float() would also take 1_000, the digits of other scripts and odd white space.
    if '_' in text or not text.isascii() or not text.isprintable():
        return None
    try:
        return float(text)
    except ValueError:
        return None


class _Columns:
    """Which column holds which channel, in which unit."""

    def __init__(self, path, header, mapping, units):
        self.path, self.names, self._header = path, header.names, header
        names = header.names
        self.index, self.scale, self.findings = {}, {}, []
        for channel, source in mapping.items():
            if isinstance(source, str):
                self._put(channel, [i for i, name in enumerate(names) if name == source], source)
        for channel in CHANNELS:
            if channel in mapping:
                continue
            places = [i for i, name in enumerate(names) if name.lower() == channel]
            tagged = [(i, tag) for i, tag in enumerate(map(header_unit, names))
                      if tag and tag[0] == channel]
            if places or tagged:
                self._put(channel, places + [i for i, _ in tagged], channel)
            else:
                self._put_unknown(channel, units)
            if tagged:
                self._note(tagged[0][0], f'the header gives {channel} in {tagged[0][1][1]}')
                self.scale[channel] = tagged[0][1][2]
        for channel, place in self.index.items():
            if channel in self.scale or channel in units:
                continue
            tag = self._boxed(channel, names[place])
            if header.units[place]:
                self._scale(channel, header.units[place], self._unit(channel, header))
            elif tag:
                self._scale(channel, *tag)
            elif any(map(str.isalpha, boxed(names[place]))):
                self._note(place, f'{boxed(names[place])} is taken for no unit: {channel} is read '
                           f'in {UNITS[channel]}', f'if it is one, say so with --unit {channel}=')
        for channel, factor in units.items():
            if channel in self.index:
                self.scale[channel] = factor
                if factor != 1.0:
                    self._note(self.index[channel],
                               f'{channel} is multiplied by {factor:g} (--unit)')
        self._check(header.drive)

    def _boxed(self, channel, name):
        """Return the unit that the name of a mapped column gives, None if there is none."""
        own = header_unit(name)
        if own and UNITS[own[0]] == UNITS[channel]:
            return own[1:]
        try:
            return boxed_unit(channel, name)
        except InputError as error:
            raise InputError(f'{self.path}: column {shown(name)}: '
                             f'{str(error).removeprefix("--unit ")}; --unit {channel}=... '
                             'overrules it') from None

    def _put_unknown(self, channel, units):
        """Take the column that has a channel's name and brackets that nobody understands."""
        # A number there is that of a sensor.
        places = [i for i, name in enumerate(self.names)
                  if boxed_channel(name) == channel and not boxed(name).isdigit()]
        others = {name.lower() for name in self.names} | {
            tag[0] for tag in map(header_unit, self.names) if tag}
        if places and channel in MEASURED and channel not in units and others & {*MEASURED}:
            # It may be a remark, and a recording without it is one.
            self._note(places[0], f'{shown(boxed(self.names[places[0]]))} is no unit of {channel} '
                       'that is known: the column is not used', f'say it with --unit {channel}=')
            return
        if places and channel not in units:
            name, unit = self.names[places[0]], UNITS[channel]
            raise InputError(
                f'{self.path}: column {shown(name)}: {shown(boxed(name))} is no unit of {channel} '
                f'that is known: expected {unit} with a prefix of k, m, u, n, p: say what it is, '
                f'as in --unit {channel}={"u" * (unit in "mC")}{unit} (or =2.5, a factor to '
                f'{unit}), or rename the column')
        if places:
            self._put(channel, places, channel)

    def _unit(self, channel, header):
        """Return the factor to SI of a unit in the row of units."""
        unit = header.units[self.index[channel]]
        try:
            return unit_scale(channel, unit)
        except InputError as error:
            raise InputError(f'{self.path}: row {header.row}: {str(error).removeprefix("--unit ")}'
                             f'; --unit {channel}=... overrules it') from None

    def _scale(self, channel, unit, factor):
        self.scale[channel] = factor
        if factor != 1.0:
            self._note(self.index[channel], f'the header gives {channel} in {unit}')

    def _note(self, index, what, mend=''):
        what = f'column {shown(self.names[index])}: {what}'
        self.findings.append(Finding(self.path, None, NOTE, what, mend))

    def _put(self, channel, places, wanted):
        if not places:
            hint = self._header.misplaced()
            raise InputError(
                f'{self.path}: --map {channel}: no column {shown(wanted)}'
                f'{suggestion(wanted, self.names)}{f": {hint}" if hint else ""}: its columns are '
                f'{self._listed()}'
            )
        if len(places) > 1:
            first, second = (self.names[place] for place in places[:2])
            # What --map names must be one column.
            mend = 'rename one in the file' if first == second else (
                f"rename one, or choose with --map '{channel}={first}'")
            raise InputError(
                f'{self.path}: columns {places[0] + 1} and {places[1] + 1} are both '
                f'{shown(wanted)}: {mend}'
            )
        self.index[channel] = places[0]

    def _listed(self):
        names = ', '.join(shown(name) for name in self.names[:12])
        return names + (', ...' if len(self.names) > 12 else '')

    def _lacks(self, channel, unused, other='', more=''):
        hint = self._header.misplaced()
        if hint:
            raise InputError(f'{self.path}: row {self._header.row}: no column "{channel}"{other} '
                             f'in what should be the header: {hint}; its columns are '
                             f'{self._listed()}')
        raise InputError(
            f'{self.path}: no column "{channel}"{other}{suggestion(channel, unused)}: map it '
            f'(--map {channel}=...){more}; its columns are {self._listed()}'
        )

    def _check(self, drive):
        used = set(self.index.values())
        missing = [channel for channel in CHANNELS if channel not in self.index]
        unused = [name for place, name in enumerate(self.names) if place not in used]
        if 'time' in missing:
            self._lacks('time', unused)
        if not drive and all(name in missing for name in COMMANDS):
            read = self.names[self.index['voltage']] if 'voltage' in self.index else ''
            self._lacks('voltage_command', unused, ' or "charge_command"',
                        (f'; --map voltage_command={read} plays the voltage that was measured'
                         if read else '')
                        + '; or say "# drive: open" (or shorted) above the header')
        for place, name in enumerate(self.names):
            hint = suggestion(name.lower(), missing) if place not in used and name else ''
            if hint:
                self._note(place, f'not used{hint}', 'use it with --map')


def _careful(path, lines, numbers, header, columns):
    """Parse lines cell by cell: quotes and missing cells are understood, the rest is named."""
    out = np.empty((len(lines), len(columns.index)))
    for k, line in enumerate(lines):
        cells = _split(path, line.decode('utf-8', 'replace'), int(numbers[k]), header.delimiter)
        if len(cells) != len(header.names):
            raise InputError(
                f'{path}: row {numbers[k]}: {len(cells)} cells, but the header has '
                f'{len(header.names)}: {_mend_width(cells, header)}'
            )
        for j, (channel, place) in enumerate(columns.index.items()):
            value = _fraction(cells[place], header)
            if value is None:
                raise InputError(
                    f'{path}: row {numbers[k]}, column {shown(header.names[place])}: '
                    f'{shown(cells[place])} is not a number: '
                    f'{_mend_cell(channel, cells[place])}'
                )
            out[k, j] = value
    return out


def _mend_width(cells, header):
    """Say what to do about a row of more or fewer cells than the header."""
    whole = not any(_number(cell) is None or '.' in cell for cell in cells)
    if header.delimiter == ',' and len(cells) > len(header.names) and whole:
        return ('if its decimals are written with commas, separate the columns by semicolons or '
                'tabs, or write the decimals with a point; else mend or remove the row')
    return 'mend or remove the row'


def _mend_cell(channel, cell):
    """Say what is expected in place of a cell that is not a number."""
    # Digits with a mark that is not the decimal one; dates have several of one kind.
    if re.fullmatch(r'[-+.,\d\s]*\d(?:[eE][-+]?\d+)?\s*', cell) and (
            ',' in cell or _number(cell) is not None):
        return 'write all decimals with a point, and nothing between thousands'
    if MINUS in cell:
        return f'write its minus as -, not as {MINUS}'
    if channel == 'time':
        return ('expected seconds as a plain number: write dates and clock times as the seconds '
                'since the first row, or remove the row')
    return 'expected a number: leave the cell empty or write NaN if there is none'


def _fraction(cell, header):
    """Return the float of a cell, as `_number`; in one file with a point or with a comma."""
    mark = ',' if header.delimiter != ',' and ',' in cell else '.' if '.' in cell else None
    header.decimal = header.decimal or mark
    if mark not in (None, header.decimal):
        return None
    return _number(cell.replace(',', '.') if mark == ',' and '.' not in cell else cell)


def _even(data, delimiter, width):
    """Return whether every line has `width` cells, by the positions of what separates them."""
    characters = np.frombuffer(data, np.uint8)
    ends = np.flatnonzero(characters == ord('\n'))
    marks = np.flatnonzero(characters == ord(delimiter))
    if marks.size != ends.size * (width - 1):
        return False
    if width == 1:
        return True
    marks = marks.reshape(ends.size, width - 1)
    return bool(np.all(marks[:, -1] < ends) and np.all(marks[1:, 0] > ends[:-1]))


def _filled(data, delimiter):
    """Write nan into empty cells."""
    mark = delimiter.encode()
    for _ in range(2):
        data = data.replace(mark + mark, mark + b'nan' + mark)
    return (b'\n' + data).replace(mark + b'\n', mark + b'nan\n').replace(
        b'\n' + mark, b'\nnan' + mark)[1:]


def _parse(path, data, first, header, columns):
    """Return the numbers, shape (rows, channels), and the line numbers of a block of lines."""
    numbers = np.arange(first, first + data.count(b'\n'))
    if b'\n\n' in data or data.startswith(b'\n'):
        lines = data.split(b'\n')[:-1]
        full = [k for k, line in enumerate(lines) if line.strip()]
        numbers = numbers[full]
        data = b''.join(lines[k] + b'\n' for k in full)
    if data and b'"' not in data and _even(data, header.delimiter, len(header.names)):
        commas = header.delimiter != ',' and b',' in data and b'.' not in data
        plain = data.replace(b',', b'.') if commas else data
        for prepare in (lambda text, _: text, _filled):
            try:
                values = np.loadtxt(
                    io.BytesIO(prepare(plain, header.delimiter)), delimiter=header.delimiter,
                    comments=None, ndmin=2, usecols=list(columns.index.values()),
                    encoding='latin-1')
            except ValueError:
                continue
            if header.decimal in (None, ',') if commas else header.decimal != ',':
                header.decimal = ',' if commas else header.decimal
                return values, numbers
    return _careful(path, data.split(b'\n')[:-1], numbers, header, columns), numbers


class _Thinned:
    """
    Rows as they are read; of too many, every `step`-th with the mean of the inputs until the next.

    An input holds from its row on: what acted until the next kept row is sampled is the mean.
    """

    def __init__(self, inputs, max_values):
        self.step = 1
        self._inputs, self._most = np.array(inputs), max_values
        self._waiting, self._kept, self._count = [], [], 0

    def take(self, values, rows):
        """Take rows (n, channels) with their line numbers (n,)."""
        if not len(rows):
            return
        self._waiting.append((values, rows))
        if sum(len(each) for _, each in self._waiting) >= _LOT:
            values, rows = self._all_waiting()
            whole = len(rows) - len(rows) % _LOT
            self._waiting = [(values[whole:], rows[whole:])]
            self._keep(values[:whole], rows[:whole])

    def finish(self):
        """Return the rows kept (m, channels) and their line numbers (m,)."""
        if self._waiting:
            self._keep(*self._all_waiting())
        if not self._kept:
            return np.empty((0, self._inputs.size)), None
        values, rows = zip(*self._kept)
        return np.concatenate(values), np.concatenate(rows)

    def _all_waiting(self):
        values, rows = zip(*self._waiting)
        return np.concatenate(values), np.concatenate(rows)

    def _keep(self, values, rows):
        self._kept.append(self._joined(values, rows, self.step))
        self._count += len(self._kept[-1][1])
        while self._count * self._inputs.size > self._most and self._count > 1:
            values, rows = zip(*self._kept)
            self._kept = [self._joined(np.concatenate(values), np.concatenate(rows), 2)]
            self._count, self.step = len(self._kept[0][1]), 2 * self.step

    def _joined(self, values, rows, step):
        kept = values[::step].copy()
        starts = np.arange(0, len(values), step)
        if step > 1 and starts.size:
            given = values[:, self._inputs]
            there = np.isfinite(given)
            count = np.add.reduceat(there, starts, dtype=float)
            count[count == 0.0] = np.nan
            kept[:, self._inputs] = np.add.reduceat(np.where(there, given, 0.0), starts) / count
        return kept, rows[::step]


def read_csv(path, mapping=None, units=None, max_values=MAX_VALUES):
    """
    Read one CSV file.

    The first row that is neither empty nor a comment names the columns; a comment
    ``# drive: open`` or ``# drive: shorted`` stands for a command. Cells are separated by commas,
    semicolons or tabs; beside the latter two, decimals may be written with a comma. A row of units
    may follow the names. Empty cells, NaN, NA, N/A, null and none are read as NaN. A last row
    without a line end is left out, because nobody can tell whether it was cut within a number.

    Parameters
    ----------
    path : str or Path
        A file, gzipped or not.
    mapping : dict, optional
        From `parse_mapping`; entries for topics are ignored.
    units : dict of str to float, optional
        From `parse_units`.
    max_values : int
        Numbers to keep at most; of a larger file every m-th row is kept, with the mean of the
        inputs that act before the next one.

    Returns
    -------
    Recording
        Not yet checked by preflight.

    Raises
    ------
    InputError
        The file, row, column and cell that are wrong.

    """
    path = str(path)
    lines = _Lines(path)
    blocks = iter(lines)
    first = next(blocks, None)
    if first is None:
        raise InputError(f'{path}: empty: expected a header and rows, each with a line end')
    header = _Header(path, first)
    columns = _Columns(path, header, mapping or {}, units or {})
    line = header.row + 1
    thinned_out = _Thinned([each in INPUTS for each in columns.index], max_values)
    for block in chain([header.rest] if header.rest else [], blocks):
        thinned_out.take(*_parse(path, block, line, header, columns))
        line += block.count(b'\n')
    table, rows = thinned_out.finish()
    findings = list(columns.findings)
    if header.decimal == ',':
        findings.append(Finding(path, None, NOTE, 'decimals are written with a comma'))
    if lines.cut:
        findings.append(Finding(
            path, int(line), REPAIRED, 'the last row has no line end, it may have been cut',
            'it is left out'))
    if thinned_out.step > 1:
        findings.append(thinned(path, len(table), thinned_out.step, max_values))
    read = {
        channel: table[:, j] * columns.scale.get(channel, 1.0)
        for j, channel in enumerate(columns.index)
    }
    recording = assemble(path, read, header.drive, rows, findings)
    stated = {channel: ('--unit' if channel in (units or {}) else 'the header', factor)
              for channel, factor in columns.scale.items()}
    return recording.replace(timed='time' in columns.scale, stated=stated)
