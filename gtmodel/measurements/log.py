"""Read logs of measurements as trajectories, with declared columns and units."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime, timedelta
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..lang.units import UnitError, convert, parse_unit
from ..results.trajectory import Trajectory
from ..results.trajectory_checks import Array, put_in_order
from ..results.trajectory_files import PathLike
from ..results.work import Progress, silent
from .conversion import Conversion
from .sampling import MISSING, EmptyRows, LateRows, in_order
from .streams.form import LogError as LogError, LogForm, NoNumberError, shown
from .streams.opening import stream_of
from .streams.stream import Lines, Stream, TableRows
from .streams.text import date_in

JITTER = 0.1  # share of the sample time; the relative error of central differences on an uneven grid is about as large


class Column(NamedTuple):
    """Name and unit of the column that holds a quantity.

    If there is no column "q", the name "q" stands for the columns "q[0]", "q[1]" and so on. Several names also make a
    vector: `Column(("x", "y", "z"), "mm")`. Components of different units have one unit each: `Column("q", ("deg",
    "mm"))`. A member of a MATLAB struct is "rec.q", a field of a message "pose.position.x".

    time, stream, file: time column, stream and file (name, path or pattern) of this column, for `read_recording` only.
    conversion: from the columns to the quantity; default: the columns are the quantity.

    Of a time column alone: several names are parts that are added, `Column(("sec", "usec"), ("s", "us"))`.
    since: when the time is zero: a date such as "1970-01-01", "2026-11-28T08:15:00.25+01:00", or words of a line above
        the table that has the date, such as "Log started". The times then count from the first row, as dates do, and
        `read_recording` joins the clock with others of known origin.
    zone: zone of `since` and of dates in the column if they have none, such as "+01:00"; default: UTC.
    per_channel: each channel has a time column of this name, or pattern such as "t_*", on its left.
    """

    name: str | Sequence[str]
    unit: str | Sequence[str]
    time: Column | None = None
    stream: str = ""
    file: str = ""
    conversion: Conversion = Conversion()
    since: str = ""
    zone: str = ""
    per_channel: bool = False


TIME = Column("time", "s")


class Session(NamedTuple):
    """One recording: a name for messages, the quantities in SI units, and the sample time [s]. It is evenly sampled,
    unless it was read with `uneven`; then the sample time is the median step. If gaps split a recording, each stretch
    is a session, and `stretch` is its number in the recording, from 0."""

    name: str
    trajectory: Trajectory
    sample_time: float
    stretch: int = 0


def session_of(
    trajectory: Trajectory, name: str = "log", *, jitter: float = JITTER, sample_time: float | None = None
) -> Session:
    """Return a recording in memory as a session.

    jitter: largest deviation of a step from the sample time, as a share of it. sample_time: expected sample time [s].
    Raises LogError if the rows are not evenly sampled.

    >>> log = gt.Trajectory([0.0, 0.1, 0.2], {"q": [0.0, 0.1, 0.4]}, {"q": "m"})
    >>> round(gt.measurements.session_of(log).sample_time, 6)  # s
    0.1
    """
    lines = Lines()
    lines.extend(np.arange(1, len(trajectory.time) + 1))
    return Session(name, trajectory, _sample_time(trajectory.time, f"'{name}' row", lines, 0, sample_time, jitter))


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
    r"""Read a log file; return one session, in SI units, for each recording in it.

    Args:
        columns: quantity -> its `Column`. Other columns of the file are ignored. If a header cell states a unit, such
            as "pos [mm]", it must agree with the declared one.
        time: the time column, or columns whose sum is the time. None: there is none, and the rows are `sample_time`
            apart. If the file has its own times, as bags do, and no column "time", the default means these times.
        session: a column with the number of the recording that a row belongs to; the time may restart with each.
        sample_time: expected sample time [s]; None: the median step of the file.
        jitter: largest deviation of a step from the sample time, as a share of it.
        uneven: accept uneven steps, for `sampling_of` and resampling.
        late_rows: treatment of rows that are not later than all earlier rows: "refuse", "drop", or "sort".
        empty_rows: treatment of rows with an empty cell or nan: "refuse", or "drop".
        form: format of the file, as far as the file does not state it.
        progress: called while a large file is read.

    Formats: delimited text, MATLAB (all versions), Parquet, ROS bags; see `open_log`. A matrix of a MATLAB file is read
    as a vector signal, with the samples along the dimension that matches the time. Trajectories keep the comments
    "# title:" and "# synthetic:" of a text file. Raises LogError or TrajectoryError with file and line (or sample) for
    a missing column, another unit, a cell without a finite number, a row of another length, a time that goes back, a
    gap, or jitter. FileNotFoundError passes through.

    >>> from pathlib import Path
    >>> Column = gt.measurements.Column
    >>> written = Path("run.csv").write_text("t [ms],pos [mm]\n0,10\n4,12\n8,15\n")
    >>> (session,) = gt.measurements.read_log("run.csv", {"q": Column("pos", "mm")}, time=Column("t", "ms"))
    >>> session.trajectory["q"].tolist(), session.sample_time
    ([0.01, 0.012, 0.015], 0.004)

    Without a time column:

    >>> written = Path("run.csv").write_text("pos [mm]\n10\n12\n15\n")
    >>> (session,) = gt.measurements.read_log("run.csv", {"q": Column("pos", "mm")}, time=None, sample_time=0.004)
    >>> session.trajectory.time.tolist()
    [0.0, 0.004, 0.008]
    """
    check_units(columns, time)
    stream = stream_of(path, form, time="" if time is None else _one_name(time))
    if time is not None and time == TIME and "time" not in stream.heads.names and stream.clock:
        time = Column(stream.clock, "s")
    if time is not None and time.per_channel:
        time = time._replace(name=_beside(stream, columns, time))
    if time is None and sample_time is None:
        raise LogError(f"{shown(path)}: there is no time column, so the sample time is needed")
    gaps = empty_rows == "drop"
    try:
        rows, shape = _in_si(stream, columns, time, session, gaps, progress)
    except NoNumberError as error:
        raise LogError(f'{error}; empty_rows = "drop" leaves such rows out') from error
    origin = None if time is None else _count(rows, stream, time)
    last = len(rows.lines)
    if time is not None and time.per_channel and gaps:  # a channel may end before others
        last = int(np.max(np.flatnonzero(np.isfinite(rows.values[_TIME][:, 0])), initial=-1)) + 1
    sessions = []
    for begin, end in pairwise([*_begins(rows, session, stream), last]):
        part, numbers, note = slice(begin, end), rows.lines, dict[str, Any]()
        if origin is not None:
            note[ORIGIN] = origin
        label = Path(path).name if session is None else f"{Path(path).name} {session} {rows.values[_OF][begin, 0]:g}"
        if time is None:
            assert sample_time is not None
            grid: Array = sample_time * np.arange(float(end - begin))
        else:
            grid = rows.values[_TIME][part, 0]
        chosen = _chosen(grid, {n: rows.values[n][part] for n in shape} if gaps else {}, late_rows, note)
        if chosen is not None:
            grid, numbers, begin = grid[chosen], _lines_of(rows.lines, chosen + begin), 0
        if not len(grid):
            raise LogError(f"{stream.source}: every row lacks a number in one of the declared columns")
        _refuse_backward(grid, begin, numbers, stream, time)
        if uneven:
            step = float(np.median(np.diff(grid))) if len(grid) > 1 else 0.0
        else:
            step = _sample_time(grid, f"{stream.source} {stream.row}", numbers, begin, sample_time, jitter)
        values = {name: _signal(rows.values[name][part], chosen, vector) for name, vector in shape.items()}
        units = {name: column.conversion.si_unit(_units(column)) for name, column in columns.items()}
        trajectory = Trajectory(
            grid, values, units, title=" ".join(stream.comments.get("title", [])), provenance=note,
            synthetic="; ".join(stream.comments.get("synthetic", [])) or None,
        )  # fmt: skip
        sessions.append(Session(label, trajectory, step))
    return tuple(sessions)


def recordings_of(sessions: Sequence[Session]) -> list[int]:
    """Return the number of the recording, from 0, to which each session belongs."""
    return (np.cumsum([n == 0 or session.stretch == 0 for n, session in enumerate(sessions)]) - 1).tolist()


# keys of the provenance: numbers of dropped rows
SHORT = "rows between gaps, too few to interpolate"
LEFT_OUT = ("rows without a number", "rows that came late or twice", SHORT)
ORIGIN = "origin of the time [ns since 1970]"  # key of the provenance, if it is known


def left_out(trajectories: Iterable[Trajectory]) -> dict[str, int]:
    """Return the numbers of dropped rows, by reason, as kept in the provenance; without zeros."""
    provenances = [trajectory.provenance for trajectory in trajectories]
    counts = {why: sum(provenance.get(why, 0) for provenance in provenances) for why in LEFT_OUT}
    return {why: count for why, count in counts.items() if count}


_TIME, _OF = "\0time", "\0session"  # keys that cannot be names of quantities


def check_units(columns: Mapping[str, Column], time: Column | None) -> None:
    """Raise LogError for an unknown unit, and for a time column whose unit is not a unit of time."""
    for name, column in {**columns, **({} if time is None else {"time": time})}.items():
        for text in _units(column):
            try:
                unit = parse_unit(text)
            except UnitError as error:
                raise LogError(f"the unit declared for '{name}': {error}") from error
            if column is time and unit.dimension != parse_unit("s").dimension:
                raise LogError(f"the time is declared in {text}; expected a unit of time such as s or ms")
        column.conversion.check(_units(column), column.name)


def _units(column: Column) -> Sequence[str]:
    return [column.unit] if isinstance(column.unit, str) else column.unit


def _one_name(time: Column) -> str:
    return time.name if isinstance(time.name, str) else time.name[0] if len(time.name) else ""


def _beside(stream: Stream, columns: Mapping[str, Column], time: Column) -> str:
    """Return the time column of the channels. Raises LogError if they have different ones."""
    if not isinstance(time.name, str):
        raise LogError("each channel has a time column of its own; expected one name or pattern for them")
    channels = {stream.heads.time_of(time.name, m): m for c in columns.values() for m in stream.heads.members(c.name)}
    if len(channels) > 1:
        one, other = list(channels.values())[:2]
        raise LogError(
            f"{stream.heads.where}: '{one}' and '{other}' have time columns of their own; read_recording reads them"
        )
    return next(iter(channels))


def _count(rows: TableRows, stream: Stream, time: Column) -> int | None:
    """Put the time [s] in place of its columns; return its origin [ns since 1970] if it is known.

    With a declared origin the time counts from the first row: seconds since 1970 have no room for microseconds.
    """
    columns, units, names = rows.values[_TIME], _units(time), [time.name] if isinstance(time.name, str) else time.name
    zero = next((stream.stamps[name] for name in names if name in stream.stamps), None)
    if time.since and zero is not None:
        raise LogError(f"{stream.source}: '{_one_name(time)}' holds dates, which need no origin; leave `since` out")
    width, begin = columns.shape[1], Fraction()
    if width > 1 or time.since:
        units = list(units) * width if len(units) == 1 else units
        whole = np.isfinite(columns).all(axis=1)
        first = columns[np.argmax(whole)] if time.since and whole.any() else np.zeros(width)
        parts = [convert(x - x_0, unit, "s") for x, x_0, unit in zip(columns.T, first, units, strict=True)]
        rows.values[_TIME] = np.sum(parts, axis=0)[:, None]
        rows.values[_TIME].setflags(write=False)
        begin = sum((Fraction(x) * parse_unit(unit).factor for x, unit in zip(first, units, strict=True)), begin)
    if time.since:
        return _since(time, stream) + round(begin * 10**9)
    return None if zero is None else zero - _ahead(time) // timedelta(microseconds=1) * 1000


def _since(time: Column, stream: Stream) -> int:
    """Return the declared origin of a time [ns since 1970]. Raises LogError if it is no date."""
    text, place = time.since, ""
    if not (date := _date(text)):
        place = next((line.strip() for line in stream.above() if text in line), "")
        date = _date(date_in(place.partition(text)[2]))
    if date is None:
        line = f"the line {place[:60]!r} has no date behind it" if place else "it is not in a line above the table"
        raise LogError(
            f"{stream.source}: since = {text!r} is no date such as 2026-11-28T08:15:00, and {line}", "time.since"
        )
    ahead = _ahead(time) if date.tzinfo is None else timedelta()
    return (date.replace(tzinfo=date.tzinfo or UTC) - ahead - _EPOCH) // timedelta(microseconds=1) * 1000


def _ahead(time: Column) -> timedelta:
    """Return by how much the zone of the dates is ahead of UTC. Raises LogError if it is no zone."""
    dated = _date(f"2000-01-01T00:00{time.zone}")
    if dated is None or (time.zone and dated.tzinfo is None):
        raise LogError(f"zone = {time.zone!r}; expected a time ahead of UTC such as +01:00", "time.zone")
    return dated.utcoffset() or timedelta()


_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


def _date(text: str) -> datetime | None:
    try:
        return datetime.fromisoformat(text)
    except ValueError:
        return None


def _in_si(
    stream: Stream,
    columns: Mapping[str, Column],
    time: Column | None,
    session: str | None,
    gaps: bool,
    progress: Progress,
) -> tuple[TableRows, dict[str, bool]]:
    """Return the declared columns of a stream in SI units, and whether each quantity is a vector."""
    declared = {} if time is None else {_TIME: time}
    declared |= dict(columns) | ({} if session is None else {_OF: Column(session, "1")})
    groups, units = dict[str, list[str]](), dict[str, list[str]]()
    for name, column in declared.items():
        groups[name] = stream.heads.members(column.name)
        units[name] = each(column.unit, groups[name], name)
        for member, unit in zip(groups[name], units[name], strict=True):
            stream.heads.refuse_other_unit(member, unit)
    columns_of_time = len(groups.get(_TIME, []))

    def si(name: str, values: Array) -> Array:
        if name == _TIME and (columns_of_time > 1 or (time is not None and time.since)):
            return values  # `_count` adds them
        if len(set(units[name])) > 1:
            values = np.column_stack([in_si(part, u) for part, u in zip(values.T, units[name], strict=True)])
        else:
            values = in_si(values, units[name][0])
        conversion = declared[name].conversion
        return values if conversion.is_plain else conversion.apply(values, units[name])

    def in_si(values: Array, unit: str) -> Array:
        si_unit = parse_unit(unit).si_text
        return values if unit == si_unit else convert(values, unit, si_unit)

    rows = stream.read(groups, si, gaps=gaps, progress=progress)
    for values in rows.values.values():
        values.setflags(write=False)  # so that a trajectory does not copy them
    return rows, {name: len(groups[name]) > 1 for name in columns}


def each(unit: str | Sequence[str], members: Sequence[str], name: str) -> list[str]:
    """Return the unit of each column. Raises LogError if their numbers differ."""
    units = [unit] * len(members) if isinstance(unit, str) else list(unit)
    if len(units) != len(members):
        raise LogError(f"'{name}' has {len(units)} units for {len(members)} columns; give one for all, or one each")
    return units


def _begins(rows: TableRows, session: str | None, stream: Stream) -> list[int]:
    """Return the first row of each recording. Raises LogError if a recording continues after another one."""
    if session is None:
        return [0]
    number = rows.values[_OF][:, 0]
    begins = [0, *(np.flatnonzero(np.diff(number)) + 1).tolist()]
    _, first = np.unique(number[begins], return_index=True)
    if len(first) < len(begins):
        k = begins[min(set(range(len(begins))) - set(first.tolist()))]
        raise LogError(
            f"{stream.source} {stream.row} {rows.lines[k]}: {session} {number[k]:g} begins again after another one; "
            "sort the rows by session, or renumber the recordings"
        )
    return begins


def _chosen(time: Array, values: Mapping[str, Array], late_rows: LateRows, note: dict[str, Any]) -> np.ndarray | None:
    """Return the rows to take, None for all; `note` gets the numbers of dropped rows.

    values: the values that must be finite.
    """
    finite_rows: np.ndarray | None = None
    if values:
        finite = np.isfinite(time) & np.all([np.isfinite(v).all(axis=1) for v in values.values()], axis=0)
        if not finite.all():
            finite_rows = np.flatnonzero(finite)
            note[LEFT_OUT[0]] = len(time) - len(finite_rows)
            time = time[finite_rows]
    order = in_order(time, late_rows)
    if order is None:
        return finite_rows
    note[LEFT_OUT[1]] = int(np.sum(np.diff(np.maximum.accumulate(time)) <= 0))
    return order if finite_rows is None else finite_rows[order]


def _signal(values: Array, chosen: np.ndarray | None, vector: bool) -> Array:
    rows = values if chosen is None else values[chosen]
    return rows if vector else rows.reshape(-1)


def _lines_of(lines: Lines, rows: np.ndarray) -> Lines:
    chosen = Lines()
    chosen.extend(lines.array()[rows])
    return chosen


def _refuse_backward(time: Array, begin: int, lines: Lines, stream: Stream, column: Column | None) -> None:
    """Raise LogError, with the lines, if the time [s] does not increase."""
    if column is None or not (bad := np.flatnonzero(np.diff(time) <= 0)).size:
        return
    i, unit = int(bad[0]) + 1, column.unit if isinstance(column.unit, str) else column.unit[0]
    here, before = (float(f"{convert(float(t), 's', unit):.12g}") for t in (time[i], time[i - 1]))
    raise LogError(
        f"{stream.source} {stream.row} {lines[begin + i]}, {stream.cell} '{_one_name(column)}': {here!r} {unit} does "
        f"not come after {before!r} {unit} in {stream.row} {lines[begin + i - 1]}; {put_in_order(time)}, "
        'or set late_rows = "drop" or "sort", which keep the first of several rows with one time'
    )


def _sample_time(time: Array, where: str, lines: Lines, begin: int, expected: float | None, jitter: float) -> float:
    """Return the sample time of a session [s]. Raises LogError for the first step that is too long or too short.

    where: file and term for a row. lines: line numbers; those of `time` start at `begin`.
    """
    if time.size < 3:
        raise LogError(f"{where} {lines[begin]}: a recording has {time.size} rows; expected at least 3")
    median = float(np.median(np.diff(time), overwrite_input=True))
    if expected is not None and abs(median - expected) > jitter * expected:
        raise LogError(
            f"{where} {lines[begin]}: the samples are {_ms(median)} ms apart; expected {_ms(expected)} ms; correct the "
            "sample time or the unit of the time column"
        )
    step = median if expected is None else expected
    steps = np.diff(time)
    deviation = steps - step
    if (bad := np.flatnonzero(np.abs(deviation, out=deviation) > jitter * step)).size:
        k = int(bad[0])
        lost = float(np.round(steps[k] / step)) - 1
        cause = "the step jitters, so resample the log"
        if steps[k] > (1 + MISSING) * step:
            missing = "samples are" if lost > 1 else "sample is"
            cause = f"about {lost:.6g} {missing} missing, so split the log into sessions there"
        raise LogError(
            f"{where} {lines[begin + k + 1]}: {_ms(float(steps[k]))} ms after the row before; expected {_ms(step)} ms "
            f"within {100 * jitter:g} %: {cause}"
        )
    return float((time[-1] - time[0]) / (time.size - 1))


def _ms(seconds: float) -> str:
    return f"{convert(seconds, 's', 'ms'):.6g}"
