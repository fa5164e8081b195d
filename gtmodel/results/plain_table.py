"""A table as plain text."""

from __future__ import annotations

import unicodedata
from collections.abc import Sequence

_SHORT = 32  # characters; a longer text at the end of its row does not widen its column


def plain(head: Sequence[str], rows: Sequence[Sequence[str]], title: str = "") -> str:
    """Return a table as text without line breaks in cells. A long text at the end of its row, such as a note, does not
    widen its column."""
    widths = [width(name) for name in head]
    for row in rows:
        for k, cell in enumerate(row):
            if any(row[k + 1 :]) or width(cell) <= _SHORT:
                widths[k] = max(widths[k], width(cell))
    lines = [
        "   ".join(cell + " " * (w - width(cell)) for cell, w in zip(r, widths, strict=True)) for r in (head, *rows)
    ]
    lines.insert(1, "─" * max(sum(widths) + 3 * (len(widths) - 1), 1))
    return "\n".join([*([title, ""] if title else []), *(f" {line}".rstrip() for line in lines)])


def width(cell: str) -> int:
    """Return the width of a text on a terminal."""
    if cell.isascii():
        return len(cell)
    return sum(0 if unicodedata.combining(c) else 2 if unicodedata.east_asian_width(c) in "WF" else 1 for c in cell)
