# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Claims about starting and stopping `piezo_stack_node`: errors in one line, clean ends."""

from pathlib import Path
import shutil
import signal
import subprocess
import sys
import time

from piezo_stack_sim.errors import InputError
from piezo_stack_sim.plant import kernel
from piezo_stack_sim.plant.compilation import compile_kernels
import pytest
from ros_process import (
    Client, ENVIRONMENT, node_arguments, NodeProcess, NOMINAL, PATIENCE, SPACE)

rclpy = pytest.importorskip('rclpy')

from piezo_stack_sim.node.main import run  # noqa: E402, I100

TEXT = Path(NOMINAL).read_text(encoding='utf-8')
WRONG = {  # name: (text of the file or None for no file, extra parameters, words of the message)
    'misspelt key': (TEXT.replace('stiffness: 6.0e+6', 'stifness: 6.0e+6'), [],
                     ['stifness', 'did you mean actuator.stiffness?', '.yaml:13']),
    'misspelt effect': (TEXT + '    effects:\n      crep: {gain_per_decade: 0.01}\n', [],
                        ['crep', '.yaml:']),
    'missing key': (TEXT.replace('      mass: 0.00375  # kg, m of Table 1\n', ''), [],
                    ['actuator.mass is missing']),
    'unit slip': (TEXT.replace('rate: 1000.0', 'rate: 1.0'), [], ['rate', 'kHz', '1000']),
    'not YAML': ('/**: [', [], ['expected YAML']),
    'mixed list': (TEXT.replace('[0.0, 150.0]', '[0, 150.0]'), [], ['decimal point']),
    'no file': (None, [], ['no such file']),
    'wrong parameter': (TEXT, ['driv:=charge'], ['driv', 'did you mean drive?']),
    'wrong QoS topic': (TEXT, [f'qos_overrides.{SPACE}/stack/displacment.publisher.depth:=5'],
                        ['displacment', 'did you mean', '/displacement.publisher.depth']),
}


@pytest.mark.parametrize('name', WRONG)
def test_what_is_wrong_is_told_with_file_key_and_mend(name, tmp_path):
    text, parameters, words = WRONG[name]
    file = tmp_path / 'wrong.yaml'
    if text is not None:
        file.write_text(text, encoding='utf-8')
    with pytest.raises(InputError) as refusal:
        run(node_arguments(*parameters, file=file))
    for word in words:
        assert word in str(refusal.value)
    assert not rclpy.ok()  # nothing is left behind


def test_what_is_wrong_ends_with_status_2_and_one_line(tmp_path):
    file = tmp_path / 'wrong.yaml'
    file.write_text(WRONG['misspelt key'][0], encoding='utf-8')
    node = NodeProcess(*node_arguments(file=file), wait=False)
    assert node.process.wait(PATIENCE) == 2
    assert node.end()[1].splitlines() == [
        f'{file}:13: actuator.stifness = 6000000.0: expected a known parameter; '
        'did you mean actuator.stiffness?']


@pytest.mark.parametrize('arguments, words', [
    (['--actuator', 'left'], 'NAMESPACE=FILE'),
    (['--no-such-option'], 'unrecognized'),
    (['--actuator', f'a={NOMINAL}', '--actuator', f'/a/={NOMINAL}'], 'different namespaces'),
    (['--actuator', f'a={NOMINAL}', '--actuator', f'b={NOMINAL}', '--ros-args', '-r',
      '__ns:=/lab'], '__ns:=/lab: expected none.*--actuator lab/a='),
])
def test_wrong_arguments_are_told_too(arguments, words):
    with pytest.raises(InputError, match=words):
        run(arguments)


