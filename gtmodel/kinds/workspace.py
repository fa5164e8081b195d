"""Kind "workspace": reachable tool centre points of a robot, with cross-section and volume."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from gtmodel.kinematics import workspace
from gtmodel.kinematics.section import CrossSection
from gtmodel.kinematics.workspace import options
from gtmodel.problem_files.base import Call, Context, InputError
from gtmodel.problem_files.from_options import Made
from gtmodel.problem_files.keys import RobotProblem
from gtmodel.results import listed

RESULT = "gtmodel.kinematics.WorkspaceStudy"

Point = Annotated[list[float], Field(min_length=3, max_length=3)]
Angle = Annotated[float, Field(gt=0, le=180)]


class Schema(RobotProblem):
    """Workspace of a robot whose plate has a constant orientation, or one that depends on T."""

    home_m: Point | None = Field(default=None, description="pose of the cone axes; the robot's home if left out")
    compare_cones_deg: list[Angle] = Field(default=[], description="further cone angles to report")
    points_m: list[Point] = Field(default=[], description="single points to test")
    section: Made[CrossSection] = Made[CrossSection].left_out()
    volume: Made[options.Sections] | None = Field(default=None, description="volume from parallel sections")
    limits: Made[options.WorkspaceLimits] = Made[options.WorkspaceLimits].left_out()
    bodies: Made[options.Bodies] = Made[options.Bodies].left_out()
    obstacles: list[Made[options.Box]] = Field(default=[], description="boxes that links and plate must not touch")
    beams: list[Made[options.Beam]] = Field(default=[], description="beams of the frame that links must not touch")


def call(problem: Schema, context: Context) -> Call:
    """Return the call of the study of the section, with and without limits, and of the volume."""
    if context.start is not None:
        raise InputError("--start: a workspace map does not use an earlier result; leave it out")
    return Call(
        workspace.workspace_study, problem.model(context), problem.limits.options(), home=problem.home_m,
        section=problem.section.options(), volume=None if problem.volume is None else problem.volume.options(),
        bodies=problem.bodies.options(), obstacles=[box.options() for box in problem.obstacles],
        beams=[beam.options() for beam in problem.beams],
        compare_cones=np.radians(problem.compare_cones_deg).tolist(), points=problem.points_m, title=problem.title,
    )  # fmt: skip


def explain(problem: Schema, context: Context) -> str:
    """Describe the section, the grid and the tests in their order."""
    study = call(problem, context)
    robot, limits = study.arguments
    task = workspace.reach.task_of(
        robot, limits, *(study.options[k] for k in ("home", "section", "bodies", "obstacles", "beams"))
    )
    section, low, high, step = task.section, task.low, task.high, study.options["section"].step
    lines = [
        f"{problem.heading}: section orthogonal to ({listed(section.normal)}), through ({listed(section.origin)}) m",
        f"  u along ({listed(section.across)}) from {low[0]:.4g} to {high[0]:.4g} m, "
        f"v along ({listed(section.up)}) from {low[1]:.4g} to {high[1]:.4g} m, step {step:g} m",
        "  tests of a point, in this order:",
        "    inverse kinematics",
        *(f"    {limit.name}" for limit in task.reach.limits),
        *(f"  {sentence}" for sentence in task.reach.assumptions),
    ]
    return "\n".join(lines)
