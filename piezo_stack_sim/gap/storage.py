# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""``diagnosis.json`` on disk: written whole and valid, read with every error in one line."""

import json
from pathlib import Path

from piezo_stack_sim.atomic import note_input, write_text
from piezo_stack_sim.errors import InputError
from piezo_stack_sim.gap.schema import validate


def write_diagnosis(diagnosis, path):
    """
    Write a diagnosis: a reader finds the old file or the whole new one.

    Parameters
    ----------
    diagnosis : dict
        Plain values only; checked before anything is written.
    path : str or Path
        Usually ``diagnosis.json`` in the folder of the answers.

    Raises
    ------
    InputError
        When the diagnosis does not have the shape of the schema, or the file cannot be written.

    """
    validate(diagnosis, str(path))
    write_text(path, json.dumps(diagnosis, allow_nan=False, ensure_ascii=False,
                                separators=(',', ':')) + '\n')


def read_diagnosis(path):
    """
    Read and check a diagnosis.

    Raises
    ------
    InputError
        When the file cannot be read, is not JSON or is not a diagnosis.

    """
    try:
        text = Path(note_input(path)).read_text(encoding='utf-8')
    except UnicodeDecodeError as error:
        raise InputError(f'{path}: byte {error.start} is not UTF-8: '
                         'expected a diagnosis.json') from error
    except OSError as error:
        raise InputError(f'{path}: cannot be read: {error.strerror}') from error
    try:
        diagnosis = json.loads(text)
    except json.JSONDecodeError as error:
        raise InputError(f'{path}: line {error.lineno}, column {error.colno}: {error.msg}: '
                         'expected JSON, as piezo_stack diagnose writes it') from error
    except (RecursionError, ValueError) as error:
        raise InputError(f'{path}: expected a diagnosis.json, got something nested too deeply or '
                         'with numbers too long') from error
    validate(diagnosis, str(path))
    return diagnosis
