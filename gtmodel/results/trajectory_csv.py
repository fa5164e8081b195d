"""Reading of trajectories from CSV files."""

from __future__ import annotations

import csv
import math
import re
from array import array
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, BinaryIO, NamedTuple

import numpy as np
import numpy.typing as npt

from gtmodel.lang.units import UnitError, convert, parse_unit

from .disk import path_of
from .read_bounds import json_of
from .trajectory_checks import COLUMN, Array, TrajectoryError, check_name, put_in_order
from .trajectory_files import PathLike

if TYPE_CHECKING:
    from .trajectory import Trajectory

HEADER_CELL = re.compile(r"(?P<name>\S+)\s+\[(?P<unit>[^\[\]]+)\]")
MOST_SHOWN = 40  # characters of a cell in a message
_NOTES = ("title", "synthetic", "provenance", "scalar")


class TrajectoryCsv(NamedTuple):
    """The numbers of a CSV file as written: columns with their units, one row per line of the file.

    columns, units: names and units of the columns, the time first. values: (rows, columns). lines: line numbers from 1.
    notes: texts of the comments "# title:", "# synthetic:", "# provenance:", "# scalar:".
    """

    columns: list[str]
    units: list[str]
    values: Array
    lines: npt.NDArray[np.int64]
    notes: dict[str, list[str]]

    def in_si(self) -> Array:
        """Return the values (rows, columns) in SI units."""
        si_units = [parse_unit(unit).si_text for unit in self.units]
        if si_units == self.units:
            return self.values
        values = np.empty(self.values.shape)
        for j, (unit, si) in enumerate(zip(self.units, si_units, strict=True)):
            values[:, j] = convert(self.values[:, j], unit, si)
        return values


Header = tuple[list[str], list[str], list[int]]
"""Names, unit texts and places of the columns to keep, the time first."""


def read_table(path: PathLike, header_of: Callable[[Sequence[str], str], Header]) -> TrajectoryCsv:
    """Read the numbers of a CSV file whose header `header_of` parses.

    header_of: (cells of the header line, place in the file for messages) -> the columns to keep.

    Raises TrajectoryError with file and line if there is no text, header or row, a row has a different length, or a
    cell of a kept column is not a finite number.
    """
    notes: dict[str, list[str]] = {key: [] for key in _NOTES}
    header: Header | None = None
    width = 0
    # eight bytes per number; a list of lists would need ten times as much
    numbers, places = array("d"), array("q")
    blank = 0  # first blank line, after which only the end of the file may follow
    with open(path_of(path), "rb") as file:
        for number, line in enumerate(_decoded(file, path), 1):
            where = f"{path} line {number}"
            if not line.strip():
                blank = blank or number
                continue
            if blank and header is not None:
                _read_row("", header, width, f"{path} line {blank}")
            blank = 0
            if line.startswith("#"):
                key, colon, note = line[1:].partition(":")
                if colon and key.strip().lower() in notes:
                    notes[key.strip().lower()].append(note.strip())
            elif header is None:
                cells = _header_cells(line, where)
                header, width = header_of(cells, where), len(cells)
            else:
                numbers.extend(_read_row(line, header, width, where))
                places.append(number)
    if header is None:
        raise TrajectoryError(f"{path} has no header; expected a line such as 'time [s],q[0] [m]'")
    if not places:
        raise TrajectoryError(f"{path} has a header but no rows; expected a row of numbers for each time")
    values = np.frombuffer(numbers, dtype=np.float64).reshape(len(places), len(header[0]))
    return TrajectoryCsv(header[0], header[1], values, np.frombuffer(places, dtype=np.int64), notes)


def _decoded(file: BinaryIO, path: PathLike) -> Iterator[str]:
    """Lines without their ends. Raises TrajectoryError for what is not UTF-8."""
    for number, line in enumerate(file, 1):
        try:
            text = line.decode("utf-8-sig" if number == 1 else "utf-8")
        except UnicodeDecodeError as error:
            raise TrajectoryError(
                f"{path} is not a UTF-8 text file (line {number}: {error.reason}); save it as UTF-8"
            ) from error
        text = text.rstrip("\n").removesuffix("\r")
        if "\r" in text:
            raise TrajectoryError(
                f"{path} line {number} has a carriage return inside the line; save the file with line feeds"
            )
        yield text


def read_csv(cls: type[Trajectory], path: PathLike) -> Trajectory:
    """Read a CSV file; see `Trajectory.from_csv`."""
    rows = read_table(path, _read_header)
    table, notes = rows.in_si(), rows.notes
    check_increasing(table[:, 0], rows, path)
    values, signal_units = _grouped(
        rows.columns[1:], [parse_unit(unit).si_text for unit in rows.units[1:]], table[:, 1:], notes["scalar"]
    )
    try:
        return cls(
            table[:, 0],
            values,
            signal_units,
            title=" ".join(notes["title"]),
            provenance=_read_provenance(notes["provenance"]),
            synthetic="; ".join(notes["synthetic"]) if notes["synthetic"] else None,
        )
    except TrajectoryError as error:
        raise TrajectoryError(f"{path}: {error}") from error


