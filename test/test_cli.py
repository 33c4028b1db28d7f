# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""The command piezo_stack: its help, its exit status, its one-line errors."""

import os
from pathlib import Path
import signal
import subprocess
import sys

import click
from piezo_stack_sim import cli
from piezo_stack_sim.errors import InputError
from piezo_stack_sim.resources import config_file
import pytest


@pytest.fixture
def act(monkeypatch):
    """Return a function that installs a subcommand `act` which runs a given function."""
    def install(function):
        command = click.Command('act', callback=function)
        monkeypatch.setitem(cli.COMMANDS, 'act', 'A test.')
        monkeypatch.setattr(cli.LazyGroup, 'list_commands', lambda self, ctx: ['act'])
        monkeypatch.setattr(cli.LazyGroup, 'get_command', lambda self, ctx, name: command)
        return lambda *arguments: cli.main(['act', *arguments])
    return install


def raising(error):
    """Return a function that raises an error."""
    def function():
        raise error
    return function


def one_line(capsys):
    """Return what stands on stderr, which must be one line, with nothing on stdout."""
    out, err = capsys.readouterr()
    assert out == ''
    assert err.count('\n') == 1
    return err


@pytest.mark.parametrize('arguments', [[], ['--help'], ['-h']])
def test_help_lists_the_installed_subcommands(capsys, arguments):
    assert cli.main(arguments) == 0
    out, err = capsys.readouterr()
    assert 'simulate' in out
    assert err == ''


def test_help_imports_nothing_heavy():
    heavy = ['matplotlib', 'numba', 'numpy', 'rclpy', 'rich', 'rosbags', 'scipy', 'yaml']
    code = ('import sys; from piezo_stack_sim.cli import main; main(["--help"]); '
            f'print([name for name in {heavy} if name in sys.modules])')
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == '[]'


@pytest.mark.parametrize('name', cli.LazyGroup('g').list_commands(None))
def test_every_subcommand_has_a_help_page(capsys, name):
    assert cli.main([name, '--help']) == 0
    assert f'piezo_stack {name}' in capsys.readouterr().out


def test_every_command_module_is_listed():
    modules = {path.stem for path in cli.FOLDER.glob('*.py')} - {'__init__', 'options'}
    assert modules <= {name.replace('-', '_') for name in cli.COMMANDS}


@pytest.mark.parametrize('arguments, words', [
    (['simulat'], ["'simulat'", 'did you mean simulate?']),
    (['nonsense'], ['choose', 'simulate']),
    (['--nonsense'], ['--nonsense']),
    (['simulate'], ['SET', 'piezo_stack simulate --help']),
    (['simulate', 'somewhere', '--out', 'x'], ['--params']),
    (['simulate', 'somewhere', '--prams', 'x'], ['--params']),
])
def test_wrong_arguments_end_with_status_2_and_one_line(capsys, arguments, words):
    assert cli.main(arguments) == 2
    err = one_line(capsys)
    for word in words:
        assert word in err


def test_wrong_input_ends_with_status_2_and_one_line(capsys, act):
    run = act(raising(InputError('file.yaml: mass = -1:\nexpected more')))
    assert run() == 2
    assert one_line(capsys) == 'file.yaml: mass = -1: expected more\n'


@pytest.mark.parametrize('arguments', [
    ['simulate', 'set', '--params', 'p'], ['report', 'x'],
    ['diagnose', 'set', '--params', 'p'], ['identify', 'set'], ['excite', 'triangle'],
    ['export', 'spice', '--params', 'p'], ['effects', 'creep'], ['challenge', 'make'],
    ['from-datasheet', '--free-stroke', '1e-5', '--blocking-force', '800', '--capacitance',
     '1e-6', '--voltage-range', '0', '150']])
