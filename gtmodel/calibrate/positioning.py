"""Predicted accuracy of a calibrated robot over its workspace, before any measurement, and the sufficient number of
poses."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..lang.source import ModelError
from .pose_information import LEAK, PoseInformation
from .pose_selection import Criterion, exchange
from .problem import CalibrationProblem


@dataclass(frozen=True, eq=False)
class PredictedErrors:
    """Covariance (M, 3, 3) [m2] of the tool centre point's error at M evaluation poses, due to parameter errors."""

    covariance: np.ndarray

    @property
    def each(self) -> np.ndarray:
        """(M,) root mean square of |error| [m] at each pose."""
        return np.sqrt(np.trace(self.covariance, axis1=1, axis2=2))

    @property
    def rms(self) -> float:
        """Root mean square of |error| [m] over the poses."""
        return float(np.sqrt(np.mean(self.each**2)))

    @property
    def greatest(self) -> float:
        """Root mean square of |error| [m] at the worst pose."""
        return float(np.max(self.each))


@dataclass(frozen=True, eq=False)
class Positioning:
    """Jacobian (M, 3, n) [m] of the tool centre point in the unknowns `names`, in their units, with fixed actuators."""

    names: tuple[str, ...]
    jacobian: np.ndarray

    def moment(self, info: PoseInformation) -> np.ndarray:
        """Return the mean of J'J (r, r) over the poses, with the Jacobian J in the combinations of `info`.

        trace(C moment) is the mean square error if C is their covariance.
        """
        P = self._scaled(info)
        return np.einsum("kip,kiq->pq", P, P) / len(P)

    def errors(self, info: PoseInformation, selection: ArrayLike | None = None) -> PredictedErrors:
        """Return the predicted errors after a calibration with some poses (default all) of `info`.

        Raises ModelError if these poses do not determine the errors.
        """
        self._scaled(info)
        P, C = self._columns(info), info.covariance(selection)
        return PredictedErrors(P @ C @ P.transpose(0, 2, 1))

    def spread(self, info: PoseInformation, runs: int, selection: ArrayLike | None = None) -> float:
        """Return the relative standard deviation of the rms error from this number of simulated calibrations."""
        P = self._columns(info)
        CM = info.covariance(selection) @ (np.einsum("kip,kiq->pq", P, P) / len(P))
        return float(np.sqrt(np.trace(CM @ CM) / (2 * runs)) / np.trace(CM))

    def _columns(self, info: PoseInformation) -> np.ndarray:
        """The Jacobian with the columns of `info`; zero for unknowns that do not move the robot."""
        unknown = [n for n in self.names if n not in info.names]
        if unknown:
            raise ModelError(f"the position depends on '{unknown[0]}', which is not free at the poses; free it there")
        full = np.zeros((*self.jacobian.shape[:2], len(info.names)))
        full[:, :, [info.names.index(n) for n in self.names]] = self.jacobian
        return full

    def _scaled(self, info: PoseInformation) -> np.ndarray:
        P = self._columns(info) * info.sizes
        inside = P @ info.basis
        outside = np.abs(P - inside @ info.basis.T)
        if np.max(outside, initial=0.0) > LEAK * np.max(np.abs(P), initial=0.0):
            k = int(np.argmax(outside.max(axis=(0, 1))))
            raise ModelError(
                f"the position depends on combinations that no pose determines ({info.rank} of {len(info.names)} are "
                f"determined; '{info.names[k]}' is among the others): measure more, or fix a parameter"
            )
        return inside


def positioning(
    problem: CalibrationProblem, signal: str = "T", names: Sequence[str] | None = None, *, x: ArrayLike | None = None
) -> Positioning:
    """Return the Jacobian of the tool centre point in the unknowns, at the poses of a problem.

    It follows from the closure equations; actuators and whole pose must be measured. `signal`: the position. `names`:
    restrict it to these unknowns (of another problem of the same robot); default all. `x`: values of the unknowns,
    default their start values. Raises ModelError for singular poses, and if the equations do not determine the pose.

    >>> robot = gt.robots.gantry_tau("l1_tape")
    >>> T = np.array([[x, y, z] for x in (0.0, 0.5, 1.0) for y in (-1.0, -0.5, 0.0) for z in (0.2, 0.5, 0.8)])
    >>> q, _ = robot.causal(known="T", targets="q")(T)
    >>> poses = gt.calibrate.Measurements({"q": q, "T": T}, noise={"T": 2e-5})
    >>> problem = gt.calibrate.prepare(robot, poses)
    >>> info = gt.calibrate.pose_information(problem)
    >>> target = gt.calibrate.positioning(problem)
    >>> target.jacobian.shape, round(1e6 * target.errors(info).rms)  # um, after a calibration with these poses
    ((27, 3, 21), 18)
    """
    every = problem.unknowns.names
    chosen = list(every) if names is None else [n for n in every if n in set(names)]
    jacobian = pose_jacobians(problem, signal, x)[signal]
    return Positioning(tuple(chosen), jacobian[:, :, [every.index(n) for n in chosen]])


