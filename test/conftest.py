# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Which tests run, and in which order.

Files that take long come first, so that no core waits for another.  Tests marked ``slow``, whole
diagnoses, compilations and long generated pages, run where they are asked for (``--slow``) or
named.
"""

from pathlib import Path
import re

import pytest

LONG = ('test_laboratory', 'test_gap_strangers', 'test_walkthrough', 'test_documentation',
        'test_gap', 'test_gap_terminals', 'test_soak', 'test_excite', 'test_gap_pairs',
        'test_node_startup', 'test_challenge_forms', 'test_diagnose_many', 'test_identify')


def pytest_addoption(parser):
    """Let who runs the tests choose how many of the slow ones."""
    parser.addoption('--slow', default='none', metavar='PART', type=_part,
                     help='run the slow tests, too: all, none (the default) or a part, as 2/5')


def _part(text):
    """Return which of how many parts of the slow tests are meant, counted from 0."""
    if text in ('all', 'none'):
        return (0, 1) if text == 'all' else None
    match = re.fullmatch(r'(\d+)/(\d+)', text)
    if not match or not 1 <= int(match[1]) <= int(match[2]):
        raise pytest.UsageError(f'--slow {text}: expected all, none or a part as 2/5')
    return int(match[1]) - 1, int(match[2])


def pytest_configure(config):
    """Have xdist keep that order; it would begin with the files of most tests."""
    config.addinivalue_line('markers', 'slow: takes ten seconds to a minute; see --slow')
    if hasattr(config.option, 'loadscopereorder'):
        config.option.loadscopereorder = False


def pytest_collection_modifyitems(config, items):
    """Sort by file, within which nothing changes; leave out what is slow and was not asked for."""
    slow = sorted((item for item in items if item.get_closest_marker('slow')),
                  key=lambda item: item.nodeid)
    part = config.getoption('--slow')
    if not any('::' in arg for arg in config.args):
        out = slow if part is None else [
            item for i, item in enumerate(slow) if i % part[1] != part[0]]
        config.hook.pytest_deselected(items=out)
        items[:] = [item for item in items if item not in out]

    def place(item):
        name = Path(item.path).stem
        return LONG.index(name) if name in LONG else len(LONG)

    items.sort(key=place)
