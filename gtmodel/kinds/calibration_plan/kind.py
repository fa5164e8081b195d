"""Kind "calibration_plan": which poses to measure with which device, and what the calibration will then be worth."""

from __future__ import annotations

import numpy as np

from gtmodel.calibrate import Choice
from gtmodel.calibrate.plan import plan_study
from gtmodel.calibrate.plan.device import measuring
from gtmodel.calibrate.plan.stages import stages_of
from gtmodel.calibrate.plan.task import Task
from gtmodel.calibrate.plan.turns import turns_of
from gtmodel.problem_files.base import Context, InputError
from gtmodel.problem_files.call import Call

from .keys import MOVED, Schema

NAME = "calibration_plan"
ARGUMENTS = {"choice": ""}


def call(problem: Schema, context: Context) -> Call:
    """The steps of Fig. 5.21, with more poses while the criteria are not met."""
    if context.start is not None:
        raise InputError("--start: a plan is made from the beginning; leave it out")
    p = problem
    free, fixed, tied, quaternions, sizes = (getattr(p, name) for name in MOVED)
    choice = Choice(free, fixed, tied, quaternions, sizes=sizes)
    return Call(plan_study, p.model(context), p.device.options(), choice=choice, title=p.title, **p.given())


def explain(problem: Schema, context: Context) -> str:
    """The steps and what a point must pass."""
    asked = call(problem, context)
    task = Task(*asked.arguments, **asked.options)
    turns, device = turns_of(task), measuring(task)
    stages = stages_of(task, turns[0], device)
    lines = [f"{problem.title or 'calibration plan'}: candidates every {task.room.step:g} m, which must pass"]
    seen: list[str] = []
    for name, reach in stages.items():
        new = [limit.name for limit in reach.limits if limit.name not in seen]
        seen += new
        if name == "safety":
            s = task.safety
            cone = np.degrees(s.cone)
            new = [f"the same, {cone:g} deg, {s.stroke:g} m of stroke and {s.obstacles:g} m of air narrower"]
        lines.append(f"  {name}: {', '.join(['inverse kinematics'] * (name == 'workspace') + new) or 'nothing more'}")
    lines.append(f"  safety distance: {task.safety.edge:g} m in 26 directions")
    p = task.poses
    many = f"{p.number} to {p.most} poses by {p.method}, and {p.held_out} held out"
    lines.append(f"then {many}; {device.signal} is measured")
    return "\n".join([*lines, *(f"  {s}" for s in stages["device"].assumptions)])