@pytest.mark.parametrize('signum', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_node_cleanly(signum):
    node = NodeProcess(*node_arguments('rate:=250'))
    status, output = node.end(signum)
    assert status == 0
    assert 'Traceback' not in output and 'rror' not in output


@pytest.fixture(scope='module')
def start_time():
    """Return how long a node takes from its call to the word `ready`, s."""
    began = time.monotonic()
    node = NodeProcess(*node_arguments())
    duration = time.monotonic() - began
    node.end()
    return duration


@pytest.mark.parametrize('share', [0.0, 0.2, 0.4, 0.6, 0.8, 0.95])
def test_a_signal_while_it_starts_ends_it_cleanly_too(share, start_time):
    node = NodeProcess(*node_arguments(), wait=False)
    time.sleep(share * start_time)
    status, output = node.end()
    assert status in (0, -signal.SIGTERM)  # the latter before Python has got to this package
    assert 'Traceback' not in output


def compiled_but_for_the_general_kernel(folder):
    """Copy what is compiled to where numba looks for it in another folder, all but one part."""
    compile_kernels()
    code = ('from piezo_stack_sim.plant import kernel; '
            'print(kernel.run._cache.cache_path)')
    target = subprocess.run(
        [sys.executable, '-c', code], env=ENVIRONMENT | {'NUMBA_CACHE_DIR': str(folder)},
        capture_output=True, text=True, check=True).stdout.strip()
    shutil.copytree(kernel.run._cache.cache_path, target, dirs_exist_ok=True,
                    ignore=shutil.ignore_patterns('kernel.run-*', '*.pyc'))


def test_it_starts_before_effects_are_compiled_and_refuses_them_until_then(tmp_path):
    compiled_but_for_the_general_kernel(tmp_path)
    node = NodeProcess(*node_arguments('rate:=100.0'), cache=tmp_path)
    client = Client()
    try:
        client.connect()
        refused = client.set_parameters(effects__sensor_lag__time_constant=1e-3)[0]
        assert not refused.successful and 'compiled' in refused.reason
        # A scale factor is none of the kernel's business.
        assert client.set_parameters(effects__sensor_gain__gain_error=0.1)[0].successful
        node.wait_for('every effect can be switched on now')
        assert client.set_parameters(effects__sensor_lag__time_constant=1e-3)[0].successful
    finally:
        client.close()
        status, output = node.end()
    assert status == 0 and 'Traceback' not in output


def test_it_ends_at_once_while_effects_are_being_compiled(tmp_path):
    node = NodeProcess(*node_arguments('rate:=100.0'), cache=tmp_path)
    node.wait_for('compiling the effects')
    status, output = node.end(signal.SIGINT)
    assert status == 0 and 'Traceback' not in output


def test_without_a_file_it_is_the_stack_of_the_paper():
    node = NodeProcess(*node_arguments('stepping:=lockstep', 'drive:=charge', file=None))
    status, output = node.end()
    assert status == 0
    assert 'NEC/TOKIN AE0505D16' in output and 'drive charge' in output


def test_several_actuators_live_in_one_process_each_with_its_own_file(tmp_path):
    soft = tmp_path / 'soft.yaml'
    soft.write_text(TEXT.replace('stiffness: 6.0e+6', 'stiffness: 3.0e+6'), encoding='utf-8')
    node = NodeProcess('--actuator', f'{SPACE}/left={NOMINAL}', '--actuator',
                       f'{SPACE}/right={soft}', '--ros-args', '-p', 'stepping:=lockstep')
    left, right = (Client(f'{SPACE}/{side}/piezo_stack_node') for side in ('left', 'right'))
    try:
        left.connect()
        right.connect()
        left.forget()
        for client, count in ((left, 20), (right, 30)):
            client.send('voltage_command', *[50.0] * count)
        for client, count in ((left, 20), (right, 30)):
            client.wait_for_states(count)
        assert len(left.rows()) == 20 and len(right.rows()) == 30
        assert right.rows()[-1][0] > 1.05 * left.rows()[-1][0]
        # Their common clock shows no time that one of them has not reached.
        left.until(lambda: left.heard['clock'][-1:] == [20_000_000], 'the common clock')
        assert max(left.heard['clock']) == 20_000_000
    finally:
        left.close()
        right.close()
        assert node.end()[0] == 0


def test_two_nodes_of_the_same_name_keep_their_own_state_and_warn():
    first = NodeProcess(*node_arguments('rate:=100.0'))
    second = NodeProcess(*node_arguments('rate:=100.0', 'drive:=charge'))
    client = Client()
    try:
        first.wait_for('2 nodes are called')
        second.wait_for('2 nodes are called')
        client.until(lambda: len(client.inputs) == 3 and all(
            p.get_subscription_count() == 2 for p in client.inputs.values()), 'both nodes')
        client.send('voltage_command', 50.0)
        client.until(lambda: any(v > 49.0 for v in client.heard['voltage']), 'the voltage driven')
        client.forget()
        # One follows the voltage, the other, driven by charge, refuses and stays.
        client.until(lambda: len({round(v) for v in client.heard['voltage']}) == 2, 'both states')
        client.listen(0.5)
        assert {round(v) for v in client.heard['voltage']} == {0, 50}
    finally:
        client.close()
        assert first.end()[0] == second.end()[0] == 0


@pytest.mark.slow
def test_a_helper_compiles_what_the_kernel_then_finds(tmp_path):
    """From an empty cache: every part is compiled once, by the one process or by the other."""
    script = ('from piezo_stack_sim.plant.compilation import compile_kernels; compile_kernels()\n'
              'from piezo_stack_sim.plant import ideal, modes, kernel\n'
              'print(sum(modes.build_mode.stats.cache_hits.values()),\n'
              '      sum(ideal.run.stats.cache_hits.values()),\n'
              '      len(kernel.run.signatures))\n')
    done = subprocess.run([sys.executable, '-c', script], capture_output=True, text=True,
                          env={**ENVIRONMENT, 'NUMBA_CACHE_DIR': str(tmp_path)}, check=True)
    # The ideal kernel in two forms: alone, and with something that follows the stack.
    assert list(map(int, done.stdout.split())) == [1, 2, 1]
