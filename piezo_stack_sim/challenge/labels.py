# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Commit and reveal: labels lie outside the public folder, which holds only their salted hash."""

import hashlib
import json
from pathlib import Path

from piezo_stack_sim.atomic import write_text
from piezo_stack_sim.errors import InputError

SCHEMA = 'piezo_stack_sim/challenge-labels/1'


def label_file(public):
    """Return where the labels of a public folder lie by default."""
    public = Path(public)
    return public.with_name(public.name + '.labels.json')


def truth_folder(public):
    """Return where the noise-free responses of a public folder lie."""
    public = Path(public)
    return public.with_name(public.name + '.truth')


def commit(public, content):
    """
    Write the labels beside the public folder and their hash into it; return the label file.

    The salt follows from the seed, which the public folder does not tell: without it the few
    possible labels could be tried out against the hash.

    """
    salt = hashlib.sha256(f'salt of {content["seed"]}'.encode()).hexdigest()
    text = json.dumps({'schema': SCHEMA, 'salt': salt, **content}, indent=1) + '\n'
    path = label_file(public)
    write_text(path, text)
    write_text(Path(public) / 'labels.sha256', digest(text.encode()) + '\n')
    return path


def digest(content):
    """Return the SHA-256 of bytes, in hexadecimal."""
    return hashlib.sha256(content).hexdigest()


def reveal(public, path=None):
    """
    Return the labels (dict) of a public folder once they prove to be those committed to.

    Raises
    ------
    InputError
        When a file is missing or the labels are not the ones whose hash was published.

    """
    path = Path(path) if path else label_file(public)
    committed = Path(public) / 'labels.sha256'
    for needed in (path, committed):
        if not needed.is_file():
            raise InputError(f'{needed}: no such file; expected what `challenge make` wrote')
    content = path.read_bytes()
    published = committed.read_text().split()
    if not published or digest(content) != published[0]:
        raise InputError(f'{path}: not the labels that {committed} commits to; '
                         'they were changed, or belong to another batch')
    labels = json.loads(content)
    if labels.get('schema') != SCHEMA:
        raise InputError(f'{path}: schema {labels.get("schema")!r}; expected {SCHEMA!r}')
    return labels
