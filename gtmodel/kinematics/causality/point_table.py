"""Points as a CSV table: reading what a causality needs, writing what it gives. A NaN is data here, not an error."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ...compiler.causal import CausalSignal
from ...lang.units import UnitError, convert, parse_unit
from ...measurements.csv_table import CsvTable
from ...results import ArgumentError


def read(path: Path, signals: Sequence[CausalSignal]) -> list[np.ndarray]:
    """One array per signal, (rows, *shape), in SI units.

    The header names the columns: "T[0] [m]", or "T[0]" for the unit that the model declares; further columns are left
    alone, so a table written by `text` can be read again. An empty cell or nan is NaN; lines that begin with # are
    comments. Raises ArgumentError with the line: a column missing or there twice, a unit that does not fit, a cell that
    is no number.
    """
    table = CsvTable(path)
    parts = [[_in_units_of(signal, table, name) for name in columns(signal)] for signal in signals]
    return [np.stack(c, axis=1).reshape(-1, *signal.shape) for c, signal in zip(parts, signals, strict=True)]


def columns(signal: CausalSignal) -> list[str]:
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


def _in_units_of(signal: CausalSignal, table: CsvTable, name: str) -> np.ndarray:
    """Numbers of a column in the unit that the model declares."""
    unit, values = table.units[table.place(name)], table.numbers(name, gaps=True)
    if not unit:
        return values
    where = f"{table.where}, column '{name}'"
    try:
        fits = not signal.unit or parse_unit(unit).dimension == parse_unit(signal.unit).dimension
    except UnitError as error:
        raise ArgumentError(f"{where}: {error}") from error
    if not fits:
        raise ArgumentError(f"{where}: the unit {unit} does not fit; the model has it in {signal.unit}")
    return np.asarray(convert(values, unit, signal.unit), float) if signal.unit else values
