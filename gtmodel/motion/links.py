"""Where the links of a robot on guideways stand, and how far from the edge of reach."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from .. import lang as gt
from ..compiler.causal import compile_causal, flat_of
from ..robots.links import link_names


def link_ends(robot: gt.Model, T: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cart and plate joints (rows, n, 3) [m] of the links in `link_names` order at TCP positions (rows, 3), and the
    status of each row; without links only the status counts."""
    names = link_names(robot)
    targets = [*names, *(name.removesuffix("a.r") + "b.r" for name in names)]
    place = compile_causal(robot, known="T", targets=targets or ["q" if "q" in flat_of(robot).groups else "tau"])
    *points, status = place.along(T)
    if not names:
        return np.zeros((len(T), 0, 3)), np.zeros((len(T), 0, 3)), status
    a, b = (np.stack(part, axis=1) for part in (points[: len(names)], points[len(names) :]))
    return a, b, status


def along_guideways(robot: gt.Model, tips: np.ndarray, joints: Sequence[np.ndarray] | np.ndarray) -> np.ndarray:
    """Components (..., n) [m] of n links along their guideways, for plate and cart joints (..., n, 3) in the order of
    `link_names`; where all links meet in one point, tips may be that point."""
    flat = flat_of(robot)
    directions = [flat.bindings[name.removesuffix("rod.a.r") + "v"] for name in link_names(robot)]
    if not directions:
        return np.zeros(0)
    v = np.array(ca.Function("v", [flat.p], [ca.horzcat(*directions)])(flat.p0)).T
    return np.sum((tips - np.asarray(joints)) * v, axis=-1) / np.linalg.norm(v, axis=1)
