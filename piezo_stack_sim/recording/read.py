# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Recording sets: a folder of CSV files and bags, or single files, into one RecordingSet."""

import os
from pathlib import Path

from piezo_stack_sim.errors import InputError
from piezo_stack_sim.recording.assemble import MAX_VALUES, recording_name
from piezo_stack_sim.recording.bag import read_bag
from piezo_stack_sim.recording.bag_file import FILE_ENDINGS, is_bag
from piezo_stack_sim.recording.csv_file import read_csv
from piezo_stack_sim.recording.finding import Finding, NOTE
from piezo_stack_sim.recording.mapping import (
    is_displacement_arbitrary, parse_mapping, parse_units, suggestion, TopicField,
)
from piezo_stack_sim.recording.recording import RecordingSet

_TABLES = ('.csv', '.csv.gz')
# What people keep recordings in, but what is not read here; other files are none of our business.
_FOREIGN = (
    '.bag', '.feather', '.h5', '.hdf5', '.mat', '.npy', '.npz', '.parquet', '.tdms', '.tsv',
    '.txt', '.xls', '.xlsx', '.zip', '.bz2', '.xz', '.zst',
)


def _is_table(path):
    return path.name.lower().endswith(_TABLES)


def _entries(folder):
    """Return the recordings in a folder, and Findings about what looks like one but is not."""
    try:
        names = sorted(os.listdir(folder))
    except OSError as error:
        raise InputError(f'{folder}: cannot be read: {error.strerror}') from error
    paths = [folder / name for name in names if not name.startswith('.')]
    found = [path for path in paths if (path.is_file() and _is_table(path)) or is_bag(path)]
    foreign = [path for path in paths
               if path.is_file() and path.suffix.lower() in _FOREIGN and path not in found]
    # By their names they are recordings: links to nothing, folders.
    odd = [path for path in paths if path not in found
           and path.name.lower().endswith((*_TABLES, *FILE_ENDINGS))]
    if not found:
        inner = [path.name for path in paths if path.is_dir() and path not in odd]
        if odd and not inner:
            mend = f'{odd[0].name} is {_unreadable(odd[0])}'
        elif inner:
            mend = f'give one of its folders ({", ".join(inner[:4])}{", ..." * (len(inner) > 4)})'
        else:
            mend = 'expected .csv, .csv.gz, .mcap or .db3 files or rosbag2 folders'
        raise InputError(f'{folder}: no recording in it: {mend}')
    findings = [Finding(str(path), None, NOTE, 'not a format that is read', 'convert it to CSV')
                for path in foreign]
    return found, findings + [
        Finding(str(path), None, NOTE, _unreadable(path), 'passed over: mend or remove it')
        for path in odd
    ]


def _unreadable(path):
    """Return why what has the name of a recording is none."""
    if path.is_symlink() and not path.exists():
        return f'a link to {os.readlink(path)}, which is not there'
    return 'a folder with the name of a file' if path.is_dir() else 'not a file'


def _files(path):
    """Return the recordings that a path stands for, and Findings."""
    if not path.exists():
        near = os.listdir(path.parent) if path.parent.is_dir() else ()
        raise InputError(f'{path}: no such file or folder{suggestion(path.name, near)}')
    if is_bag(path) or (path.is_file() and _is_table(path)):
        return [path], []
    if path.is_dir():
        return _entries(path)
    raise InputError(
        f'{path}: not a recording: expected {", ".join((*_TABLES, *FILE_ENDINGS))}, a rosbag2 '
        'folder, or a folder of them'
    )


def _check_used(source, mapping, files):
    """Raise InputError for a mapping that no file could have used."""
    kinds = {TopicField: any(is_bag(path) for path in files),
             str: any(not is_bag(path) for path in files)}
    for channel, place in mapping.items():
        if not kinds[type(place)]:
            wrong = 'topic, but there is no bag' if isinstance(place, TopicField) \
                else 'column, but there is no CSV file: a topic begins with /'
            raise InputError(f'{source}: --map {channel}={place} names a {wrong}')


def _check_units_used(source, units, recordings):
    """Raise InputError for a unit of what no recording has."""
    known = dict.fromkeys(name for each in recordings for name in (*each.columns(), *each.stated))
    for channel in units:
        if channel not in known:
            raise InputError(
                f'{source}: --unit {channel}: no recording has {channel}, but {", ".join(known)}: '
                f'leave it out, or say where it is, as in --map {channel}=...')


def read_set(paths, mapping=None, units=None, progress=None, max_values=None):
    """
    Read the recordings of one device.

    Parameters
    ----------
    paths : str, Path, or sequence of them
        A folder with one file or bag for each recording, or files and bags themselves. Hidden
        files are passed over.
    mapping : sequence of str or mapping, optional
        Where channels are found, see `parse_mapping`: ``['displacement=stage_um']``.
    units : sequence of str or mapping, optional
        What their numbers mean, see `parse_units`: ``{'displacement': 'um'}``.
    progress : callable, optional
        Called with the number of files read, the number of files, and the name of the next one.
    max_values : int, optional
        Numbers to keep of all files together at most, as many of each: a larger one is thinned.

    Returns
    -------
    RecordingSet
        As recorded: not yet checked and mended by `preflight`.

    Raises
    ------
    InputError
        The first file that cannot be read, with row, value and mend.

    """
    arbitrary = is_displacement_arbitrary(units)
    mapping, units = parse_mapping(mapping), parse_units(units)
    if arbitrary:
        units['displacement'] = 1.0  # and no unit that a file may give
    if isinstance(paths, (str, os.PathLike)):
        paths = [paths]
    paths = [Path(path) for path in paths]
    if not paths:
        raise InputError('no recording set given')
    files, findings = [], []
    for path in paths:
        found, more = _files(path)
        files += found
        findings += more
    source = str(paths[0]) if len(paths) == 1 else ', '.join(str(path) for path in paths)
    _check_used(source, mapping, files)
    most = MAX_VALUES if max_values is None else min(MAX_VALUES, max_values // len(files))
    recordings = []
    for number, path in enumerate(files):
        if progress:
            progress(number, len(files), path.name)
        reader = read_bag if is_bag(path) else read_csv
        recording = reader(path, mapping, units, most)
        recordings.append(recording.replace(arbitrary=True) if arbitrary else recording)
    _check_units_used(source, units, recordings)
    single = len(paths) == 1 and files != paths
    name = paths[0].resolve().name if single else recording_name(paths[0])
    return RecordingSet(name, tuple(recordings), source, tuple(findings))
