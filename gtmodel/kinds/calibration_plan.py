"""Kind "calibration_plan": poses to measure with a device, and the expected accuracy of the calibration."""

from __future__ import annotations

from dataclasses import fields
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from gtmodel.calibrate import Choice, plan
from gtmodel.calibrate.options import Fit
from gtmodel.calibrate.plan import options
from gtmodel.calibrate.plan.options import Task
from gtmodel.problem_files.base import Call, Context, InputError
from gtmodel.problem_files.from_options import Made, made_from
from gtmodel.problem_files.keys import RobotProblem

RESULT = "gtmodel.calibrate.PlanStudy"

MOVED = ("free", "fixed", "tied", "unit_quaternions", "sizes")


@made_from(options.Tracker)
class TrackerSection(Made):
    """A laser tracker, which measures a distance and two angles."""

    kind: Literal["laser_tracker"] = Field(description="kind of device")


@made_from(options.PatternCamera)
class CameraSection(Made):
    """A fixed camera that sees a pattern on the plate."""

    kind: Literal["camera"] = Field(description="kind of device")


@made_from(options.Wire)
class WireSection(Made):
    """A wire sensor, a bar or an interferometer: the distance of the tool centre point from one point."""

    kind: Literal["distance"] = Field(description="kind of device")


@made_from(options.Gauge)
class GaugeSection(Made):
    """A dial gauge or another sensor for the height of the tool centre point above a known plane."""

    kind: Literal["plane"] = Field(description="kind of device")


@made_from(Fit, *(f.name for f in fields(Fit) if f.name not in MOVED))
class _Moved(RobotProblem, Made):
    """Parameters to calibrate."""

    device: Annotated[
        TrackerSection | CameraSection | WireSection | GaugeSection,
        Field(discriminator="kind", description="measuring device"),
    ]


@made_from(Task, "robot", "device", "choice", "title")
class Schema(_Moved):
    """Plan of a calibration before the measurement (Dressler 2012, Fig. 5.21)."""


ARGUMENTS = {"choice": ""}


def call(problem: Schema, context: Context) -> Call:
    """Return the call of the study: the steps of Fig. 5.21, adding poses until the criteria are met."""
    if context.start is not None:
        raise InputError("--start: a plan does not use an earlier result; leave it out")
    p = problem
    free, fixed, tied, quaternions, sizes = (getattr(p, name) for name in MOVED)
    choice = Choice(free, fixed, tied, quaternions, sizes=sizes)
    return Call(plan.plan_study, p.model(context), p.device.options(), choice=choice, title=p.title, **p.given())


def explain(problem: Schema, context: Context) -> str:
    """Describe the steps and the limits of the candidate points."""
    study = call(problem, context)
    task = Task(*study.arguments, **study.options)
    turns, device = plan.steps.turns_of(task), plan.device.measuring(task)
    stages = plan.steps.stages_of(task, turns[0], device)
    lines = [f"{problem.title or 'calibration plan'}: candidates every {task.room.step:g} m that pass"]
    listed: list[str] = []
    for name, reach in stages.items():
        new = [limit.name for limit in reach.limits if limit.name not in listed]
        listed += new
        if name == "safety":
            s = task.safety
            cone = np.degrees(s.cone)
            new = [f"these limits narrowed by {cone:g} deg, {s.stroke:g} m of stroke and {s.obstacles:g} m of distance"]
        lines.append(f"  {name}: {', '.join(['inverse kinematics'] * (name == 'workspace') + new) or 'nothing more'}")
    lines.append(f"  safety distance: {task.safety.edge:g} m in 26 directions")
    p = task.poses
    number = f"{p.number} to {p.most} poses, chosen by {p.method}, and {p.held_out} held out"
    lines.append(f"then {number}; {device.signal} is measured")
    return "\n".join([*lines, *(f"  {s}" for s in stages["device"].assumptions)])