@pytest.mark.parametrize('path', ['', ' '])
def test_nothing_is_written_where_no_path_is_given(arguments, path, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert cli.main([*arguments, '--out', path]) == 2
    assert f'--out {path!r}: expected a path to write to' in one_line(capsys)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize('group, names', [
    ('export', 'spice'), ('challenge', 'answer, make, score')])
def test_a_group_without_a_command_names_those_it_has(capsys, group, names):
    assert cli.main([group]) == 2
    assert one_line(capsys) == (f'piezo_stack {group}: expected a command after it; choose '
                                f'{names}; see "piezo_stack {group} --help"\n')


def test_one_device_has_one_parameter_file(capsys, tmp_path):
    for command in (['analyse'], ['excite', 'triangle', '--out', str(tmp_path / 'set')]):
        assert cli.main([*command, '--params', 'a.yaml', '--params', 'b.yaml']) == 2
        assert one_line(capsys).startswith('--params: given 2 times')


def test_a_missing_parameter_file_is_wrong_input(capsys, tmp_path):
    (tmp_path / 'set').mkdir()
    arguments = ['simulate', str(tmp_path / 'set'), '--params', str(tmp_path / 'no.yaml'),
                 '--out', str(tmp_path / 'out')]
    assert cli.main(arguments) == 2
    assert 'no.yaml: no such file' in one_line(capsys)


def test_recordings_are_never_overwritten_by_their_simulation(capsys, tmp_path):
    arguments = ['simulate', str(tmp_path), '--params', str(config_file('ae0505d16.yaml')),
                 '--out', f'{tmp_path}/.']
    assert cli.main(arguments) == 2
    assert 'overwritten' in one_line(capsys)


def test_a_fault_of_the_program_is_one_line_without_traceback(capsys, act, monkeypatch):
    monkeypatch.delenv('PIEZO_STACK_DEBUG', raising=False)
    run = act(raising(ZeroDivisionError('by\nzero')))
    assert run() == 1
    err = one_line(capsys)
    assert 'ZeroDivisionError: by zero' in err
    assert 'PIEZO_STACK_DEBUG=1' in err
    monkeypatch.setenv('PIEZO_STACK_DEBUG', '1')
    with pytest.raises(ZeroDivisionError):
        run()


def test_a_missing_package_is_named_with_its_cure(capsys, act):
    run = act(raising(ModuleNotFoundError('No module named rclpy', name='rclpy')))
    assert run() == 1
    err = one_line(capsys)
    assert 'rclpy' in err
    assert 'piezo_stack_sim[ros]' in err


def test_an_interrupt_ends_with_status_130(capsys, act):
    assert act(raising(KeyboardInterrupt()))() == 130
    assert one_line(capsys) == 'interrupted\n'


def test_a_real_interrupt_leaves_no_traceback():
    code = ('import os, signal, click, piezo_stack_sim.cli as cli\n'
            # A shell that runs tests in the background hands SIGINT down as ignored.
            'signal.signal(signal.SIGINT, signal.default_int_handler)\n'
            'cli.LazyGroup.list_commands = lambda self, ctx: ["wait"]\n'
            'cli.LazyGroup.get_command = lambda self, ctx, name: click.Command(\n'
            '    "wait", callback=lambda: os.kill(os.getpid(), signal.SIGINT))\n'
            'raise SystemExit(cli.main(["wait"]))')
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True)
    assert done.returncode == 130, signal.SIGINT
    assert 'Traceback' not in done.stderr


def test_a_closed_pipe_ends_quietly():
    reading, writing = os.pipe()
    os.close(reading)
    done = subprocess.run([sys.executable, '-m', 'piezo_stack_sim', '--help'],
                          stdout=writing, stderr=subprocess.PIPE, text=True)
    os.close(writing)
    assert done.stderr == ''
    assert done.returncode == 141


def test_the_folder_of_the_supplied_files_is_printed(capsys):
    assert cli.main(['--config']) == 0
    assert capsys.readouterr().out.strip() == str(config_file('x').parent)


@pytest.mark.parametrize('arguments', [
    ['export', 'spice', '--params', 'device.yaml', '--out', 'device.yaml'],
    ['export', 'spice', '--params', 'device.yaml', '--out', 'link.yaml']])
def test_what_a_command_reads_it_does_not_write_over(arguments, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    before = Path(config_file('ae0505d16.yaml')).read_bytes()
    Path('device.yaml').write_bytes(before)
    Path('link.yaml').symlink_to('device.yaml')
    assert cli.main(arguments) == 2
    assert 'is what was read' in capsys.readouterr().err
    assert Path('device.yaml').read_bytes() == before


def test_a_path_that_the_system_refuses_is_named_in_one_line(capsys):
    assert cli.main(['compare', 'x' * 300, '--params', str(config_file('ae0505d16.yaml'))]) == 2
    error = capsys.readouterr().err
    assert error.count('\n') == 1 and 'xxx' in error and 'internal' not in error
