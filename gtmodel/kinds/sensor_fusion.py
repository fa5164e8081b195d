"""Kind "sensor_fusion": filter for tracker and inertial unit on one body, or for a recorded gyro with references."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from gtmodel import filtering
from gtmodel.filtering import paths
from gtmodel.filtering.attitude import options as attitude
from gtmodel.filtering.fusion import options
from gtmodel.measurements import sampling_of
from gtmodel.measurements.orientations import WORDS, orientation_vectors
from gtmodel.problem_files.base import Call, Context, FileSection, InputError, Problem
from gtmodel.problem_files.from_options import Made, options_of
from gtmodel.problem_files.keys import RecordedSignalSection, RecordingFiles
from gtmodel.results import ArgumentError, Trajectory
from gtmodel.results.refusal import naming

RESULT = ("gtmodel.filtering.FusionStudy", "gtmodel.filtering.AttitudeStudy")


class OrientationSection(FileSection):
    """Orientations from another device, with its own clock."""

    quaternion: RecordedSignalSection = Field(
        description="four columns, whose order and direction the study finds; other columns with a representation"
    )
    representation: str | None = Field(
        default=None, description=f"if the columns are no quaternion, or its order is known: {WORDS}"
    )
    row: RecordedSignalSection | None = Field(
        default=None,
        description="if every row of the gyro has a quaternion: column with the row numbers of the true references",
    )
    first_row: int = Field(default=0, ge=0, description="number of the log's first row, for `row`")


class AttitudeLogSection(RecordingFiles):
    """A recorded gyro and reference orientations, instead of a path."""

    rate: RecordedSignalSection = Field(description='rate of the gyro; with unit "1" the study finds the unit')
    acceleration: RecordedSignalSection | None = Field(
        default=None, description="acceleration of the same unit, if recorded"
    )
    temperature: RecordedSignalSection | None = Field(default=None, description="temperature of the gyro, in K")
    reference: OrientationSection


class Schema(Problem):
    """A laser tracker and an inertial unit on one body, along a known path: the fused motion and consistency tests of
    the filter. With [log] or [synthetic_log] instead of [path]: a recorded gyro, calibrated against reference
    orientations, and the attitude between them."""

    path: Made[paths.TrackedPath] = Made[paths.TrackedPath].left_out()
    sensors: Made[options.FusionSensors] = Made[options.FusionSensors].left_out()
    filter: Made[options.FusionFilter] = Made[options.FusionFilter].left_out()
    sweep: Made[options.FusionSweep] | None = Field(default=None, description="sweep of one number over several values")
    seed: int = Field(default=1, ge=0, description="seed of the noise in the synthetic readings along a path")
    log: AttitudeLogSection | None = Field(default=None, description="a recording, instead of [path]")
    synthetic_log: Made[attitude.SyntheticAttitude] | None = Field(
        default=None, description="a synthetic recording, instead of [log]"
    )
    judging: Made[attitude.AttitudeJudging] = Made[attitude.AttitudeJudging].left_out()


ARGUMENTS = {"recording": "log"}
OF_A_PATH = ("path", "sensors", "filter", "sweep", "seed")


def call(problem: Schema, context: Context) -> Call:
    """Return the call of the study of the path or of the recording."""
    if context.start is not None:
        raise InputError("--start: the filter starts at the beginning of the path; leave it out")
    if _logged(problem):
        judging = problem.judging.options()
        if problem.log is None:
            assert problem.synthetic_log is not None
            return Call(filtering.attitude_study, problem.synthetic_log.options(), judging, title=problem.title)
        return Call(filtering.attitude_study, _recording(problem.log, context), judging, title=problem.title)
    path, sensors, design, sweep = options_of(problem, "path", "sensors", "filter", "sweep").values()
    return Call(filtering.fusion_study, path, sensors, design, sweep, seed=problem.seed, title=problem.title)


def explain(problem: Schema, context: Context) -> str:
    """Describe the readings and the filter."""
    if _logged(problem):
        return _explained_log(problem, context)
    path, sensors, design = options_of(problem, "path", "sensors", "filter").values()
    rate = 1 / sensors.sample_time
    lines = [f"{problem.heading}: {path.kind} in {path.axes} axes at {1e3 * path.feed:g} mm/s, {path.duration:g} s"]
    lines.append(f"  synthetic readings at {rate:g} Hz, seed {problem.seed}")
    if design.printed:
        lines.append("  filter: the covariance of appendix B of Cvitanic 2021")
    else:
        densities = ", ".join(f"{q:g}" for q in design.jerk_density)
        lines.append(f"  filter: white jerk of density {densities} m2/s5 along x, y, z")
    if design.fast_jerk_density is not None:
        lines.append(f"  interacting with a faster filter of density {design.fast_jerk_density:g} m2/s5")
    unknown = {"bias of the accelerometer": sensors.acceleration_bias, "error of the arm": sensors.arm_error,
               "misalignment": sensors.misalignment}  # fmt: skip
    lines.append(f"  unknown to the filter: {', '.join(n for n, v in unknown.items() if v) or 'nothing'}")
    return "\n".join(lines)


def _logged(problem: Schema) -> bool:
    """True for a recording instead of a path. Raises InputError if the file has both."""
    logs = [name for name in ("log", "synthetic_log") if getattr(problem, name) is not None]
    if len(logs) == 2:
        raise InputError("expected one of [log] and [synthetic_log]; found both", "log")
    if not logs and "judging" in problem.model_fields_set:
        raise InputError("needs [log] or [synthetic_log]; found neither", "judging")
    for name in OF_A_PATH:
        if logs and name in problem.model_fields_set:
            raise InputError(f"belongs to a path; leave it out with [{logs[0]}]", name)
    return bool(logs)


def _recording(log: AttitudeLogSection, context: Context) -> filtering.AttitudeRecording:
    """Gyro and references with their own clocks; from references repeated in the gyro's rows, only the new ones."""
    columns = {"rate": log.rate}
    if log.acceleration is not None:
        columns["acceleration"] = log.acceleration
    if log.temperature is not None:
        columns["temperature"] = log.temperature
    rows = log.reference.row
    if log.time.column and log.sample_time_s is not None:
        raise InputError("belongs to a log without a time column; leave it out", "log.sample_time_s")
    if rows is None and "first_row" in log.reference.model_fields_set:
        raise InputError("belongs to `row`, which is missing; leave it out", "log.reference.first_row")
    if rows is None:
        columns["quaternion"] = log.reference.quaternion
    else:
        columns["row"] = rows
    recording = log.recording(columns, context)
    by_name = {name: t for t in recording.values() for name in t.names}
    gyro = by_name["rate"]
    moving = [name for name in ("rate", "acceleration", "temperature") if name in columns]
    if apart := [name for name in moving if by_name[name] is not gyro]:
        raise InputError("must have the same clock as the rate", f"log.{apart[0]}")
    if rows is None:
        return _checked(gyro.select(moving), _quaternions(log, by_name["quaternion"].select(["quaternion"])))
    references, every = by_name["row"], _every_row(log, context)
    numbers = np.rint(references["row"]).astype(int) - log.reference.first_row
    index = {int(n): k for k, n in enumerate(np.rint(every.time).astype(int))}
    inside = np.array([int(n) in index for n in numbers])  # the last reference may be after the last row
    if not inside.any():
        raise InputError("names no row of the log", "log.reference.row")
    quaternion = every["quaternion"][[index[int(n)] for n in numbers[inside]]]
    return _checked(gyro.select(moving), Trajectory(references.time[inside], {"quaternion": quaternion}))


