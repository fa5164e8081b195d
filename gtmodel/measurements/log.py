"""Logs of measurements as trajectories: columns and units are declared, and what does not fit is refused."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..lang.units import UnitError, convert, parse_unit
from ..results.refusal import ArgumentError
from ..results.trajectory import Trajectory
from ..results.trajectory_csv import Header, TrajectoryCsv, check_increasing, read_table
from ..results.trajectory_errors import Array, TrajectoryError
from ..results.trajectory_files import PathLike
from .csv_table import Heads

JITTER = 0.1  # of the sample time: central differences of an uneven grid are off by about as much
MISSING = 0.5  # of a sample time beyond the next row: a sample is missing, not late


class LogError(TrajectoryError):
    """A log that is not as declared. The message is one sentence with the file and its line."""


class Column(NamedTuple):
    """Where a quantity stands in a log: the column's name, and its unit there.

    "q" means also the columns "q[0]", "q[1]" and so on, where there is no "q"; several names make a vector too:
    `Column(("x", "y", "z"), "mm")`.
    """

    name: str | Sequence[str]
    unit: str


TIME = Column("time", "s")


class Session(NamedTuple):
    """One evenly sampled recording: a name for messages, the quantities in SI units, and the sample time [s]."""

    name: str
    trajectory: Trajectory
    sample_time: float


def session_of(trajectory: Trajectory, name: str = "log", *, jitter: float = JITTER) -> Session:
    """A recording in memory as a session.

    jitter: how far a step may be from the sample time, as a share of it. Raises LogError where the rows are not evenly
    sampled.

    >>> log = gt.Trajectory([0.0, 0.1, 0.2], {"q": [0.0, 0.1, 0.4]}, {"q": "m"})
    >>> round(gt.measurements.session_of(log).sample_time, 6)  # s
    0.1
    """
    rows = np.arange(1, len(trajectory.time) + 1)
    return Session(name, trajectory, _sample_time(trajectory.time, f"'{name}'", "row", rows, None, jitter))


def read_log(
    path: PathLike,
    columns: Mapping[str, Column],
    *,
    time: Column = TIME,
    session: str | None = None,
    sample_time: float | None = None,
    jitter: float = JITTER,
) -> tuple[Session, ...]:
    r"""Read a CSV or MATLAB file; returns a session for each recording in it, in SI units.

    Args:
        columns: quantity -> where it stands. Further columns of the file are left alone. A header cell may repeat the
            unit, "pos [mm]"; it must then be the declared one.
        time: the column of time.
        session: a column whose number says which recording a row belongs to; the time may begin anew with each.
        sample_time: expected [s]; the median of the file's own where it is None.
        jitter: how far a step may be from the sample time, as a share of it.

    A matrix (n, k) of a MATLAB file is a vector. Comments "# title:" and "# synthetic:" of a CSV file are kept with the
    trajectories. Raises LogError or TrajectoryError in one sentence with file and line (or sample): a column missing or
    of another unit, a cell that is no finite number, a row of another length, a time going back, a gap, jitter.
    FileNotFoundError passes through.

    >>> from pathlib import Path
    >>> Column = gt.measurements.Column
    >>> written = Path("run.csv").write_text("t [ms],pos [mm]\n0,10\n4,12\n8,15\n")
    >>> (session,) = gt.measurements.read_log("run.csv", {"q": Column("pos", "mm")}, time=Column("t", "ms"))
    >>> session.trajectory["q"].tolist(), session.sample_time
    ([0.01, 0.012, 0.015], 0.004)
    """
    _check_units(columns, time)
    wanted = {"time": time, **columns}
    read = _from_mat if str(path).lower().endswith(".mat") else _from_csv
    table, names = read(path, wanted, session)
    values = table.in_si()
    stops = np.flatnonzero(np.diff(values[:, -1])) + 1 if session else np.array([], dtype=int)
    _refuse_scattered(values, stops, table, path, session)
    sessions = []
    for begin, end in pairwise([0, *stops.tolist(), len(values)]):
        rows = slice(begin, end)  # views: logs are large
        part = TrajectoryCsv(table.columns, table.units, table.values[rows], table.lines[rows], table.notes)
        label = f"{Path(path).name} {session} {values[begin, -1]:g}" if session else Path(path).name
        check_increasing(values[rows, 0], part, path)
        step = _sample_time(values[rows, 0], str(path), "line", part.lines, sample_time, jitter)
        arrays = {name: values[rows][:, at] if len(at) > 1 else values[rows, at[0]] for name, at in names.items()}
        units = {name: parse_unit(column.unit).si_text for name, column in columns.items()}
        note = "; ".join(table.notes.get("synthetic", []))
        trajectory = Trajectory(
            values[rows, 0], arrays, units, title=" ".join(table.notes.get("title", [])), synthetic=note or None
        )
        sessions.append(Session(label, trajectory, step))
    return tuple(sessions)


def _check_units(columns: Mapping[str, Column], time: Column) -> None:
    for name, column in {**columns, "time": time}.items():
        try:
            unit = parse_unit(column.unit)
        except UnitError as error:
            raise LogError(f"the unit declared for '{name}': {error}") from error
        if name == "time" and unit.dimension != parse_unit("s").dimension:
            raise LogError(f"the time is declared in {column.unit}; expected a unit of time such as s or ms")


def _from_csv(
    path: PathLike, wanted: Mapping[str, Column], session: str | None
) -> tuple[TrajectoryCsv, dict[str, list[int]]]:
    names: dict[str, list[int]] = {}
    return read_table(path, partial(_columns_of, wanted=wanted, session=session, names=names)), names


def _columns_of(
    cells: Sequence[str], where: str, wanted: Mapping[str, Column], session: str | None, names: dict[str, list[int]]
) -> Header:
    """The declared columns of a header; where each quantity stands among them goes into `names`."""
    heads = Heads(cells, where)
    own, units, places = list[str](), list[str](), list[int]()
    try:
        for quantity, column in {**wanted, **({session: Column(session, "1")} if session else {})}.items():
            members = heads.members(column.name)
            if quantity != "time" and quantity in wanted:
                names[quantity] = list(range(len(own), len(own) + len(members)))
            for member in members:
                heads.refuse_other_unit(member, column.unit)
                own.append(member)
                units.append(column.unit)
                places.append(heads.place(member))
    except ArgumentError as error:
        raise LogError(error.message) from error
    return own, units, places


def _from_mat(
    path: PathLike, wanted: Mapping[str, Column], session: str | None
) -> tuple[TrajectoryCsv, dict[str, list[int]]]:
    from scipy.io import loadmat

    try:
        data = _by_columns({k: np.asarray(v) for k, v in loadmat(str(path)).items() if not k.startswith("__")})
    except FileNotFoundError:
        raise
    except Exception as error:
        raise LogError(f"{path} cannot be read as a MATLAB file ({error}); save it with -v7, or as CSV") from error
    names: dict[str, list[int]] = {}
    columns, units, _ = _columns_of(list(data), str(path), wanted, session, names)
    rows = data[columns[0]].size
    arrays = []
    for name in columns:
        value = data[name].ravel()
        if value.dtype.kind not in "biuf" or value.size != rows:
            raise LogError(
                f"{path}: the variable '{name}' holds {value.size} {value.dtype.name} values; "
                f"expected {rows} numbers, one for each of '{columns[0]}'"
            )
        if (bad := np.flatnonzero(~np.isfinite(value))).size:
            raise LogError(
                f"{path} sample {bad[0] + 1}, variable '{name}': found {float(value[bad[0]])}; expected a finite "
                "number, so cut the log there or repair it"
            )
        arrays.append(value.astype(float))
    return TrajectoryCsv(columns, units, np.column_stack(arrays), np.arange(1, rows + 1), {}), names


def _by_columns(data: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Matrices "q" as columns "q[0]", "q[1]", ..."""
    columns: dict[str, np.ndarray] = {}
    for name, value in data.items():
        if value.ndim == 2 and min(value.shape) > 1:
            columns |= {f"{name}[{j}]": value[:, j] for j in range(value.shape[1])}
        else:
            columns[name] = value
    return columns


