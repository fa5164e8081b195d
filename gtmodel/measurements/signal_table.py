"""Measured signals as a CSV table with declared columns and units."""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..lang.units import UnitError, convert, parse_unit
from ..results.refusal import ArgumentError
from . import csv_lines

_HEAD = re.compile(r"(?P<name>\S+)(\s+\[(?P<unit>[^\[\]]+)\])?")
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
    (number, cells), rows = csv_lines.lines_of(path, "q[0] [mm],q[1] [mm],q[2] [mm],T[0] [m],T[1] [m],T[2] [m]")
    where = f"{path.name} line {number}"
    heads = [_HEAD.fullmatch(c) for c in cells]
    names = ["" if h is None else h["name"] for h in heads]
    units = ["" if h is None else h["unit"] or "" for h in heads]
    chosen = {signal: _columns(signal, *given, names, where) for signal, given in wanted.items()}
    used = {n for c in chosen.values() for n in c.names} | ({session} if session else set())
    csv_lines.refuse_twice([n if n in used else "" for n in names], where)
    if not rows:
        raise ArgumentError(f"{path.name} has a header but no rows")
    for n, row in rows:
        if len(row) != len(cells):
            found = f"{path.name} line {n}: found {len(row)} cells"
            raise ArgumentError(f"{found}; expected {len(cells)}, as in the header")
    values = {}
    for signal, c in chosen.items():
        read_columns = []
        for name, unit in zip(c.names, c.units, strict=True):
            k = names.index(name)
            _same_unit(name, units[k], unit, where)
            found = [_number(row[k], name, f"{path.name} line {n}") for n, row in rows]
            read_columns.append(convert(np.array(found), unit, parse_unit(unit).si_text))
        values[signal] = np.column_stack(read_columns)
    if session is not None and session not in names:
        raise ArgumentError(f"{where}: there is no column '{session}' for the sessions; it has {', '.join(names)}")
    sessions = None if session is None else tuple(row[names.index(session)] for _, row in rows)
    notes = [x for x in path.read_text(encoding="utf-8-sig").splitlines() if x.startswith(_NOTE)]
    note = notes[0].removeprefix(_NOTE).strip() if notes else None
    return SignalTable(chosen, values, np.array([n for n, _ in rows]), sessions, note)


def _columns(
    signal: str, column: str | Sequence[str], unit: str | Sequence[str], names: Sequence[str], where: str
) -> Columns:
    members = [column] if isinstance(column, str) else list(column)
    if isinstance(column, str) and column not in names:
        stem = [n for n in names if re.fullmatch(rf"{re.escape(column)}\[\d+\]", n)]
        members = [f"{column}[{k}]" for k in range(len(stem))] or members
    for m in members:
        if m not in names:
            close = difflib.get_close_matches(m, names, n=1)
            hint = f"did you mean '{close[0]}'?" if close else f"it has {', '.join(n for n in names if n)}"
            raise ArgumentError(f"{where}: there is no column '{m}'; {hint}", f"signals.{signal}.column")
    units = [unit] * len(members) if isinstance(unit, str) else list(unit)
    if len(units) != len(members):
        raise ArgumentError(
            f"has {len(units)} units for {len(members)} columns; give one for all, or one each",
            f"signals.{signal}.unit",
        )
    for u in units:
        try:
            parse_unit(u)
        except UnitError as error:
            raise ArgumentError(str(error), f"signals.{signal}.unit") from error
    return Columns(tuple(members), tuple(units))


def _same_unit(name: str, headed: str, declared: str, where: str) -> None:
    """Raises ArgumentError where the file's header says another unit than the problem."""
    if not headed:
        return
    try:
        same = parse_unit(headed) == parse_unit(declared) or convert(1.0, headed, declared) == 1.0
    except UnitError:
        same = False
    if not same:
        raise ArgumentError(f"{where}: '{name}' is in {headed} here and declared in {declared}; correct one of them")


def _number(cell: str, name: str, where: str) -> float:
    try:
        value = csv_lines.number(cell) if cell else np.nan
    except ValueError:
        raise ArgumentError(f"{where}, column '{name}': found '{cell}'; expected a number") from None
    if not np.isfinite(value):
        raise ArgumentError(
            f"{where}, column '{name}': found {cell or 'nothing'}; a pose needs all its numbers, take the line out"
        )
    return value