def pose_jacobians(problem: CalibrationProblem, signal: str = "T", x: ArrayLike | None = None) -> dict[str, np.ndarray]:
    """Return the Jacobian of each pose signal in the unknowns (N, k, n), actuators fixed. Raises as positioning()."""
    J, B, pose = closure_jacobians(problem, signal, x)
    try:
        jacobian = -np.linalg.solve(B, J)
    except np.linalg.LinAlgError:
        raise ModelError("an evaluation pose is singular: the closure equations do not determine the pose") from None
    places = {n: s for n, s in problem.reading.places.items() if n != problem.actuators}
    return {n: jacobian[:, [pose.index(k) for k in range(s.start, s.stop)]] for n, s in places.items()}


def closure_jacobians(
    problem: CalibrationProblem, signal: str = "T", x: ArrayLike | None = None
) -> tuple[np.ndarray, np.ndarray, list[int]]:
    """Return Jacobians of the length residuals in the unknowns (N, m, n) and in the whole pose (N, m, m).

    `signal` is a part of the pose. The third value holds the indices of the pose's components among the signals. Raises
    ModelError if the equations do not determine the pose.
    """
    read, u = problem.reading, problem.unknowns
    if signal not in read.places or read.latent.numel() or read.derived.numel() or len(read.stances) > 1:
        raise ModelError(f"predicted errors need whole poses with '{signal}', one per row, and no latent variables")
    pose = [k for n, s in read.places.items() if n != problem.actuators for k in range(s.start, s.stop)]
    m = len(problem.labels)
    if m != len(pose):
        raise ModelError(f"{m} closure equations cannot determine a pose with {len(pose)} degrees of freedom")
    J, B, _ = problem.all_jacobians("forward", u.start if x is None else np.asarray(x, float))
    return J, B[:, :, pose], pose


class Point(NamedTuple):
    """Number of poses, predicted root mean square of |error| [m] over the workspace and at its worst pose."""

    poses: int
    rms: float
    greatest: float


@dataclass(frozen=True, eq=False)
class ErrorCurve:
    """Points ordered by their number of poses; `complete` is False if stopped."""

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
    """Return predicted errors over the workspace for selections of these `numbers` of poses.

    `criterion`, `repeats`, `starts`, `seed`: as in exchange(). `stop(fraction)`: True ends with the points so far.

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
    points, counts = [], sorted(set(numbers))
    for k, number in enumerate(counts):
        if stop is not None and stop(k / len(counts)):
            return ErrorCurve(tuple(points), complete=False)
        s = exchange(info, number, criterion, moment, repeats=repeats, starts=starts, seed=seed)
        e = target.errors(info, s.indices)
        points.append(Point(number, e.rms, e.greatest))
    return ErrorCurve(tuple(points))


def grid_point(info: PoseInformation, target: Positioning) -> Point:
    """Return the predicted errors with all poses of `info`, such as those of a regular grid.

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
    """Return the smallest number of selected poses whose predicted rms error is at most `accuracy` [m].

    None if `most` (default all candidates, each once) are too few. Found by doubling and bisection, as the error never
    grows with the number of poses. Raises ModelError unless the accuracy is positive.

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
    equations = info.rows.shape[1]
    prior = int(np.linalg.matrix_rank(info.priors)) if len(info.priors) else 0
    low, high = max(1, -(-(info.rank - prior) // equations)), min(most or len(info), len(info))

    def enough(number: int) -> bool:
        s = exchange(info, number, criterion, moment, repeats=repeats, starts=starts, seed=seed)
        try:
            return target.errors(info, s.indices).rms <= accuracy
        except ModelError:  # so few poses may not determine all parameters
            return False

    if high < low:
        return None
    tried = low
    while not enough(tried):  # from below: the effort grows with the number
        if tried == high:
            return None
        low, tried = tried + 1, min(2 * tried, high)
    return low + bisect_left(range(low, tried), True, key=enough)
