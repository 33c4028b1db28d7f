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


def shown(text, length=40):
    """Quote text from a file for a message: one line, printable, at most `length` long."""
    text = str(text)
    return repr(text if len(text) <= length else f'{text[:length - 3]}...')
