"""The motions of problems/f1_motion.toml and f1_path.toml as objects; a mass and limits of OURS."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

import gtmodel as gt
from gtmodel.motion import AxisCost, AxisEnd, AxisLimits, Polyline
from gtmodel.motion.axes import AxisPlan, AxisProblem, AxisStudy, axis_study, plan_of

FORCE, TORQUE = 1000.0, 40.0
SPEED = 0.8  # of the tool centre point along the path [m/s]
STROKE = np.radians(45.0)
STROKES = {
    "cart_low": [0.0] * 3, "cart_high": [1.2] * 3, "axis_low": [-STROKE] * 3, "axis_high": [STROKE] * 3,
}  # fmt: skip
LIMITS = AxisLimits(FORCE, torque=TORQUE, **STROKES)
START = AxisEnd([0.72, 0.26, 0.21], [0.0, 0.0, 0.0])
GOAL = AxisEnd([0.90, 0.50, 0.35], np.radians([12.0, -12.0, -9.0]).tolist())
PLACE = AxisEnd(tcp=[-0.32, 2.15, 0.32], tool=[0.15, -0.15, -1.0])


@cache
def f1() -> gt.Model:
    return gt.robots.catalogue.make("f1")


def free(**changes: Any) -> dict[str, Any]:
    """The arguments of the free motion."""
    given = {"robot": f1(), "start": START, "goal": GOAL, "limits": LIMITS, "cost": AxisCost(energy=0.01)}
    return {**given, **changes}


def along(**changes: Any) -> dict[str, Any]:
    """The arguments of the motion along a path."""
    limits = AxisLimits(FORCE, torque=TORQUE, tcp_velocity=SPEED, **STROKES)
    return free(goal=PLACE, path=Polyline([[-0.16, 2.32, 0.22]]), limits=limits) | changes


def planned(given: dict[str, Any]) -> AxisPlan:
    return plan_of(AxisProblem(**given))


def studied(given: dict[str, Any]) -> AxisStudy:
    return axis_study(**given)