def _refuse_scattered(
    values: Array, stops: np.ndarray, table: TrajectoryCsv, path: PathLike, session: str | None
) -> None:
    seen: list[float] = []
    for k in [0, *stops] if session else []:
        number = float(values[k, -1])
        if number in seen:
            raise LogError(
                f"{path} line {table.lines[k]}: {session} {number:g} begins again after another one; "
                "sort the rows by session, or number the recordings anew"
            )
        seen.append(number)


def _sample_time(
    time: Array, source: str, row: str, numbers: np.ndarray, expected: float | None, jitter: float
) -> float:
    """The sample time of a session [s]. Raises LogError for the first step that is not one, with the number of its row,
    a line of a file or another `row`."""
    steps = np.diff(time)
    if steps.size < 2:
        raise LogError(f"{source} {row} {numbers[0]}: a recording has {time.size} rows; expected at least 3")
    median = float(np.median(steps))
    if expected is not None and abs(median - expected) > jitter * expected:
        raise LogError(
            f"{source}: the samples are {_ms(median)} ms apart; expected {_ms(expected)} ms; correct the sample time "
            "or the unit of the time"
        )
    step = median if expected is None else expected
    if (bad := np.flatnonzero(np.abs(steps - step) > jitter * step)).size:
        k = int(bad[0])
        lost = round(float(steps[k]) / step) - 1
        what = "the step jitters, so resample the log"
        if steps[k] > (1 + MISSING) * step:
            missing = "samples are" if lost > 1 else "sample is"
            what = f"about {lost} {missing} missing, so split the log into sessions there"
        raise LogError(
            f"{source} {row} {numbers[k + 1]}: {_ms(float(steps[k]))} ms after the row before; expected {_ms(step)} ms "
            f"within {100 * jitter:g} %: {what}"
        )
    return float((time[-1] - time[0]) / steps.size)


def _ms(seconds: float) -> str:
    return f"{convert(seconds, 's', 'ms'):.6g}"
