"""Attitude at hidden references: carried by the gyro, corrected at both ends, interpolated, or from the error-state
filter and its smoother."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation, RotationSpline, Slerp

from ...geometry.expressions import quaternion_kinematics
from ...lang.declare import input as known, parameter, variable
from ...lang.functions import der, dot, sqrt
from ...lang.model import Model
from ...results.trajectory import Trajectory
from ..belief import InitialState, Readings
from ..error_state import ErrorState
from ..filtered import Filtered
from ..process import ProcessModel
from ..sensors import Sensor
from ..system import System
from .gyro_path import GyroPath, ReferenceNoise, picked
from .options import METHODS

MOST_GAPS = 400  # judged gaps of one length, evenly over the recording: bounds the cost
ROUND_ABOUT = 5  # references on each side that a spline goes through: more distant ones hardly change it


@dataclass(frozen=True, eq=False)
class HiddenStretch:
    """Two references and the hidden ones between them: rows `first`, `hidden`, `last`."""

    first: int
    hidden: np.ndarray
    last: int


@dataclass(frozen=True, eq=False)
class GapErrors:
    """Errors at hidden references over all gaps of one length, one row each.

    time: of the hidden reference; since: time after the left end [s]. error: by method [rad]. expected: normalised
    squared errors of "carried" and "corrected", chi-squared with three degrees of freedom if their covariance is right.
    """

    gaps: int
    time: np.ndarray
    since: np.ndarray
    error: Mapping[str, np.ndarray]
    expected: Mapping[str, np.ndarray]

    @property
    def mean(self) -> dict[str, float]:
        """Mean error by method [rad]."""
        return {name: float(np.mean(error)) for name, error in self.error.items()}


def gaps_of(time: np.ndarray, length: float) -> Iterator[HiddenStretch]:
    """Gaps of at least this length [s], one from each reference, if it hides a reference."""
    for first, begin in enumerate(time):
        last = int(np.searchsorted(time, begin + length - 1e-9))
        if last >= len(time):
            return
        if last > first + 1:
            yield HiddenStretch(first, np.arange(first + 1, last), last)


def gap_errors(
    time: np.ndarray,
    reference: Rotation,
    path: GyroPath,
    noise: ReferenceNoise,
    doubt: np.ndarray,
    length: float,
    ask: Callable[[], None] = lambda: None,
) -> GapErrors | None:
    """Errors of each method at the hidden references of all gaps; None if there is no gap of this length.

    time (k,), reference (k): by its own clock. path: of the calibrated gyro at these instants, with derivatives. noise:
    disagreement of gyro and references. doubt: covariance (13, 13) of the calibration. ask: called at each gap; may
    raise.
    """
    times, since, gaps = list[np.ndarray](), list[np.ndarray](), 0
    error: dict[str, list[np.ndarray]] = {name: [] for name in METHODS}
    expected: dict[str, list[np.ndarray]] = {"carried": [], "corrected": []}
    candidates = list(gaps_of(time, length))
    for k in np.unique(np.linspace(0, len(candidates) - 1, min(len(candidates), MOST_GAPS)).round().astype(int)):
        ask()
        gap = candidates[k]
        gaps += 1
        hidden, ends = gap.hidden, [gap.first, gap.last]
        bridge = Bridge.over(gap, time, reference, path, noise, doubt)
        truth = picked(reference, hidden)
        estimates = {
            "carried": bridge.carried[:-1],
            "corrected": bridge.corrected[:-1],
            "slerp": Slerp(time[ends], picked(reference, ends))(time[hidden]),
            "spline": _spline(time, reference, _others(gap, len(time)), hidden),
            "slow_spline": _spline(time, reference, _comb(time, gap, length), hidden),
        }
        for name, rotation in estimates.items():
            error[name].append((rotation.inv() * truth).magnitude())
        for name, squares in bridge.expected(truth).items():
            expected[name].append(squares)
        times.append(time[hidden])
        since.append(time[hidden] - time[gap.first])
    if not gaps:
        return None
    joined = {name: np.concatenate(rows) for name, rows in error.items()}
    squares = {name: np.concatenate(rows) for name, rows in expected.items()}
    return GapErrors(gaps, np.concatenate(times), np.concatenate(since), joined, squares)


@dataclass(frozen=True, eq=False)
class Bridge:
    """Orientations over one gap, at m instants: the hidden references and the right end; body to world.

    carried: from the left end with the gyro. corrected: with the reference at the right end too, by the formula of the
    fixed-interval smoother, P_kj (P_jj + N_j)^-1 times the error at the end; errors are rotations about the axes of the
    world. before, after: covariances of carried and corrected (m, 3, 3). timing: covariance of the references
    (m, 3, 3).
    """

    carried: Rotation
    corrected: Rotation
    before: np.ndarray
    after: np.ndarray
    timing: np.ndarray

    @classmethod
    def over(
        cls,
        gap: HiddenStretch,
        time: np.ndarray,
        reference: Rotation,
        path: GyroPath,
        noise: ReferenceNoise,
        doubt: np.ndarray,
    ) -> Bridge:
        """Bridge the gap between two references; arguments as in `gap_errors`."""
        assert path.derivative is not None
        rows = np.append(gap.hidden, gap.last)
        carried = reference[gap.first] * (path.turn[gap.first].inv() * picked(path.turn, rows))
        R = carried.as_matrix()
        steps = picked(path.turn, rows - 1).inv() * picked(path.turn, rows)
        relative = noise.turn_covariance(steps.magnitude(), (time[rows - 1] + time[rows]) / 2)
        m = len(rows)
        pairs = relative[:, :, None, None] * np.einsum("lab,mcb->lmac", R, R)
        left = reference[gap.first].as_matrix() @ noise.timing_covariance(path.rate[[gap.first]])[0]
        left = left @ reference[gap.first].as_matrix().T
        world = (reference[gap.first] * path.turn[gap.first].inv()).as_matrix()  # from the first instant of the path
        moved = world @ (path.derivative[rows] - path.derivative[gap.first])
        calibrated = np.einsum("lap,pq,mbq->lmab", moved, doubt, moved)
        P = left + np.cumsum(np.cumsum(pairs, axis=0), axis=1) + calibrated  # (m, m, 3, 3)
        timing = R @ noise.timing_covariance(path.rate[rows]) @ np.swapaxes(R, 1, 2) + noise.floor**2 * np.eye(3)
        gain = P[:, -1] @ np.linalg.inv(P[-1, -1] + timing[-1])
        end = (reference[gap.last] * carried[-1].inv()).as_rotvec()
        before = P[np.arange(m), np.arange(m)]
        after = before - gain @ np.swapaxes(P[:, -1], 1, 2)
        return cls(carried, Rotation.from_rotvec(gain @ end) * carried, before, after, timing)

    def expected(self, truth: Rotation) -> dict[str, np.ndarray]:
        """Normalised squared errors at the hidden references, with the covariance of their timing included."""
        squares = {}
        for name, estimate, P in (("carried", self.carried, self.before), ("corrected", self.corrected, self.after)):
            d = (truth * estimate[:-1].inv()).as_rotvec()
            S = P[:-1] + self.timing[:-1]
            squares[name] = np.sum(d * np.linalg.solve(S, d[..., None])[..., 0], axis=1)
        return squares


def _spline(time: np.ndarray, reference: Rotation, through: np.ndarray, at: np.ndarray) -> Rotation:
    return RotationSpline(time[through], picked(reference, through))(time[at])


def _others(gap: HiddenStretch, count: int) -> np.ndarray:
    """The references nearest to a gap, without those hidden in it."""
    low, high = max(0, gap.first - ROUND_ABOUT + 1), min(count, gap.last + ROUND_ABOUT)
    return np.concatenate([np.arange(low, gap.first + 1), np.arange(gap.last, high)])


def _comb(time: np.ndarray, gap: HiddenStretch, length: float) -> np.ndarray:
    """References one gap apart, including the ends of this gap."""
    rows = [gap.first, gap.last]
    for _ in range(ROUND_ABOUT):
        later = int(np.searchsorted(time, time[rows[-1]] + length - 1e-9))
        if later < len(time):
            rows.append(later)
        earlier = int(np.searchsorted(time, time[rows[0]] - length + 1e-9, side="right")) - 1
        if earlier >= 0:
            rows.insert(0, earlier)
    return np.array(rows)


class GyroCarriedBody(Model):
    """A body whose rate is a known input from a gyro, with a slowly changing error in proportion to the rate.

    States: Q (unit quaternion, body to world, scalar first) and the relative error e of the rate, in the axes of the
    body, an Ornstein-Uhlenbeck process driven by `drift`.

    >>> body = gt.filtering.GyroCarriedBody(persistence=2.0)
    >>> process = gt.filtering.ProcessModel(
    ...     body, noise={"drift": 1e-5}, inputs=["rate"], states=["Q", "e"], quaternions=["Q"]
    ... )
    >>> process.inputs
    ('rate',)
    """

    persistence = parameter(1.0, unit="s", description="correlation time of the relative error")
    Q = variable(4, unit="1", start=[1.0, 0.0, 0.0, 0.0], description="body to world, scalar first")
    e = variable(3, unit="1", description="error of the rate over its magnitude, in the axes of the body")
    rate = known(3, unit="rad/s", description="calibrated rate of the gyro")
    drift = known(3, unit="1/s")

    def equations(self) -> Any:
        w = self.rate + self.e * sqrt(dot(self.rate, self.rate) + SLOW**2)
        scalar, rates = quaternion_kinematics(self.Q, w)
        yield der(self.Q[0]) == scalar
        yield der(self.Q[1:4]) == rates
        yield der(self.e) == -self.e / self.persistence + self.drift


SLOW = 1e-3  # rad/s: keeps the magnitude of the rate differentiable at rest
LEAST = 1e-4  # rad, least deviation of the readings: the filter divides by it


def attitude_filter(
    time: np.ndarray,
    rate: np.ndarray,
    reference_time: np.ndarray,
    reference: Rotation,
    noise: ReferenceNoise,
    used: np.ndarray,
    ask: Callable[[], None] = lambda: None,
) -> Filtered:
    """Run the error-state filter over a recording, with the references in the mask `used` (k,) as readings.

    time (n,), rate (n, 3): of the calibrated gyro, by the reference's clock. The instants are the samples of the gyro
    and all references; references outside the mask are not read. The timing error of the references is taken as an
    error of equal size about all axes, from the mean square of the rate. ask: called from time to time; may raise.

    >>> from scipy.spatial.transform import Rotation
    >>> time = 0.01 * np.arange(201)
    >>> rate = np.tile([0.0, 0.0, 1.0], (201, 1))
    >>> at = 0.5 * np.arange(5)
    >>> true = Rotation.from_rotvec(np.outer(at, [0.0, 0.0, 1.01]))
    >>> noise = gt.filtering.ReferenceNoise(timing=1e-4, relative=0.02, floor=1e-4, persistence=5.0)
    >>> run = gt.filtering.attitude_filter(time, rate, at, true, noise, np.ones(5, bool))
    >>> run["e"][-1].round(2).tolist()  # the gyro reads one per cent too little
    [0.0, 0.0, 0.01]
    """
    inside = (time > reference_time[0]) & (time < reference_time[-1])
    nodes = np.unique(np.concatenate([time[inside], reference_time]))
    rates = np.column_stack([np.interp(nodes, time, rate[:, k]) for k in range(3)])
    values = np.full((len(nodes), 4), np.nan)
    rows = np.searchsorted(nodes, reference_time)
    values[rows[used]] = picked(reference, used).as_quat(scalar_first=True)
    size = float(np.sqrt(np.mean(np.sum(rates**2, axis=1)) / 3)) * noise.timing
    deviation = max(float(np.hypot(size, noise.floor)), LEAST)
    density = 2 * noise.relative**2 / noise.persistence
    body = GyroCarriedBody(persistence=noise.persistence)
    process = ProcessModel(body, noise={"drift": density}, inputs=["rate"], states=["Q", "e"], quaternions=["Q"])
    system = System(process, [Sensor("reference", "Q", deviation=deviation, kind="quaternion")])
    begin = reference[0].as_quat(scalar_first=True)
    start = InitialState({"Q": begin}, {"Q": deviation, "e": noise.relative}, time=float(nodes[0]))
    inputs = Trajectory(nodes, {"rate": rates}, {"rate": "rad/s"})
    log = {"reference": Readings(nodes, values)}
    return ErrorState(system).run(log, start, inputs=inputs, progress=lambda _: bool(ask()))
