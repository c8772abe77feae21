"""Cells of tables, guarded against spreadsheets, which evaluate text that begins like a formula.

Such a text is written with an apostrophe in front, and read without it, so nothing of it is lost. Numbers stay.
"""

import csv
import re
from collections.abc import Iterable
from typing import IO, Any

_FORMULA = re.compile(r"'*\s*[=+\-@＝＋－＠]")
"""Spreadsheets take the wide signs, too. Apostrophes count, so that a text that has its own is read as it was."""


def guarded(value: Any) -> Any:
    """Return a cell's value, with an apostrophe in front if it is a text that a spreadsheet takes for a formula."""
    if not isinstance(value, str) or not _FORMULA.match(value):
        return value
    try:
        float(value)
    except ValueError:
        return f"'{value}"
    return value


def raw(cell: Any) -> Any:
    """Return the value that `guarded` was given."""
    return cell[1:] if isinstance(cell, str) and cell.startswith("'") and _FORMULA.match(cell) else cell


class TableWriter:
    """Writes rows of guarded cells."""

    def __init__(self, stream: IO[str], delimiter: str = ",", lineterminator: str = "\r\n") -> None:
        self._rows = csv.writer(stream, delimiter=delimiter, lineterminator=lineterminator)

    def writerow(self, cells: Iterable[Any]) -> None:
        self._rows.writerow([guarded(cell) for cell in cells])

    def writerows(self, rows: Iterable[Iterable[Any]]) -> None:
        for row in rows:
            self.writerow(row)


def rows_by_column(lines: Iterable[str], delimiter: str = ",") -> list[dict[str, str]]:
    """Return the rows below a header, by column, with their values as they were before they were guarded."""
    return [{name: raw(cell) for name, cell in row.items()} for row in csv.DictReader(lines, delimiter=delimiter)]
