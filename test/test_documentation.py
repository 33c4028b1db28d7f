# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Claims about the documentation: every command in it exists, and the marked ones run."""

import os
from pathlib import Path
import re
import shlex
import signal
import socket
import subprocess
import sys
from textwrap import dedent
import time

import click
from piezo_stack_sim.cli import cli
import pytest

ROOT = Path(__file__).resolve().parent.parent
PAGES = [path for path in (ROOT / 'README.md', *sorted((ROOT / 'doc').rglob('*.md')))
         if path.is_file()]
pytestmark = pytest.mark.skipif(len(PAGES) < 2, reason='the tests run outside a checkout')
# A comment above a block of indented lines says that it can be run as it stands; what follows a
# colon are modules that it needs. All such blocks of a page make one script.
MARK = re.compile(r'<!-- executed(?:: (?P<needs>[\w ]+))? -->')
SLOW = ('run-on-a-cluster', 'model-your-actuator', 'laboratory-recordings')
PATIENCE = 400.0  # s for one page, compilation included


def blocks(page):
    """Return the indented blocks of a page: what they need, None if not marked, and the text."""
    found, needs, lines = [], None, []
    for line in [*page.read_text(encoding='utf-8').splitlines(), 'end']:
        if re.match(r' {4,}\S', line) or (lines and not line.strip()):
            lines.append(line)
            continue
        text = dedent('\n'.join(lines)).strip('\n')
        if text:
            found.append((needs, text))
            needs = None
        lines = []
        if line.strip():
            mark = MARK.search(line)
            needs = (mark['needs'] or '').split() if mark else None
    return found


def commands():
    """Return every shell command of a page that starts with `piezo_stack`."""
    for page in PAGES:
        for _, text in blocks(page):
            for line in text.replace('\\\n', ' ').splitlines():
                if re.match(r'piezo_stack [a-z]', line) and '...' not in line:
                    yield pytest.param(line, id=f'{page.name}: {line[:50]}')


@pytest.mark.parametrize('line', list(commands()))
def test_every_command_shown_has_these_options(line):
    words = shlex.split(line.partition(' > ')[0].rstrip('& '), comments=True)[1:]
    group, name = cli, 'piezo_stack'
    context = click.Context(group)
    while isinstance(group, click.Group):
        name = words.pop(0)
        command = group.get_command(context, name)
        assert command is not None, f'there is no {name}'
        group = command
    if '--help' not in words:
        group.make_context(name, words).close()  # raises what the user would see


def executable():
    for page in PAGES:
        marked = [(needs, text) for needs, text in blocks(page) if needs is not None]
        if marked:
            needs = sorted({module for needed, _ in marked for module in needed})
            yield pytest.param(needs, '\n'.join(text for _, text in marked), id=page.stem,
                               marks=[pytest.mark.slow] if page.stem in SLOW else [])


@pytest.fixture
def shell(tmp_path):
    """Run a script as a user of an installed package would, in an empty folder."""
    programs = tmp_path / 'bin'
    programs.mkdir()
    source = (ROOT / 'setup.py').read_text(encoding='utf-8')
    scripts = dict(re.findall(r"f'(\w+) = \{PACKAGE\}\.([\w.]+):main'", source))
    modules = {name: f'-m piezo_stack_sim.{module}' for name, module in scripts.items()}
    for name, arguments in {**modules, 'python3': '', 'dask': '-m dask'}.items():
        program = programs / name
        program.write_text(f'#!/bin/sh\nexec "{sys.executable}" {arguments} "$@"\n')
        program.chmod(0o755)
    folder = tmp_path / 'work'
    folder.mkdir()
    from ros_process import ENVIRONMENT
    environment = {**ENVIRONMENT, 'PATH': f'{programs}:{os.environ["PATH"]}'}

    def run(script):
        log = tmp_path / 'output.txt'
        with open(log, 'w', encoding='utf-8') as stream:
            process = subprocess.Popen(
                ['bash', '-eu', '-o', 'pipefail', '-c', script], cwd=folder, env=environment,
                stdin=subprocess.DEVNULL, stdout=stream, stderr=stream, start_new_session=True)
        try:
            status = process.wait(PATIENCE)
            return status, log.read_text(encoding='utf-8')
        finally:
            for signum in (signal.SIGTERM, signal.SIGKILL):  # what it left running, a node mostly
                try:
                    os.killpg(process.pid, signum)
                except ProcessLookupError:
                    break
                time.sleep(2.0)

    return run


@pytest.mark.parametrize('needs, script', list(executable()))
def test_what_is_marked_as_executed_runs(needs, script, shell):
    for module in ['rclpy', *needs]:
        pytest.importorskip(module)
    with socket.socket() as free:  # so that two runs on one host do not meet at Dask's port
        free.bind(('127.0.0.1', 0))
        port = free.getsockname()[1]
    status, output = shell(script.replace('8786', str(port)))
    assert status == 0, output
    assert 'Traceback' not in output


def test_every_link_inside_the_documentation_leads_somewhere():
    for page in PAGES:
        for target in re.findall(r'\]\(([^)#\s]+)(?:#[^)]*)?\)', page.read_text(encoding='utf-8')):
            if '://' not in target:
                assert (page.parent / target).exists(), f'{page.name}: {target}'
