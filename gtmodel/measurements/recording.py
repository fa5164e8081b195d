"""A recording with several clocks: each stream with its own time, whatever file it stands in."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from ..results.disk import path_of
from ..results.trajectory import Trajectory
from ..results.trajectory_files import PathLike
from ..results.work import Progress, silent
from .log import TIME, Column, LogError, read_log
from .sampling import EmptyRows, LateRows
from .streams.form import LogForm, shown
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
    r"""The quantities of one recording by the clock that they were taken with, in SI units; rows may be uneven.

    Args:
        paths: one file, or those that were recorded at once.
        columns: quantity -> where it stands. A `Column` may name a time, a stream and a file of its own.
        time: the column of time of all others; None: their rows are `sample_time` apart.
        late_rows, empty_rows, form, progress: as of `read_log`.

    The clocks are named by file, stream and column of time, as far as they differ: "MATLABtime", "/imu", "force.csv".
    Times that are stamps, of bags and Parquet files, count from the earliest of them in all files. Nothing is
    resampled; `sampling_of(trajectory.time)` says how the rows follow each other. Raises LogError as `read_log` does,
    and where a column could stand in several files.

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
    files = [path_of(one, "paths") for one in ([paths] if isinstance(paths, (str, os.PathLike)) else paths)]
    if not columns or not files:
        raise LogError("a recording needs a file and a column; none was given")
    groups: dict[tuple[Path, str, Column | None], dict[str, Column]] = {}
    for name, column in columns.items():
        of_file = _file_of(name, column, files, form)
        key = of_file, column.stream or form.stream, column.time or time
        groups.setdefault(key, {})[name] = Column(column.name, column.unit)
    read: dict[str, Trajectory] = {}
    zeros = {key: _zero(*key, form) for key in groups}
    first = min((zero for zero in zeros.values() if zero is not None), default=0)
    for (file, stream, clock), chosen in groups.items():
        (session,) = read_log(
            file, chosen, time=clock, sample_time=sample_time, uneven=True, late_rows=late_rows, empty_rows=empty_rows,
            form=replace(form, stream=stream), progress=progress,
        )  # fmt: skip
        zero, trajectory = zeros[file, stream, clock], session.trajectory
        if zero is not None and zero > first:  # stamps of several files count from the earliest
            trajectory = _later(trajectory, (zero - first) * 1e-9)
        read[_name(file, stream, clock, list(groups))] = trajectory
    return read


def _file_of(name: str, column: Column, files: Sequence[Path], form: LogForm) -> Path:
    """The file in which a column stands. Raises LogError where that is none or not clear."""
    if column.file:
        chosen = [file for file in files if column.file in (str(file), file.name)]
        if len(chosen) != 1:
            there = ", ".join(file.name for file in files)
            raise LogError(f"the file '{column.file}' of '{name}' is none of those of the recording, {there}")
        return chosen[0]
    if len(files) == 1:
        return files[0]
    wanted = [column.name] if isinstance(column.name, str) else list(column.name)
    chosen = [file for file in files if any(_holds(stream.heads.names, wanted) for stream in open_log(file, form))]
    if len(chosen) != 1:
        where = " and ".join(shown(file) for file in chosen) if chosen else "no file of the recording"
        raise LogError(f"the column '{wanted[0]}' of '{name}' is in {where}; name its file")
    return chosen[0]


def _zero(file: Path, stream: str, clock: Column | None, form: LogForm) -> int | None:
    """The instant [ns since 1970] from which the time of a stream counts; None where that is not known."""
    if clock is None:
        return None
    name = clock.name if isinstance(clock.name, str) else ""
    opened = stream_of(file, form, stream, time=name)
    own = opened.clock if clock == TIME and name not in opened.heads.names else name
    return opened.stamps.get(own)


def _later(trajectory: Trajectory, shift: float) -> Trajectory:
    values = {name: trajectory[name] for name in trajectory.names}
    return Trajectory(
        trajectory.time + shift, values, trajectory.units, title=trajectory.title, provenance=trajectory.provenance,
        synthetic=trajectory.synthetic,
    )  # fmt: skip


def _holds(names: Sequence[str], wanted: Sequence[str]) -> bool:
    return all(name in names or f"{name}[0]" in names for name in wanted)


def _name(file: Path, stream: str, clock: Column | None, groups: Sequence[tuple[Path, str, Column | None]]) -> str:
    """What tells this clock from the others; the column of time where there is one only."""
    by_file = {(f, s): {t for g, r, t in groups if (g, r) == (f, s)} for f, s, _ in groups}
    parts = [file.name] if len({f for f, _, _ in groups}) > 1 else []
    parts += [stream] if len({s for _, s, _ in groups}) > 1 else []
    if not parts or len(by_file[file, stream]) > 1:
        parts.append("rows" if clock is None else str(clock.name))
    return " ".join(parts)
