"""Kind "wrench_calibration": readings of a force sensor without contact, to subtract them from contact forces."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from pydantic import Field, PositiveFloat

from gtmodel.control import lead_through
from gtmodel.control.lead_through.options import Drift, SyntheticReadings, WrenchAlarm
from gtmodel.control.lead_through.scenes import SyntheticSensor
from gtmodel.lang.units import UnitError
from gtmodel.measurements import Column, LogError, Match, joined, read_log, read_recording
from gtmodel.measurements.log import TIME
from gtmodel.measurements.orientations import FIRST, VECTOR, WORDS, orientation_vectors
from gtmodel.measurements.streams.opening import stream_of
from gtmodel.problem_files.base import Call, Context, FileSection, InputError, Problem
from gtmodel.problem_files.from_options import Made, made_from, options_of
from gtmodel.problem_files.keys import LogReading, RecordedSignalSection, TimeColumn
from gtmodel.results import Trajectory, TrajectoryError
from gtmodel.results.refusal import naming

RESULT = "gtmodel.control.lead_through.WrenchStudy"


@made_from(SyntheticReadings, "sensor")
class SyntheticWrenches(Made):
    """Synthetic readings of a sensor with known errors."""

    sensor: Made[SyntheticSensor] = Made[SyntheticSensor].left_out()


class SensorOrientation(RecordedSignalSection):
    """Columns of the orientation of the sensor's axes in the world frame."""

    representation: str = Field(default=VECTOR, description=WORDS)


class WrenchSignals(FileSection):
    """Columns of the signals; a signal that is left out has the column of its default and the unit of the header."""

    orientation: SensorOrientation | None = Field(
        default=None, description="orientation of the sensor's axes in the world frame; column turn if left out"
    )
    force: RecordedSignalSection | None = Field(default=None, description="three forces; column force if left out")
    moment: RecordedSignalSection | None = Field(default=None, description="three moments; column moment if left out")
    temperature: RecordedSignalSection | None = Field(default=None, description="temperature of the sensor, if known")


class PosesSection(FileSection):
    """Orientations in files of their own, in the same format as the readings."""

    file: str = Field(description="orientations of the readings at rest")
    pushes: str | None = Field(default=None, description="orientations of the readings during pushes")
    match: Match = Field(
        default="nearest",
        description="row of a reading: nearest in time, interpolated in time, with the same number, or by the order of "
        "the rows",
    )
    tolerance_s: PositiveFloat | None = Field(default=None, description="nearest: largest difference of the times")
    number: str | None = Field(default=None, description="number: column with the number of the row, in both files")
    time: TimeColumn | None = Field(default=None, description="time column; that of the readings if left out")


class ReadingsSection(LogReading):
    """Measured readings, a row for each pose, in a text, MATLAB or Parquet file or a bag."""

    file: str = Field(description="readings at rest without contact, a row for each pose")
    pushes: str | None = Field(
        default=None, description="readings during pushes of a fixed point against the contact point of the tool"
    )
    poses: PosesSection | None = Field(default=None, description="orientations in another file")
    signals: WrenchSignals = WrenchSignals.left_out()
    session: str | None = Field(default=None, description="column whose number distinguishes the recordings")
    force_noise_N: PositiveFloat | None = Field(
        default=None, description="standard deviation of a force reading; from the residuals if left out"
    )
    moment_noise_Nm: PositiveFloat | None = Field(default=None, description="standard deviation of a moment reading")
    drift: bool | Drift | list[Drift] = Field(
        default="none",
        description="drifts of the biases to estimate, one or several: linear in time, by session, with temperature; "
        "or blocks, for an irregular drift; true is linear, false none",
    )
    accept: list[WrenchAlarm] = Field(
        default_factory=list, description="alarms about the readings that become notes instead of errors"
    )


class Schema(Problem):
    """Bias, mass and centre of mass of the load on a force sensor, from readings at rest in several poses, with
    intervals, and the lever arm to the contact point."""

    readings: ReadingsSection | None = Field(default=None, description="measured readings")
    synthetic: SyntheticWrenches | None = Field(default=None, description="synthetic readings")


ARGUMENTS = {
    "readings": "readings.file", "pushes": "readings.pushes", "force_noise": "readings.force_noise_N",
    "moment_noise": "readings.moment_noise_Nm", "turns": "readings.file", "forces": "readings.file",
    "moments": "readings.file", "drift": "readings.drift", "accept": "readings.accept", "time": "readings.file",
    "session": "readings.session", "temperature": "readings.signals.temperature",
}  # fmt: skip


