"""Smoothing: what the readings after an instant say of it too, over the whole log or a fixed time later."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..results.refusal import ArgumentError
from .filtered import Estimates, Filtered, normalised_square
from .manifold import Manifold
from .transition import Advance

SINGULAR = 1e-13  # of a covariance scaled to a diagonal of ones: directions below that are not uncertain at all


@dataclass(frozen=True, eq=False)
class Smoothed(Estimates):
    """Smoothed states: K instants of m runs; of a single run the arrays have no axis of runs.

    time: of the instants [s]. lag: how long after each instant readings were used [s], infinite for all of them.
    x: means (K, m, size). P: covariances (K, m, n, n). errors, nees: where the truth was given to the filter, as in
        `Filtered`.

    smoothed["p"] is the mean of a state, smoothed.deviation["p"] the standard deviation of its error.
    """

    lag: float
    P: np.ndarray
    nees: np.ndarray | None

    @property
    def covariances(self) -> np.ndarray:
        """Covariances of the errors (K, n, n) of a single run, (m, K, n, n) of several."""
        return self._shown(self.P)


def smooth(filtered: Filtered) -> Smoothed:
    """What all readings of a log say of the state at each of its instants: smoothing over a fixed interval.

    Rauch, Tung and Striebel's recursion from the last instant to the first, with minus and plus of the manifold. Where
    process and sensors are linear it is the least-squares estimate from the whole log; else it linearises where the
    filter did.

    filtered: a run whose covariances were kept: of a single run they are, of several with `keep=True`.
    Raises ArgumentError where they were not, and for a filter that gives no Jacobian of its steps.

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
    """What the readings up to a time `lag` after each instant say of it: an estimate that a machine has `lag` later.

    Args:
        filtered: a run whose covariances were kept.
        lag: [s], at least 0, which is the filter's own estimate; infinite: `smooth`.

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
    # of each instant the last one whose readings are used; instants with the same end share one way back
    slack = 1e-9 * max(1.0, float(np.max(np.abs(filtered.time)))) if np.isfinite(lag) else 0.0
    last = np.searchsorted(filtered.time, filtered.time + lag + slack, side="right") - 1
    last = np.maximum(last, np.arange(K))
    ends, first = np.unique(last, return_index=True)
    x, P = back.x.copy(), back.P.copy()
    at, own_x, own_P = ends.copy(), back.x[ends].copy(), back.P[ends].copy()
    while True:
        going = at > first
        if not going.any():
            break
        at, own_x, own_P = at[going], own_x[going], own_P[going]
        ends, first = ends[going], first[going]
        own_x, own_P = back.step(space, at, own_x, own_P)
        at = at - 1
        mine = last[at] == ends
        x[at[mine]], P[at[mine]] = own_x[mine], own_P[mine]
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
    """Of all instants (K, m, ...): beliefs after readings, before them, and the gain from each instant to the one
    before it; at the first instant it is not used."""

    x: np.ndarray
    P: np.ndarray
    before: np.ndarray
    gain: np.ndarray
    rest: np.ndarray
    Q: np.ndarray

    @classmethod
    def of(cls, filtered: Filtered) -> _Backward:
        kept = filtered.kept or ()
        if not all(isinstance(k.step, Advance) for k in kept):
            raise ArgumentError(
                "this filter keeps no Jacobian of its steps, which smoothing needs; run ErrorState over the log, or "
                "ScheduledNoise with the likely modes of interacting models",
                "filtered",
            )
        x, P = np.array([k.after.x for k in kept]), np.array([k.after.P for k in kept])
        before, P_before = np.array([k.before.x for k in kept]), np.array([k.before.P for k in kept])
        F, Q = (
            np.array([np.broadcast_to(m, P.shape[1:]) for m in of])
            for of in zip(*[k.step[1:] for k in kept], strict=True)
        )
        gain = np.zeros_like(P)
        gain[1:] = _gain(F[1:] @ P[:-1], P_before[1:])
        return cls(x, P, before, gain, np.eye(P.shape[-1]) - gain @ F, Q)

    def step(self, space: Manifold, k: np.ndarray, x: np.ndarray, P: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """From smoothed states at instants k (c, m, ...) to those at k - 1; the covariance as a sum of squares, which
        stays positive."""
        G, A = self.gain[k], self.rest[k]
        d = space.minus(x, self.before[k])
        ahead = P
        if not space.flat:  # the axes of an error turn with the point that it belongs to
            J = _carried(space, self.before[k], d)
            ahead = np.linalg.solve(J, np.swapaxes(np.linalg.solve(J, P), -1, -2))
        d = (G @ d[..., None])[..., 0]
        there = A @ self.P[k - 1] @ np.swapaxes(A, -1, -2) + G @ (ahead + self.Q[k]) @ np.swapaxes(G, -1, -2)
        if not space.flat:
            J = _carried(space, self.x[k - 1], d)
            there = J @ there @ np.swapaxes(J, -1, -2)
        return space.plus(self.x[k - 1], d), (there + np.swapaxes(there, -1, -2)) / 2


def _carried(space: Manifold, x: np.ndarray, d: np.ndarray) -> np.ndarray:
    rows = space.carried(x.reshape(-1, space.size), d.reshape(-1, space.dimension))
    return rows.reshape(*d.shape, space.dimension)


def _gain(FP: np.ndarray, P_before: np.ndarray) -> np.ndarray:
    """P F' P_before^-1, with a diagonal of ones in P_before; what is certain beforehand is not corrected."""
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
