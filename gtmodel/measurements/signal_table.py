"""Measured signals as a CSV table with declared columns and units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..lang.units import UnitError, convert, parse_unit
from ..results.refusal import ArgumentError, naming
from .csv_table import CsvTable

_NOTE = "# synthetic:"


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


def read(path: Path, wanted: Mapping[str, tuple[str | Sequence[str], str | Sequence[str]]],
         session: str | None = None) -> SignalTable:  # fmt: skip
    """The columns of each signal by name; `wanted`: signal -> its columns, or their common stem, and unit or units.

    Columns that nobody asks for are left alone. Raises ArgumentError with the line: a column missing or there twice,
    a unit that is not the declared one, an empty cell, a cell that is no finite number; of a signal's column or unit
    with the argument "signals.NAME.column".
    """
    table = CsvTable(path, "q[0] [mm],q[1] [mm],q[2] [mm],T[0] [m],T[1] [m],T[2] [m]")
    chosen = {signal: _columns(table, signal, *given) for signal, given in wanted.items()}
    values = {}
    for signal, c in chosen.items():
        for name, unit in zip(c.names, c.units, strict=True):
            table.refuse_other_unit(name, unit)
        read = [convert(table.numbers(n), u, parse_unit(u).si_text) for n, u in zip(c.names, c.units, strict=True)]
        values[signal] = np.column_stack(read)
    sessions = None if session is None else tuple(table.texts(session))
    notes = [x for x in path.read_text(encoding="utf-8-sig").splitlines() if x.startswith(_NOTE)]
    note = notes[0].removeprefix(_NOTE).strip() if notes else None
    return SignalTable(chosen, values, table.lines, sessions, note)


def _columns(table: CsvTable, signal: str, column: str | Sequence[str], unit: str | Sequence[str]) -> Columns:
    with naming(f"signals.{signal}.column", ArgumentError):
        members = table.members(column)
    units = [unit] * len(members) if isinstance(unit, str) else list(unit)
    with naming(f"signals.{signal}.unit", ArgumentError, UnitError):
        if len(units) != len(members):
            raise ArgumentError(f"has {len(units)} units for {len(members)} columns; give one for all, or one each")
        for u in units:
            parse_unit(u)
    return Columns(tuple(members), tuple(units))
