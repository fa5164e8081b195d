"""Kind "workspace": which tool centre points a robot reaches, and the cross-section and volume of them."""

from __future__ import annotations

import numpy as np

from gtmodel.kinematics.workspace import workspace_study
from gtmodel.kinematics.workspace.limited import task_of
from gtmodel.problem_files.base import Context, InputError
from gtmodel.problem_files.call import Call
from gtmodel.results import listed

from .keys import Schema

NAME = "workspace"


def call(problem: Schema, context: Context) -> Call:
    """The section with and without limits, then the volume."""
    if context.start is not None:
        raise InputError("--start: a workspace is mapped from the beginning; leave it out")
    return Call(
        workspace_study, problem.model(context), problem.limits.options(), home=problem.home_m,
        section=problem.section.options(), volume=None if problem.volume is None else problem.volume.options(),
        bodies=problem.bodies.options(), obstacles=[box.options() for box in problem.obstacles],
        beams=[beam.options() for beam in problem.beams],
        compare_cones=np.radians(problem.compare_cones_deg).tolist(), points=problem.points_m, title=problem.title,
    )  # fmt: skip


def explain(problem: Schema, context: Context) -> str:
    """The tests in their order, the section and the grid."""
    made = call(problem, context)
    robot, limits = made.arguments
    task = task_of(robot, limits, *(made.options[k] for k in ("home", "section", "bodies", "obstacles", "beams")))
    section, low, high = task.section, task.low, task.high
    lines = [
        f"{problem.title or 'workspace'}: section orthogonal to ({listed(section.normal)}), through "
        f"({listed(section.origin)}) m",
        f"  u along ({listed(section.across)}) from {low[0]:.4g} to {high[0]:.4g} m, "
        f"v along ({listed(section.up)}) from {low[1]:.4g} to {high[1]:.4g} m, step {made.options['section'].step:g} m",
        "  a point is tested by, in this order:",
        "    inverse kinematics",
        *(f"    {limit.name}" for limit in task.reach.limits),
        *(f"  {sentence}" for sentence in task.reach.assumptions),
    ]
    return "\n".join(lines)
