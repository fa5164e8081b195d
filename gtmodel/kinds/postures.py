"""Kind "postures": all postures of a serial arm for a pose, a table of poses or a path."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from gtmodel import kinematics
from gtmodel.kinematics import arm_postures
from gtmodel.kinematics.arm_postures import options
from gtmodel.problem_files.base import Call, Context, FileSection, InputError
from gtmodel.problem_files.from_options import Made, made_from
from gtmodel.problem_files.keys import RobotProblem
from gtmodel.results.refusal import naming

RESULT = "gtmodel.kinematics.PosturesStudy"

Three = Annotated[list[float], Field(min_length=3, max_length=3)]


@made_from(options.ToolColumns)
class Table(Made):
    """A file with one pose in each row."""

    file: str = Field(description="CSV file or log, from the problem's folder")
    path: bool = Field(default=False, description="whether successive rows are a path, without jumps if possible")
    largest_step_deg: float = Field(
        default=30.0, gt=0, description="largest step of a joint between two rows of a path; more is a jump"
    )


class Elbow(FileSection):
    """The plane of shoulder, elbow and wrist of an arm of seven joints."""

    angle_deg: float = Field(description="about the line from shoulder to wrist, from the side of `direction`")
    direction: Three = Field(default=[0.0, 0.0, 1.0], description="world coordinates")


class Locked(FileSection):
    """A joint of an arm of seven joints that is held."""

    joint: int = Field(description="index in q, from 0; negative from the end")
    value: float = Field(description="its coordinate, rad or m")


class Schema(RobotProblem):
    """All postures of a serial arm for a pose or for each row of a table: names, limits, the nearest, a path."""

    pose: Made[options.ToolPose] | None = Field(default=None, description="one pose of the tool")
    table: Table | None = Field(default=None, description="poses from a file, instead of [pose]")
    near: list[float] | None = Field(
        default=None, description="joint coordinates, rad or m, that the chosen posture is next to; default: the start"
    )
    near_deg: list[float] | None = Field(default=None, description="the same in degrees, for revolute joints only")
    elbow: Elbow | None = Field(default=None, description="for seven joints")
    locked: Locked | None = Field(default=None, description="for seven joints, instead of [elbow]")


def arguments(problem: Schema) -> dict[str, str]:
    """Return the keys of the study's arguments."""
    return {
        "near": "near" if problem.near_deg is None else "near_deg", "largest_step": "table.largest_step_deg",
        "redundancy": "elbow" if problem.locked is None else "locked",
    }  # fmt: skip


def call(problem: Schema, context: Context) -> Call:
    """Return the call of the study."""
    if context.start is not None:
        raise InputError("--start: postures do not use an earlier result; leave it out")
    if (problem.pose is None) == (problem.table is None):
        present = "neither" if problem.pose is None else "both"
        raise InputError(f"give either [pose] or [table]; found {present}", "pose")
    near = problem.near
    if problem.near_deg is not None:
        if near is not None:
            raise InputError("give either near or near_deg", "near_deg")
        near = np.radians(problem.near_deg).tolist()
    if problem.elbow is not None and problem.locked is not None:
        raise InputError("give either [elbow] or [locked]", "locked")
    model, more = problem.model(context), {}
    if problem.table is None:
        assert problem.pose is not None
        with naming("pose."):
            poses = problem.pose.options().poses
    else:
        with naming("table."):
            poses = arm_postures.read_tool_poses(
                context.file(problem.table.file, "table.file"), problem.table.options()
            )
        more = {"path": problem.table.path, "largest_step": float(np.radians(problem.table.largest_step_deg))}
    return Call(
        arm_postures.postures_study, model, poses, near=near, redundancy=_redundancy(problem), **more,
        title=problem.title or f"postures of {problem.robot}",
    )  # fmt: skip


def explain(problem: Schema, context: Context) -> str:
    """Describe the arm, its limits and how its postures are found."""
    robot, poses = call(problem, context).arguments
    with naming("robot"):
        chain = kinematics.chain_of(robot)
    form = kinematics.closed_form(chain, oriented=poses.R is not None)
    if form is None:
        return f"{problem.heading}: {len(chain)} joints; their axes have no closed form"
    names = "; ".join(form.names)
    return f"{problem.heading}: {len(chain)} joints, {form.structure}\n  up to {len(form.names)} postures: {names}"


def _redundancy(problem: Schema) -> kinematics.ElbowAngle | kinematics.LockedJoint | None:
    if problem.elbow is not None:
        x, y, z = problem.elbow.direction
        return kinematics.ElbowAngle(float(np.radians(problem.elbow.angle_deg)), (x, y, z))
    return None if problem.locked is None else kinematics.LockedJoint(problem.locked.joint, problem.locked.value)
