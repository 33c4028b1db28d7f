# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Files that are either the old one or the complete new one, whenever the writer is killed."""

from contextlib import contextmanager
import os
from pathlib import Path
import tempfile

from piezo_stack_sim.errors import InputError


_inputs = None  # of a command: what it has read, which it must not write over


def guard_inputs():
    """From now on no file is written over that was read before: one command begins."""
    global _inputs
    _inputs = set()


def note_input(path):
    """Note that a file was read; return the path."""
    if _inputs is not None:
        _inputs.add(os.path.realpath(path))
    return path


@contextmanager
def atomic_path(path):
    """
    Give a temporary path beside `path`; move it over `path` when the block ends without error.

    Parameters
    ----------
    path : str or Path
        The file to write. Missing folders above it are made.

    Yields
    ------
    Path
        An empty file in the same folder and with the same suffixes, to be written by the caller.

    Raises
    ------
    InputError
        When the folder or the file cannot be written, or was read by the same command.

    """
    path = Path(path)
    if _inputs and os.path.realpath(path) in _inputs:
        raise InputError(f'{path}: is what was read: expected another file to write to; '
                         'choose another --out')
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        # A leading dot, so that a reader of the folder never takes it for a recording.
        handle, name = tempfile.mkstemp(
            dir=path.parent, prefix='.partial-', suffix=''.join(path.suffixes)
        )
        os.close(handle)
    except OSError as error:
        raise InputError(f'{path}: cannot be written: {error.strerror}') from error
    partial = Path(name)
    try:
        yield partial
        with open(partial, 'rb') as written:
            os.fsync(written.fileno())
        # mkstemp made it private; a result file is as readable as any other.
        umask = os.umask(0)
        os.umask(umask)
        os.chmod(partial, 0o666 & ~umask)
        os.replace(partial, path)
    except OSError as error:
        raise InputError(f'{path}: cannot be written: {error.strerror}') from error
    finally:
        partial.unlink(missing_ok=True)


def check_file(path):
    """
    Ask whether a file can be written, before what takes long is done for it.

    Raises
    ------
    InputError
        When it is a folder, or what should be a folder above it is none or must not be written
        into.

    """
    path = Path(path)
    if path.is_dir():
        raise InputError(f'{path}: is a folder: expected the name of a file to write')
    above = next((each for each in path.absolute().parents if os.path.lexists(each)), None)
    if above is None or not above.is_dir() or not os.access(above, os.W_OK | os.X_OK):
        raise InputError(f'{path}: cannot be written: {above} is no folder that can be written '
                         'into; choose another')


def make_folder(path):
    """
    Make a folder and those above it, if they are missing; return its Path.

    Raises
    ------
    InputError
        When that is not possible.

    """
    path = Path(path)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f'{path}: cannot be made a folder: {error.strerror}') from error
    if not os.access(path, os.W_OK | os.X_OK):
        raise InputError(f'{path}: cannot be written into: expected a folder with the permission '
                         'to write; choose another')
    return path


def write_text(path, text):
    """Write a UTF-8 text file atomically (see `atomic_path`)."""
    with atomic_path(path) as partial:
        partial.write_text(text, encoding='utf-8')
