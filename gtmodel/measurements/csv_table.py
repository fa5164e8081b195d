"""A small table with columns of a header, read whole: cells may be texts, and gaps."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from .streams.form import LogError, LogForm
from .streams.text import TextStream, number


class CsvTable:
    """A CSV file: cells by column, and the line of each row. Raises ArgumentError with the line for what is no table.

    file: for messages. names, units, where: see `Heads`. lines: of each row.
    """

    def __init__(self, path: Path, form: LogForm = LogForm()) -> None:  # noqa: B008
        stream = TextStream(path, form)
        rows = list(stream.cells())
        if not rows:
            raise LogError(f"{stream.heads.where} has a header but no rows")
        self.file, self.names, self.units, self.where = (
            path.name,
            stream.heads.names,
            stream.heads.units,
            stream.heads.where,
        )
        self.lines, self._rows = np.array([n for n, _ in rows]), [row for _, row in rows]
        self._stream = stream

    def place(self, name: str) -> int:
        """Where a column stands. Raises ArgumentError where it does not, or twice."""
        return self._stream.heads.place(name)

    def refuse_other_unit(self, name: str, declared: str) -> None:
        """Raises ArgumentError where the header says another unit than was declared."""
        self._stream.heads.refuse_other_unit(name, declared)

    def texts(self, name: str) -> list[str]:
        """The cells of a column."""
        place = self.place(name)
        return [row[place] for row in self._rows]

    def numbers(self, name: str, *, gaps: bool = False) -> np.ndarray:
        """The numbers of a column as written; with `gaps` an empty cell is NaN, and no number need be finite."""
        values = np.empty(len(self.lines))
        for k, (line, cell) in enumerate(zip(self.lines.tolist(), self.texts(name), strict=True)):
            try:
                values[k] = number(cell, self._stream.layout.decimal_comma) if cell or not gaps else np.nan
            except ValueError:
                raise self._stream.no_number(line, name, cell) from None
            if not (gaps or np.isfinite(values[k])):
                raise self._stream.no_number(line, name, cell)
        return values
