"""What a point must pass to be a pose of a calibration plan, stage by stage (Dressler 2012, Fig. 5.21)."""

from __future__ import annotations

import numpy as np

from gtmodel.kinematics.workspace import Reach, limits_of
from gtmodel.kinematics.workspace.limited import LONGEST_STROKE
from gtmodel.problem_files.base import InputError

from .calibration_plan_device import Measuring
from .calibration_plan_keys import PlanLimits, Schema
from .calibration_plan_turns import Turn, facing


def stages_of(problem: Schema, turn: Turn, measuring: Measuring) -> dict[str, Reach]:
    """Tests of a point, each with those before: workspace, with obstacles and safety, seen by the device."""
    robot, safety = turn.robot, problem.safety
    limits = _with_axes(problem, turn, 0.0, 0.0)
    cone = limits.cone_deg
    if cone is not None and safety.cone_deg >= cone:
        raise InputError(f"takes {safety.cone_deg:g} deg off cones of {cone:g} deg; nothing is left", "safety.cone_deg")
    strokes = _with_axes(problem, turn, safety.stroke_m, safety.axes_deg).actuators_m
    bodies = problem.bodies
    boxes, beams = ([one.options() for one in listed] for listed in (problem.obstacles, problem.beams))
    wider = {name: getattr(bodies, name) + safety.obstacles_m for name in ("link_radius_m", "plate_radius_m")}
    narrower = {"cone_deg": None if cone is None else cone - safety.cone_deg, "actuators_m": strokes}
    safe = limits.model_copy(update=narrower)
    within = limits_of(safe.options(), bodies.model_copy(update=wider).options(), boxes, beams, robot)
    given = limits.options(), bodies.options()
    return {
        "workspace": Reach(robot.inverse, limits_of(*given, [], [], robot)),
        "obstacles": Reach(robot.inverse, limits_of(*given, boxes, beams, robot)),
        "safety": Reach(robot.inverse, within),
        "device": Reach(robot.inverse, [*within, *measuring.limits, *facing(problem, turn)]),
    }


def _with_axes(problem: Schema, turn: Turn, stroke: float, angle: float) -> PlanLimits:
    """Limits of all actuators, narrower by a stroke [m] of carts and an angle [deg] of rotary axes, which are behind
    them in rad. Raises InputError."""
    limits, carts = problem.limits, problem.limits.actuators_m
    rotary = turn.robot.home.q.shape[1] - 3 if turn.e is not None else 0
    axes = limits.axes_deg
    if axes is not None and len(axes) != rotary:
        raise InputError(f"the robot has {rotary} rotary axes; found {len(axes)} pairs", "limits.axes_deg")
    if carts is not None:
        carts = [[a + stroke, b - stroke] for a, b in carts]
    if rotary and (carts is not None or axes is not None):
        if carts is not None and len(carts) != 3:
            raise InputError(f"the robot has 3 carts; found {len(carts)} pairs", "limits.actuators_m")
        wide = turn.robot.lengths.max() * LONGEST_STROKE / 2
        turned = [[-180.0, 180.0]] * rotary if axes is None else [[a + angle, b - angle] for a, b in axes]
        carts = (carts or [[-wide, wide]] * 3) + [np.radians(pair).tolist() for pair in turned]
    return limits.model_copy(update={"actuators_m": carts})
