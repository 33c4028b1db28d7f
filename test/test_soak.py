# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Claims about nodes that are left running: a short soak, every fault done once."""

import json
import subprocess
import sys

import pytest

pytest.importorskip('rclpy')

from piezo_stack_sim.commands.soak import _print_markdown  # noqa: E402, I100
from piezo_stack_sim.errors import InputError  # noqa: E402, I100
from piezo_stack_sim.node.soak.run import choose, FAULTS, Outcome  # noqa: E402, I100
from piezo_stack_sim.node.soak.stage import Check  # noqa: E402, I100
from ros_process import ENVIRONMENT, FIRST_START  # noqa: E402, I100


def soak(*arguments):
    return subprocess.run(
        [sys.executable, '-m', 'piezo_stack_sim.cli', 'soak', *arguments], env=ENVIRONMENT,
        capture_output=True, text=True, timeout=2 * FIRST_START)


def test_the_nodes_survive_every_fault():
    done = soak('--device-time', '4', '--wall-time', '1', '--scale', '0.02', '--json')
    assert done.returncode in (0, 1), done.stderr
    outcomes = json.loads(done.stdout)
    assert [o['name'] for o in outcomes] == [*(fault.name for fault in FAULTS), 'end']
    broken = [(o['name'], c) for o in outcomes for c in o['checks'] if not c['held']]
    assert not broken
    assert done.returncode == 0
    for outcome in outcomes[:-1]:
        claims = ' '.join(check['must'] for check in outcome['checks'])
        assert 'offline simulation' in claims and 'memory' in claims and 'finite' in claims


def test_faults_are_listed_without_a_node():
    done = soak('--list')
    assert done.returncode == 0
    assert [line.split()[0] for line in done.stdout.splitlines()] == [f.name for f in FAULTS]


def test_an_unknown_fault_is_told_with_those_that_there_are():
    with pytest.raises(InputError, match='flood'):
        choose(('flod',))


def test_the_table_of_the_documentation_shows_what_broke(capsys):
    outcomes = [Outcome('flood', 'wall', 'much', (Check('it lives', 'no', False),
                                                  Check('it is flat', '0 KiB', True)), 1.0)]
    _print_markdown(outcomes)
    rows = capsys.readouterr().out.splitlines()
    assert {row.count('|') for row in rows} == {6}
    assert rows[2] == '| **flood**: much | wall | it lives | no | **broke** |'
    assert rows[3].endswith('| held |')
    assert not outcomes[0].held
