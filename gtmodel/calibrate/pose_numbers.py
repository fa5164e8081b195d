"""How many poses suffice: predicted error of the workspace against their number."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..lang.source import ModelError
from .pose_information import PoseInformation
from .pose_selection import Criterion, exchange
from .positioning import Positioning


class Point(NamedTuple):
    """Number of poses, predicted root mean square of |error| [m] over the workspace and at its worst pose."""

    poses: int
    rms: float
    greatest: float


@dataclass(frozen=True, eq=False)
class ErrorCurve:
    """Points in the order of their number of poses; `complete` False after a stop."""

    points: tuple[Point, ...]
    complete: bool = True


def error_curve(
    info: PoseInformation,
    target: Positioning,
    numbers: Sequence[int],
    criterion: Criterion = "I",
    *,
    stop: Callable[[float], bool] | None = None,
    repeats: int = 2,
    starts: int = 3,
    seed: int = 0,
) -> ErrorCurve:
    """Predicted errors over the workspace with selected poses, for each of `numbers` of poses.

    `criterion`, `repeats`, `starts`, `seed`: as of exchange(). `stop(fraction)`: True ends with what is done.

    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> T = np.array([[x, y, z] for x in (0.0, 0.5, 1.0) for y in (-1.0, -0.5, 0.0) for z in (0.2, 0.5, 0.8)])
    >>> q, _ = robot.causal(known="T", targets="q")(T)
    >>> poses = gt.calibrate.Measurements({"q": q, "T": T}, noise={"T": 2e-5})
    >>> problem = gt.calibrate.prepare(robot, poses)
    >>> info = gt.calibrate.pose_information(problem)
    >>> target = gt.calibrate.positioning(problem)
    >>> for p in gt.calibrate.error_curve(info, target, [8, 16], starts=1).points:
    ...     print(p.poses, round(1e6 * p.rms))  # um
    8 32
    16 21
    """
    moment = target.moment(info)
    points, wanted = [], sorted(set(numbers))
    for k, number in enumerate(wanted):
        if stop is not None and stop(k / len(wanted)):
            return ErrorCurve(tuple(points), complete=False)
        s = exchange(info, number, criterion, moment, repeats=repeats, starts=starts, seed=seed)
        e = target.errors(info, s.indices)
        points.append(Point(number, e.rms, e.greatest))
    return ErrorCurve(tuple(points))


def grid_point(info: PoseInformation, target: Positioning) -> Point:
    """The predicted errors with all poses of `info`, such as those of a regular grid.

    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> T = np.array([[x, y, z] for x in (0.0, 0.5, 1.0) for y in (-1.0, -0.5, 0.0) for z in (0.2, 0.5, 0.8)])
    >>> q, _ = robot.causal(known="T", targets="q")(T)
    >>> poses = gt.calibrate.Measurements({"q": q, "T": T}, noise={"T": 2e-5})
    >>> problem = gt.calibrate.prepare(robot, poses)
    >>> info = gt.calibrate.pose_information(problem)
    >>> point = gt.calibrate.grid_point(info, gt.calibrate.positioning(problem))
    >>> point.poses, round(1e6 * point.rms), round(1e6 * point.greatest)  # um
    (27, 18, 23)
    """
    e = target.errors(info)
    return Point(len(info), e.rms, e.greatest)


def sufficient_number(
    info: PoseInformation,
    target: Positioning,
    accuracy: float,
    criterion: Criterion = "I",
    *,
    most: int | None = None,
    repeats: int = 2,
    starts: int = 3,
    seed: int = 0,
) -> int | None:
    """The least number of selected poses whose predicted rms error is at most `accuracy` [m].

    None if `most` (default all candidates, each once) are too few. It is found by doubling and bisection: the error
    never grows with the number of poses. Raises ModelError for an accuracy that is not positive.

    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> T = np.array([[x, y, z] for x in (0.0, 0.5, 1.0) for y in (-1.0, -0.5, 0.0) for z in (0.2, 0.5, 0.8)])
    >>> q, _ = robot.causal(known="T", targets="q")(T)
    >>> poses = gt.calibrate.Measurements({"q": q, "T": T}, noise={"T": 2e-5})
    >>> problem = gt.calibrate.prepare(robot, poses)
    >>> info = gt.calibrate.pose_information(problem)
    >>> target = gt.calibrate.positioning(problem)
    >>> gt.calibrate.sufficient_number(info, target, accuracy=25e-6, starts=1)
    11
    >>> gt.calibrate.sufficient_number(info, target, accuracy=1e-6, starts=1) is None
    True
    """
    if not accuracy > 0:
        raise ModelError(f"the accuracy is {accuracy:g} m; it must be positive")
    moment = target.moment(info)
    own = info.rows.shape[1]
    prior = int(np.linalg.matrix_rank(info.priors)) if len(info.priors) else 0
    low, high = max(1, -(-(info.rank - prior) // own)), min(most or len(info), len(info))

    def enough(number: int) -> bool:
        s = exchange(info, number, criterion, moment, repeats=repeats, starts=starts, seed=seed)
        try:
            return target.errors(info, s.indices).rms <= accuracy
        except ModelError:  # so few poses need not determine all
            return False

    if high < low:
        return None
    tried = low
    while not enough(tried):  # upwards: the effort grows with the number
        if tried == high:
            return None
        low, tried = tried + 1, min(2 * tried, high)
    return low + bisect_left(range(low, tried), True, key=enough)
