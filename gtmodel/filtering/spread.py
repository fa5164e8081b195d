"""Innovations: covariance of the residuals, gates and outlier weights, gain, normalised square, likelihood."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import scipy.linalg

from .belief import Innovation, all_finite
from .system import SensorGroup, System

_posv: Any = scipy.linalg.get_lapack_funcs("posv", dtype=np.float64)
LOG_TWO_PI = float(np.log(2 * np.pi))


class Solved(NamedTuple):
    """For residuals with covariance S: gain (m, n, k), normalised square (m,), log of the determinant of S (m,), and
    the variance of each residual (m, k)."""

    K: np.ndarray
    nis: np.ndarray
    log_determinant: np.ndarray
    variance: np.ndarray


class UsedNumbers(NamedTuple):
    """Which numbers are used (m, k), and the factors on the variances of their noise, 1 or (m, k)."""

    used: np.ndarray
    larger: np.ndarray | float = 1.0


class Spread(NamedTuple):
    """Residuals of m rows of readings, with their covariance.

    residual: (m, k), zero where not used. S: their covariance (m, k, k). PH: their covariance with the error of the
    state (m, n, k). R: variance of their noise, (1, k) or (m, k). used: (m, k). whole: all are used. gated: (m,
    sensors). edge: log-likelihood of the readings that a gate leaves out, as if they were at its edge (m,); without it,
    closed gates would make a log likelier. loss: term of Huber's loss to add to the log-likelihood of the squares (m,).
    weighed: whether a reading of each sensor counts less (m, sensors). larger: factor on the variance of its noise, 1
    or (m, k). cut: the spread with cut residuals for the innovation, if a reading counts less.
    """

    residual: np.ndarray
    S: np.ndarray
    PH: np.ndarray
    R: np.ndarray
    used: np.ndarray
    whole: bool
    gated: np.ndarray
    edge: np.ndarray | float = 0.0
    loss: np.ndarray | float = 0.0
    weighed: np.ndarray | None = None
    larger: np.ndarray | float = 1.0
    cut: Spread | None = None

    @property
    def choice(self) -> UsedNumbers:
        """The used numbers and weights, so that other models use the same."""
        return UsedNumbers(self.used, self.larger)

    def solved(self) -> Solved:
        """Return gain and likelihood from one factorisation of S; NaN if S is not positive definite.

        S is scaled to a diagonal of ones first: its entries may differ by 1e8.
        """
        if len(self.S) == 1:
            return self._solved_alone()
        variance = self.S.diagonal(0, 1, 2)
        scale = 1.0 / np.sqrt(variance)
        unit = self.S * scale[:, :, None] * scale[:, None, :]
        m, n, k = self.PH.shape
        right = np.empty((m, n + 1, k))
        np.multiply(self.PH, scale[:, None, :], out=right[:, :n])
        white = right[:, n] = self.residual * scale
        diagonal = factors(unit).diagonal(0, 1, 2)
        lost = np.isnan(diagonal).any(axis=1)
        if lost.any():
            unit[lost], right[lost] = np.eye(k), np.nan
        solution = np.linalg.solve(unit, right.mT).mT
        logs = 2 * np.log(diagonal / scale).sum(axis=1)
        return Solved(solution[:, :n] * scale[:, None, :], (white * solution[:, n]).sum(axis=1), logs, variance)

    def _solved_alone(self) -> Solved:
        """`solved` for one row, by plain matrices and LAPACK: NumPy's functions for stacks take four times as long.

        Cholesky's factorisation is as accurate without the scaling, which LU needs.
        """
        n, k = self.PH.shape[1:]
        right = np.empty((1, n + 1, k))
        right[:, :n], right[:, n] = self.PH, self.residual
        L, answer, fault = _posv(self.S[0], right[0].T, lower=1)
        if fault:
            L, answer = np.full((k, k), np.nan), np.full((k, n + 1), np.nan)
        solution = answer.T[None]
        logs = 2 * np.add.reduce(np.log(L.diagonal()), keepdims=True)
        nis = np.dot(self.residual, answer[:, n])
        return Solved(solution[:, :n], nis, logs, self.S.diagonal(0, 1, 2))

    def innovation(self, names: tuple[str, ...], solved: Solved) -> Innovation:
        """Return the innovation of these readings."""
        if self.cut is not None:
            return self.cut.innovation(names, self.cut.solved())
        m, k = self.used.shape
        count = k if self.whole else self.used.sum(axis=1)
        numbers = np.array([k] * m) if self.whole else count
        likelihood = (solved.nis + solved.log_determinant + count * LOG_TWO_PI) * -0.5 + (self.edge + self.loss)
        return Innovation(
            names, self.residual, solved.variance, self.used, solved.nis, numbers, likelihood,
            self.gated, self.weighed, self.whole,
        )  # fmt: skip


def spread_of(
    system: System,
    names: tuple[str, ...],
    residual: np.ndarray,
    S: np.ndarray,
    PH: np.ndarray,
    chosen: UsedNumbers | None = None,
) -> Spread:
    """Spread of the finite readings, or of the chosen ones, after gates and outlier weights.

    S is the covariance of the readings without their noise; the noise is added in place.
    """
    group = system.group(names)
    R = group.variances[None]
    if chosen is None:
        used, whole = np.isfinite(residual), all_finite(residual)
        S += group.noise
    else:
        used, whole = chosen.used, bool(chosen.used.all())
        R = R * chosen.larger
        np.einsum("mkk->mk", S)[...] += R
    s = Spread(residual, S, PH, R, used, whole, np.zeros((len(residual), len(names)), bool))
    s = s if whole else without(s, used)
    if chosen is not None or not (group.gates or group.robust):
        return s
    if group.gates:
        s = _gated(system, group, s)
    return _weighed(system, group, s) if group.robust else s


def _gated(system: System, group: SensorGroup, s: Spread) -> Spread:
    """Without the readings beyond their gates."""
    used, gated, edge = s.used, s.gated, np.zeros(len(s.residual))
    for n, name in group.gates:
        columns = group.rows[n]
        square, count = _own_square(s, columns), used[:, columns].sum(axis=1)
        limit = system.gate_limits(name)[count]
        out = gated[:, n] = square > limit
        if out.any():
            logs = np.linalg.slogdet(s.S[out, columns, columns])[1]
            edge[out] -= 0.5 * (limit[out] + logs + count[out] * LOG_TWO_PI)
        used = used.copy()
        used[:, columns] &= ~gated[:, n, None]
    return without(s, used)._replace(edge=edge) if gated.any() else s


def _weighed(system: System, group: SensorGroup, s: Spread) -> Spread:
    """With larger noise for the readings beyond Huber's k.

    The innovation reports residuals cut at k, whose squares have a known mean, and the likelihood of Huber's loss
    divided by the factor by which it is smaller than a square for true noise.
    """
    weighed = np.zeros(s.gated.shape, bool)
    larger, loss = np.ones(s.residual.shape), np.zeros(len(s.residual))
    for n, name in group.robust:
        columns = group.rows[n]
        square, count = _own_square(s, columns), s.used[:, columns].sum(axis=1)
        limits, factors_ = system.huber_limits(name)
        k, factor = limits[count], factors_[count]
        distance = np.sqrt(square)
        far = weighed[:, n] = distance > k
        larger[:, columns] = np.where(far, distance / k, 1.0)[:, None]
        cut = np.where(far, k, distance)
        # half of this is Huber's loss; the square of the cut residual is in the likelihood already
        loss -= 0.5 * ((cut**2 + np.where(far, 2 * cut * (distance - cut), 0.0)) / factor - cut**2)
    judged = s._replace(loss=loss, weighed=weighed)
    if not weighed.any():
        return judged
    larger = np.where(s.used, larger, 1.0)
    S = s.S.copy()
    np.einsum("mkk->mk", S)[...] += s.R * (larger - 1.0)
    return s._replace(
        S=S, R=s.R * larger, larger=larger, weighed=weighed, cut=judged._replace(residual=s.residual / larger)
    )


def _own_square(s: Spread, columns: slice) -> np.ndarray:
    """Normalised innovation squared of one sensor (m,)."""
    solved = np.linalg.solve(s.S[:, columns, columns], s.residual[:, columns, None])[..., 0]
    return np.sum(solved * s.residual[:, columns], axis=1)


def without(s: Spread, used: np.ndarray) -> Spread:
    """Replace unused readings by independent ones of variance 1 and residual 0, which change no result."""
    S = np.where(used[:, :, None] & used[:, None, :], s.S, 0.0)
    np.einsum("mkk->mk", S)[...] += ~used
    return Spread(
        np.where(used, s.residual, 0.0),
        S,
        np.where(used[:, None, :], s.PH, 0.0),
        np.where(used, s.R, 1.0),
        used,
        bool(used.all()),
        s.gated,
        larger=s.larger,
    )


def factors(matrices: np.ndarray) -> np.ndarray:
    """Cholesky factors (m, n, n); NaN for a matrix that is not positive definite."""
    try:
        return np.linalg.cholesky(matrices)
    except np.linalg.LinAlgError:
        if len(matrices) == 1:
            return np.full_like(matrices, np.nan)
        return np.concatenate([factors(matrix[None]) for matrix in matrices])


def roots(P: np.ndarray) -> np.ndarray:
    """L (m, n, n) with L L' = P for covariances, also singular ones; they are scaled to a diagonal of ones first."""
    scale = np.sqrt(P.diagonal(0, 1, 2))
    safe = np.where(scale > 0, scale, 1.0)
    unit = P / safe[:, :, None] / safe[:, None, :]
    np.einsum("mii->mi", unit)[...] += scale == 0
    L = factors(unit)
    lost = np.isnan(L).any(axis=(1, 2)) & np.isfinite(unit).all(axis=(1, 2))
    if lost.any():
        values, vectors = np.linalg.eigh(unit[lost])
        L[lost] = vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]
    return L * scale[:, :, None]


def moments(d: np.ndarray, weights: np.ndarray, e: np.ndarray | None = None) -> np.ndarray:
    """Sum over k of weights (m, k) times d e' (m, n, n) for errors d and e (m, k, .); e = d if left out."""
    return (d * weights[..., None]).mT @ (d if e is None else e)
