# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Claims of the paper, shown by the example controllers as processes of their own."""

import re
import subprocess
import sys

import numpy as np
from piezo_stack_sim.errors import InputError
from piezo_stack_sim.examples.tracking import HEIGHT, reference, Run, table, VALLEY
import pytest
from ros_process import (
    ENVIRONMENT, FIRST_START, node_arguments, NodeProcess, PATIENCE, SPACE)

rclpy = pytest.importorskip('rclpy')


@pytest.fixture(scope='module')
def device():
    """One device in lockstep for all examples."""
    node = NodeProcess(*node_arguments('stepping:=lockstep'))
    yield f'{SPACE}/stack'
    assert node.end()[0] == 0


def example(name, folder, *arguments):
    """Run an example to its end; return its status, what it said and its errors."""
    done = subprocess.run(
        [sys.executable, '-m', f'piezo_stack_sim.examples.{name}', '--waves', '2',
         '--out', str(folder / name), *arguments],
        env=ENVIRONMENT, capture_output=True, text=True, timeout=PATIENCE + FIRST_START)
    return done.returncode, done.stdout, done.stderr


def percentages(output, label):
    """Return RMS error, largest error and loop width, in per cent, of a row of the table."""
    row = next(line for line in output.splitlines() if line.startswith(label))
    return [float(number) for number in re.findall(r'([\d.]+)%', row.removeprefix(label))]


def test_voltage_control_works_against_a_hysteretic_plant(device, tmp_path):
    status, output, errors = example('closed_loop_voltage', tmp_path, '--device', device)
    assert status == 0, errors
    open_rms, _, open_loop = percentages(output, 'constant gain')
    closed_rms, _, closed_loop = percentages(output, 'PI by voltage')
    assert 15.0 < open_loop < 25.0 and 15.0 < closed_loop < 25.0
    assert open_rms > 8.0
    assert closed_rms < 1.5
    assert (tmp_path / 'closed_loop_voltage.png').stat().st_size > 10_000


def test_charge_control_sees_a_linear_plant(device, tmp_path):
    status, output, errors = example('closed_loop_charge', tmp_path, '--device', device)
    assert status == 0, errors
    assert percentages(output, 'constant gain') == [0.0, 0.0, 0.0]
    rms, _, loop = percentages(output, 'PI by charge')
    assert rms < 1.5 and loop < 0.05
    assert (tmp_path / 'closed_loop_charge.png').exists()


def test_the_inverse_model_removes_most_of_the_hysteresis(tmp_path):
    status, output, errors = example('feed_forward', tmp_path, '--start', '--device',
                                     '/piezo_stack_node')
    assert status == 0, errors
    shares = [float(n) for n in re.findall(r'removes ([\d.]+)%', output)]
    assert shares[0] > 99.0
    assert shares[1] > 90.0
    assert (tmp_path / 'feed_forward.svg').exists()


def test_without_a_device_the_mend_is_told(monkeypatch):
    from piezo_stack_sim.examples import stack_client
    monkeypatch.setattr(stack_client, 'PATIENCE', 0.3)
    with pytest.raises(InputError, match='start one with piezo_stack_node'):
        stack_client.in_ros([], lambda: stack_client.StackClient('/nobody', 'voltage'))


def test_a_controller_by_wall_time_gets_every_sample_it_answers():
    from piezo_stack_sim.examples.stack_client import in_ros, StackClient
    node = NodeProcess(*node_arguments('rate:=200', name='by_wall_time'))
    heights = np.array([HEIGHT, VALLEY, 6e-6])
    answers = {height: [] for height in heights}

    def task():
        client = StackClient(f'{SPACE}/by_wall_time', 'charge')
        client.reset()
        for height in heights:
            for _ in range(100):  # however late the command gets there
                answers[height].append(client.exchange(height / 9.32836e-2))
                if answers[height][-1][1] == pytest.approx(height, rel=0.01):
                    break
        client.close()

    in_ros([], task)
    assert node.end()[0] == 0
    reached = [answers[height][-1][1] for height in heights]
    assert reached == pytest.approx(heights, rel=0.01)
    numbers = [number for height in heights for number, _ in answers[height]]
    assert numbers == sorted(set(numbers))  # no sample came twice, or before the one it follows


class Late:
    """A device by wall time whose samples 3 and 4 the controller was too late for."""

    rate, delay = 100.0, 2

    def __init__(self):
        self.numbers, self.commands = iter([1, 2, *range(5, 1000)]), []

    def reset(self):
        self.commands.clear()

    def exchange(self, command):
        self.commands.append(command)
        return next(self.numbers), 1e-6 * len(self.commands)


def test_a_sample_that_was_missed_counts_as_the_next_one():
    from piezo_stack_sim.examples.experiment import track
    device = Late()
    run = track(device, 'charge', lambda wanted, ahead, measured: ahead, 2)
    assert list(run.displacement[:7]) == pytest.approx(
        [0.0, 1e-6, 2e-6, 3e-6, 3e-6, 3e-6, 4e-6])
    assert list(run.command[2:5]) == [device.commands[2]] * 3
    assert device.commands[3] == run.reference[5 + device.delay]


@pytest.mark.parametrize('rate', [100.0, 1000.0])
def test_the_reference_begins_at_rest_and_turns_smoothly(rate):
    wanted = reference(rate, 5)
    assert wanted[0] == 0.0
    assert wanted.max() == pytest.approx(HEIGHT, rel=1e-3)
    assert wanted[-1] == pytest.approx(VALLEY)
    assert np.abs(np.diff(wanted, 2)).max() * rate ** 2 < 1e-3  # m/s^2


def test_the_table_states_errors_in_nanometres_and_per_cent():
    wanted = reference(100.0, 2)
    run = Run('lagging', 100.0, 1, wanted, wanted * 1e7, np.roll(wanted, 1))
    assert f'{run.rms_error * 1e9:.1f} nm' in table([run])
    assert run.loop_width < 1e-6  # a delay of one sample is no hysteresis
