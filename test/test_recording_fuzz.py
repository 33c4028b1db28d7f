# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Whatever bytes and numbers come in, either a sound recording or an InputError comes out."""

from functools import lru_cache
import gzip
from pathlib import Path
import tempfile
import warnings

from hypothesis import given, HealthCheck, settings, strategies
from hypothesis.extra.numpy import arrays
import numpy as np
from piezo_stack_sim.errors import InputError
from piezo_stack_sim.recording import (
    preflight, read_bag, read_csv, read_set, Recording, RecordingSet, write_bag, write_csv,
)
import pytest
from recorded import DEVICE, pushed, slow

NASTY = [0.0, -0.0, 1.0, -1.0, 1e-300, 1e300, -1e308, np.nan, np.inf, -np.inf, 1e-9, 40.0, 1.7e18]
NUMBERS = [b'\0' * 4, b'\xff' * 4, b'\xff\xff\xff\x7f', b'nan,', b'1e99', b'\n,,"']
VALUES = strategies.one_of(strategies.sampled_from(NASTY), strategies.floats(width=32))
MODEST = settings(max_examples=80, deadline=None, suppress_health_check=list(HealthCheck))


@lru_cache
def good_files():
    """Return the bytes of one sound file of each format."""
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        write_csv(pushed(60), folder / 'run.csv')
        write_bag(pushed(60), folder / 'mcap')
        write_bag(pushed(60), folder / 'sqlite3', 'sqlite3')
        return {
            'csv': (folder / 'run.csv').read_bytes(),
            'csv.gz': gzip.compress((folder / 'run.csv').read_bytes(), mtime=0),
            'mcap': (folder / 'mcap/mcap.mcap').read_bytes(),
            'db3': (folder / 'sqlite3/sqlite3.db3').read_bytes(),
            'yaml': (folder / 'sqlite3/metadata.yaml').read_bytes(),
        }


@strategies.composite
def damaged(draw, kind):
    """Draw a damaged copy of a good file: bytes changed, cut out, put in, or all made up."""
    data = bytearray(good_files()[kind])
    if draw(strategies.integers(0, 9)) == 0:
        return draw(strategies.binary(max_size=200))
    for _ in range(draw(strategies.integers(1, 6))):
        # Most of what can go wrong is in the beginning and in the end.
        end = draw(strategies.sampled_from([len(data), min(len(data), 600)]))
        place = draw(strategies.integers(0, max(end - 1, 0)))
        place = len(data) - 1 - place if draw(strategies.booleans()) else place
        change = draw(strategies.sampled_from(['byte', 'number', 'cut', 'insert', 'end']))
        if change == 'byte' and data:
            data[place] = draw(strategies.integers(0, 255))
        elif change == 'number':
            data[place:place + 4] = draw(strategies.sampled_from(NUMBERS))
        elif change == 'cut':
            del data[place:place + draw(strategies.integers(1, 200))]
        elif change == 'insert':
            data[place:place] = draw(strategies.binary(max_size=20))
        else:
            del data[max(place, 0):]
    return bytes(data)


def sound(recordings):
    """Assert what preflight promises."""
    for recording in recordings:
        assert recording.time[0] == 0.0 and np.all(np.diff(recording.time) > 0.0)
        for values in (recording.external_force, *recording.columns().values()):
            assert np.all(np.isfinite(values)) and len(values) == len(recording)
        assert recording.measured


def survives(read, *arguments):
    """Read and check; InputError is the only way out."""
    for device in (None, DEVICE):
        try:
            found = read(*arguments)
            if isinstance(found, Recording):
                found = RecordingSet('run', (found,))
            sound(preflight(found, device)[0])
        except InputError as error:
            assert '\n' not in str(error)


@pytest.mark.parametrize('kind', ['csv', 'csv.gz', 'mcap', 'db3'])
def test_a_damaged_file_is_read_or_refused(tmp_path_factory, kind):
    folder = tmp_path_factory.mktemp('fuzz')

    @given(damaged(kind))
    @MODEST
    def check(data):
        path = folder / f'run.{kind}'
        path.write_bytes(data)
        survives(read_csv if kind.startswith('csv') else read_bag, path)
    check()


def test_a_damaged_bag_folder_is_read_or_refused(tmp_path_factory):
    folder = tmp_path_factory.mktemp('fuzz')
    (folder / 'sqlite3.db3').write_bytes(good_files()['db3'])

    @given(damaged('yaml'))
    @MODEST
    def check(data):
        (folder / 'metadata.yaml').write_bytes(data)
        survives(read_set, folder)
    check()


@strategies.composite
def recordings(draw):
    """Draw a recording of wild numbers, or a good one with wild numbers in it."""
    if draw(strategies.booleans()):
        rows = draw(strategies.integers(1, 80))
        table = draw(arrays(float, (rows, 5), elements=VALUES))
        if draw(strategies.booleans()):
            table[:, 0] = np.sort(table[:, 0])
        drive = draw(strategies.sampled_from(['voltage', 'charge', 'open', 'shorted']))
        names = draw(strategies.sets(strategies.sampled_from(
            ['voltage', 'charge', 'displacement'])))
        return Recording('wild', table[:, 0], drive, table[:, 1], table[:, 2],
                         measured={name: table[:, 3 + k % 2] for k, name in enumerate(names)})
    good = slow(200) if draw(strategies.booleans()) else pushed(200)
    columns = {name: values.copy() for name, values in good.columns().items()}
    for _ in range(draw(strategies.integers(0, 5))):
        name = draw(strategies.sampled_from(sorted(columns)))
        place = draw(strategies.integers(0, 199))
        columns[name][place:place + draw(strategies.integers(1, 40))] = draw(VALUES)
    for _ in range(draw(strategies.integers(0, 3))):
        name = draw(strategies.sampled_from(sorted(columns)))
        with np.errstate(all='ignore'):
            columns[name] *= draw(strategies.sampled_from([-1.0, 1e3, 1e-3, 1e6, 1e9, 0.0, 1e200]))
    return good.replace(
        time=columns['time'], command=columns['voltage_command'],
        external_force=columns.get('external_force'),
        measured={name: columns[name] for name in good.measured})


@given(strategies.lists(recordings(), min_size=1, max_size=2))
@settings(max_examples=200, deadline=None, suppress_health_check=list(HealthCheck))
def test_wild_numbers_are_mended_or_refused(drawn):
    drawn = [each.replace(name=str(k)) for k, each in enumerate(drawn)]
    for device in (None, DEVICE):
        with warnings.catch_warnings():
            # A silent overflow would be a wrong number.
            warnings.simplefilter('error')
            survives(RecordingSet, 'wild', drawn)
