"""Smoothing: estimates that use later readings too, over the whole log or with a fixed lag."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..results.refusal import ArgumentError
from .filtered import Estimates, Filtered, normalised_square
from .manifold import Manifold
from .transition import Advance

SINGULAR = 1e-13  # eigenvalue of a correlation matrix: directions below that are exactly known


@dataclass(frozen=True, eq=False)
class Smoothed(Estimates):
    """Smoothed states: K instants of m runs.

    time: of the instants [s]. lag: readings up to this long after each instant were used [s]; infinite: all of them.
    x: means (K, m, size). P: covariances (K, m, n, n). errors, nees: if the truth was given to the filter, as in
        `Filtered`.

    smoothed["p"] is the mean of a state, smoothed.deviation["p"] the standard deviation of its error.
    """

    lag: float
    P: np.ndarray
    nees: np.ndarray | None

    @property
    def covariances(self) -> np.ndarray:
        """Covariances of the errors, (K, n, n) of a single run, (m, K, n, n) of several."""
        return self._shown(self.P)


def smooth(filtered: Filtered) -> Smoothed:
    """Estimate the state at each instant from all readings of the log (fixed-interval smoothing).

    Rauch, Tung and Striebel's recursion from the last instant to the first, with minus and plus of the manifold. For a
    linear process with linear sensors this is the least-squares estimate from the whole log; otherwise it uses the
    linearisation of the filter.

    filtered: a run with its covariances: a single run keeps them, several runs with `keep=True`.
    Raises ArgumentError if they were not kept, and for a filter without Jacobians of its steps.

    Source: Rauch, Tung, Striebel 1965, AIAA Journal 3, 1445-1450.

    >>> parts = [gt.filtering.StatePart("x", unit="m")]
    >>> process = gt.filtering.DiscreteProcess(parts, 0.1, lambda s: {"x": s.x}, [1e-4])
    >>> system = gt.filtering.System(process, [gt.filtering.Sensor("tape", "x", deviation=0.01)])
    >>> log = {"tape": gt.filtering.Readings([0.0, 0.1, 0.2], [0.0, 0.0, 0.02])}
    >>> run = gt.filtering.ErrorState(system).run(log, gt.filtering.InitialState({}, {"x": 1.0}))
    >>> smoothed = gt.filtering.smooth(run)
    >>> smoothed["x"].round(4).tolist()  # symmetric in time: half of the last step belongs to the state before
    [0.0025, 0.005, 0.0125]
    >>> bool(np.all(smoothed.deviation["x"] <= run.deviation["x"]))
    True
    """
    return fixed_lag(filtered, np.inf)


def fixed_lag(filtered: Filtered, lag: float) -> Smoothed:
    """Estimate the state at each instant from the readings up to `lag` later, as in real time with this lag.

    Args:
        filtered: a run with its covariances.
        lag: [s]; 0 is the filter's own estimate, infinite is `smooth`.

    Raises ArgumentError as `smooth` does.

    >>> parts = [gt.filtering.StatePart("x", unit="m")]
    >>> process = gt.filtering.DiscreteProcess(parts, 0.1, lambda s: {"x": s.x}, [1e-4])
    >>> system = gt.filtering.System(process, [gt.filtering.Sensor("tape", "x", deviation=0.01)])
    >>> log = {"tape": gt.filtering.Readings(0.1 * np.arange(9), np.zeros(9))}
    >>> run = gt.filtering.ErrorState(system).run(log, gt.filtering.InitialState({}, {"x": 1.0}))
    >>> later = gt.filtering.fixed_lag(run, 0.2)
    >>> later.deviation["x"][4].round(4), run.deviation["x"][4].round(4)
    (np.float64(0.0067), np.float64(0.0079))
    """
    if not lag >= 0:
        raise ArgumentError(f"expected at least 0 s; found {lag}", "lag")
    if filtered.kept is None:
        raise ArgumentError("the covariances were not kept; run with keep=True", "filtered")
    if not filtered.kept:
        raise ArgumentError(f"the run holds no instant: {filtered.message}", "filtered")
    space = filtered.system.space
    back = _Backward.of(filtered)
    K = len(filtered.time)
    # for each instant the last one whose readings count; instants with the same last one share a backward pass
    slack = 1e-9 * max(1.0, float(np.max(np.abs(filtered.time)))) if np.isfinite(lag) else 0.0
    last = np.searchsorted(filtered.time, filtered.time + lag + slack, side="right") - 1
    last = np.maximum(last, np.arange(K))
    ends, first = np.unique(last, return_index=True)
    x, P = back.x.copy(), back.P.copy()
    k, x_k, P_k = ends.copy(), back.x[ends].copy(), back.P[ends].copy()
    while True:
        going = k > first
        if not going.any():
            break
        k, x_k, P_k = k[going], x_k[going], P_k[going]
        ends, first = ends[going], first[going]
        x_k, P_k = back.step(space, k, x_k, P_k)
        k = k - 1
        reached = last[k] == ends
        x[k[reached]], P[k[reached]] = x_k[reached], P_k[reached]
    deviations = np.sqrt(np.einsum("kmii->kmi", P))
    errors = nees = None
    if filtered.errors is not None:
        truth = space.plus(filtered.x, filtered.errors)
        errors = space.minus(truth, x)
        n = space.dimension
        nees = normalised_square(errors.reshape(-1, n), P.reshape(-1, n, n)).reshape(errors.shape[:2])
    return Smoothed(filtered.system, filtered.time, x, deviations, errors, float(lag), P, nees)


@dataclass(frozen=True, eq=False)
class _Backward:
    """For all instants (K, m, ...): beliefs after and before the readings, and the gain from each instant to the
    previous one, unused at the first instant."""

    x: np.ndarray
    P: np.ndarray
    before: np.ndarray
    gain: np.ndarray
    rest: np.ndarray
    Q: np.ndarray

    @classmethod
    def of(cls, filtered: Filtered) -> _Backward:
        records = filtered.kept or ()
        if not all(isinstance(k.step, Advance) for k in records):
            raise ArgumentError(
                "smoothing needs Jacobians of the steps, which this filter does not keep; run ErrorState over the log, "
                "or ScheduledNoise with the likely modes of interacting models",
                "filtered",
            )
        x, P = np.array([k.after.x for k in records]), np.array([k.after.P for k in records])
        before, P_before = np.array([k.before.x for k in records]), np.array([k.before.P for k in records])
        F, Q = (
            np.array([np.broadcast_to(m, P.shape[1:]) for m in matrices])
            for matrices in zip(*[k.step[1:] for k in records], strict=True)
        )
        gain = np.zeros_like(P)
        gain[1:] = _gain(F[1:] @ P[:-1], P_before[1:])
        return cls(x, P, before, gain, np.eye(P.shape[-1]) - gain @ F, Q)

    def step(self, space: Manifold, k: np.ndarray, x: np.ndarray, P: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """From smoothed states at instants k (c, m, ...) to those at k - 1; the covariance is a sum of squares, so it
        stays positive."""
        G, A = self.gain[k], self.rest[k]
        d = space.minus(x, self.before[k])
        ahead = P
        if not space.flat:  # the axes of an error rotate with its point
            J = _carried(space, self.before[k], d)
            ahead = np.linalg.solve(J, np.swapaxes(np.linalg.solve(J, P), -1, -2))
        d = (G @ d[..., None])[..., 0]
        P_smoothed = A @ self.P[k - 1] @ np.swapaxes(A, -1, -2) + G @ (ahead + self.Q[k]) @ np.swapaxes(G, -1, -2)
        if not space.flat:
            J = _carried(space, self.x[k - 1], d)
            P_smoothed = J @ P_smoothed @ np.swapaxes(J, -1, -2)
        return space.plus(self.x[k - 1], d), (P_smoothed + np.swapaxes(P_smoothed, -1, -2)) / 2


def _carried(space: Manifold, x: np.ndarray, d: np.ndarray) -> np.ndarray:
    rows = space.carried(x.reshape(-1, space.size), d.reshape(-1, space.dimension))
    return rows.reshape(*d.shape, space.dimension)


def _gain(FP: np.ndarray, P_before: np.ndarray) -> np.ndarray:
    """P F' P_before^-1, with P_before scaled to a diagonal of ones; exactly known directions are not corrected."""
    variance = np.einsum("...ii->...i", P_before)
    scale = np.where(variance > 0, 1.0 / np.sqrt(np.where(variance > 0, variance, 1.0)), 0.0)
    unit = P_before * scale[..., :, None] * scale[..., None, :]
    right = scale[..., :, None] * FP
    try:
        np.linalg.cholesky(unit)
        solved = np.linalg.solve(unit, right)
    except np.linalg.LinAlgError:
        solved = np.linalg.pinv(unit, rcond=SINGULAR, hermitian=True) @ right
    return np.swapaxes(scale[..., :, None] * solved, -1, -2)
