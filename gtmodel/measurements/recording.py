"""Recordings with several clocks, in one or several files."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from ..results.disk import path_of
from ..results.trajectory import Trajectory
from ..results.trajectory_files import PathLike
from ..results.work import Progress, silent
from .log import ORIGIN, TIME, Column, LogError, each, read_log
from .sampling import EmptyRows, LateRows
from .streams.form import LogForm, matching, shown
from .streams.opening import open_log, stream_of


def read_recording(
    paths: PathLike | Sequence[PathLike],
    columns: Mapping[str, Column],
    *,
    time: Column | None = TIME,
    sample_time: float | None = None,
    late_rows: LateRows = "refuse",
    empty_rows: EmptyRows = "refuse",
    form: LogForm = LogForm(),  # noqa: B008
    progress: Progress = silent,
) -> dict[str, Trajectory]:
    r"""Read the quantities of one recording, in SI units, as one trajectory per clock; rows may be uneven.

    Args:
        paths: one file, or all files of the recording.
        columns: quantity -> its `Column`, which may name its own time column, stream and file.
        time: time column of the other quantities; None: their rows are `sample_time` apart.
        late_rows, empty_rows, form, progress: as in `read_log`.

    The keys name the clocks by file, stream and time column, as far as these differ: "MATLABtime", "/imu",
    "force.csv". Times of known origin (dates, bags, Parquet, `Column.since`) count from the earliest origin in all
    files. If the columns of a vector "q" have time columns of their own (`Column.per_channel`), each is a signal,
    "q[0]", "q[1]". Nothing is resampled; `sampling_of(trajectory.time)` describes the sampling. Raises LogError as
    `read_log` does, if a column could be in several files, and if the origin of one clock is declared and that of
    another is unknown.

    >>> from pathlib import Path
    >>> written = Path("robot.csv").write_text("t,q\n0.0,1.0\n0.1,1.2\n0.2,1.1\n")
    >>> written = Path("sensor.csv").write_text("stamp_ms,volts\n3,0.1\n16,0.3\n31,0.2\n44,0.2\n")
    >>> Column = gt.measurements.Column
    >>> columns = {
    ...     "q": Column("q", "m", time=Column("t", "s")),
    ...     "force": Column("volts", "V", time=Column("stamp_ms", "ms")),
    ... }
    >>> recording = gt.measurements.read_recording(["robot.csv", "sensor.csv"], columns)
    >>> {clock: len(trajectory) for clock, trajectory in recording.items()}
    {'robot.csv': 3, 'sensor.csv': 4}
    >>> recording["sensor.csv"].time.tolist()
    [0.003, 0.016, 0.031, 0.044]
    """
    files = [path_of(path, "paths") for path in ([paths] if isinstance(paths, (str, os.PathLike)) else paths)]
    if not columns or not files:
        raise LogError("a recording needs at least one file and one column")
    groups: dict[_Key, dict[str, Column]] = {}
    for name, column in columns.items():
        file, stream, clock = _file_of(name, column, files, form), column.stream or form.stream, column.time or time
        for part, plain, label in _by_clock(name, column, file, stream, clock, form):
            groups.setdefault(_Key(file, stream, clock, label), {})[part] = plain
    read = dict[str, tuple[_Key, Trajectory]]()
    for key, group in groups.items():
        (session,) = read_log(
            key.file, group, time=key.clock, sample_time=sample_time, uneven=True, late_rows=late_rows,
            empty_rows=empty_rows, form=replace(form, stream=key.stream), progress=progress,
        )  # fmt: skip
        read[_name(key, list(groups))] = key, session.trajectory
    zeros = {name: trajectory.provenance.get(ORIGIN) for name, (_, trajectory) in read.items()}
    declared = next((name for name, (key, _) in read.items() if key.clock and key.clock.since), "")
    if declared and (unknown := next((name for name, zero in zeros.items() if zero is None), "")):
        raise LogError(f"the origin of the clock '{declared}' is declared, that of '{unknown}' is not; declare `since`")
    first = min((zero for zero in zeros.values() if zero is not None), default=0)
    shifts = {name: 0.0 if zero is None else (zero - first) * 1e-9 for name, zero in zeros.items()}
    return {name: _later(trajectory, shifts[name]) for name, (_, trajectory) in read.items()}


class _Key(NamedTuple):
    """What the signals of one clock share; time: label of the time column."""

    file: Path
    stream: str
    clock: Column | None
    time: str


def _by_clock(
    name: str, column: Column, file: Path, stream: str, clock: Column | None, form: LogForm
) -> list[tuple[str, Column, str]]:
    """Return the signals of a declared column, one for each of its clocks, with the label of the time column."""
    plain = column._replace(time=None, stream="", file="")
    if clock is None or not clock.per_channel or not isinstance(clock.name, str):
        named = "rows" if clock is None else clock.name
        return [(name, plain, named if isinstance(named, str) else " + ".join(named))]
    heads = stream_of(file, form, stream, time=clock.name).heads
    members = heads.members(column.name)
    labels = [heads.time_of(clock.name, member) for member in members]
    if len(set(labels)) == 1:
        return [(name, plain, labels[0])]
    units = each(column.unit, members, name)
    return [
        (f"{name}[{k}]", Column(member, unit, conversion=column.conversion.component(k, len(members))), label)
        for k, (member, unit, label) in enumerate(zip(members, units, labels, strict=True))
    ]


def _file_of(name: str, column: Column, files: Sequence[Path], form: LogForm) -> Path:
    """Return the file that holds a column. Raises LogError if there is not exactly one."""
    if column.file:
        matches = matching(files, column.file)
        if len(matches) != 1:
            file_names = ", ".join(file.name for file in files)
            raise LogError(f"'{column.file}', the file of '{name}', is not in the recording; its files: {file_names}")
        return matches[0]
    if len(files) == 1:
        return files[0]
    labels = [column.name] if isinstance(column.name, str) else list(column.name)
    matches = [file for file in files if any(_holds(stream.heads.names, labels) for stream in open_log(file, form))]
    if len(matches) != 1:
        where = " and ".join(shown(file) for file in matches) if matches else "no file of the recording"
        raise LogError(f"the column '{labels[0]}' of '{name}' is in {where}; name its file")
    return matches[0]


def _later(trajectory: Trajectory, shift: float) -> Trajectory:
    if not shift:
        return trajectory
    values = {name: trajectory[name] for name in trajectory.names}
    return Trajectory(
        trajectory.time + shift, values, trajectory.units, title=trajectory.title, provenance=trajectory.provenance,
        synthetic=trajectory.synthetic,
    )  # fmt: skip


def _holds(names: Sequence[str], labels: Sequence[str]) -> bool:
    return all(label in names or f"{label}[0]" in names for label in labels)


def _name(key: _Key, groups: Sequence[_Key]) -> str:
    """Return the shortest name that distinguishes this clock; the time column if there is only one clock."""
    parts = [key.file.name] if len({g.file for g in groups}) > 1 else []
    parts += [key.stream] if len({g.stream for g in groups}) > 1 else []
    if not parts or sum((g.file, g.stream) == (key.file, key.stream) for g in groups) > 1:
        parts.append(key.time)
    return " ".join(parts)
