# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""The order of the tests: files that take long come first, so that no core waits for another."""

from pathlib import Path

LONG = ('test_laboratory', 'test_gap_strangers', 'test_walkthrough', 'test_documentation',
        'test_gap', 'test_gap_terminals', 'test_soak', 'test_excite', 'test_gap_pairs',
        'test_node_startup', 'test_challenge_forms', 'test_diagnose_many', 'test_identify')


def pytest_configure(config):
    """Have xdist keep that order; it would begin with the files of most tests."""
    if hasattr(config.option, 'loadscopereorder'):
        config.option.loadscopereorder = False


def pytest_collection_modifyitems(items):
    """Sort by file; within a file nothing changes."""
    def place(item):
        name = Path(item.path).stem
        return LONG.index(name) if name in LONG else len(LONG)

    items.sort(key=place)
