#!/usr/bin/env python3
# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Make the environment and run the tests: `python3 tools/test.py [pytest arguments]`.

Works from any folder; paths among the arguments are relative to the checkout.

"""

import os
import subprocess
import sys

import environment


def main():
    """Run pytest in `.venv` and return its exit status."""
    python = environment.ensure('ros', 'test')
    # A file's tests share processes of ROS, so that files are what is spread over the cores. One
    # worker more than these: a test of nodes mostly waits for them.
    workers = 1 + (os.cpu_count() or 1)
    spread = [] if any(a.startswith(('-n', '--numprocesses')) for a in sys.argv[1:]) else [
        '-n', str(workers), '--dist', 'loadfile']
    command = [str(python), '-m', 'pytest', *spread, *sys.argv[1:]]
    return subprocess.run(command, cwd=environment.ROOT, env=environment.variables()).returncode


if __name__ == '__main__':
    environment.run(main)
