# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""Where the subcommands print their tables."""

import sys


def tell_findings(recordings):
    """Print what the reader had to say of a set, where it does not mix with results."""
    import click
    for finding in (*recordings.findings, *(each for recording in recordings.recordings
                                            for each in recording.findings)):
        click.echo(str(finding), err=True)


def console(width=140):
    """
    Return a console for standard output.

    What comes from a file is text, not markup: ``displacement [um]`` keeps its unit. In a pipe
    rich would assume 80 columns and cut; a reader of a file can scroll, hence the ``width``.

    """
    from rich.console import Console
    return Console(width=None if sys.stdout.isatty() else width, highlight=False, markup=False)
