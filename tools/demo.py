#!/usr/bin/env python3
# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Make the environment, start the virtual actuator and a controller on its topics, show the result.

Works from any folder; the picture goes to the current one. With --realistic the actuator has a
catalogue-class driver, creep, sensor and noise, of which the controller is not told. Other
arguments are passed on to the controller, see `closed_loop_voltage --help`.

"""

import os
from pathlib import Path
import subprocess
import sys
import tempfile
import time

import environment

CONFIG = environment.ROOT / 'config'
NOMINAL, REALISTIC = CONFIG / 'ae0505d16.yaml', CONFIG / 'ae0505d16_realistic.yaml'
PATIENCE = 120.0  # s; the first start compiles the plant


def wait_until_ready(node, log):
    """Wait for the node's word that it is ready; raise EnvironmentProblem when it ends instead."""
    end = time.monotonic() + PATIENCE
    while 'ready:' not in log.read_text(encoding='utf-8', errors='replace'):
        if node.poll() is not None or time.monotonic() > end:
            text = log.read_text(encoding='utf-8', errors='replace').strip()
            raise environment.EnvironmentProblem(f'the node did not start: {text[-500:]}')
        time.sleep(0.05)


def main():
    """Run node and controller as two processes and return the controller's exit status."""
    arguments = [each for each in sys.argv[1:] if each != '--realistic']
    params = NOMINAL if arguments == sys.argv[1:] else REALISTIC
    scripts = environment.ensure('ros').parent
    variables = environment.variables()
    # Its own domain, so that a device or a controller already running is not disturbed.
    variables.setdefault('ROS_DOMAIN_ID', str(1 + os.getpid() % 100))
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / 'node.log'
        environment.say(f'starting piezo_stack_node with {params.relative_to(environment.ROOT)}')
        with open(log, 'wb') as stream:
            node = subprocess.Popen(
                [str(scripts / 'piezo_stack_node'), '--ros-args', '--params-file', str(params),
                 '-p', 'stepping:=lockstep'],
                env=variables, stdin=subprocess.DEVNULL, stdout=stream, stderr=stream)
        try:
            wait_until_ready(node, log)
            environment.say('starting closed_loop_voltage, a PI controller, on its topics')
            return subprocess.run(
                [str(scripts / 'closed_loop_voltage'), '--params', str(NOMINAL),
                 '--out', 'demo.png', *arguments], env=variables).returncode
        finally:
            node.terminate()
            try:
                node.wait(10.0)
            except subprocess.TimeoutExpired:
                node.kill()
                node.wait()


if __name__ == '__main__':
    environment.run(main)
