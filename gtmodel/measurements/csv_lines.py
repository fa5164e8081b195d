"""A CSV file as lines of cells, for all that read one."""

from __future__ import annotations

import csv
from pathlib import Path

from ..results.refusal import ArgumentError

Line = tuple[int, list[str]]
_NO_CSV = (".mat", ".xlsx", ".xls", ".ods", ".mdf", ".mf4", ".parquet")


def lines_of(path: Path, header: str) -> tuple[Line, list[Line]]:
    """The header and the rows: line numbers from 1 and cells without blanks around them, one line of text each.

    Empty lines and those that begin with # are left out; a byte order mark, as spreadsheets write it, too.

    Args:
        header: an example, for the message about an empty file.

    Raises ArgumentError: no text, nothing in it, other separators, a quote that is not closed.
    """
    try:
        lines = path.read_bytes().decode("utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise ArgumentError(f"{path.name} is no UTF-8 text; save it as CSV with commas") from error
    except OSError as error:
        raise ArgumentError(f"{path.name} cannot be read: {error.strerror}") from error
    if any("\0" in line for line in lines) or path.suffix.lower() in _NO_CSV:
        raise ArgumentError(f"{path.name} is no CSV file but of another program; save the table as CSV with commas")
    kept = [(n, line) for n, line in enumerate(lines, 1) if line.strip() and not line.startswith("#")]
    if not kept:
        raise ArgumentError(f"{path.name} is empty; expected a header such as '{header}' and rows")
    number, first = kept[0]
    for sign, word in ((";", "semicolons"), ("\t", "tabs"), ("|", "bars")):
        if "," not in first and sign in first:
            raise ArgumentError(f"{path.name} line {number}: the columns are separated by {word}; save it with commas")
    cells = [(n, _cells(line, f"{path.name} line {n}")) for n, line in kept]
    return cells[0], cells[1:]


def number(cell: str) -> float:
    """A cell as a number, nan and inf among them. Raises ValueError for anything else, 1_000 of Python's too."""
    if "_" in cell:
        raise ValueError(f"'{cell}' is no number")
    return float(cell)


def _cells(line: str, where: str) -> list[str]:
    try:
        return [cell.strip() for cell in next(csv.reader([line], strict=True))]
    except csv.Error as error:
        raise ArgumentError(
            f'{where}: a quote (") is not closed before the next comma or the end of the line; close it or take it out'
        ) from error
