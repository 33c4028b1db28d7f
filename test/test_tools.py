# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""The environment that the two commands of the README make, without making one."""

import importlib.util
import json
from pathlib import Path
import subprocess
import sys

import pytest

SCRIPT = Path(__file__).resolve().parent.parent / 'tools' / 'environment.py'


@pytest.fixture
def environment(tmp_path, monkeypatch):
    """Return the module for a pretended checkout; `installed` lists what pip was asked for."""
    spec = importlib.util.spec_from_file_location('environment', SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    for name in module.SOURCES:
        (tmp_path / name).write_text(name, encoding='utf-8')
    folder = tmp_path / '.venv'
    module.installed = []

    def create():
        folder.mkdir()

    monkeypatch.setattr(module, 'ROOT', tmp_path)
    monkeypatch.setattr(module, 'STAMP', folder / 'stamp.json')
    monkeypatch.setattr(module, '_works', folder.is_dir)
    monkeypatch.setattr(module, '_create', create)
    monkeypatch.setattr(module, '_pip', lambda *arguments: module.installed.append(arguments[-1]))
    return module


def test_nothing_is_installed_twice(environment):
    for _ in range(3):
        environment.ensure('ros', 'test')
        environment.ensure('ros')
    assert environment.installed == ['.[ros,test]']


def test_extras_add_up(environment):
    environment.ensure('ros')
    environment.ensure('test')
    environment.ensure('ros', 'test')
    assert environment.installed == ['.[ros]', '.[ros,test]']


def test_a_changed_package_is_installed_again(environment):
    environment.ensure('ros')
    (environment.ROOT / 'setup.py').write_text('other', encoding='utf-8')
    environment.ensure('ros')
    assert environment.installed == ['.[ros]', '.[ros]']


def test_an_interrupted_installation_is_not_taken_for_complete(environment, monkeypatch):
    environment.ensure('ros')
    (environment.ROOT / 'setup.py').write_text('other', encoding='utf-8')
    with monkeypatch.context() as patch:
        patch.setattr(environment, '_pip', lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
        with pytest.raises(KeyboardInterrupt):
            environment.ensure('ros')
    (environment.ROOT / 'setup.py').write_text('setup.py', encoding='utf-8')
    environment.ensure('ros')
    assert len(environment.installed) == 2


@pytest.mark.parametrize('text', ['', '[]', 'null', '{"extras": 3}', json.dumps({'sources': ''})])
def test_a_broken_stamp_means_another_installation(environment, text):
    environment.ensure('ros')
    environment.STAMP.write_text(text, encoding='utf-8')
    environment.ensure('ros')
    assert len(environment.installed) == 2


def test_programs_see_neither_a_sourced_ros_nor_other_hosts(environment, monkeypatch):
    for name in environment.FOREIGN:
        monkeypatch.setenv(name, 'elsewhere')
    monkeypatch.delenv('ROS_AUTOMATIC_DISCOVERY_RANGE', raising=False)
    variables = environment.variables()
    assert not set(environment.FOREIGN) & set(variables)
    assert variables['ROS_AUTOMATIC_DISCOVERY_RANGE'] == 'LOCALHOST'
    assert variables['PATH'].startswith(str(environment.PYTHON.parent))


def test_a_problem_is_one_line(environment, capsys):
    def main():
        raise environment.EnvironmentProblem('no network')

    with pytest.raises(SystemExit) as ended:
        environment.run(main)
    assert ended.value.code == 1
    assert capsys.readouterr().err.count('\n') == 1


@pytest.mark.slow
def test_the_reference_has_a_page_for_every_module(tmp_path):
    pytest.importorskip('pdoc')
    pytest.importorskip('rclpy')
    script = SCRIPT.parent / 'reference.py'
    done = subprocess.run([sys.executable, str(script), '--here', str(tmp_path)],
                          capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    package = SCRIPT.parent.parent / 'piezo_stack_sim'
    for path in package.rglob('*.py'):
        page = path.relative_to(package.parent).with_suffix('.html')
        if page.name == '__init__.html':
            page = page.parent.with_suffix('.html')
        assert page.name == '__main__.html' or (tmp_path / page).is_file(), page
    simulate = (tmp_path / 'piezo_stack_sim' / 'plant.html').read_text(encoding='utf-8')
    assert 'Strictly increasing times' in simulate  # words of a docstring that is imported lazily


def test_the_readme_says_what_the_last_blind_tests_come_to():
    """What `tools/tests_so_far.py` prints is what the README adds up."""
    script = SCRIPT.parent / 'tests_so_far.py'
    printed = subprocess.run([sys.executable, str(script)], check=True, capture_output=True,
                             text=True).stdout
    said = (SCRIPT.parent.parent / 'README.md').read_text(encoding='utf-8')
    lines = printed.splitlines()
    assert len(lines) == 7
    assert [line for line in lines if line not in said] == []
