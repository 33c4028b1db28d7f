#!/usr/bin/env python3
# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Write the reference of the package from its docstrings: `python3 tools/reference.py [FOLDER]`.

Works from any folder. The HTML pages go to `reference/` in the checkout if no folder is given.

"""

import argparse
from pathlib import Path
import subprocess
import sys

import environment

PACKAGE = 'piezo_stack_sim'


def modules():
    """Return the names of all modules that can be imported without being run."""
    folder = environment.ROOT / PACKAGE
    for path in sorted(folder.rglob('*.py')):
        parts = path.relative_to(environment.ROOT).with_suffix('').parts
        if parts[-1] != '__main__':
            yield '.'.join(parts[:-1] if parts[-1] == '__init__' else parts)


def write(folder):
    """Write the pages into a folder; needs pdoc and everything that the package imports."""
    from importlib import import_module
    import warnings

    import pdoc

    names = list(modules())
    for name in names:
        module = import_module(name)
        for public in getattr(module, '__all__', ()):
            # Names that are imported when first asked for: pdoc looks for them in the module.
            setattr(module, public, getattr(module, public))
    # Every module is named, because pdoc passes over those that a package's __all__ leaves out.
    warnings.filterwarnings('ignore', message='The module specification')
    pdoc.render.configure(docformat='numpy', show_source=False, footer_text=PACKAGE)
    pdoc.pdoc(*names, output_directory=Path(folder))
    return len(names)


def main():
    """Make the environment, then write the reference with its Python."""
    parser = argparse.ArgumentParser(description='Write the reference as HTML.')
    parser.add_argument('folder', nargs='?', default=str(environment.ROOT / 'reference'))
    parser.add_argument('--here', action='store_true', help='with this Python, as it is')
    options = parser.parse_args()
    if options.here:
        sys.path.insert(0, str(environment.ROOT))
        count = write(options.folder)
        environment.say(f'{count} modules: {Path(options.folder) / "index.html"}')
        return 0
    python = environment.ensure('ros', 'doc')
    command = [str(python), __file__, '--here', str(Path(options.folder).resolve())]
    return subprocess.run(command, cwd=environment.ROOT, env=environment.variables()).returncode


if __name__ == '__main__':
    environment.run(main)
