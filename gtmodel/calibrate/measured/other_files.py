"""Signals of poses in files of their own, such as a tracker's: their rows joined with the poses."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ...measurements import ClockColumn, LogForm, RowJoin, signal_table
from ...measurements.joining import IN_TIME, JoinRows, by_number, by_order, in_time
from ...measurements.signal_table import SignalTable
from ...results import ArgumentError
from ...results.interpolation import Nature
from ...results.refusal import naming
from .options import Measured

Wanted = dict[str, tuple[str | Sequence[str], str | Sequence[str]]]  # signal -> columns, units
Reader = Callable[..., SignalTable]
ROTATIONS: dict[str, Nature] = {"quaternion": "quaternion", "matrix": "matrix"}  # first word of the representation


def signal_of(name: str) -> str:
    """Return the signal that a rate "der(q)" belongs to, or the name itself."""
    return name[4:-1] if name.startswith("der(") else name


def file_of(name: str, measured: Measured) -> tuple[str, RowJoin] | None:
    """Return the file of a signal, and how its rows are joined; None if the signal is in the file of the poses."""
    signal = measured.signals.get(signal_of(name))
    if signal is None or signal.file is None:
        return None
    join = signal.join
    if isinstance(join, RowJoin):
        return signal.file, join
    return signal.file, RowJoin("order") if join is None else RowJoin("number", number=join)


@dataclass(frozen=True)
class PoseFile:
    """A file of poses, its table, and a function that reads further columns of the same rows."""

    path: Path
    table: SignalTable
    read: Reader


def with_other_files(
    files: Sequence[PoseFile], columns: Wanted, measured: Measured, form: LogForm
) -> list[SignalTable]:
    """Return the tables with the signals from other files, row by row.

    files: the poses, and held-out poses if there are any. Raises ArgumentError with file and line for a row that has no
    partner.
    """
    complete = [file.table for file in files]
    for name, join in dict.fromkeys(place for n in columns if (place := file_of(n, measured)) is not None):
        names = {n: pair for n, pair in columns.items() if file_of(n, measured) == (name, join)}
        argument = f"measured.signals.{signal_of(next(iter(names)))}"
        path = files[0].path.parent / name
        if not path.is_file():
            raise ArgumentError(f"there is no file {path}", f"{argument}.file")
        if join.match in IN_TIME:
            joined = _in_time(files, path, names, join, measured, form, argument)
        else:
            joined = _by_row(files, path, names, join, form, argument)
        for k, (other, values) in enumerate(joined):
            table = complete[k]
            complete[k] = replace(
                table, columns=table.columns | {n: other.columns[n] for n in names}, values=table.values | values,
                synthetic=table.synthetic or other.synthetic,
            )  # fmt: skip
    return [
        replace(t, columns={n: t.columns[n] for n in columns}, values={n: t.values[n] for n in columns})
        for t in complete
    ]


Joined = list[tuple[SignalTable, dict[str, np.ndarray]]]


def _by_row(
    files: Sequence[PoseFile], path: Path, names: Wanted, join: RowJoin, form: LogForm, argument: str
) -> Joined:
    key = f"{argument}.file" if join.match == "order" else f"{argument}.join"
    if join.match == "number" and join.number is None:
        raise ArgumentError("is missing; name the column with the number of the row", f"{key}.number")
    other = _read(partial(signal_table.read, path, form=form), names, join.number, key)
    theirs = _rows(path, other, other.sessions)
    if join.match == "order":
        if len(files) > 1:
            raise ArgumentError(
                f"'{path.name}' has the rows of '{files[0].path.name}' in order, and none of '{files[1].path.name}'; "
                "name a column that joins the rows: join",
                key,
            )
        with naming(key):
            rows = [by_order(_rows(files[0].path, files[0].table), theirs)]
    else:
        first = next(iter(files[0].table.columns))
        column = {first: (files[0].table.columns[first].names, files[0].table.columns[first].units)}
        firsts = [_rows(f.path, f.table, _read(f.read, column, join.number, key).sessions) for f in files]
        with naming(key):
            rows = by_number(firsts, theirs, join.number or "")
    return [(other, {n: other.values[n][r] for n in names}) for r in rows]


CLOCK = "\0time"  # cannot be the name of a signal


def _in_time(
    files: Sequence[PoseFile], path: Path, names: Wanted, join: RowJoin, measured: Measured, form: LogForm,
    argument: str,
) -> Joined:  # fmt: skip
    if measured.time is None:
        raise ArgumentError("is missing; a join in time needs the time of each pose", "measured.time")
    mine, theirs = _clock(measured.time), _clock(join.time or measured.time)
    other = _read(partial(signal_table.read, path, form=form), theirs | names, None, f"{argument}.join")
    natures: dict[str, Nature] = {
        n: nature for n in names if (nature := _nature(measured.signals[signal_of(n)].representation)) is not None
    }
    joined: Joined = []
    for file in files:
        time = _read(file.read, mine, None, "measured.time").values[CLOCK][:, 0]
        values = {n: other.values[n] for n in names}
        with naming({"": f"{argument}.join", "tolerance": f"{argument}.join.tolerance"}):
            joined.append((other, in_time(
                _rows(file.path, file.table, time=time), _rows(path, other, time=other.values[CLOCK][:, 0]), values,
                join, natures,
            )))  # fmt: skip
    return joined


def _clock(clock: ClockColumn) -> Wanted:
    return {CLOCK: (clock.column, clock.unit)}


def _nature(representation: str | None) -> Nature | None:
    """Return how rows of an orientation are interpolated; Euler angles as single angles."""
    if representation is None:
        return None
    return ROTATIONS.get(representation.split()[0], "angle")


def _rows(path: Path, table: SignalTable, keys: Sequence[str] | None = None, **more: Any) -> JoinRows:
    return JoinRows(
        f"'{path.name}'", lambda k: f"{path.name} line {table.lines[k]}", len(table.lines), keys or (), **more
    )


def _read(read: Reader, names: Mapping[str, Any], join: str | None, argument: str) -> SignalTable:
    """Read the columns; an error about the clock names `measured.time`."""
    try:
        return read(names, join)
    except ArgumentError as error:
        inner = f"measured.{error.argument}" if error.argument and CLOCK not in error.argument else argument
        raise ArgumentError(error.message, inner) from error
