# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Progress of long work: a bar on a terminal, nothing in a pipe."""

import sys


def track(items, description, total=None):
    """
    Yield the items one by one and show how far it is, on stderr, if that is a terminal.

    Parameters
    ----------
    items : iterable
        The pieces of work.
    description : str
        What is being done, such as ``'Simulating'``.
    total : int, optional
        How many there are, for an iterable without a length.

    """
    if not sys.stderr.isatty():
        yield from items
        return
    from rich.console import Console
    from rich.progress import track as bar
    yield from bar(items, description, total, console=Console(stderr=True), transient=True)
