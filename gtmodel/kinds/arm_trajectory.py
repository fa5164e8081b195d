"""Kind "arm_trajectory": optimal motion of a serial arm through waypoints, with distances of its links kept."""

from __future__ import annotations

from pydantic import Field

from gtmodel import motion
from gtmodel.kinematics.clearance import options as link_clearance
from gtmodel.motion import options
from gtmodel.motion.arms import options as arm_options
from gtmodel.motion.axes import options as axis_options
from gtmodel.problem_files.base import Call, Context, InputError
from gtmodel.problem_files.from_options import Made, options_of
from gtmodel.problem_files.keys import RobotProblem

RESULT = "gtmodel.motion.ArmStudy"


class Schema(RobotProblem):
    """Optimal motion of a serial arm from rest to rest, through waypoints, with distances of its links kept."""

    start: Made[arm_options.ArmPose]
    goal: Made[arm_options.ArmPose]
    waypoints: list[Made[arm_options.Waypoint]] = Field(default=[], description="poses passed in this order")
    limits: Made[arm_options.ArmLimits] = Made[arm_options.ArmLimits].left_out()
    clearance: Made[link_clearance.Clearance] | None = Field(
        default=None, description="distances of links from each other and from obstacles; none is kept if left out"
    )
    cost: Made[axis_options.AxisCost] | None = Field(
        default=None, description="weights of time and effort; 1 and 0.05 if left out"
    )
    mesh: Made[axis_options.AxisMesh] = Made[axis_options.AxisMesh].left_out()
    solver: Made[options.Solver] = Made[options.Solver].left_out()


ARGUMENTS: dict[str, str] = {}


def call(problem: Schema, context: Context) -> Call:
    """Return the library call that solves the motion."""
    if context.start is not None:
        raise InputError("--start: this study does not use an earlier result; leave it out")
    arguments = options_of(problem)
    return Call(
        motion.arm_study, problem.model(context), **arguments,
        waypoints=[w.options() for w in problem.waypoints], title=problem.title,
    )  # fmt: skip
