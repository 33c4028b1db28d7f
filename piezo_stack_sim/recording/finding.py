# Copyright 2026 the piezo_stack_sim maintainers
# SPDX-License-Identifier: Apache-2.0
"""What reading and preflight found out about a recording, and what was done about it."""

from dataclasses import dataclass

NOTE = 'note'
REPAIRED = 'repaired'
REFUSED = 'refused'


@dataclass(frozen=True)
class Finding:
    """
    One thing about one file that its owner should know.

    Attributes
    ----------
    file : str
        The file or bag.
    row : int or None
        The first row concerned: a line number of a CSV file, where the header is row 1, or the
        number of a message, from 1, of the topic that gives a bag its rows. None: the whole file.
    severity : str
        'note' (kept as it is), 'repaired' (mended in memory, never on disk) or 'refused' (left
        out).
    what : str
        What is there, with numbers and units.
    mend : str
        What was done, or what the owner can do.

    """

    file: str
    row: int | None
    severity: str
    what: str
    mend: str = ''

    def __str__(self):
        """Return one line: severity, file, row, what, mend."""
        where = self.file if self.row is None else f'{self.file}: row {self.row}'
        text = f'{self.severity}: {where}: {self.what}'
        return ' '.join((f'{text}: {self.mend}' if self.mend else text).split())


class RefusedError(Exception):
    """A recording, or a channel of it, that preflight will not let pass; carries the Finding."""

    def __init__(self, finding):
        super().__init__(str(finding))
        self.finding = finding


def refuse(recording, row, what, mend):
    """Return the RefusedError about a recording; `row` is the index of a sample, or None."""
    return RefusedError(Finding(recording.source or recording.name, row_of(recording, row),
                                REFUSED, what, mend))


def found(recording, row, severity, what, mend=''):
    """Return a Finding about a recording; `row` is the index of a sample, or None."""
    return Finding(recording.source or recording.name, row_of(recording, row), severity, what,
                   mend)


def renewed(findings, later):
    """Return findings and later ones; what was found of the same once more takes its place."""
    again = {(each.file, each.row, each.what): each for each in later}
    kept = [again.pop((each.file, each.row, each.what), each) for each in findings]
    return [*kept, *again.values()]


def row_of(recording, index):
    """
    Return the row of the file that a sample came from.

    A sample that was put in has none; then it is the row of the last sample before it.

    """
    if index is None:
        return None
    if recording.rows is None:
        return int(index) + 1
    known = recording.rows[:int(index) + 1]
    known = known[known > 0]
    return int(known[-1]) if known.size else None


def shown(text, length=40):
    """Quote text from a file for a message: one line, printable, at most `length` long."""
    text = str(text)
    return repr(text if len(text) <= length else f'{text[:length - 3]}...')
