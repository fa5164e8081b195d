"""Gantry-Taus whose carts go along measured points: models 2, 4 and 5 of D1 (Dressler 2012, section 5.3)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from .. import lang as gt
from ..geometry.quaternions import quaternion_matrix
from ..mechanics import Guideway, MeasuredGuideway

# straight pieces, arm by arm, of models 1 to 5: three links up to model 2, six from model 3 on
D1_MODELS = {1: (), 2: (0, 1, 2), 3: (), 4: (0, 1, 2), 5: (1,)}


LEAST = 0.5  # least travel along the guideway per travel of the cart; its inverse is the most


class OnPoints(NamedTuple):
    """The robot, and the names of its guideways on measured points, such as "link[1].guideway"."""

    robot: Any
    guideways: list[str]


def on_measured_points(robot: Any, at: np.ndarray, points: Mapping[int, np.ndarray], u: np.ndarray) -> OnPoints:
    """The robot with some arms on straight pieces through measured cart points, eq. (5.7), all others as they were.

    robot: GantryTau, one guideway per arm, or SixLink, one per link; `at` (n,) [m] increasing cart coordinates;
    `points`: arm from 0 -> (n, 3) [m] in the frame of their recording, whose orientation in the robot's frame is `u`
    (4), a quaternion, scalar first. Its origin is set where the points lie best on the A + q v of each guideway: the
    reflector stands beside the joint. A calibration moves t and u of the named guideways, u as a unit quaternion.

    Raises ModelError for an arm that is not there, and points of another shape or that do not go along v as q does.
    """
    A, v = np.array(robot.A, float), np.array(robot.v, float)
    stands_on = getattr(robot, "stands_on", tuple(range(len(A))))
    for arm, rows in points.items():
        if arm not in stands_on:
            raise gt.ModelError(f"cart points of arm {arm + 1} were given; the robot has {max(stands_on) + 1} arms")
        if np.shape(rows) != (len(at), 3):
            raise gt.ModelError(f"cart points of arm {arm + 1} have the shape {np.shape(rows)}; expected "
                                f"{(len(at), 3)}, a point per coordinate")  # fmt: skip
    R = quaternion_matrix(u)
    parts: list[Any] = []
    for k, arm in enumerate(stands_on):
        if arm in points:
            t = np.mean(A[k] + at[:, None] * v[k] - points[arm] @ R.T, axis=0)
            parts.append(MeasuredGuideway(at=at, points=points[arm], t=t, u=u))
            along = _along(np.asarray(at, float), np.asarray(points[arm]) @ R.T, v[k])
            if not LEAST <= along <= 1 / LEAST:
                raise gt.ModelError(f"cart points of arm {arm + 1} go {along:.3g} m along its guideway where the "
                                    "cart goes 1 m, about 1 expected; check their unit, their order and u")  # fmt: skip
        else:
            parts.append(Guideway)
    of = "link" if hasattr(robot, "stands_on") else "arm"
    named = [f"{of}[{k}].guideway" for k, arm in enumerate(stands_on) if arm in points]
    return OnPoints(robot.with_(**{of: [dict(guideway=g) for g in parts]}), named)


def _along(at: np.ndarray, points: np.ndarray, v: np.ndarray) -> float:
    """Slope of points (n, 3) [m] over at (n,) [m] along v, in v; NaN where `at` does not vary."""
    s = at - np.mean(at)
    with np.errstate(invalid="ignore", divide="ignore"):
        return float(s @ (points @ v) / (s @ s) / (v @ v))
