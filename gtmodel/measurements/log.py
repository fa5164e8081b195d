"""Logs of measurements as trajectories: columns and units are declared, and what does not fit is refused."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..lang.units import UnitError, convert, parse_unit
from ..results.trajectory import Trajectory
from ..results.trajectory_checks import Array, put_in_order
from ..results.trajectory_files import PathLike
from ..results.work import Progress, silent
from .sampling import MISSING, EmptyRows, LateRows, in_order
from .streams.form import LogError as LogError, LogForm, NoNumberError, shown
from .streams.opening import stream_of
from .streams.stream import Lines, Stream, TableRows

JITTER = 0.1  # of the sample time: central differences of an uneven grid are off by about as much


class Column(NamedTuple):
    """Where a quantity stands in a log: the column's name, and its unit there.

    "q" means also the columns "q[0]", "q[1]" and so on, where there is no "q"; several names make a vector too:
    `Column(("x", "y", "z"), "mm")`. Components of different units have one each: `Column("q", ("deg", "mm"))`. A member
    of a MATLAB struct is "rec.q", a field of a message "pose.position.x".

    time, stream, file: of its own, for `read_recording`; `read_log` has one of each for all columns.
    """

    name: str | Sequence[str]
    unit: str | Sequence[str]
    time: Column | None = None
    stream: str = ""
    file: str = ""


TIME = Column("time", "s")


class Session(NamedTuple):
    """One recording: a name for messages, the quantities in SI units, and the sample time [s]; evenly sampled unless it
    was read as uneven, then the sample time is the median step."""

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
    lines = Lines()
    lines.extend(np.arange(1, len(trajectory.time) + 1))
    return Session(name, trajectory, _sample_time(trajectory.time, f"'{name}' row", lines, 0, None, jitter))


def read_log(
    path: PathLike,
    columns: Mapping[str, Column],
    *,
    time: Column | None = TIME,
    session: str | None = None,
    sample_time: float | None = None,
    jitter: float = JITTER,
    uneven: bool = False,
    late_rows: LateRows = "refuse",
    empty_rows: EmptyRows = "refuse",
    form: LogForm = LogForm(),  # noqa: B008
    progress: Progress = silent,
) -> tuple[Session, ...]:
    r"""Read a log file of any kind; returns a session for each recording in it, in SI units.

    Args:
        columns: quantity -> where it stands. Further columns of the file are left alone. A header cell may repeat the
            unit, "pos [mm]"; it must then be the declared one.
        time: the column of time. None: there is none, and rows are `sample_time` apart. Where the file has times of its
            own, as bags do, and no column "time", the default means those.
        session: a column whose number says which recording a row belongs to; the time may begin anew with each.
        sample_time: expected [s]; the median of the file's own where it is None.
        jitter: how far a step may be from the sample time, as a share of it.
        uneven: True takes any steps of the time, for `sampling_of` and resampling.
        late_rows: what becomes of rows whose time does not come after all earlier ones: "refuse", "drop", or "sort".
        empty_rows: what becomes of rows that lack a number, or hold nan: "refuse", or "drop".
        form: how the file is written, where it does not say so itself.
        progress: called while a large file is read.

    A text file of any delimiter, a MATLAB file of any version, Parquet, or a ROS bag; see `open_log`. A matrix of a
    MATLAB file is a vector, its samples along the dimension that the time has. Comments "# title:" and "# synthetic:"
    of a text file are kept with the trajectories. Raises LogError or TrajectoryError in one sentence with file and line
    (or sample): a column missing or of another unit, a cell that is no finite number, a row of another length, a time
    going back, a gap, jitter. FileNotFoundError passes through.

    >>> from pathlib import Path
    >>> Column = gt.measurements.Column
    >>> written = Path("run.csv").write_text("t [ms],pos [mm]\n0,10\n4,12\n8,15\n")
    >>> (session,) = gt.measurements.read_log("run.csv", {"q": Column("pos", "mm")}, time=Column("t", "ms"))
    >>> session.trajectory["q"].tolist(), session.sample_time
    ([0.01, 0.012, 0.015], 0.004)

    Without a time, rows at even times:

    >>> written = Path("run.csv").write_text("pos [mm]\n10\n12\n15\n")
    >>> (session,) = gt.measurements.read_log("run.csv", {"q": Column("pos", "mm")}, time=None, sample_time=0.004)
    >>> session.trajectory.time.tolist()
    [0.0, 0.004, 0.008]
    """
    check_units(columns, time)
    stream = stream_of(path, form, time="" if time is None else _one_name(time))
    if time is not None and time == TIME and "time" not in stream.heads.names and stream.clock:
        time = Column(stream.clock, "s")
    if time is None and sample_time is None:
        raise LogError(f"{shown(path)}: without a column of time the sample time has to be given")
    gaps = empty_rows == "drop"
    try:
        rows, shape = _in_si(stream, columns, time, session, gaps, progress)
    except NoNumberError as error:
        raise LogError(f'{error}; empty_rows = "drop" leaves such rows out') from error
    sessions = []
    for begin, end in pairwise([*_begins(rows, session, stream), len(rows.lines)]):
        part, numbers, note = slice(begin, end), rows.lines, dict[str, Any]()
        label = Path(path).name if session is None else f"{Path(path).name} {session} {rows.values[_OF][begin, 0]:g}"
        if time is None:
            assert sample_time is not None
            grid: Array = sample_time * np.arange(float(end - begin))
        else:
            grid = rows.values[_TIME][part, 0]
        taken = _chosen(grid, {n: rows.values[n][part] for n in shape} if gaps else {}, late_rows, note)
        if taken is not None:
            grid, numbers, begin = grid[taken], _lines_of(rows.lines, taken + begin), 0
        if not len(grid):
            raise LogError(f"{stream.source}: each row lacks a number of the columns that are asked for")
        _refuse_backward(grid, begin, numbers, stream, time)
        if uneven:
            step = float(np.median(np.diff(grid))) if len(grid) > 1 else 0.0
        else:
            step = _sample_time(grid, f"{stream.source} {stream.row}", numbers, begin, sample_time, jitter)
        values = {name: _signal(rows.values[name][part], taken, vector) for name, vector in shape.items()}
        units = {name: si_unit_of(column.unit) for name, column in columns.items()}
        trajectory = Trajectory(
            grid, values, units, title=" ".join(stream.comments.get("title", [])), provenance=note,
            synthetic="; ".join(stream.comments.get("synthetic", [])) or None,
        )  # fmt: skip
        sessions.append(Session(label, trajectory, step))
    return tuple(sessions)


LEFT_OUT = ("rows without a number", "rows that came late or twice")  # of the provenance: how many were
_TIME, _OF = "\0time", "\0session"  # beside the names of quantities


def si_unit_of(unit: str | Sequence[str]) -> str:
    """The SI unit of a quantity in this unit; "1" of one whose components have different ones."""
    texts = {parse_unit(u).si_text for u in ([unit] if isinstance(unit, str) else unit)}
    return texts.pop() if len(texts) == 1 else "1"


def check_units(columns: Mapping[str, Column], time: Column | None) -> None:
    """Raises LogError for a declared unit that is none, and for a time that is not in one of time."""
    for name, column in {**columns, **({} if time is None else {"time": time})}.items():
        for text in [column.unit] if isinstance(column.unit, str) else column.unit:
            try:
                unit = parse_unit(text)
            except UnitError as error:
                raise LogError(f"the unit declared for '{name}': {error}") from error
            if name == "time" and unit.dimension != parse_unit("s").dimension:
                raise LogError(f"the time is declared in {text}; expected a unit of time such as s or ms")


def _one_name(time: Column) -> str:
    return time.name if isinstance(time.name, str) else ""


def _in_si(
    stream: Stream,
    columns: Mapping[str, Column],
    time: Column | None,
    session: str | None,
    gaps: bool,
    progress: Progress,
) -> tuple[TableRows, dict[str, bool]]:
    """The declared columns of a stream, and whether each quantity is a vector."""
    declared = {} if time is None else {_TIME: time}
    declared |= dict(columns) | ({} if session is None else {_OF: Column(session, "1")})
    groups, changed = dict[str, list[str]](), dict[str, list[str]]()
    for name, column in declared.items():
        groups[name] = stream.heads.members(column.name)
        changed[name] = _each(column.unit, groups[name], name)
        for member, unit in zip(groups[name], changed[name], strict=True):
            stream.heads.refuse_other_unit(member, unit)

    def si(name: str, values: Array) -> Array:
        if len(set(changed[name])) > 1:
            return np.column_stack([in_si(part, u) for part, u in zip(values.T, changed[name], strict=True)])
        return in_si(values, changed[name][0])

    def in_si(values: Array, unit: str) -> Array:
        si_unit = parse_unit(unit).si_text
        return values if unit == si_unit else convert(values, unit, si_unit)

    rows = stream.read(groups, si, gaps=gaps, progress=progress)
    for values in rows.values.values():
        values.setflags(write=False)  # a trajectory takes them without a copy
    return rows, {name: len(groups[name]) > 1 for name in columns}


def _each(unit: str | Sequence[str], members: Sequence[str], name: str) -> list[str]:
    """The unit of each column. Raises LogError."""
    units = [unit] * len(members) if isinstance(unit, str) else list(unit)
    if len(units) != len(members):
        raise LogError(f"'{name}' has {len(units)} units for {len(members)} columns; give one for all, or one each")
    return units


def _begins(rows: TableRows, session: str | None, stream: Stream) -> list[int]:
    """The first row of each recording. Raises LogError where one goes on behind another."""
    if session is None:
        return [0]
    of = rows.values[_OF][:, 0]
    begins = [0, *(np.flatnonzero(np.diff(of)) + 1).tolist()]
    _, first = np.unique(of[begins], return_index=True)
    if len(first) < len(begins):
        k = begins[min(set(range(len(begins))) - set(first.tolist()))]
        raise LogError(
            f"{stream.source} {stream.row} {rows.lines[k]}: {session} {of[k]:g} begins again after another one; "
            "sort the rows by session, or number the recordings anew"
        )
    return begins


def _chosen(time: Array, values: Mapping[str, Array], late_rows: LateRows, note: dict[str, Any]) -> np.ndarray | None:
    """The rows to take, None for all as they are; what is left out goes into the note.

    values: those that must be numbers.
    """
    taken: np.ndarray | None = None
    if values:
        whole = np.isfinite(time) & np.all([np.isfinite(v).all(axis=1) for v in values.values()], axis=0)
        if not whole.all():
            taken = np.flatnonzero(whole)
            note[LEFT_OUT[0]] = len(time) - len(taken)
            time = time[taken]
    order = in_order(time, late_rows)
    if order is None:
        return taken
    note[LEFT_OUT[1]] = int(np.sum(np.diff(np.maximum.accumulate(time)) <= 0))
    return order if taken is None else taken[order]


def _signal(values: Array, taken: np.ndarray | None, vector: bool) -> Array:
    rows = values if taken is None else values[taken]
    return rows if vector else rows.reshape(-1)


def _lines_of(lines: Lines, rows: np.ndarray) -> Lines:
    chosen = Lines()
    chosen.extend(lines.array()[rows])
    return chosen


def _refuse_backward(time: Array, begin: int, lines: Lines, stream: Stream, column: Column | None) -> None:
    """Raises LogError with the lines where the time [s] does not increase."""
    if column is None or not (bad := np.flatnonzero(np.diff(time) <= 0)).size:
        return
    i, unit = int(bad[0]) + 1, column.unit if isinstance(column.unit, str) else column.unit[0]
    here, before = (float(f"{convert(float(t), 's', unit):.12g}") for t in (time[i], time[i - 1]))
    raise LogError(
        f"{stream.source} {stream.row} {lines[begin + i]}, {stream.cell} '{_one_name(column)}': {here!r} {unit} does "
        f"not come after {before!r} {unit} in {stream.row} {lines[begin + i - 1]}; {put_in_order(time)}, "
        'or say late_rows = "drop" or "sort", which leave out all but the first of one time'
    )


def _sample_time(time: Array, where: str, lines: Lines, begin: int, expected: float | None, jitter: float) -> float:
    """The sample time of a session [s]. Raises LogError for the first step that is not one.

    where: file and what a row is called. lines: the number of each row; those of `time` stand from `begin` on.
    """
    if time.size < 3:
        raise LogError(f"{where} {lines[begin]}: a recording has {time.size} rows; expected at least 3")
    median = float(np.median(np.diff(time), overwrite_input=True))
    if expected is not None and abs(median - expected) > jitter * expected:
        raise LogError(
            f"{where} {lines[begin]}: the samples are {_ms(median)} ms apart; expected {_ms(expected)} ms; correct the "
            "sample time or the unit of the time"
        )
    step = median if expected is None else expected
    steps = np.diff(time)
    off = steps - step
    if (bad := np.flatnonzero(np.abs(off, out=off) > jitter * step)).size:
        k = int(bad[0])
        lost = float(np.round(steps[k] / step)) - 1
        what = "the step jitters, so resample the log"
        if steps[k] > (1 + MISSING) * step:
            missing = "samples are" if lost > 1 else "sample is"
            what = f"about {lost:.6g} {missing} missing, so split the log into sessions there"
        raise LogError(
            f"{where} {lines[begin + k + 1]}: {_ms(float(steps[k]))} ms after the row before; expected {_ms(step)} ms "
            f"within {100 * jitter:g} %: {what}"
        )
    return float((time[-1] - time[0]) / (time.size - 1))


def _ms(seconds: float) -> str:
    return f"{convert(seconds, 's', 'ms'):.6g}"