def call(problem: Schema, context: Context) -> Call:
    """Return the call of the study of measured or synthetic readings."""
    if context.start is not None:
        raise InputError("--start: this kind does not use an earlier result; leave it out")
    measured, synthetic = problem.readings, problem.synthetic
    if (measured is None) == (synthetic is None):
        present = "both" if measured is not None else "neither"
        raise InputError(f"expected one of [readings] and [synthetic]; found {present}", "readings")
    if synthetic is not None:
        sensor = options_of(synthetic, "sensor")["sensor"]
        return Call(
            lead_through.wrench_study, SyntheticReadings(**synthetic.given(), sensor=sensor), title=problem.title
        )
    assert measured is not None
    apart = measured.poses
    readings = _read(measured, measured.file, None if apart is None else apart.file, "", context)
    pushes = None
    if measured.pushes is not None:
        if apart is not None and apart.pushes is None:
            raise InputError("is missing; name the orientations during the pushes", "readings.poses.pushes")
        pushes = _read(measured, measured.pushes, None if apart is None else apart.pushes, "pushes", context)
    return Call(
        lead_through.wrench_study, readings, pushes, force_noise=measured.force_noise_N,
        moment_noise=measured.moment_noise_Nm, drift=measured.drift, accept=measured.accept, title=problem.title,
    )  # fmt: skip


def _read(keys: ReadingsSection, name: str, poses: str | None, part: str, context: Context) -> Trajectory:
    """Return turn, force, moment, and session and temperature if known, of the poses at rest or of the pushes (part).
    Raises InputError."""
    key = f"readings.{part or 'file'}"
    linear = keys.drift is True or keys.drift == "linear" or (isinstance(keys.drift, list) and "linear" in keys.drift)
    if linear and not keys.time.column and keys.sample_time_s is None:
        raise InputError("is missing; a drift in time needs it without a time column", "readings.sample_time_s")
    path = context.file(name, key, "readings" if not part else key, source=keys.source)
    try:
        columns = {signal: _column(keys, signal, path) for signal in ("force", "moment")}
        if keys.signals.temperature is not None and not part:
            columns["temperature"] = keys.signals.temperature.recorded()
        if keys.session is not None and not part:
            columns["session"] = Column(keys.session, "1")
        session = None if part else keys.session
        if poses is None:
            columns["turn"] = _column(keys, "turn", path)
            return _turned(_rows(keys, path, columns, session), _representation(keys))
        assert keys.poses is not None
        place = f"readings.poses.{part or 'file'}"
        other = context.file(poses, place, place, source=keys.source)
        return _turned(_joined(keys, keys.poses, path, other, columns, session), FIRST)
    except (TrajectoryError, UnitError) as error:
        # the sentence names the file; a wrong column may be the fault of the section or of the file
        raise InputError(str(error), key) from error


def _joined(
    keys: ReadingsSection, apart: PosesSection, path: Path, other: Path, columns: dict[str, Column],
    session: str | None,
) -> Trajectory:  # fmt: skip
    """Return the readings with the orientations of another file as quaternions. Raises InputError and LogError."""
    turn = _column(keys, "turn", other)
    if apart.match in ("nearest", "interpolated"):
        if apart.match == "nearest" and apart.tolerance_s is None:
            raise InputError("is missing; give the largest difference of the times", "readings.poses.tolerance_s")
        if not keys.time.column:
            raise InputError("is missing; a join in time needs it", "readings.time.column")
        clock = _time(keys, path)
        theirs = _time(keys, other) if apart.time is None else apart.time.declared()
        placed = {n: c._replace(file=str(path), time=clock) for n, c in columns.items()}
        placed["turn"] = turn._replace(file=str(other), time=turn.time or theirs)
        recording = read_recording(
            list(dict.fromkeys([path, other])),
            placed,
            late_rows=keys.late_rows,
            empty_rows=keys.empty_rows,
            form=keys.form(),
        )
        readings, poses = (next(t for t in recording.values() if n in t.names) for n in ("force", "turn"))
        if other_clock := sorted(set(columns) - set(readings.names)):
            raise InputError("must have the clock of the force", f"readings.signals.{other_clock[0]}")
        poses = poses.select("turn")
        return joined(
            readings.select(list(columns)), _quaternions(keys, poses), apart.match, tolerance=apart.tolerance_s,
            natures={("turn",): "quaternion"},
        )  # fmt: skip
    more = dict[str, Column]()
    if apart.match == "number":
        if apart.number is None:
            raise InputError("is missing; name the column with the number of the row", "readings.poses.number")
        more["number"] = Column(apart.number, "1")
    readings = _rows(keys, path, columns | more, session)
    (poses,) = read_log(other, {"turn": turn} | more, time=None, sample_time=1.0, uneven=True, form=keys.form())
    return joined(readings, _quaternions(keys, poses.trajectory), apart.match)


