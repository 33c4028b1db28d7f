# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Where the files of config/ lie: in a checkout, in a colcon workspace or in an environment."""

from pathlib import Path

from piezo_stack_sim.errors import InputError

PACKAGE = 'piezo_stack_sim'


def config_folder():
    """
    Return the folder of the parameter files that come with the package.

    A checkout has ``config/`` beside the package. Every installation, by colcon or by pip, has it
    in ``share/piezo_stack_sim`` of the prefix whose ``lib`` holds the package.

    """
    package = Path(__file__).resolve().parent
    if (package.parent / 'package.xml').is_file():
        return package.parent / 'config'
    for prefix in package.parents:
        folder = prefix / 'share' / PACKAGE / 'config'
        if folder.is_dir():
            return folder
    raise InputError(
        f'{package}: found no share/{PACKAGE}/config above it; install the package again'
    )


def config_file(name):
    """Return the path of one file of config/, such as ``ae0505d16.yaml``."""
    return config_folder() / name
