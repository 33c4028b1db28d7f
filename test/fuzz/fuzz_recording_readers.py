# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Coverage-guided fuzzing of the readers of recordings: CSV, gzip, MCAP, sqlite3, mapping, units.

Not part of the tests, which fuzz less but always; run it by hand, for as long as you like::

    pip install atheris
    python test/fuzz/fuzz_recording_readers.py csv -max_total_time=600

Kinds: csv, csv.gz, mcap, db3, map. Without atheris, or with ``--random SECONDS``, damaged copies
of good files are drawn without guidance. An input that breaks something is kept as ``crash-...``.
"""

from pathlib import Path
import random
import sys
import tempfile
import time

TESTS = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(TESTS), str(TESTS.parent)]

KINDS = ('csv', 'csv.gz', 'mcap', 'db3', 'map')


def target(kind, folder):
    """Return the function of bytes that is fuzzed."""
    from piezo_stack_sim.errors import InputError
    from piezo_stack_sim.recording import (
        parse_mapping, parse_units, preflight, read_bag, read_csv, RecordingSet)
    from recorded import DEVICE
    path = Path(folder) / f'run.{kind}'
    read = read_csv if kind.startswith('csv') else read_bag

    def parse(data):
        text = data.decode('utf-8', 'surrogateescape')
        for parse_one in (parse_mapping, parse_units):
            try:
                parse_one([text])
            except InputError:
                pass

    def consume(data):
        path.write_bytes(data)
        try:
            recording = read(path)
            preflight(RecordingSet('run', (recording,)), DEVICE)
        except InputError as error:
            if '\n' in str(error):
                raise AssertionError('more than one line') from error

    return parse if kind == 'map' else consume


def seed(kind):
    """Return a good input to start from."""
    from test_recording_fuzz import good_files
    return b'displacement=/stage/state.position[0]' if kind == 'map' else good_files()[kind]


def at_random(consume, good, seconds):
    """Draw damaged copies of a good input for some seconds."""
    draw, begin, count = random.Random(0), time.monotonic(), 0
    while time.monotonic() - begin < seconds:
        data = bytearray(good)
        for _ in range(draw.randint(1, 8)):
            place = draw.randrange(len(data) + 1)
            change = draw.randrange(4)
            if change == 0 and place < len(data):
                data[place] = draw.randrange(256)
            elif change == 1:
                del data[place:place + draw.randint(1, 64)]
            elif change == 2:
                data[place:place] = draw.randbytes(draw.randint(1, 16))
            elif draw.random() < 0.2:
                del data[place:]
        try:
            consume(bytes(data))
        except BaseException:
            Path('crash-random').write_bytes(data)
            raise
        count += 1
    print(f'{count} inputs in {seconds:g} s: nothing but recordings and InputError')


def main(arguments):
    """Fuzz one kind of input."""
    if not arguments or arguments[0] not in KINDS:
        sys.exit(f'usage: {sys.argv[0]} {{{",".join(KINDS)}}} [--random SECONDS | libFuzzer ...]')
    kind, *rest = arguments
    with tempfile.TemporaryDirectory() as folder:
        try:
            if rest[:1] == ['--random']:
                raise ImportError
            import atheris
        except ImportError:
            seconds = float(rest[1]) if len(rest) > 1 else 60.0
            at_random(target(kind, folder), seed(kind), seconds)
            return
        with atheris.instrument_imports(include=['piezo_stack_sim', 'rosbags']):
            consume = target(kind, folder)
        corpus = Path(folder) / 'corpus'
        corpus.mkdir()
        (corpus / 'good').write_bytes(seed(kind))
        atheris.Setup([sys.argv[0], *rest, str(corpus)], consume)
        atheris.Fuzz()


if __name__ == '__main__':
    main(sys.argv[1:])