def _every_row(log: AttitudeLogSection, context: Context) -> Trajectory:
    """The quaternions of all rows of the log; the time is the row number."""
    section = log.reference.quaternion.model_copy(update={"time": None})
    rows = log.model_copy(update={"time": log.time.model_copy(update={"column": ""}), "sample_time_s": 1.0})
    (trajectory,) = rows.recording({"quaternion": section}, context).values()
    return _quaternions(log, trajectory)


def _quaternions(log: AttitudeLogSection, reference: Trajectory) -> Trajectory:
    """The references as quaternions, scalar first, if their representation is declared. Raises InputError."""
    representation = log.reference.representation
    if representation is None:
        return reference
    with naming("log.reference.representation", refusal=InputError):
        turn = orientation_vectors(reference["quaternion"], representation, reference.units["quaternion"])
    import scipy  # here: the keys alone need no engine

    rows = scipy.spatial.transform.Rotation.from_rotvec(turn).as_quat(scalar_first=True)
    return reference.with_values({"quaternion": rows}, units={"quaternion": "1"})


def _checked(gyro: Trajectory, reference: Trajectory) -> filtering.AttitudeRecording:
    try:
        return filtering.AttitudeRecording(gyro, reference)
    except ArgumentError as error:
        key = "log.rate" if error.argument == "gyro" else "log.reference.quaternion"
        raise InputError(error.message, key) from error


def _explained_log(problem: Schema, context: Context) -> str:
    judging = problem.judging.options()
    lines = [f"{problem.heading}: a gyro calibrated against reference orientations"]
    if problem.log is not None:
        recording = _recording(problem.log, context)
        for name, rows in (("gyro", recording.gyro), ("references", recording.reference)):
            lines.append(f"  {name}: {len(rows)} rows at {sampling_of(rows.time).rate:.4g} Hz")
    elif problem.synthetic_log is not None:
        lines.append(f"  synthetic recording of {problem.synthetic_log.options().duration:g} s")
    until = "half of the references" if judging.calibrate_until is None else f"{judging.calibrate_until:g} s"
    lines.append(f"  calibrated up to {until}; tested on the rest, over gaps of {', '.join(map(str, judging.gaps))} s")
    return "\n".join(lines)
