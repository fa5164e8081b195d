"""Where the links of a robot on guideways stand, and how far from the edge of reach."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from .. import lang as gt
from ..compiler.causal import CausalFunction, compile_causal, flat_of
from ..results import Status
from ..robots.links import link_names
from .constraints import NO_GUARD, MotionConstraints


def motion_function(robot: gt.Model, guard: MotionConstraints = NO_GUARD) -> CausalFunction:
    """(T, T', T'') -> forces, carts, their speeds, joints of the links (`joint_names`), and the guard's margins: one
    function for all questions."""
    p = guard.prefix
    names = [f"{p}tau", f"{p}q", f"der({p}q)", *(f"{p}{name}" for name in joint_names(robot))]
    return compile_causal(guard.model(robot), known=f"{p}T", targets=[*names, *(["margin"] if guard.margins else [])])


def joint_names(robot: gt.Model) -> list[str]:
    """The cart joints of the links in `link_names` order, and behind them their plate joints."""
    names = link_names(robot)
    return [*names, *(name.removesuffix("a.r") + "b.r" for name in names)]


def link_ends(robot: gt.Model, T: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cart and plate joints (rows, n, 3) [m] of the links in `link_names` order at TCP positions (rows, 3), and the
    status of each row; without links only the status counts."""
    names = joint_names(robot)
    # forces and all: where there are none, the positions are asked for alone
    _, _, _, *points, status = motion_function(robot).along(T)
    if np.any(status != Status.OK):
        *points, status = compile_causal(robot, known="T", targets=names or ["q"]).along(T)
    return *joints_of(names, points, len(T)), status


def joints_of(names: Sequence[str], points: Sequence[np.ndarray], rows: int) -> tuple[np.ndarray, np.ndarray]:
    """Cart and plate joints (rows, n, 3) of the values of `joint_names`."""
    if not names:
        return np.zeros((rows, 0, 3)), np.zeros((rows, 0, 3))
    half = len(names) // 2
    return np.stack(points[:half], axis=1), np.stack(points[half:], axis=1)


def along_guideways(robot: gt.Model, tips: np.ndarray, joints: Sequence[np.ndarray] | np.ndarray) -> np.ndarray:
    """Components (..., n) [m] of n links along their guideways, for plate and cart joints (..., n, 3) in the order of
    `link_names`; where all links meet in one point, tips may be that point."""
    flat = flat_of(robot)
    directions = [flat.bindings[name.removesuffix("rod.a.r") + "v"] for name in link_names(robot)]
    if not directions:
        return np.zeros(0)
    v = np.array(ca.Function("v", [flat.p], [ca.horzcat(*directions)])(flat.p0)).T
    return np.sum((tips - np.asarray(joints)) * v, axis=-1) / np.linalg.norm(v, axis=1)
