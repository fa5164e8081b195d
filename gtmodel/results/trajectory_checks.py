"""Checks of the constructor of `Trajectory`, and errors about trajectories."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from gtmodel.lang.units import UnitError, si_unit

from .._near import meant
from .read_bounds import not_deep
from .refusal import ArgumentError

Array = npt.NDArray[np.float64]
COLUMN = re.compile(r"(?P<base>.+)\[(?P<index>0|[1-9][0-9]*)\]")


class TrajectoryError(ArgumentError):
    """Invalid data of a trajectory, or a request that it cannot answer. The message is one sentence."""


class UnknownNameError(KeyError):
    """Unknown name of a signal; the message suggests close matches."""

    def __str__(self) -> str:
        return str(self.args[0])


def columns(name: str, value: Array) -> list[str]:
    """Return the column names of a signal: its name, or one name per component."""
    return [name] if value.ndim == 1 else [f"{name}[{i}]" for i in range(value.shape[1])]


def unknown(name: object, signals: Mapping[str, Array], lead: str) -> str:
    known = [*signals, *(c for n, v in signals.items() if v.ndim == 2 for c in columns(n, v))]
    shown = ", ".join(map(repr, list(signals)[:10]))
    otherwise = f"the trajectory has {shown}{' and more' if len(signals) > 10 else ''}"
    return f"{lead} {name!r}; {meant(name, known, otherwise, most=3)}"


def _frozen(data: npt.ArrayLike, what: str) -> Array:
    try:
        raw = np.asarray(data)
    except ValueError as error:
        raise TrajectoryError(f"{what} is not an array ({error}); expected rows of equal length") from error
    if raw.dtype.kind not in "biuf":
        raise TrajectoryError(f"{what} has {raw.dtype} data; expected real numbers")
    owner = raw if raw.base is None else raw.base
    frozen = isinstance(owner, np.ndarray) and not (raw.flags.writeable or owner.flags.writeable)
    if frozen and raw.dtype == np.float64 and raw.flags.c_contiguous:
        return raw  # read-only: no copy of a large recording
    array = np.array(raw, dtype=np.float64, order="C")
    array.setflags(write=False)
    return array


def checked_time(time: npt.ArrayLike) -> Array:
    grid = _frozen(time, "time")
    if grid.ndim != 1 or grid.size == 0:
        raise TrajectoryError(f"time has shape {grid.shape}; expected (n,) with n at least 1")
    if (bad := np.flatnonzero(~np.isfinite(grid))).size:
        raise TrajectoryError(f"time[{bad[0]}] is {float(grid[bad[0]])!r}; expected finite seconds")
    if (bad := np.flatnonzero(np.diff(grid) <= 0)).size:
        i = int(bad[0]) + 1
        raise TrajectoryError(
            f"time[{i}] = {float(grid[i])!r} s does not come after time[{i - 1}] = {float(grid[i - 1])!r} "
            f"s; {put_in_order(grid)}"
        )
    return grid


def put_in_order(time: Array) -> str:
    """Return advice about times that do not increase strictly; sorting does not remove repeated times."""
    late, repeated = np.any(np.diff(time) < 0), np.unique(time).size < time.size
    cures = ["sort the rows"] * bool(late) + ["average the rows with equal time or keep the first"] * bool(repeated)
    return f"time must increase strictly, so {', and '.join(cures)}"


def checked_values(values: Mapping[str, npt.ArrayLike], rows: int) -> dict[str, Array]:
    if not values:
        raise TrajectoryError("a trajectory needs at least one signal; values is empty")
    signals: dict[str, Array] = {}
    for name, data in values.items():
        check_name(name)
        value = _frozen(data, f"signal {name!r}")
        if value.ndim not in (1, 2) or value.shape[0] != rows or value.size == 0:
            raise TrajectoryError(
                f"signal {name!r} has shape {value.shape}; expected ({rows},) or ({rows}, k), a row for each time"
            )
        if (bad := np.argwhere(~np.isfinite(value))).size:
            row = int(bad[0][0])
            column = name if value.ndim == 1 else f"{name}[{bad[0][1]}]"
            raise TrajectoryError(
                f"signal {column!r} is {float(value[tuple(bad[0])])!r} in row {row}; expected finite "
                "numbers, so remove the row or fill the gap before"
            )
        signals[name] = value
    for name, value in signals.items():
        for column in columns(name, value) if value.ndim == 2 else []:
            if column in signals:
                raise TrajectoryError(
                    f"signal {column!r} has the name of a component of the vector signal {name!r}; rename one of them"
                )
    return signals


def check_name(name: object) -> None:
    if not isinstance(name, str):
        raise TrajectoryError(f"a signal is named {name!r} of type {type(name).__name__}; expected a text")
    if not name or not name.isprintable() or any(mark in name for mark in ' "') or name.startswith("#"):
        raise TrajectoryError(
            f"signal name {name!r} cannot be written to a file; expected printable characters without "
            "blank or quote and no leading '#'"
        )
    if name == "time":
        raise TrajectoryError("a signal is named 'time', the name of the time grid; choose another name")


def checked_unit(name: str, unit: str) -> str:
    try:
        return si_unit(unit).text
    except UnitError as error:
        raise TrajectoryError(f"signal {name!r}: {error}") from error


def one_line(what: str, text: str) -> str:
    stripped = text.strip()
    if not stripped.isprintable():
        raise TrajectoryError(f"{what} is {text!r}; expected one line of printable characters")
    return stripped


def json_text(provenance: Mapping[str, Any]) -> str:
    try:
        return json.dumps(not_deep(dict(provenance)), sort_keys=True, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise TrajectoryError(
            f"provenance cannot be written as JSON ({error}); give texts, finite numbers, lists and dictionaries"
        ) from error
