# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""
How the plant's kernels are compiled.

What is compiled is kept on disk, for as long as no source has changed that goes into
it: numba looks at the file of a kernel only, not at those of what it calls.

They get every array from their caller and make none, so that numba need not count
references: counting them took two fifths of the time of a sub-step.
"""

from collections.abc import Callable
import hashlib
from pathlib import Path

from numba import njit

OTHERS = ('compiled.py', 'lanes.py', 'layout.py')  # sources that compile nothing themselves
_HOW = {'cache': True, 'nogil': True, 'error_model': 'numpy', '_nrt': False}


def _stamp() -> str:
    """Return what changes with any source that goes into compiled code."""
    sources = hashlib.sha256()
    for path in sorted(Path(__file__).parent.glob('*.py')):
        text = path.read_bytes()
        if b'plant.compiled import' in text or path.name in OTHERS:
            sources.update(text)
    return sources.hexdigest()


_STAMP = _stamp()


def _decorator(**more) -> Callable:
    compiled = njit(**_HOW, **more)

    def decorate(function):
        made = compiled(function)
        try:
            made._cache._cache_file._source_stamp = _STAMP
        except AttributeError:
            pass  # nothing is compiled, or numba keeps it otherwise and looks at the file alone
        return made

    return decorate


jit = _decorator()
# Where passing a dozen arrays would cost more than the work.
inline = _decorator(forceinline=True)
