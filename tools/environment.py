# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Make and refresh the virtual environment `.venv` of this checkout; nothing but Python needed."""

import argparse
import hashlib
import json
import os
from pathlib import Path
import re
import subprocess
import sys

ROOT = Path(__file__).resolve().parent.parent
FOLDER = ROOT / '.venv'
PYTHON = FOLDER / 'bin' / 'python'
STAMP = FOLDER / 'piezo_stack_sim.json'
OLDEST = (3, 10)
NEWEST_ROS = (3, 13)
# What decides which packages the environment holds.
SOURCES = ('setup.py', 'setup.cfg', 'pyproject.toml', 'package.xml')
# A sourced ROS installation or another environment would shadow the packages of this one.
FOREIGN = (
    '_ROS_WHEELS_BOOTSTRAP_COMPLETE',
    'AMENT_PREFIX_PATH',
    'LD_LIBRARY_PATH',
    'PYTHONHOME',
    'PYTHONPATH',
    'VIRTUAL_ENV',
)


class EnvironmentProblem(Exception):
    """The environment cannot be made; the message says why and what to do."""


def say(text):
    """Print one line of progress, on stderr so that it never mixes with results."""
    print(text, file=sys.stderr, flush=True)


def variables():
    """Return the environment variables for the programs of `.venv`, kept to this host."""
    clean = {name: value for name, value in os.environ.items() if name not in FOREIGN}
    clean['PATH'] = f'{PYTHON.parent}{os.pathsep}{clean.get("PATH", os.defpath)}'
    clean.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    return clean


def ensure(*extras):
    """
    Make `.venv` hold this package, editable, with some of its extras.

    Does nothing when it already does and the package's metadata are unchanged.

    Parameters
    ----------
    *extras : str
        Extras of setup.py, such as ``'ros'``.

    Returns
    -------
    Path
        The environment's Python.

    Raises
    ------
    EnvironmentProblem
        There is no venv module, or pip cannot install.

    """
    if sys.version_info < OLDEST:
        raise EnvironmentProblem(
            f'Python {OLDEST[0]}.{OLDEST[1]} or newer is needed, this is {sys.version.split()[0]};'
            ' start this script with a newer python3')
    digest = hashlib.sha256()
    for name in SOURCES:
        digest.update((ROOT / name).read_bytes())
    sources = digest.hexdigest()
    stamp = _read_stamp() if _works() else {}
    if stamp.get('sources') == sources and set(extras) <= set(stamp['extras']):
        return PYTHON
    if not _works():
        _create()
    wanted = sorted({*extras, *stamp.get('extras', ())})
    suffix = f'[{",".join(wanted)}]' if wanted else ''
    say(f'installing piezo_stack_sim{suffix} and what it needs (minutes the first time)')
    STAMP.unlink(missing_ok=True)  # a broken installation must not look complete
    _pip('install', '--editable', f'.{suffix}')
    STAMP.write_text(json.dumps({'sources': sources, 'extras': wanted}), encoding='utf-8')
    return PYTHON


def _read_stamp():
    try:
        stamp = json.loads(STAMP.read_text(encoding='utf-8'))
        return stamp if isinstance(stamp.get('extras'), list) else {}
    except (OSError, ValueError, AttributeError):
        return {}


def _works():
    """Tell whether `.venv` has a Python that runs: its base may be gone, or its making cut off."""
    if not PYTHON.exists():
        return False
    test = [str(PYTHON), '-c', 'import pip']
    return subprocess.run(test, env=variables(), capture_output=True).returncode == 0


def _create():
    say(f'making {FOLDER} with Python {sys.version.split()[0]}')
    made = subprocess.run(
        [sys.executable, '-m', 'venv', '--clear', str(FOLDER)],
        env=variables(), capture_output=True, text=True)
    if made.returncode:
        text = (made.stdout + made.stderr).strip()
        if 'ensurepip' in text or 'No module named venv' in text:
            raise EnvironmentProblem('this Python cannot make virtual environments; on Debian and '
                                     'Ubuntu: sudo apt install python3-venv')
        raise EnvironmentProblem(f'cannot make {FOLDER}: {text.splitlines()[-1:]}')


def _pip(*arguments):
    command = [str(PYTHON), '-m', 'pip', *arguments, '--quiet', '--disable-pip-version-check']
    done = subprocess.run(command, cwd=ROOT, env=variables(), capture_output=True, text=True)
    if done.returncode == 0:
        return
    lines = [line.strip(' |\u2502') for line in (done.stdout + done.stderr).splitlines()]
    for line in [line for line in lines if line.lower().startswith('error')][:3]:
        say(f'  pip: {line}')
    if sys.version_info[:2] > NEWEST_ROS:
        reason = (f'ROS 2 has wheels for Python up to {NEWEST_ROS[0]}.{NEWEST_ROS[1]}: start this '
                  f'script with such a python3 (and remove {FOLDER} before)')
    elif re.search('from versions: none|onnection|imed out|imeout|unreachable', done.stderr):
        reason = 'are the network and the package index reachable?'
    else:
        reason = f'"{PYTHON} -m pip install -e {arguments[-1]}" in {ROOT} tells more'
    raise EnvironmentProblem(f'pip could not install the packages; {reason}')


def run(main):
    """Run a script's main function and end the process, with one line for what went wrong."""
    try:
        status = main()
    except EnvironmentProblem as problem:
        say(f'{Path(sys.argv[0]).name}: {problem}')
        status = 1
    except OSError as error:
        say(f'{Path(sys.argv[0]).name}: {error}')
        status = 1
    except KeyboardInterrupt:
        status = 130
    sys.exit(status)


def main():
    """Make the environment and print its Python, for shell scripts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('extras', nargs='*', help='extras of setup.py, such as ros, test, lint')
    print(ensure(*parser.parse_args().extras))
    return 0


if __name__ == '__main__':
    run(main)
