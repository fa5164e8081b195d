"""What a point must pass to be a pose of a calibration plan, stage by stage (Dressler 2012, Fig. 5.21)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...kinematics.workspace import Reach, limits_of
from ...kinematics.workspace.limited import LONGEST_STROKE
from ...results import ArgumentError
from .device import Measuring
from .options import PlanLimits
from .task import Task
from .turns import Turn, facing


def stages_of(task: Task, turn: Turn, measuring: Measuring) -> dict[str, Reach]:
    """Tests of a point, each with those before: workspace, with obstacles and safety, seen by the device.

    Raises ArgumentError.
    """
    robot, safety, bodies = turn.robot, task.safety, task.bodies
    limits = _with_axes(task, turn, 0.0, 0.0)
    cone = limits.cone
    if cone is not None and safety.cone >= cone:
        off, whole = (f"{np.degrees(angle):g}" for angle in (safety.cone, cone))
        raise ArgumentError(f"takes {off} deg off cones of {whole} deg; nothing is left", "safety.cone")
    safe = replace(
        limits, cone=None if cone is None else cone - safety.cone,
        actuators=_with_axes(task, turn, safety.stroke, safety.axes).actuators,
    )  # fmt: skip
    wider = replace(
        bodies, link_radius=bodies.link_radius + safety.obstacles, plate_radius=bodies.plate_radius + safety.obstacles
    )
    boxes, beams = task.obstacles, task.beams
    within = limits_of(safe, wider, boxes, beams, robot)
    return {
        "workspace": Reach(robot.inverse, limits_of(limits, bodies, [], [], robot)),
        "obstacles": Reach(robot.inverse, limits_of(limits, bodies, boxes, beams, robot)),
        "safety": Reach(robot.inverse, within),
        "device": Reach(robot.inverse, [*within, *measuring.limits, *facing(task, turn)]),
    }


def _with_axes(task: Task, turn: Turn, stroke: float, angle: float) -> PlanLimits:
    """Limits of all actuators, narrower by a stroke [m] of carts and an angle [rad] of rotary axes, which are behind
    them. Raises ArgumentError."""
    limits, carts, axes = task.limits, task.limits.actuators, task.limits.axes
    rotary = turn.robot.home.q.shape[1] - 3 if turn.e is not None else 0
    if axes is not None and len(axes) != rotary:
        raise ArgumentError(f"the robot has {rotary} rotary axes; found {len(axes)} pairs", "limits.axes")
    if carts is not None:
        carts = [[a + stroke, b - stroke] for a, b in carts]
    if rotary and (carts is not None or axes is not None):
        if carts is not None and len(carts) != 3:
            raise ArgumentError(f"the robot has 3 carts; found {len(carts)} pairs", "limits.actuators")
        wide = turn.robot.lengths.max() * LONGEST_STROKE / 2
        turned = [[-np.pi, np.pi]] * rotary if axes is None else [[a + angle, b - angle] for a, b in axes]
        carts = (carts or [[-wide, wide]] * 3) + turned
    return replace(limits, actuators=carts)
