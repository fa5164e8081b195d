"""Recordings with several clocks, in one or several files."""

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
    r"""Read the quantities of one recording, in SI units, as one trajectory per clock; rows may be uneven.

    Args:
        paths: one file, or all files of the recording.
        columns: quantity -> its `Column`, which may name its own time column, stream and file.
        time: time column of the other quantities; None: their rows are `sample_time` apart.
        late_rows, empty_rows, form, progress: as in `read_log`.

    The keys name the clocks by file, stream and time column, as far as these differ: "MATLABtime", "/imu",
    "force.csv". Absolute time stamps (bags, Parquet) count from the earliest stamp in all files. Nothing is resampled;
    `sampling_of(trajectory.time)` describes the sampling. Raises LogError as `read_log` does, and if a column could be
    in several files.

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
    groups: dict[tuple[Path, str, Column | None], dict[str, Column]] = {}
    for name, column in columns.items():
        key = _file_of(name, column, files, form), column.stream or form.stream, column.time or time
        groups.setdefault(key, {})[name] = column._replace(time=None, stream="", file="")
    trajectories: dict[str, Trajectory] = {}
    zeros = {key: _zero(*key, form) for key in groups}
    first = min((zero for zero in zeros.values() if zero is not None), default=0)
    for (file, stream, clock), group in groups.items():
        (session,) = read_log(
            file, group, time=clock, sample_time=sample_time, uneven=True, late_rows=late_rows, empty_rows=empty_rows,
            form=replace(form, stream=stream), progress=progress,
        )  # fmt: skip
        zero, trajectory = zeros[file, stream, clock], session.trajectory
        if zero is not None and zero > first:
            trajectory = _later(trajectory, (zero - first) * 1e-9)
        trajectories[_name(file, stream, clock, list(groups))] = trajectory
    return trajectories


def matching(files: Sequence[Path], name: str) -> list[Path]:
    """Return the files with this name, path or pattern."""
    return [file for file in files if name in (str(file), file.name) or file.match(name)]


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


def _zero(file: Path, stream: str, clock: Column | None, form: LogForm) -> int | None:
    """Return the origin [ns since 1970] of the times of a stream, None if unknown."""
    if clock is None:
        return None
    name = clock.name if isinstance(clock.name, str) else ""
    opened = stream_of(file, form, stream, time=name)
    return opened.stamps.get(opened.clock if clock == TIME and name not in opened.heads.names else name)


def _later(trajectory: Trajectory, shift: float) -> Trajectory:
    values = {name: trajectory[name] for name in trajectory.names}
    return Trajectory(
        trajectory.time + shift, values, trajectory.units, title=trajectory.title, provenance=trajectory.provenance,
        synthetic=trajectory.synthetic,
    )  # fmt: skip


def _holds(names: Sequence[str], labels: Sequence[str]) -> bool:
    return all(label in names or f"{label}[0]" in names for label in labels)


def _name(file: Path, stream: str, clock: Column | None, groups: Sequence[tuple[Path, str, Column | None]]) -> str:
    """Return the shortest name that distinguishes this clock; the time column if there is only one clock."""
    by_file = {(f, s): {t for g, r, t in groups if (g, r) == (f, s)} for f, s, _ in groups}
    parts = [file.name] if len({f for f, _, _ in groups}) > 1 else []
    parts += [stream] if len({s for _, s, _ in groups}) > 1 else []
    if not parts or len(by_file[file, stream]) > 1:
        parts.append("rows" if clock is None else str(clock.name))
    return " ".join(parts)
