"""Tables of a CSV file read whole, with the columns of a header, and measured signals in declared columns and units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..lang.units import UnitError, convert, parse_unit
from ..results.refusal import ArgumentError, naming
from .streams.form import LogError, LogForm
from .streams.opening import stream_of
from .streams.stream import Stream
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


@dataclass(frozen=True, eq=False)
class Columns:
    """Names of columns in a file and their units, one each."""

    names: tuple[str, ...]
    units: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class SignalTable:
    """`columns` and `values` by signal, (N, k) in SI units; the line of each row, its session, and what a synthetic
    file says."""

    columns: dict[str, Columns]
    values: dict[str, np.ndarray]
    lines: np.ndarray
    sessions: tuple[str, ...] | None
    synthetic: str | None


def read(
    path: Path,
    wanted: Mapping[str, tuple[str | Sequence[str], str | Sequence[str]]],
    session: str | None = None,
    form: LogForm = LogForm(),  # noqa: B008
    *,
    gaps: bool = False,
) -> SignalTable:
    """The columns of each signal by name; `wanted`: signal -> its columns, or their common stem, and unit or units.

    A file of any kind, see `open_log`; `form` says how it is written where it does not say so itself. With `gaps` an
    empty cell or nan is NaN. Columns that nobody asks for are left alone. Raises ArgumentError with the line: a column
    missing or there twice, a unit that is not the declared one, an empty cell, a cell that is no finite number; of a
    signal's column or unit with the argument "signals.NAME.column".
    """
    try:
        stream = stream_of(path, form, holding=_first(wanted))
    except OSError as error:
        raise ArgumentError(f"{path.name} cannot be read: {error.strerror}") from error
    chosen = {signal: _columns(stream, signal, *given) for signal, given in wanted.items()}
    for c in chosen.values():
        for name, unit in zip(c.names, c.units, strict=True):
            stream.heads.refuse_other_unit(name, unit)

    def si(signal: str, values: np.ndarray) -> np.ndarray:
        parts = zip(values.T, chosen[signal].units, strict=True)
        return np.column_stack([convert(part, unit, parse_unit(unit).si_text) for part, unit in parts])

    rows = stream.read({signal: c.names for signal, c in chosen.items()}, si, gaps=gaps)
    sessions = None if session is None else tuple(stream.texts(session))
    note = next(iter(stream.comments.get("synthetic", [])), None)
    return SignalTable(chosen, rows.values, rows.lines.array(), sessions, note)


def _first(wanted: Mapping[str, tuple[str | Sequence[str], str | Sequence[str]]]) -> str:
    """A column by which the table of a file with several is found."""
    column = next(iter(wanted.values()))[0]
    return column if isinstance(column, str) else column[0]


def _columns(stream: Stream, signal: str, column: str | Sequence[str], unit: str | Sequence[str]) -> Columns:
    with naming(f"signals.{signal}.column"):
        members = stream.heads.members(column)
    units = [unit] * len(members) if isinstance(unit, str) else list(unit)
    with naming(f"signals.{signal}.unit", ArgumentError, UnitError):
        if len(units) != len(members):
            raise ArgumentError(f"has {len(units)} units for {len(members)} columns; give one for all, or one each")
        for u in units:
            parse_unit(u)
    return Columns(tuple(members), tuple(units))