def _read_provenance(notes: list[str]) -> dict[str, Any]:
    if not notes:
        return {}
    try:
        origin = json_of(notes[0])
    except ValueError as error:
        raise TrajectoryError(f"the note '# provenance:' is not JSON ({error}); correct or remove it") from error
    if len(notes) > 1 or not isinstance(origin, dict):
        raise TrajectoryError("the note '# provenance:' must be one JSON object on one line")
    return origin


def _header_cells(line: str, where: str) -> list[str]:
    if "," not in line and (";" in line or "\t" in line):
        raise TrajectoryError(
            f"{where}: the columns are not separated by ','; save the file with commas and decimal points"
        )
    return [cell.strip() for cell in next(csv.reader([line]))]


def _read_header(cells: Sequence[str], where: str) -> Header:
    """All columns, the time first."""
    names: list[str] = []
    units: list[str] = []
    for number, cell in enumerate(cells, 1):
        match = HEADER_CELL.fullmatch(cell)
        if not match:
            raise TrajectoryError(
                f"{where}, column {number}: {cell!r} has no unit; expected 'name [unit]', such as 'q[0] [m]'"
            )
        name, unit = match["name"], match["unit"].strip()
        try:
            dimension = parse_unit(unit).dimension
            if number > 1:
                check_name(name)
        except (UnitError, TrajectoryError) as error:
            raise TrajectoryError(f"{where}, column {number}: {error}") from error
        if number == 1 and (name != "time" or dimension != parse_unit("s").dimension):
            raise TrajectoryError(f"{where}, column 1: found {cell!r}; expected the time, as 'time [s]' or 'time [ms]'")
        if name in names:
            raise TrajectoryError(
                f"{where}, column {number}: the name {name!r} occurs twice; give every column a different name"
            )
        names.append(name)
        units.append(unit)
    if len(names) == 1:
        raise TrajectoryError(f"{where}: there is no column besides the time; expected at least one signal")
    return names, units, list(range(len(names)))


def shortened(cell: str) -> str:
    """Return a cell, shortened for a message."""
    return cell if len(cell) <= MOST_SHOWN else f"{cell[:MOST_SHOWN]}..."


def _quoted(line: str, where: str) -> list[str]:
    """Cells of a line with quotes. Raises TrajectoryError for an unclosed quote."""
    try:
        return next(csv.reader([line], strict=True))
    except csv.Error as error:
        raise TrajectoryError(f"{where}: unmatched quotes ({error}); write numbers without quotes") from error


def _read_row(line: str, header: Header, width: int, where: str) -> list[float]:
    cells = line.split(",") if '"' not in line else _quoted(line, where)
    if len(cells) != width:
        raise TrajectoryError(f"{where}: found {len(cells)} cells; expected {width}, one for each column of the header")
    try:
        row = [float(cells[place]) for place in header[2]]
        # the common case: all numbers finite
        if math.isfinite(sum(row)) and "_" not in line:
            return row
    except ValueError:
        pass
    row = []
    for name, place in zip(header[0], header[2], strict=True):
        cell = cells[place]
        try:
            number = float(cell) if "_" not in cell else None
        except ValueError:
            number = None
        if number is None or not math.isfinite(number):
            raise TrajectoryError(
                f"{where}, column {name!r}: found {shortened(cell.strip())!r}; expected a finite number such as 1.5e-3"
            )
        row.append(number)
    return row


def check_increasing(time: Array, read: TrajectoryCsv, path: PathLike) -> None:
    """Raises TrajectoryError, with line numbers, if the time [s] of a table does not increase."""
    if (bad := np.flatnonzero(np.diff(time) <= 0)).size:
        i, unit, name = int(bad[0]) + 1, read.units[0], read.columns[0]
        written = read.values[:, 0].tolist()
        raise TrajectoryError(
            f"{path} line {read.lines[i]}, column {name!r}: {written[i]!r} {unit} does not come after "
            f"{written[i - 1]!r} {unit} in line {read.lines[i - 1]}; {put_in_order(time)}"
        )


def _grouped(
    columns: list[str], units: list[str], table: Array, scalars: list[str]
) -> tuple[dict[str, Array], dict[str, str]]:
    """Signals from columns, column j being table[:, j]: "T[0]", "T[1]", ... become "T" if that is safe.

    The columns of that base name must be adjacent, count from 0 and have the same unit, and no column may be called
    "T". Otherwise they stay scalar signals, so that "T" is missing rather than incomplete.
    """
    places: dict[str, list[int]] = {}
    for j, column in enumerate(columns):
        match = None if column in scalars else COLUMN.fullmatch(column)
        if match:
            places.setdefault(match["base"], []).append(j)
    starts = {}
    for base, indices in places.items():
        in_order = columns[indices[0] : indices[0] + len(indices)] == [f"{base}[{i}]" for i in range(len(indices))]
        if in_order and len({units[j] for j in indices}) == 1 and base not in ("time", *columns):
            starts[indices[0]] = base, len(indices)
    values: dict[str, Array] = {}
    signal_units: dict[str, str] = {}
    j = 0
    while j < len(columns):
        name, width = starts.get(j, (columns[j], 0))
        values[name] = table[:, j : j + width] if width else table[:, j]
        signal_units[name] = units[j]
        j += width or 1
    return values, signal_units
