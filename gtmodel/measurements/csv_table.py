"""Columns of a table by the names and units of its header, "q[0] [mm]"; and a CSV file read whole."""

from __future__ import annotations

import difflib
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..lang.units import UnitError, parse_unit
from ..results.refusal import ArgumentError
from .csv_lines import lines_of, number

# the blank tells e[1] from e [1]
_CELL = re.compile(r"(?P<name>\S+)(\s+\[(?P<unit>[^\[\]]+)\])?")


class Heads:
    """The columns of a header; columns that nobody asks for are left alone.

    names, units: of each column; "" where a cell is empty or has no unit. where: the header, for messages.
    """

    def __init__(self, cells: Sequence[str], where: str) -> None:
        matches = [_CELL.fullmatch(cell) for cell in cells]
        self.names = [m["name"] if m else cell for m, cell in zip(matches, cells, strict=True)]
        self.units = [(m["unit"] or "").strip() if m else "" for m in matches]
        self.where = where

    def members(self, name: str | Sequence[str]) -> list[str]:
        """The columns that a declared name means: "q" means "q[0]", "q[1]" and so on where there is no "q"."""
        members = [name] if isinstance(name, str) else list(name)
        if isinstance(name, str) and name not in self.names:
            indexed = [n for n in self.names if re.fullmatch(rf"{re.escape(name)}\[\d+\]", n)]
            members = [f"{name}[{k}]" for k in range(len(set(indexed)))] or members
        for member in members:
            self.place(member)
        return members

    def place(self, name: str) -> int:
        """Where a column stands. Raises ArgumentError where it does not, or twice: which is meant is not clear."""
        places = [k for k, n in enumerate(self.names) if n == name]
        if not places:
            close = difflib.get_close_matches(name, self.names, n=1, cutoff=0.5)
            there = ", ".join(n for n in self.names if n) or "none"
            hint = f"did you mean '{close[0]}'?" if close else f"it has {there}"
            raise ArgumentError(f"{self.where}: there is no column '{name}'; {hint}")
        if len(places) > 1:
            columns = f"columns {places[0] + 1} and {places[1] + 1}"
            raise ArgumentError(f"{self.where}: '{name}' is there twice, in {columns}; leave one of them out")
        return places[0]

    def refuse_other_unit(self, name: str, declared: str) -> None:
        """Raises ArgumentError where the header says another unit than was declared."""
        headed = self.units[self.place(name)]
        try:
            here, wanted = parse_unit(headed or declared), parse_unit(declared)
        except UnitError as error:
            raise ArgumentError(f"{self.where}, column '{name}': {error}") from error
        if (here.dimension, here.factor, here.pi_power) != (wanted.dimension, wanted.factor, wanted.pi_power):
            said = f"'{name}' is in {headed} here and declared in {declared}; correct one of them"
            raise ArgumentError(f"{self.where}: {said}")


class CsvTable(Heads):
    """A CSV file: cells by column, and the line of each row. Raises ArgumentError with the line for what is no table.

    Args:
        header: an example, for the message about an empty file.
    """

    def __init__(self, path: Path, header: str) -> None:
        (line, cells), rows = lines_of(path, header)
        super().__init__(cells, f"{path.name} line {line}")
        if not rows:
            raise ArgumentError(f"{path.name} has a header but no rows")
        for n, row in rows:
            if len(row) != len(cells):
                raise ArgumentError(
                    f"{path.name} line {n}: found {len(row)} cells; expected {len(cells)}, "
                    "one for each column of the header"
                )
        self.file, self.lines, self._rows = path.name, np.array([n for n, _ in rows]), [row for _, row in rows]

    def texts(self, name: str) -> list[str]:
        """The cells of a column."""
        place = self.place(name)
        return [row[place] for row in self._rows]

    def numbers(self, name: str, *, gaps: bool = False) -> np.ndarray:
        """The numbers of a column as written; with `gaps` an empty cell is NaN, and no number need be finite."""
        values = np.empty(len(self.lines))
        for k, (line, cell) in enumerate(zip(self.lines, self.texts(name), strict=True)):
            where = f"{self.file} line {line}, column '{name}'"
            try:
                values[k] = number(cell) if cell else np.nan
            except ValueError:
                expected = "a number, or nothing for none" if gaps else "a number"
                raise ArgumentError(f"{where}: found '{cell}'; expected {expected}") from None
            if not (gaps or np.isfinite(values[k])):
                raise ArgumentError(
                    f"{where}: found {cell or 'nothing'}; a row needs all its numbers, take the line out"
                )
        return values
