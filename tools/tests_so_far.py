#!/usr/bin/env python3
# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Add up the last blind tests in doc/challenge.md: `python3 tools/tests_so_far.py [HOW_MANY]`."""

import argparse
from pathlib import Path

TABLE = Path(__file__).resolve().parents[1] / 'doc' / 'challenge.md'


def rows(text):
    """Yield a dict, column to cell, for every test in the text of the page, the oldest first."""
    lines = text.partition('## The tests so far')[2].splitlines()
    table = [[cell.strip(' `') for cell in line.strip('| ').split('|')]
             for line in lines if line.startswith('|')]
    head, _, *body = table
    for cells in body:
        yield dict(zip(head, cells, strict=True))


def totals(tests):
    """Return column to (right, asked) of what all of these tests counted, by fractions."""
    counted = {}
    for name in tests[0]:
        parts = [test[name].split('/') for test in tests]
        if all(len(part) == 2 for part in parts):
            right, asked = (sum(int(part[i]) for part in parts) for i in (0, 1))
            counted[name] = right, asked
    return counted


def main():
    """Print what the last tests came to, together."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('how_many', nargs='?', type=int, default=10)
    asked = parser.parse_args().how_many
    tests = list(rows(TABLE.read_text(encoding='utf-8')))
    if not 1 <= asked <= len(tests):
        parser.error(f'{asked} tests asked for: {TABLE.name} has 1 to {len(tests)}')
    tests = tests[-asked:]
    print(f'{sum(int(test["devices"]) for test in tests)} devices of {len(tests)} tests, '
          f'seeds {tests[0]["seed"]} to {tests[-1]["seed"]}')
    for name, (right, counted) in totals(tests).items():
        print(f'{name:12} {right}/{counted}  {100.0 * right / counted:.0f} %')


if __name__ == '__main__':
    main()
