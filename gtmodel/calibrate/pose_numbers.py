"""How many poses suffice: predicted error of the workspace against their number."""

from __future__ import annotations

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
    """Predicted errors with selected poses, for each of `numbers`. `stop(fraction)`: True ends with what is done."""
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
    """The predicted errors with all poses of `info`, such as those of a regular grid."""
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
    """The least number of selected poses whose predicted rms error is at most `accuracy` [m]; None if `most` (default
    all candidates, each once) are too few.

    By doubling and bisection: more poses never tell less. Raises ModelError for an accuracy that is not positive.
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
        except ModelError:  # so few poses need not tell all
            return False

    if high < low:
        return None
    tried = low
    while not enough(tried):  # upwards: the effort grows with the number
        if tried == high:
            return None
        low, tried = tried + 1, min(2 * tried, high)
    high = tried
    while low < high:
        middle = (low + high) // 2
        low, high = (low, middle) if enough(middle) else (middle + 1, high)
    return low
