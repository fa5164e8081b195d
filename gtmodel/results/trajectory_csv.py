"""CSV files of trajectories: reading a file that a person or an instrument wrote."""

from __future__ import annotations

import csv
import json
import math
import re
from pathlib import Path
from typing import Any

import numpy as np

from gtmodel.lang.units import UnitError, convert, parse_unit

from .trajectory import Trajectory
from .trajectory_checks import check_name
from .trajectory_errors import COLUMN, Array, TrajectoryError
from .trajectory_files import PathLike

_HEADER_CELL = re.compile(r"(?P<name>\S+)\s+\[(?P<unit>[^\[\]]+)\]")
_NOTES = ("title", "synthetic", "provenance", "scalar")


def read_csv(path: PathLike) -> Trajectory:
    """Read a CSV file; see `Trajectory.from_csv`."""
    try:
        text = Path(path).read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise TrajectoryError(f"{path} is not a UTF-8 text file ({error.reason}); save it as UTF-8") from error
    lines = text.replace("\r\n", "\n").split("\n")
    notes: dict[str, list[str]] = {key: [] for key in _NOTES}
    header: tuple[list[str], list[str]] | None = None
    numbers: list[int] = []
    rows: list[list[float]] = []
    last = max((i for i, line in enumerate(lines, 1) if line.strip()), default=0)
    for number, line in enumerate(lines[:last], 1):
        where = f"{path} line {number}"
        if line.startswith("#"):
            key, colon, note = line[1:].partition(":")
            if colon and key.strip().lower() in notes:
                notes[key.strip().lower()].append(note.strip())
        elif header is None:
            header = _read_header(line, where)
        else:
            rows.append(_read_row(line, header[0], where))
            numbers.append(number)
    if header is None:
        raise TrajectoryError(f"{path} has no header; expected a line such as 'time [s],q[0] [m]'")
    if not rows:
        raise TrajectoryError(f"{path} has a header but no rows; expected a row of numbers for each time")
    columns, units = header
    table = np.array(rows, dtype=np.float64)
    table = np.column_stack([convert(table[:, j], unit, parse_unit(unit).si_text) for j, unit in enumerate(units)])
    _check_increasing(table[:, 0], units[0], rows, numbers, path)
    values, signal_units = _grouped(
        columns[1:], [parse_unit(unit).si_text for unit in units[1:]], table[:, 1:], notes["scalar"]
    )
    try:
        return Trajectory(
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
        origin = json.loads(notes[0])
    except json.JSONDecodeError as error:
        raise TrajectoryError(f"the note '# provenance:' is no JSON ({error}); correct or remove it") from error
    if len(notes) > 1 or not isinstance(origin, dict):
        raise TrajectoryError("the note '# provenance:' must hold one JSON dictionary in one line")
    return origin


def _read_header(line: str, where: str) -> tuple[list[str], list[str]]:
    """Names and unit texts of all columns, the time first."""
    if "," not in line and (";" in line or "\t" in line):
        raise TrajectoryError(
            f"{where}: the columns are not separated by ','; save the file with commas and decimal points"
        )
    names: list[str] = []
    units: list[str] = []
    for number, cell in enumerate(next(csv.reader([line])), 1):
        found = _HEADER_CELL.fullmatch(cell.strip())
        if not found:
            raise TrajectoryError(
                f"{where}, column {number}: {cell.strip()!r} has no unit; expected 'name [unit]', such as 'q[0] [m]'"
            )
        name, unit = found["name"], found["unit"].strip()
        try:
            dimension = parse_unit(unit).dimension
            if number > 1:
                check_name(name)
        except (UnitError, TrajectoryError) as error:
            raise TrajectoryError(f"{where}, column {number}: {error}") from error
        if number == 1 and (name != "time" or dimension != parse_unit("s").dimension):
            raise TrajectoryError(
                f"{where}, column 1: found {cell.strip()!r}; expected the time, as 'time [s]' or 'time [ms]'"
            )
        if name in names:
            raise TrajectoryError(
                f"{where}, column {number}: the name {name!r} occurs twice; give every column its own name"
            )
        names.append(name)
        units.append(unit)
    if len(names) == 1:
        raise TrajectoryError(f"{where}: there is no column besides the time; expected at least one signal")
    return names, units


def _read_row(line: str, names: list[str], where: str) -> list[float]:
    cells = line.split(",")
    if len(cells) != len(names):
        raise TrajectoryError(
            f"{where}: found {len(cells)} cells; expected {len(names)}, one for each column of the header"
        )
    row = []
    for name, cell in zip(names, cells, strict=True):
        try:
            number = float(cell) if "_" not in cell else None
        except ValueError:
            number = None
        if number is None or not math.isfinite(number):
            raise TrajectoryError(
                f"{where}, column {name!r}: found {cell.strip()!r}; expected a finite number such as 1.5e-3"
            )
        row.append(number)
    return row


def _check_increasing(time: Array, unit: str, rows: list[list[float]], numbers: list[int], path: PathLike) -> None:
    if (bad := np.flatnonzero(np.diff(time) <= 0)).size:
        i = int(bad[0]) + 1
        raise TrajectoryError(
            f"{path} line {numbers[i]}, column 'time': {rows[i][0]!r} {unit} does not come after "
            f"{rows[i - 1][0]!r} {unit} in line {numbers[i - 1]}; time must increase strictly, so sort the "
            "rows or remove the repeated one"
        )


def _grouped(
    columns: list[str], units: list[str], table: Array, scalars: list[str]
) -> tuple[dict[str, Array], dict[str, str]]:
    """Signals from columns, column j being table[:, j]: "T[0]", "T[1]", ... become "T" where that is safe.

    It is when the columns of that base name stand side by side, count up from 0, share one unit and no column
    is called "T". Otherwise all of them stay scalar signals, so that "T" is missing rather than incomplete.
    """
    places: dict[str, list[int]] = {}
    for j, column in enumerate(columns):
        found = None if column in scalars else COLUMN.fullmatch(column)
        if found:
            places.setdefault(found["base"], []).append(j)
    starts = {}
    for base, at in places.items():
        in_order = columns[at[0] : at[0] + len(at)] == [f"{base}[{i}]" for i in range(len(at))]
        if in_order and len({units[j] for j in at}) == 1 and base not in ("time", *columns):
            starts[at[0]] = base, len(at)
    values: dict[str, Array] = {}
    signal_units: dict[str, str] = {}
    j = 0
    while j < len(columns):
        name, width = starts.get(j, (columns[j], 0))
        values[name] = table[:, j : j + width] if width else table[:, j]
        signal_units[name] = units[j]
        j += width or 1
    return values, signal_units
