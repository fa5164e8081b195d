"""Readings of a force sensor from files, with orientations in the same file or in another one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from scipy.spatial.transform import Rotation

from ...measurements import Column, LogError, LogForm, RowJoin, joined, read_log, read_recording
from ...measurements.joining import IN_TIME
from ...measurements.log import TIME
from ...measurements.orientations import FIRST, VECTOR, orientation_vectors
from ...measurements.sampling import EmptyRows, LateRows
from ...measurements.streams.opening import stream_of
from ...results import ArgumentError, Trajectory
from ...results.disk import path_of
from ...results.refusal import naming
from ...results.trajectory_files import PathLike

DEFAULT = {"turn": "rad", "force": "N", "moment": "N.m"}
HEADER: Literal["header"] = "header"


@dataclass(frozen=True)
class WrenchForm:
    """How files of readings are read.

    columns: of "turn", "force", "moment" and "temperature"; the first three have, if left out, the columns of these
        names with the unit of the header. representation: of the orientation.
    time: time column; by default "time" with the unit of the header. None: rows are `sample_time` [s] apart.
    session: column with the number of the recording.
    late_rows, empty_rows, form: as in `gtmodel.measurements.read_log`.
    """

    columns: Mapping[str, Column]
    representation: str = VECTOR
    time: Column | Literal["header"] | None = HEADER
    session: str | None = None
    sample_time: float | None = None
    late_rows: LateRows = "refuse"
    empty_rows: EmptyRows = "refuse"
    form: LogForm = field(default_factory=LogForm)

    def column(self, name: str, path: Path) -> Column:
        """Return the declared column, or the default one."""
        if name in self.columns:
            return self.columns[name]
        heads = stream_of(path, self.form, holding=name).heads
        return Column(name, tuple(heads.units[heads.place(member)] or DEFAULT[name] for member in heads.members(name)))

    def clock(self, path: Path) -> Column | None:
        """Return the time column."""
        if self.time != HEADER:
            return self.time
        try:
            heads = stream_of(path, self.form).heads
        except LogError:  # a bag with several streams; its times are in s
            return TIME
        return Column("time", (heads.units[heads.place("time")] if "time" in heads.names else "") or "s")

    def turned(self, rows: Trajectory) -> Trajectory:
        """Return rows whose orientations are rotation vectors."""
        with naming("representation"):
            turn = orientation_vectors(rows["turn"], self.representation, rows.units["turn"])
        return rows.with_values({"turn": turn}, units={"turn": "rad"})

    def quaternions(self, poses: Trajectory) -> Trajectory:
        """Return poses whose orientations are quaternions, scalar first."""
        turn = Rotation.from_rotvec(np.array(self.turned(poses)["turn"]))
        return poses.with_values({"turn": turn.as_quat(scalar_first=True)}, units={"turn": "1"})


def read_wrenches(
    path: PathLike, form: WrenchForm, poses: PathLike | None = None, join: RowJoin | None = None
) -> Trajectory:
    r"""Read "turn" (rotation vector), "force", "moment", and "session" and "temperature" if declared, row by row.

    poses: file with the orientations, if not in `path`, whose rows are joined as `join` says. A clock that restarts
    with a session continues one period after the last row. Raises ArgumentError: LogError about the files; about
    "representation", "time", "join.tolerance", "join.number", or a column, such as "force".

    >>> from pathlib import Path
    >>> L = gt.control.lead_through
    >>> head = "time [s],a,b,c,Fx,Fy,Fz,Mx,My,Mz\n"
    >>> _ = Path("f.csv").write_text(head + "0,0,0,90,1,2,3,.1,.2,.3\n2,0,0,0,1,2,3,.1,.2,.3\n")
    >>> Column = gt.measurements.Column
    >>> columns = {
    ...     "turn": Column(("a", "b", "c"), "deg"), "force": Column(("Fx", "Fy", "Fz"), "N"),
    ...     "moment": Column(("Mx", "My", "Mz"), "N.m"),
    ... }
    >>> L.read_wrenches("f.csv", L.WrenchForm(columns))["turn"][0].round(3).tolist()
    [0.0, 0.0, 1.571]
    """
    file = path_of(path)
    columns = {name: form.column(name, file) for name in ("force", "moment")}
    columns |= {"temperature": form.columns["temperature"]} if "temperature" in form.columns else {}
    columns |= {} if form.session is None else {"session": Column(form.session, "1")}
    if poses is None:
        return form.turned(_rows(form, file, columns | {"turn": form.column("turn", file)}))
    join, other = join or RowJoin(), path_of(poses, "poses")
    turn = form.column("turn", other)
    with naming({"tolerance": "join.tolerance", "number": "join.number"}):
        if join.match in IN_TIME:
            readings, apart = _by_clocks(form, file, other, columns, turn, join)
            rows = joined(readings, form.quaternions(apart), join, natures={"turn": "quaternion"})
        else:
            more = {} if join.number is None else {join.number: Column(join.number, "1")}
            (session,) = read_log(other, {"turn": turn} | more, time=None, sample_time=1.0, uneven=True, form=form.form)
            rows = joined(_rows(form, file, columns | more), form.quaternions(session.trajectory), join)
    return orientations(rows)


def orientations(rows: Trajectory) -> Trajectory:
    """Return rows whose quaternions, scalar first, are rotation vectors."""
    turn = orientation_vectors(rows["turn"], FIRST, "1")
    return rows.with_values({"turn": turn}, units={"turn": "rad"})


def _by_clocks(
    form: WrenchForm, file: Path, other: Path, columns: dict[str, Column], turn: Column, join: RowJoin
) -> tuple[Trajectory, Trajectory]:
    """Return readings and orientations on one time axis."""
    clock = form.clock(file)
    if clock is None:
        raise ArgumentError("is missing; a join in time needs it", "time")
    theirs = form.clock(other) if join.time is None else Column(join.time.column, join.time.unit)
    placed = {n: c._replace(file=str(file), time=clock) for n, c in columns.items()}
    placed["turn"] = turn._replace(file=str(other), time=turn.time or theirs)
    recording = read_recording(
        list(dict.fromkeys([file, other])), placed, late_rows=form.late_rows, empty_rows=form.empty_rows,
        form=form.form,
    )  # fmt: skip
    readings, poses = (next(t for t in recording.values() if n in t.names) for n in ("force", "turn"))
    if apart := sorted(set(columns) - set(readings.names)):
        raise ArgumentError("must have the clock of the force", apart[0])
    return readings.select(list(columns)), poses.select("turn")


def _rows(form: WrenchForm, path: Path, columns: dict[str, Column]) -> Trajectory:
    """Return the rows of all sessions; a clock that restarts continues one period after the last row."""
    for name, column in columns.items():
        if column.time or column.stream or column.file:
            raise ArgumentError("has its own time, stream or file; that needs a file of poses and a join in time", name)
    time = form.clock(path)
    step = 1.0 if time is None and form.sample_time is None else form.sample_time
    parts = read_log(
        path, columns, time=time, session=form.session, sample_time=step, uneven=True, late_rows=form.late_rows,
        empty_rows=form.empty_rows, form=form.form,
    )  # fmt: skip
    whole, *rest = [part.trajectory for part in parts]
    if not rest:
        return whole
    grid = whole.time
    for part in parts[1:]:
        later = part.trajectory.time
        gap = 0.0 if later[0] > grid[-1] else grid[-1] + (part.sample_time or 1.0) - later[0]
        grid = np.concatenate([grid, later + gap])
    values: dict[str, Any] = {name: np.concatenate([t[name] for t in (whole, *rest)]) for name in whole.names}
    return Trajectory(grid, values, whole.units, title=whole.title, synthetic=whole.synthetic)
