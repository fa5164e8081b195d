"""Kind "sensor_fusion": tracker and inertial unit on one body, filtered; or a recorded gyro between references."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from gtmodel import filtering
from gtmodel.filtering import paths
from gtmodel.filtering.attitude import options as attitude
from gtmodel.filtering.fusion import options
from gtmodel.measurements import Column, sampling_of
from gtmodel.problem_files.base import Call, Context, FileSection, InputError, Problem
from gtmodel.problem_files.from_options import Made, options_of
from gtmodel.problem_files.keys import RecordedSignalSection, RecordingFiles
from gtmodel.results import ArgumentError, Trajectory

RESULT = ("gtmodel.filtering.FusionStudy", "gtmodel.filtering.AttitudeStudy")


class OrientationSection(FileSection):
    """Orientations from another device, by its own clock."""

    quaternion: RecordedSignalSection = Field(description="four columns, whose order and direction are found")
    row: RecordedSignalSection | None = Field(
        default=None,
        description="where the quaternions are written in each row of the gyro: from which row each is taken",
    )
    first_row: int = Field(default=0, ge=0, description="how the log counts its first row, for `row`")


class AttitudeLogSection(RecordingFiles):
    """A recorded gyro and references of orientation, in place of a path."""

    rate: RecordedSignalSection = Field(description='of the gyro; unit "1": as written, its unit is found')
    acceleration: RecordedSignalSection | None = Field(default=None, description="of the same unit, or none")
    reference: OrientationSection


class Schema(Problem):
    """A laser tracker and an inertial unit on one body, along a known path: what their fusion gives, and whether its
    filter may be believed. With [log] or [synthetic_log] in place of [path]: a recorded gyro, calibrated against
    references of orientation, and the attitude between them."""

    path: Made[paths.TrackedPath] = Made[paths.TrackedPath].left_out()
    sensors: Made[options.FusionSensors] = Made[options.FusionSensors].left_out()
    filter: Made[options.FusionFilter] = Made[options.FusionFilter].left_out()
    sweep: Made[options.FusionSweep] | None = Field(default=None, description="one number over several values")
    seed: int = Field(default=1, ge=0, description="of the noise of the synthetic readings along a path")
    log: AttitudeLogSection | None = Field(default=None, description="a recording, in place of [path]")
    synthetic_log: Made[attitude.SyntheticAttitude] | None = Field(
        default=None, description="a synthetic recording of that form"
    )
    judging: Made[attitude.AttitudeJudging] = Made[attitude.AttitudeJudging].left_out()


NAME = "sensor_fusion"
ARGUMENTS = {"recording": "log"}
OF_A_PATH = ("path", "sensors", "filter", "sweep", "seed")


def call(problem: Schema, context: Context) -> Call:
    """The study of the path that the file declares."""
    if context.start is not None:
        raise InputError("--start: a filter starts at the path's begin; leave it out")
    if _logged(problem):
        judging = problem.judging.options()
        if problem.log is None:
            assert problem.synthetic_log is not None
            return Call(filtering.attitude_study, problem.synthetic_log.options(), judging, title=problem.title)
        return Call(filtering.attitude_study, _recording(problem.log, context), judging, title=problem.title)
    path, sensors, design, sweep = options_of(problem, "path", "sensors", "filter", "sweep").values()
    return Call(filtering.fusion_study, path, sensors, design, sweep, seed=problem.seed, title=problem.title)


def explain(problem: Schema, context: Context) -> str:
    """What is read, and what the filter knows."""
    if _logged(problem):
        return _explained_log(problem, context)
    path, sensors, design = options_of(problem, "path", "sensors", "filter").values()
    rate = 1 / sensors.sample_time
    lines = [
        f"{problem.title or NAME}: {path.kind} in {path.axes} axes at {1e3 * path.feed:g} mm/s, {path.duration:g} s"
    ]
    lines.append(f"  synthetic readings at {rate:g} Hz, seed {problem.seed}")
    if design.printed:
        lines.append("  filter: the covariance of appendix B of Cvitanic 2021")
    else:
        densities = ", ".join(f"{q:g}" for q in design.jerk_density)
        lines.append(f"  filter: white jerk of density {densities} m2/s5 along x, y, z")
    if design.fast_jerk_density is not None:
        lines.append(f"  beside a faster one of density {design.fast_jerk_density:g} m2/s5, interacting")
    unknown = {"bias of the accelerometer": sensors.acceleration_bias, "error of the arm": sensors.arm_error,
               "misalignment": sensors.misalignment}  # fmt: skip
    lines.append(f"  the filter does not know: {', '.join(n for n, v in unknown.items() if v) or 'nothing is hidden'}")
    return "\n".join(lines)


def _logged(problem: Schema) -> bool:
    """Whether the file holds a recording in place of a path. Raises InputError where it holds both."""
    given = [name for name in ("log", "synthetic_log") if getattr(problem, name) is not None]
    if len(given) == 2:
        raise InputError("expected one of [log] and [synthetic_log]; found both", "log")
    if not given and "judging" in problem.model_fields_set:
        raise InputError("belongs to [log] and [synthetic_log]; there is none", "judging")
    for name in OF_A_PATH:
        if given and name in problem.model_fields_set:
            raise InputError(f"belongs to a path; with [{given[0]}] leave it out", name)
    return bool(given)


def _recording(log: AttitudeLogSection, context: Context) -> filtering.AttitudeRecording:
    """Gyro and references, each by its own clock; of references that stand in the rows of the gyro the true ones."""
    columns = {"rate": log.rate.recorded()}
    if log.acceleration is not None:
        columns["acceleration"] = log.acceleration.recorded()
    rows = log.reference.row
    if log.time.column and log.sample_time_s is not None:
        raise InputError("belongs to a log without a column of time; leave it out", "log.sample_time_s")
    if rows is None and "first_row" in log.reference.model_fields_set:
        raise InputError("belongs to `row`, which is not given; leave it out", "log.reference.first_row")
    if rows is None:
        columns["quaternion"] = log.reference.quaternion.recorded()
    else:
        columns["row"] = rows.recorded()
    recording = log.recording(columns, context)
    by_name = {name: t for t in recording.values() for name in t.names}
    gyro = by_name["rate"]
    moving = [name for name in ("rate", "acceleration") if name in columns]
    if any(by_name[name] is not gyro for name in moving):
        raise InputError("has another clock than the rate", "log.acceleration")
    if rows is None:
        return _checked(gyro.select(moving), by_name["quaternion"].select(["quaternion"]))
    wanted, every = by_name["row"], _every_row(log, context)
    place = np.rint(wanted["row"]).astype(int) - log.reference.first_row
    at = {int(n): k for k, n in enumerate(np.rint(every.time).astype(int))}
    there = np.array([int(n) in at for n in place])  # the last reference may lie behind the last row
    if not there.any():
        raise InputError("names no row of the log", "log.reference.row")
    quaternion = every["quaternion"][[at[int(n)] for n in place[there]]]
    return _checked(gyro.select(moving), Trajectory(wanted.time[there], {"quaternion": quaternion}))


def _every_row(log: AttitudeLogSection, context: Context) -> Trajectory:
    """The quaternions of all rows of the log; the time counts the rows."""
    written = log.reference.quaternion
    every = Column(*written.shown(), None, written.stream, written.file)
    rows = log.model_copy(update={"time": log.time.model_copy(update={"column": ""}), "sample_time_s": 1.0})
    (read,) = rows.recording({"quaternion": every}, context).values()
    return read


def _checked(gyro: Trajectory, reference: Trajectory) -> filtering.AttitudeRecording:
    try:
        return filtering.AttitudeRecording(gyro, reference)
    except ArgumentError as error:
        key = "log.rate" if error.argument == "gyro" else "log.reference.quaternion"
        raise InputError(error.message, key) from error


def _explained_log(problem: Schema, context: Context) -> str:
    judging = problem.judging.options()
    lines = [f"{problem.title or NAME}: a gyro calibrated against references of orientation"]
    if problem.log is not None:
        recording = _recording(problem.log, context)
        for name, one in (("gyro", recording.gyro), ("references", recording.reference)):
            lines.append(f"  {name}: {len(one)} rows at {sampling_of(one.time).rate:.4g} Hz")
    elif problem.synthetic_log is not None:
        lines.append(f"  synthetic recording of {problem.synthetic_log.options().duration:g} s")
    until = "half of the references" if judging.calibrate_until is None else f"{judging.calibrate_until:g} s"
    lines.append(f"  calibrated up to {until}; judged on the rest, over gaps of {', '.join(map(str, judging.gaps))} s")
    return "\n".join(lines)
