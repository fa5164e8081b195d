"""Attitude where references are hidden: carried by the gyro, corrected at both ends, and interpolated without it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation, RotationSpline, Slerp

from .attitude_result import METHODS
from .gyro_path import GyroPath, picked
from .reference_noise import ReferenceNoise

MOST_GAPS = 400  # of one length that are judged, evenly over the recording: the cost does not grow with it
ROUND_ABOUT = 5  # references on either side that a spline goes through: those further away hardly move it


@dataclass(frozen=True, eq=False)
class HiddenStretch:
    """One pair of references and those between them, which are hidden: rows `first`, `hidden`, `last`."""

    first: int
    hidden: np.ndarray
    last: int


@dataclass(frozen=True, eq=False)
class GapErrors:
    """Errors at hidden references over all gaps of one length, one row each.

    time: of the hidden reference; since: after the left end [s]. error: by method [rad]. expected: squares of errors of
    "carried" and "corrected" over their covariance, chi-squared with three degrees of freedom where that is right.
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
    """Gaps of at least this length [s] from every reference on; none that hides nothing."""
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
    """What each method makes of the hidden references of all gaps; None where there is no gap of this length.

    time (k,), reference (k): by its own clock. path: of the calibrated gyro at these instants, with derivatives. noise:
    what gyro and references disagree by. doubt: covariance (13, 13) of the calibration.
    ask: called at each gap; may raise.
    """
    times, since, gaps = list[np.ndarray](), list[np.ndarray](), 0
    error: dict[str, list[np.ndarray]] = {name: [] for name in METHODS}
    expected: dict[str, list[np.ndarray]] = {"carried": [], "corrected": []}
    there = list(gaps_of(time, length))
    for k in np.unique(np.linspace(0, len(there) - 1, min(len(there), MOST_GAPS)).round().astype(int)):
        ask()
        gap = there[k]
        gaps += 1
        hidden, ends = gap.hidden, [gap.first, gap.last]
        bridge = Bridge.over(gap, time, reference, path, noise, doubt)
        truth = picked(reference, hidden)
        made = {
            "carried": bridge.carried[:-1],
            "corrected": bridge.corrected[:-1],
            "slerp": Slerp(time[ends], picked(reference, ends))(time[hidden]),
            "spline": _spline(time, reference, _others(gap, len(time)), hidden),
            "slow_spline": _spline(time, reference, _comb(time, gap, length), hidden),
        }
        for name, rotation in made.items():
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
    """Orientations over one gap, at the hidden references and at the right end: body to world, m of them.

    carried: from the left end by the gyro. corrected: with what the right end says too, by the formula of the
    fixed-interval smoother, P_kj (P_jj + N_j)^-1 times the error at the end; errors are turns about the axes of the
    world. before, after: their covariances (m, 3, 3). timing: of the references there (m, 3, 3).
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
        """Over the gap between two references; arguments as of `gap_errors`."""
        assert path.derivative is not None
        rows = np.append(gap.hidden, gap.last)
        carried = reference[gap.first] * (path.turn[gap.first].inv() * picked(path.turn, rows))
        R = carried.as_matrix()
        steps = picked(path.turn, rows - 1).inv() * picked(path.turn, rows)
        own = noise.turn_covariance(steps.magnitude(), (time[rows - 1] + time[rows]) / 2)
        m = len(rows)
        pairs = own[:, :, None, None] * np.einsum("lab,mcb->lmac", R, R)
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
        """Squared errors at the hidden references over what is expected of them, their own timing included."""
        squares = {}
        for name, made, P in (("carried", self.carried, self.before), ("corrected", self.corrected, self.after)):
            d = (truth * made[:-1].inv()).as_rotvec()
            S = P[:-1] + self.timing[:-1]
            squares[name] = np.sum(d * np.linalg.solve(S, d[..., None])[..., 0], axis=1)
        return squares


def _spline(time: np.ndarray, reference: Rotation, through: np.ndarray, at: np.ndarray) -> Rotation:
    return RotationSpline(time[through], picked(reference, through))(time[at])


def _others(gap: HiddenStretch, count: int) -> np.ndarray:
    """The references nearest to a gap that are not hidden in it."""
    low, high = max(0, gap.first - ROUND_ABOUT + 1), min(count, gap.last + ROUND_ABOUT)
    return np.concatenate([np.arange(low, gap.first + 1), np.arange(gap.last, high)])


def _comb(time: np.ndarray, gap: HiddenStretch, length: float) -> np.ndarray:
    """References one gap apart, the ends of this one among them."""
    rows = [gap.first, gap.last]
    for _ in range(ROUND_ABOUT):
        later = int(np.searchsorted(time, time[rows[-1]] + length - 1e-9))
        if later < len(time):
            rows.append(later)
        earlier = int(np.searchsorted(time, time[rows[0]] - length + 1e-9, side="right")) - 1
        if earlier >= 0:
            rows.insert(0, earlier)
    return np.array(rows)
