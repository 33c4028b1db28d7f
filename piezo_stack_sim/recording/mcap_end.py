# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
MCAP files of a recorder that was killed: no index, no end, perhaps half a chunk.

Nothing is written: the reading library is given a file object in which the whole records are
followed by an end of file. Records of an uncompressed chunk that was cut are records like any
other; of a compressed one nothing can be read.
"""

import io
import os
import struct

from piezo_stack_sim.errors import InputError
from piezo_stack_sim.recording.finding import Finding, REPAIRED

MAGIC = b'\x89MCAP0\r\n'
_FOOTER, _CHUNK, _DATA_END = 0x02, 0x06, 0x0f
# End of data, a footer that points to no index, the magic.
_TAIL = struct.pack('<BQI', _DATA_END, 4, 0) + struct.pack('<BQQQI', _FOOTER, 20, 0, 0, 0) + MAGIC


class _Spliced(io.RawIOBase):
    """Pieces (start, end) of a file, one after the other, followed by `tail`."""

    def __init__(self, path, pieces, tail):
        self._file = open(path, 'rb')
        self._tail, self._position = tail, 0
        self._pieces, self._cut = [], 0
        for start, end in pieces:
            self._pieces.append((self._cut, start, end - start))
            self._cut += end - start

    def readable(self):
        return True

    def seekable(self):
        return True

    def seek(self, offset, whence=os.SEEK_SET):
        start = (0, self._position, self._cut + len(self._tail))[whence]
        if start + offset < 0:
            raise OSError('seek before the start')
        self._position = start + offset
        return self._position

    def tell(self):
        return self._position

    def readinto(self, buffer):
        data = b''
        for at, start, length in self._pieces:
            if at <= self._position < at + length:
                skip = self._position - at
                self._file.seek(start + skip)
                data = self._file.read(min(len(buffer), length - skip))
        if self._position >= self._cut:
            begin = self._position - self._cut
            data = self._tail[begin:begin + len(buffer)]
        buffer[:len(data)] = data
        self._position += len(data)
        return len(data)

    def close(self):
        self._file.close()
        super().close()


class MendedMcap:
    """As much of a path as the reading library's storage uses; opened, the file has an end."""

    def __init__(self, path, pieces):
        self._path, self._pieces = path, pieces

    def __str__(self):
        return str(self._path)

    def open(self, *_, **__):  # noqa: A003
        return io.BufferedReader(_Spliced(self._path, self._pieces, _TAIL), 1 << 16)


def _records(file, position, end):
    """Yield (kind, content's start, length) of the records; the last one may be cut."""
    while position + 9 <= end:
        file.seek(position)
        kind, length = struct.unpack('<BQ', file.read(9))
        if kind in (_DATA_END, _FOOTER):
            return
        yield kind, position + 9, length
        position += 9 + length


def _whole(file, position, end):
    """Return where the last whole record ends, and the (start) of a chunk cut after it."""
    for kind, start, length in _records(file, position, end):
        if start + length > end:
            return position, start if kind == _CHUNK else None
        position = start + length
    return position, None


def _cut_chunk(file, start, end):
    """Return the whole records in a chunk that was cut, as (start, end), or None."""
    file.seek(start + 28)
    field = file.read(4)
    # An empty name of the compression, then the length of the records.
    if field != b'\0\0\0\0' or start + 40 > end:
        return None
    return start + 40, _whole(file, start + 40, end)[0]


def mended(path):
    """
    Give a killed recorder's MCAP file an end.

    Parameters
    ----------
    path : Path
        The file.

    Returns
    -------
    tuple of (MendedMcap, Finding) or None
        What to open instead; None when the file is complete.

    Raises
    ------
    InputError
        When it is no MCAP file.

    """
    size = os.path.getsize(path)
    with open(path, 'rb') as file:
        if file.read(len(MAGIC)) != MAGIC:
            raise InputError(f'{path}: not an MCAP file: it does not begin like one')
        file.seek(max(size - len(MAGIC), 0))
        if size >= len(MAGIC) + len(_TAIL) and file.read() == MAGIC:
            return None
        end, chunk = _whole(file, len(MAGIC), size)
        pieces = [(0, end)]
        inner = None if chunk is None else _cut_chunk(file, chunk, size)
        if inner:
            pieces.append(inner)
    kept = sum(end - start for start, end in pieces)
    return MendedMcap(path, pieces), Finding(
        str(path), None, REPAIRED, 'the file has no end: its recorder was killed',
        f'read up to the last whole record, {kept} of {size} bytes')
