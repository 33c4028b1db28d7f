# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""The generator of the blind benchmark shares no physics with what it examines."""

import ast
from pathlib import Path
import subprocess
import sys

import piezo_stack_sim
import pytest

FOLDER = Path(piezo_stack_sim.__file__).parent / 'challenge'
MODULES = sorted(path.stem for path in FOLDER.glob('*.py'))
#: What the folder may use of the package besides itself: nothing of it knows any physics.
ALLOWED = {'piezo_stack_sim.atomic', 'piezo_stack_sim.challenge', 'piezo_stack_sim.errors',
           'piezo_stack_sim.plotting', 'piezo_stack_sim.spread'}


def imported(path):
    """Yield the modules that a file imports, at its top or inside functions."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f'{path.name}: relative import hides what is imported'
            if node.module == 'piezo_stack_sim':
                yield from (f'piezo_stack_sim.{alias.name}' for alias in node.names)
            else:
                yield node.module
        elif isinstance(node, ast.Call) and getattr(node.func, 'attr', getattr(
                node.func, 'id', '')) in {'import_module', '__import__'}:
            yield 'imported by name'


@pytest.mark.parametrize('module', MODULES)
def test_no_module_of_the_challenge_imports_plant_or_effects(module):
    """Neither at the top nor later, neither by statement nor by name."""
    for name in imported(FOLDER / f'{module}.py'):
        assert name != 'imported by name', 'use an import statement'
        if name.partition('.')[0] == 'piezo_stack_sim':
            assert any(name == allowed or name.startswith(allowed + '.') for allowed in ALLOWED)


def test_making_a_response_loads_neither_plant_nor_effects():
    """What imports cannot show: nothing comes in through a third module either."""
    script = (
        'import sys\n'
        'import numpy as np\n'
        'import piezo_stack_sim.challenge.make, piezo_stack_sim.challenge.score\n'
        'from piezo_stack_sim.challenge.device import Programme, respond, Unit\n'
        't = np.arange(20) * 1e-4\n'
        "respond(Unit(), Programme('p', t, 1e3 * t, 0 * t))\n"
        "print([m for m in sys.modules if m.startswith('piezo_stack_sim.') and m.split('.')[1] in"
        " {'plant', 'effects', 'identify', 'gap', 'node'}])\n"
    )
    done = subprocess.run([sys.executable, '-c', script], capture_output=True, text=True)
    assert done.stdout.strip() == '[]', done.stdout + done.stderr