def _rows(keys: ReadingsSection, path: Path, columns: dict[str, Column], session: str | None) -> Trajectory:
    """Return the rows of all sessions; a clock that restarts continues one period after the last row."""
    for name, column in columns.items():
        if column.time or column.stream or column.file:
            key = "orientation" if name == "turn" else name
            raise InputError("has its own time, stream or file; that needs [readings.poses] with a match in time",
                             f"readings.signals.{key}")  # fmt: skip
    time = _time(keys, path)
    step = 1.0 if time is None and keys.sample_time_s is None else keys.sample_time_s
    parts = read_log(
        path, columns, time=time, session=session, sample_time=step, uneven=True, late_rows=keys.late_rows,
        empty_rows=keys.empty_rows, form=keys.form(),
    )  # fmt: skip
    whole, *rest = [part.trajectory for part in parts]
    if not rest:
        return whole
    grid = whole.time
    for part in parts[1:]:
        later = part.trajectory.time
        gap = 0.0 if later[0] > grid[-1] else grid[-1] + (part.sample_time or 1.0) - later[0]
        grid = np.concatenate([grid, later + gap])
    values = {name: np.concatenate([t[name] for t in (whole, *rest)]) for name in whole.names}
    return Trajectory(grid, values, whole.units, title=whole.title, synthetic=whole.synthetic)


DEFAULT = {"turn": "rad", "force": "N", "moment": "N.m"}


def _column(keys: ReadingsSection, name: str, path: Path) -> Column:
    """Return the declared column, or the default one with the unit of the header."""
    section = keys.signals.orientation if name == "turn" else getattr(keys.signals, name)
    if section is not None:
        return section.recorded()
    heads = stream_of(path, keys.form(), holding=name).heads
    return Column(name, tuple(heads.units[heads.place(member)] or DEFAULT[name] for member in heads.members(name)))


def _time(keys: ReadingsSection, path: Path) -> Column | None:
    if "time" in keys.model_fields_set:
        return keys.time.declared()
    try:
        heads = stream_of(path, keys.form()).heads
    except LogError:  # a bag with several streams; its times are in s
        return TIME
    unit = heads.units[heads.place("time")] if "time" in heads.names else ""
    return Column("time", unit or "s")


def _representation(keys: ReadingsSection) -> str:
    return VECTOR if keys.signals.orientation is None else keys.signals.orientation.representation


def _turned(rows: Trajectory, representation: str) -> Trajectory:
    """Return the rows with rotation vectors."""
    with naming("readings.signals.orientation.representation", refusal=InputError):
        turn = orientation_vectors(rows["turn"], representation, rows.units["turn"])
    return rows.with_values({"turn": turn}, units={"turn": "rad"})


def _quaternions(keys: ReadingsSection, poses: Trajectory) -> Trajectory:
    """Return the orientations as quaternions, scalar first."""
    from scipy.spatial.transform import Rotation  # here: the keys alone need no engine

    turn = Rotation.from_rotvec(np.array(_turned(poses, _representation(keys))["turn"]))
    return poses.with_values({"turn": turn.as_quat(scalar_first=True)}, units={"turn": "1"})


def explain(problem: Schema, context: Context) -> str:
    """Describe the readings."""
    lines = [f"{problem.heading}: bias, mass and centre of mass of a force sensor's load"]
    if problem.synthetic is not None:
        s = problem.synthetic.given()
        lines.append(f"  {s['poses']} poses at rest and {s['pushes']} pushes, synthetic, seed {s['seed']}")
    if problem.readings is not None:
        lines.append(f"  readings from {problem.readings.file}")
    return "\n".join(lines)
