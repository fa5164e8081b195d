"""Points as a CSV table: reading what a causality needs, writing what it gives. A NaN is data here, not an error."""

from __future__ import annotations

import csv
import difflib
import io
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from ...compiler.causal import Signal
from ...lang.units import UnitError, convert, parse_unit
from ...measurements import csv_lines
from ...results import ArgumentError

_CELL = re.compile(r"(?P<name>\S+)(\s+\[(?P<unit>[^\[\]]+)\])?")  # the blank tells e[1] from e [1]


def read(path: Path, signals: Sequence[Signal]) -> list[np.ndarray]:
    """One array per signal, (rows, *shape), in SI units.

    The header names the columns: "T[0] [m]", or "T[0]" for the unit that the model declares; further columns are left
    alone, so a table written by `text` can be read again. An empty cell or nan is NaN; lines that begin with # are
    comments. Raises ArgumentError with the line: a column missing or there twice, a unit that does not fit, a cell that
    is no number.
    """
    (number, cells), rows = csv_lines.lines_of(path, ",".join(columns(signals[0])))
    matches = [_CELL.fullmatch(c) for c in cells]
    found = {m["name"]: (k, m["unit"]) for k, m in enumerate(matches) if m is not None}
    wanted = [(name, signal) for signal in signals for name in columns(signal)]
    places = [_place(name, signal.unit, found, f"{path.name} line {number}") for name, signal in wanted]
    needed = {name for name, _ in wanted}
    names = ["" if m is None or m["name"] not in needed else m["name"] for m in matches]
    csv_lines.refuse_twice(names, f"{path.name} line {number}")
    if not rows:
        raise ArgumentError(f"{path.name} has a header but no rows")
    table = np.array([_row(row, len(cells), [k for k, _ in places], f"{path.name} line {n}") for n, row in rows])
    for j, ((_, signal), (_, unit)) in enumerate(zip(wanted, places, strict=True)):
        if unit:
            table[:, j] = convert(table[:, j], unit, signal.unit)
    arrays, first = [], 0
    for signal in signals:
        arrays.append(table[:, first : first + signal.size].reshape(len(table), *signal.shape))
        first += signal.size
    return arrays


def columns(signal: Signal) -> list[str]:
    """Names of a signal's components: T[0], T[1], ...; R[0,0] is written R[0][0], for commas part columns."""
    return [signal.name + "".join(f"[{i}]" for i in index) for index in np.ndindex(*signal.shape)]


def text(table: Sequence[tuple[Sequence[str], str, np.ndarray]], status: Sequence[str]) -> str:
    """The CSV: row number from 0, columns (names, unit, values (rows, *shape)), and the status of each row."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    heads = [f"{name} [{unit}]" if unit else name for names, unit, _ in table for name in names]
    writer.writerow(["row", *heads, "status"])
    numbers = np.column_stack([values.reshape(len(status), -1) for _, _, values in table])
    for k, word in enumerate(status):
        writer.writerow([k, *map(repr, numbers[k].tolist()), word])
    return out.getvalue()


def _place(name: str, declared: str, found: Mapping[str, tuple[int, str | None]], where: str) -> tuple[int, str]:
    """Column of a name and the unit to convert from, "" for none."""
    if name not in found:
        close = difflib.get_close_matches(name, found, n=1)
        hint = f"did you mean '{close[0]}'?" if close else f"it has {', '.join(found) or 'none'}"
        raise ArgumentError(f"{where}: there is no column '{name}'; {hint}")
    place, unit = found[name]
    if not unit:
        return place, ""
    try:
        fits = not declared or parse_unit(unit).dimension == parse_unit(declared).dimension
    except UnitError as error:
        raise ArgumentError(f"{where}, column '{name}': {error}") from error
    if not fits:
        raise ArgumentError(f"{where}, column '{name}': the unit {unit} does not fit; the model has it in {declared}")
    return place, unit if declared else ""


def _row(cells: Sequence[str], width: int, places: Sequence[int], where: str) -> list[float]:
    if len(cells) != width:
        raise ArgumentError(f"{where}: found {len(cells)} cells; expected {width}, one for each column of the header")
    row = []
    for k in places:
        cell = cells[k]
        try:
            row.append(csv_lines.number(cell) if cell else np.nan)
        except ValueError:
            raise ArgumentError(
                f"{where}, column {k + 1}: found '{cell}'; expected a number, or nothing for none"
            ) from None
    return row
