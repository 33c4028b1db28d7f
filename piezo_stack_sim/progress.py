# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Progress of long work: a bar on a terminal, nothing in a pipe."""

from contextlib import contextmanager
import sys


class Bars:
    """
    A bar for each piece of work that reports how far it is; a context and a callable.

    Called with the name of a piece, how much of it is done and how much there is.
    """

    def __enter__(self):
        self._bar, self._tasks = None, {}
        if sys.stderr.isatty():
            self._bar = _progress()
            self._bar.start()
        return self

    def __call__(self, name, done, total=1.0):
        """Show that so much of a piece is done."""
        if self._bar:
            from rich.markup import escape
            if name not in self._tasks:
                self._tasks[name] = self._bar.add_task(escape(name), total=total)
            self._bar.update(self._tasks[name], completed=done)

    def __exit__(self, *_):
        if self._bar:
            self._bar.stop()


class Stage:
    """A spinner with the present stage of one long piece of work; a context and a callable."""

    def __init__(self, before=''):
        self._before, self._status = before, None

    def __enter__(self):
        if sys.stderr.isatty():
            from rich.console import Console
            self._status = Console(stderr=True).status('starting')
            self._status.start()
        return self

    def __call__(self, stage):
        """Show what is being done."""
        if self._status:
            from rich.markup import escape
            self._status.update(escape(f'{self._before}{stage}'))

    def __exit__(self, *_):
        if self._status:
            self._status.stop()


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
    from rich.markup import escape
    with _progress() as bar:
        yield from bar.track(items, total, description=escape(description))


@contextmanager
def counted(description, total):
    """Give a function that is told how many are done, shown on a terminal; None elsewhere."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.markup import escape
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
    columns = (TextColumn(escape(description)), BarColumn(), MofNCompleteColumn(),
               TimeRemainingColumn())
    with _progress(*columns) as bar:
        task = bar.add_task(description, total=total)
        yield lambda done: bar.update(task, completed=done)


def _progress(*columns):
    from rich.console import Console
    from rich.progress import Progress
    # What is printed meanwhile goes above the bar, but not where stdout goes to a file.
    return Progress(*columns, console=Console(stderr=True), transient=True,
                    redirect_stdout=sys.stdout.isatty())
