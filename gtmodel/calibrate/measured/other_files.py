"""Signals of poses in files of their own, such as a tracker's: their rows joined with the poses, by number or order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ...measurements import LogForm, signal_table
from ...measurements.signal_table import SignalTable
from ...results import ArgumentError
from .options import Measured

Wanted = dict[str, tuple[str | Sequence[str], str | Sequence[str]]]  # signal -> columns, units


def signal_of(name: str) -> str:
    """Return the signal that a rate "der(q)" belongs to, or the name itself."""
    return name[4:-1] if name.startswith("der(") else name


def file_of(name: str, measured: Measured) -> tuple[str, str | None] | None:
    """Return the file of a signal, and the column that joins it; None if the signal is in the file of the poses."""
    signal = measured.signals.get(signal_of(name))
    return None if signal is None or signal.file is None else (signal.file, signal.join)


def with_other_files(
    tables: Sequence[SignalTable], sources: Sequence[Path], columns: Wanted, measured: Measured, form: LogForm
) -> list[SignalTable]:
    """Return the tables with the signals from other files, row by row.

    tables, sources: the poses, and held-out poses if there are any. Raises ArgumentError with file and line for a row
    that has no partner.
    """
    complete = list(tables)
    for file, join in dict.fromkeys(place for n in columns if (place := file_of(n, measured)) is not None):
        names = {n: pair for n, pair in columns.items() if file_of(n, measured) == (file, join)}
        argument = f"measured.signals.{signal_of(next(iter(names)))}"
        path = sources[0].parent / file
        if not path.is_file():
            raise ArgumentError(f"there is no file {path}", f"{argument}.file")
        other = _read(path, names, join, form, f"{argument}.join")
        if join is None:
            rows = [_in_order(tables, sources, other, path, f"{argument}.file")]
        else:
            first = next(iter(tables[0].columns))
            keys = [
                _read(source, {first: columns[first]}, join, form, f"{argument}.join").sessions for source in sources
            ]
            rows = _by_key([k or () for k in keys], tables, sources, other, path, join, f"{argument}.join")
        for k, table in enumerate(complete):
            values = {n: other.values[n][rows[k]] for n in names}
            synthetic = table.synthetic or other.synthetic
            complete[k] = replace(
                table, columns=table.columns | other.columns, values=table.values | values, synthetic=synthetic
            )
    return [
        replace(t, columns={n: t.columns[n] for n in columns}, values={n: t.values[n] for n in columns})
        for t in complete
    ]


def _read(path: Path, names: Wanted, join: str | None, form: LogForm, argument: str) -> SignalTable:
    try:
        return signal_table.read(path, names, join, form)
    except ArgumentError as error:
        raise ArgumentError(error.message, f"measured.{error.argument}" if error.argument else argument) from error


def _in_order(
    tables: Sequence[SignalTable], sources: Sequence[Path], other: SignalTable, path: Path, argument: str
) -> np.ndarray:
    if len(tables) > 1:
        raise ArgumentError(
            f"'{path.name}' has the rows of '{sources[0].name}' in order, and none of '{sources[1].name}'; name a "
            "column that joins the rows: join",
            argument,
        )
    lines, others = tables[0].lines, other.lines
    if len(lines) != len(others):
        longer, place, more = (
            (sources[0], lines, len(others)) if len(lines) > len(others) else (path, others, len(lines))
        )
        raise ArgumentError(
            f"{longer.name} line {place[more]}: this row has no partner; '{sources[0].name}' has {len(lines)} rows and "
            f"'{path.name}' {len(others)}; name a column that joins the rows (join), or remove rows",
            argument,
        )
    return np.arange(len(lines))


def _by_key(
    keys: Sequence[Sequence[str]], tables: Sequence[SignalTable], sources: Sequence[Path], other: SignalTable,
    path: Path, join: str, argument: str,
) -> list[np.ndarray]:  # fmt: skip
    """Return for each table the rows of the other file with the same keys. Raises ArgumentError."""
    row_of = dict[str, int]()
    for row, key in enumerate(map(_plain, other.sessions or ())):
        if key in row_of:
            raise ArgumentError(
                f"{path.name} line {other.lines[row]}: '{join}' is {key} again, as in line {other.lines[row_of[key]]}; "
                "expected one row for each pose",
                argument,
            )
        row_of[key] = row
    rows, taken = list[np.ndarray](), dict[str, str]()
    for table, source, names in zip(tables, sources, keys, strict=True):
        partners = []
        for line, key in zip(table.lines, map(_plain, names), strict=True):
            if key not in row_of:
                raise ArgumentError(
                    f"{source.name} line {line}: no row of '{path.name}' has '{join}' {key}; remove this row, or add "
                    "its partner",
                    argument,
                )
            if key in taken:
                raise ArgumentError(
                    f"{source.name} line {line}: '{join}' is {key} again, as in {taken[key]}; expected one row for "
                    "each pose",
                    argument,
                )
            taken[key] = f"{source.name} line {line}"
            partners.append(row_of[key])
        rows.append(np.array(partners))
    lonely = next((row for key, row in row_of.items() if key not in taken), None)
    if lonely is not None:
        raise ArgumentError(
            f"{path.name} line {other.lines[lonely]}: no row of '{sources[0].name}' has '{join}' "
            f"{_plain((other.sessions or ())[lonely])}; remove this row, or add its partner",
            argument,
        )
    return rows


def _plain(text: str) -> str:
    """Return a number without leading or trailing zeros, other texts without blanks around them."""
    try:
        return f"{float(text):.12g}"
    except ValueError:
        return text.strip()
