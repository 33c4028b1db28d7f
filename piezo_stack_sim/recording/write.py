# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Recordings into CSV files: complete ones atomically, live ones row by row."""

import gzip
import os
from pathlib import Path
import zlib

import numpy as np

from piezo_stack_sim.atomic import atomic_path, check_file
from piezo_stack_sim.errors import InputError
from piezo_stack_sim.recording.finding import shown
from piezo_stack_sim.recording.recording import UNITS

_ROWS_AT_ONCE = 10_000


def _lines(table):
    """Return rows as text; repr() gives the shortest decimals that read back to the same bits."""
    return ''.join(','.join(map(repr, row)) + '\n' for row in table.tolist()).encode('ascii')


def _head(names, drive, remark=''):
    """Return the header, after comments: a remark, and which leads were open or shorted."""
    comment = f'# {remark}\n' if remark else ''
    comment += f'# drive: {drive}\n' if drive in ('open', 'shorted') else ''
    return f'{comment}{",".join(names)}\n'.encode('ascii')


def write_csv(recording, path, remark=''):
    """
    Write one recording: the file is the old one or the complete new one at every moment.

    Parameters
    ----------
    recording : Recording
        Columns that it does not have are not written.
    path : str or Path
        A name that ends with .csv or .csv.gz, which packs it. Equal recordings give equal bytes.
    remark : str
        A line of ASCII above the header.

    Raises
    ------
    InputError
        When the file cannot be written.

    """
    columns = recording.columns()
    table = np.column_stack(list(columns.values()))
    with atomic_path(path) as partial, open(partial, 'wb') as file:
        packed = str(path).endswith('.gz')
        # No name and no date in it, so that equal recordings give equal files.
        out = gzip.GzipFile('', 'wb', 6, file, mtime=0) if packed else file
        out.write(_head(columns, recording.drive, remark))
        for first in range(0, len(table), _ROWS_AT_ONCE):
            out.write(_lines(table[first:first + _ROWS_AT_ONCE]))
        if packed:
            out.close()


def write_csv_set(recording_set, folder, packed=True, remark=''):
    """
    Write a recording set, one file for each recording, each file atomically.

    Parameters
    ----------
    recording_set : RecordingSet
        Its recordings' names become the names of the files.
    folder : str or Path
        Made if it is not there.
    packed : bool
        Gzipped files (.csv.gz) or plain ones (.csv).
    remark : str
        A line above each header; a file that is there already must begin with it.

    Returns
    -------
    list of Path
        The files.

    Raises
    ------
    InputError
        When a name is no file name, or the folder has a file of the same name with the other
        ending, which would be read as a second recording, or one without the remark.

    """
    folder = Path(folder)
    ending, other = ('.csv.gz', '.csv') if packed else ('.csv', '.csv.gz')
    for recording in recording_set.recordings:
        name = recording.name
        if not name or name.startswith('.') or {'/', '\\', '\0', '\n'} & set(name):
            raise InputError(f'{folder}: recording {shown(name)}: not usable as a file name')
        check_file(folder / f'{name}{ending}')
        if (folder / f'{name}{other}').exists():
            raise InputError(f'{folder / (name + other)}: is in the way of {name}{ending}: remove')
        if remark:
            _check_replaceable(folder / f'{name}{ending}', remark)
    paths = []
    for recording in recording_set.recordings:
        paths.append(folder / f'{recording.name}{ending}')
        write_csv(recording, paths[-1], remark)
    return paths


def _check_replaceable(path, remark):
    """Raise InputError for a file that does not begin with a remark."""
    try:
        with (gzip.open if path.suffix == '.gz' else open)(path, 'rb') as file:
            if file.readline(200).rstrip(b'\r\n') == f'# {remark}'.encode('ascii'):
                return
    except FileNotFoundError:
        return
    except (OSError, EOFError, zlib.error):
        pass  # whatever it is, it is none of ours
    raise InputError(f'{path}: is there and does not begin with "# {remark}": expected a folder '
                     'without recordings of that name; choose another --out')


class CsvWriter:
    """
    A recording in the making: whole rows reach the file at once.

    However the process ends, the file can be read up to the last row that was written: every call
    hands complete rows to the operating system, and `read_csv` leaves out a row without line end.

    Parameters
    ----------
    path : str or Path
        A new file that ends with .csv.
    columns : sequence of str
        Names from the file format, 'time' first.
    drive : str, optional
        Written into the file for 'open' and 'shorted', where no command column tells it.

    Raises
    ------
    InputError
        Unknown columns, or a file that exists or cannot be written.

    """

    def __init__(self, path, columns, drive=None):
        self.path = Path(path)
        self.columns = tuple(columns)
        unknown = [name for name in self.columns if name not in UNITS]
        if unknown or self.columns[:1] != ('time',):
            raise InputError(
                f'{path}: columns {", ".join(self.columns)}: expected time, then any of '
                f'{", ".join(list(UNITS)[1:])}'
            )
        if self.path.suffix != '.csv':
            raise InputError(f'{path}: a live recording ends with .csv: gzip would tear at a kill')
        self._file, self._size = None, 0
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._file = os.open(self.path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666)
        except FileExistsError as error:
            raise InputError(f'{path}: exists already: remove it or choose another') from error
        except OSError as error:
            raise InputError(f'{path}: cannot be written: {error.strerror}') from error
        self._write(_head(self.columns, drive))

    def write(self, rows):
        """
        Append rows.

        Parameters
        ----------
        rows : array_like, shape (n, columns) or (columns,)
            Values in the order of the columns, SI units; NaN for a missing one.

        Raises
        ------
        InputError
            When the disk is full.

        """
        table = np.atleast_2d(np.asarray(rows, dtype=float))
        if table.shape[1] != len(self.columns):
            raise ValueError(f'expected {len(self.columns)} columns, got {table.shape[1]}')
        self._write(_lines(table))

    def _write(self, text):
        if self._file is None:
            raise InputError(f'{self.path}: cannot be written: closed')
        try:
            rest = text
            while rest:
                rest = rest[os.write(self._file, rest):]
            self._size += len(text)
        except OSError as error:
            # Nothing may follow half a row: the two would read as one wrong row.
            file, self._file = self._file, None
            os.ftruncate(file, self._size)
            os.close(file)
            raise InputError(f'{self.path}: cannot be written: {error.strerror}') from error

    def close(self):
        """Flush to the disk and close; more than once does no harm."""
        if self._file is not None:
            file, self._file = self._file, None
            try:
                os.fsync(file)
            except OSError as error:
                raise InputError(f'{self.path}: cannot be written: {error.strerror}') from error
            finally:
                os.close(file)

    def __enter__(self):
        """Return the writer."""
        return self

    def __exit__(self, *_):
        """Close the file."""
        self.close()
