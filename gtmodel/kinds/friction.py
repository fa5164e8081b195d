"""Kind "friction": friction of carts that carry a plate, and the mass that they carry, from constant-velocity runs."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from gtmodel.identify import friction
from gtmodel.identify.friction import options
from gtmodel.identify.friction.options import SyntheticRuns
from gtmodel.measurements import Corrections, Session
from gtmodel.problem_files.base import Call, Context, InputError
from gtmodel.problem_files.from_options import Made, made_from
from gtmodel.problem_files.keys import LogSampling, MeasuredSignalSection, RobotProblem
from gtmodel.results import listed
from gtmodel.results.options import declared
from gtmodel.results.refusal import naming

RESULT = "gtmodel.identify.FrictionStudy"


@made_from(options.HeldPose)
class HeldPoseSection(Made):
    """Position of the tool centre point in the cross-section during the runs of the carts."""

    files: list[str] = Field(default=[], description="log files of this pose, for [log]")


@made_from(options.ConstantVelocity)
class FrictionLogSection(LogSampling, Made):
    """Measured logs; each pose names its files."""

    position_m: MeasuredSignalSection = Field(description="positions of the carts")
    force_N: MeasuredSignalSection = Field(description="forces of the motors")


class Schema(RobotProblem):
    """Friction from constant-velocity runs. The forces come from one of [log], [synthetic] and [printed]."""

    directions: Literal["separate", "symmetric"] = Field(
        default="separate", description="separate: different coefficients for each direction of motion"
    )
    gravity: Literal["most_symmetric", "poses"] = Field(
        default="most_symmetric",
        description="how the mass is separated from friction: by least asymmetry of the friction, or by the change "
        "between poses",
    )
    accept: list[options.FrictionAlarm] = Field(
        default=[],
        description="alarms about runs and columns that become notes instead of errors: copied_rows, "
        "exchanged_columns, driving_friction, negative_mass",
    )
    pose: list[HeldPoseSection] = Field(min_length=1, description="one table for each; the picture shows the first")
    log: FrictionLogSection | None = Field(default=None, description="measured logs")
    synthetic: Made[options.SyntheticRuns] | None = Field(default=None, description="synthetic logs")
    printed: Made[options.FrictionCoefficients] | None = Field(
        default=None, description="published coefficients; the study determines their mass again"
    )


ARGUMENTS = {
    "runs.force": "log.force_N.column",
    **{f"runs.{name}": f"synthetic.{name}" for name in declared(SyntheticRuns)},
    "runs": "pose",
    "poses": "pose",
    "published": "printed",
}


def call(problem: Schema, context: Context) -> Call:
    """Return the call of the study, on measured or synthetic logs or on published coefficients."""
    tables = [k for k in ("log", "synthetic", "printed") if getattr(problem, k) is not None]
    if len(tables) != 1:
        raise InputError(
            "expected one of [log], [synthetic] and [printed]; "
            f"found {' and '.join(f'[{k}]' for k in tables) or 'none of them'}",
            tables[-1] if tables else "log",
        )
    model, poses = problem.model(context), [pose.options() for pose in problem.pose]
    if problem.printed is not None:
        if len(poses) > 1:
            raise InputError("published coefficients belong to one pose; leave the others out", "pose")
        return Call(friction.published_friction_study, model, problem.printed.options(), poses[0], title=problem.title)
    logs = problem.synthetic.options() if problem.synthetic is not None else _logs(problem, context)
    limits = None if problem.log is None else problem.log.options()
    return Call(
        friction.friction_study, model, logs, poses, constant_velocity=limits, directions=problem.directions,
        gravity=problem.gravity, accept=problem.accept, title=problem.title,
    )  # fmt: skip


def explain(problem: Schema, context: Context) -> str:
    """Describe the gravity pattern in each pose and the force equation."""
    poses = [pose.options() for pose in problem.pose]
    pattern = friction.gravity_pattern(problem.model(context), poses)
    lines = [f"{problem.heading}: {pattern.shape[1]} carts in {len(pattern)} poses"]
    for pose, row in zip(poses, pattern, strict=True):
        lines.append(f"{pose.name or 'pose'}: cart forces that hold one kilogram {listed(row)} N/kg")
    lines.append("tau = m pattern + fc+ + fv+ v forwards, m pattern - fc- + fv- v backwards (eqs. (6.8), (6.9))")
    return "\n".join(lines)


def _logs(problem: Schema, context: Context) -> list[tuple[Session, ...]]:
    """Recordings by pose."""
    log = problem.log
    assert log is not None
    _refuse_free(log)
    signals = {"q": log.position_m.signal("log.position_m"), "force": log.force_N.signal("log.force_N")}
    logs = []
    for n, pose in enumerate(problem.pose):
        called = {"position_m": "q", "force_N": "force"}
        raw = log.read(pose.files, signals, context, f"pose[{n}].files", called, "log")
        with naming("log", refusal=InputError):
            logs.append(Corrections(signals, raw).apply())
    return logs


def _refuse_free(log: FrictionLogSection) -> None:
    for name in ("position_m", "force_N"):
        for what in ("scale", "offset", "delay_s"):
            if getattr(getattr(log, name), what) == "estimate":
                raise InputError(
                    "constant-velocity runs cannot separate it from gravity and friction; give a number",
                    f"log.{name}.{what}",
                )
