"""CSV tables with named columns, and measured signals read from declared columns and units."""

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
    """A CSV file read whole. Raises ArgumentError with the line if the file is not a table.

    file: name for messages. names, units, where: see `Heads`. lines: line number of each row.
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
        """Return the index of a column. Raises ArgumentError if it is missing or occurs twice."""
        return self._stream.heads.place(name)

    def refuse_other_unit(self, name: str, declared: str) -> None:
        """Raise ArgumentError if the unit in the header differs from the declared one."""
        self._stream.heads.refuse_other_unit(name, declared)

    def texts(self, name: str) -> list[str]:
        """Return the cells of a column."""
        place = self.place(name)
        return [row[place] for row in self._rows]

    def numbers(self, name: str, *, gaps: bool = False) -> np.ndarray:
        """Return the numbers of a column as written; `gaps` allows numbers that are not finite and reads an empty cell
        as NaN."""
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
    """Names of columns in a file, and the unit of each."""

    names: tuple[str, ...]
    units: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class SignalTable:
    """`columns` and `values` (N, k) in SI units by signal; `lines` and `sessions` of the rows; `synthetic`: the note of
    a synthetic file."""

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
    leave_out: Sequence[int] = (),
) -> SignalTable:
    """Read the columns of each signal; `wanted`: signal -> its columns, or their common stem, and unit or units.

    The file may have any format that `open_log` reads; `form` declares a format that the file does not state. With
    `gaps` an empty cell or nan is read as NaN. Rows at the line numbers in `leave_out` are not read. Other columns are
    ignored. Raises ArgumentError with the line for a missing or repeated column, a unit other than the declared one, or
    a cell without a finite number. For a signal's column or unit the argument of the error is "signals.NAME.column" or
    "signals.NAME.unit"; for a line without a row it is "leave_out".
    """
    try:
        stream = stream_of(path, form, holding=_first(wanted))
    except OSError as error:
        raise ArgumentError(f"{path.name} cannot be read: {error.strerror}") from error
    columns = {signal: _columns(stream, signal, *pair) for signal, pair in wanted.items()}
    for c in columns.values():
        for name, unit in zip(c.names, c.units, strict=True):
            stream.heads.refuse_other_unit(name, unit)

    def si(signal: str, values: np.ndarray) -> np.ndarray:
        parts = zip(values.T, columns[signal].units, strict=True)
        return np.column_stack([convert(part, unit, parse_unit(unit).si_text) for part, unit in parts])

    rows = stream.read({signal: c.names for signal, c in columns.items()}, si, gaps=gaps or bool(leave_out))
    lines = rows.lines.array()
    kept = _kept(lines, leave_out, path.name)
    values = {signal: numbers[kept] for signal, numbers in rows.values.items()}
    for signal, numbers in () if gaps else values.items():
        for k, j in np.argwhere(np.isnan(numbers)):  # raises the error that reading without gaps would raise
            name = columns[signal].names[j]
            raise stream.no_number(int(lines[kept][k]), name, stream.texts(name)[np.flatnonzero(kept)[k]])
    sessions = None if session is None else tuple(np.array(stream.texts(session), object)[kept])
    note = next(iter(stream.comments.get("synthetic", [])), None)
    return SignalTable(columns, values, lines[kept], sessions, note)


def _kept(lines: np.ndarray, leave_out: Sequence[int], file: str) -> np.ndarray:
    """Mask of the rows that are read. Raises ArgumentError for a line without a row, and if no row is left."""
    unknown = sorted(set(leave_out) - set(lines.tolist()))
    if unknown:
        raise ArgumentError(
            f"names line {unknown[0]}, which holds no row of {file}; its rows are in lines {lines[0]} to {lines[-1]}",
            "leave_out",
        )
    kept = ~np.isin(lines, list(leave_out))
    if not kept.any():
        raise ArgumentError(f"names all {len(lines)} rows of {file}; leave at least one", "leave_out")
    return kept


def _first(wanted: Mapping[str, tuple[str | Sequence[str], str | Sequence[str]]]) -> str:
    """Return the column that identifies the table in a file with several tables."""
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
