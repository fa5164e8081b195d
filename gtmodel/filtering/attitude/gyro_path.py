"""Orientation from integrated angular rates, with derivatives, and the noise between references and gyro."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
import scipy
from scipy.spatial.transform import Rotation

from ...geometry.quaternions import product
from ...geometry.rotations import cross_matrix, left_jacobian

SMALL = 1e-2  # rad; below it sin(x) / x is a series, whose next term is 1e-14 of the first


@dataclass(frozen=True, eq=False)
class RateCorrection:
    """Correction from gyro readings to angular rates of the body: rate = matrix reading - bias [rad/s].

    matrix: (3, 3); scale, misalignment of the axes, and the rotation from the sensor to the body. bias: (3,).
    offset: stamp of an event by the clock of the reference minus its stamp by the clock of the gyro [s].
    drift: (k, 3), change of the bias with each of k conditions, such as the time, which are further columns of the
        readings, see `gtmodel.measurements.drift.DriftBasis`.

    >>> correction = gt.filtering.RateCorrection(1.02 * np.eye(3), np.array([0.0, 0.0, 0.01]))
    >>> correction(np.array([[0.0, 0.0, 1.0]])).round(3).tolist()
    [[0.0, 0.0, 1.01]]
    """

    matrix: np.ndarray
    bias: np.ndarray
    offset: float = 0.0
    drift: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))

    @classmethod
    def of(cls, numbers: np.ndarray) -> RateCorrection:
        """Make a correction from its 13 + 3 k numbers: matrix by rows, bias, offset, drift by rows."""
        matrix, bias, offset, drift = numbers[:9], numbers[9:12], float(numbers[12]), numbers[13:]
        return cls(np.reshape(matrix, (3, 3)), np.asarray(bias), offset, np.reshape(drift, (-1, 3)))

    @property
    def numbers(self) -> np.ndarray:
        """Its 13 + 3 k numbers."""
        return np.concatenate([self.matrix.ravel(), self.bias, [self.offset], self.drift.ravel()])

    def __call__(self, reading: np.ndarray) -> np.ndarray:
        """Return the rates of the body (n, 3) from readings (n, 3 + k)."""
        return reading[:, :3] @ self.matrix.T - self.bias - reading[:, 3:] @ self.drift


@dataclass(frozen=True, eq=False)
class GyroPath:
    """Rotations from the first of k instants to each of them, in the axes of the body at the first one.

    rate: of the body (k, 3) at these instants [rad/s]. derivative: (k, 3, n), derivative of the error of each
    rotation, in the axes of the first instant, by the numbers of the correction; None if not requested.
    """

    turn: Rotation
    rate: np.ndarray
    derivative: np.ndarray | None = None

    @property
    def between(self) -> Rotation:
        """Rotations (k - 1) from each instant to the next one, in the axes of the body."""
        return self.turn[:-1].inv() * self.turn[1:]


def gyro_path(
    time: np.ndarray, reading: np.ndarray, at: np.ndarray, correction: RateCorrection, *, derivative: bool = False
) -> GyroPath:
    """Rotations from the first of the ascending instants `at` (k,), by the reference's clock, to each of them.

    time (n,), reading (n, 3 + k): of the gyro, by its own clock, and conditions of a drift. Rates are linear
    between samples; each step is exact to fourth order (Magnus), and steps are multiplied as rotations.
    """
    at = np.asarray(at, float) - correction.offset
    inside = time[(time > at[0]) & (time < at[-1])]
    nodes, place = np.unique(np.concatenate([at, inside]), return_inverse=True)
    ends = place[: len(at)]
    read = np.column_stack([np.interp(nodes, time, column) for column in reading.T])
    rate = correction(read)
    h = np.diff(nodes)[:, None]
    a, b = rate[:-1], rate[1:]
    step = h / 2 * (a + b) + h**2 / 12 * _cross(a, b)
    turn = turns(Rotation.from_rotvec(step))
    if not derivative:
        return GyroPath(picked(turn, ends), rate[ends])
    h, A, B, unit = h[:, :, None], cross_matrix(a), cross_matrix(b), np.eye(3)
    r0, r1 = read[:-1, None, None, :3], read[1:, None, None, :3]  # against (n, 3, row of the matrix, column of it)
    by_matrix = h[..., None] / 2 * unit[..., None] * (r0 + r1) + h[..., None] ** 2 / 12 * (
        A[..., None] * r1 - B[..., None] * r0
    )
    by_bias = -h * unit + h**2 / 12 * (B - A)
    c0, c1 = read[:-1, 3:].T[:, :, None, None], read[1:, 3:].T[:, :, None, None]
    by_drift = -h / 2 * (c0 + c1) * unit + h**2 / 12 * (c0 * B - c1 * A)  # (k, nodes, 3, 3)
    slopes = left_jacobian(step) @ np.concatenate([by_matrix.reshape(-1, 3, 9), by_bias, *by_drift], axis=2)
    along = np.cumsum(turn[:-1].as_matrix() @ slopes, axis=0)
    total = np.concatenate([np.zeros((1, *along.shape[1:])), along])[ends]
    by_offset = rate[ends[0]] - picked(turn, ends).apply(rate[ends])  # both ends move to earlier times
    derivative_ = np.concatenate([total[:, :, :12], by_offset[:, :, None], total[:, :, 12:]], axis=2)
    return GyroPath(picked(turn, ends), rate[ends], derivative_)


def picked(rotation: Rotation, rows: Any) -> Rotation:
    """Rotations in these rows: indices or a mask."""
    return rotation[rows]


def turns(steps: Rotation) -> Rotation:
    """Rotations (n + 1) after 0, 1, ... n of these steps, each in the axes reached by the previous ones."""
    n = len(steps) + 1
    rows = int(np.ceil(np.sqrt(n)))
    q = np.tile([1.0, 0.0, 0.0, 0.0], (rows * rows, 1))
    q[1:n] = steps.as_quat(scalar_first=True)
    q = q.reshape(rows, rows, 4)
    for k in range(1, rows):  # products within all rows at once, then the product before each row
        q[:, k] = product(q[:, k - 1], q[:, k])
    before = q[:, -1].copy()
    for k in range(1, rows):
        before[k] = product(before[k - 1], before[k])
    q[1:] = product(before[:-1, None], q[1:])
    return Rotation.from_quat(q.reshape(-1, 4)[:n], scalar_first=True)


def _cross(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    return u[..., [1, 2, 0]] * v[..., [2, 0, 1]] - u[..., [2, 0, 1]] * v[..., [1, 2, 0]]


START = (3e-3, 1e-2, 1e-4, 0.3)  # s, 1, rad, s: initial guess of the maximum-likelihood noise
LIMITS = ((1e-5, 0.1), (1e-5, 1.0), (1e-7, 0.1), (1e-2, 10.0))
SEARCH = 250  # largest number of evaluations of the likelihood


@dataclass(frozen=True)
class ReferenceNoise:
    """Standard deviations of the three disagreements between references and gyro.

    timing: of the stamps of the references [s]; the error is along the rate, and neighbouring intervals share it.
    relative: of the gyro's rotations, as a fraction of them, with the correlation time `persistence` [s] of an
    Ornstein-Uhlenbeck process. floor: of the references themselves [rad], independent between intervals.

    >>> noise = gt.filtering.ReferenceNoise(timing=3e-3, relative=0.01, floor=0.0, persistence=2.0)
    >>> noise.turn_covariance(np.array([0.1, 0.1]), np.array([0.0, 2.0])).round(9).tolist()
    [[1e-06, 3.68e-07], [3.68e-07, 1e-06]]
    """

    timing: float
    relative: float
    floor: float
    persistence: float

    def timing_covariance(self, rate: np.ndarray) -> np.ndarray:
        """Return the covariance (k, 3, 3) of the orientation at these rates (k, 3), in the axes of the body."""
        return self.timing**2 * rate[:, :, None] * rate[:, None, :]

    def turn_covariance(self, angle: np.ndarray, middle: np.ndarray) -> np.ndarray:
        """Return the covariance (k, k) of rotations by these angles around these instants; equal about all axes."""
        memory = np.exp(-np.abs(middle[:, None] - middle) / self.persistence)
        return self.relative**2 * np.outer(angle, angle) * memory + self.floor**2 * np.eye(len(angle))

    def covariance(self, turn: Rotation, rate: np.ndarray, time: np.ndarray) -> np.ndarray:
        """Return the covariance (3 k, 3 k) of the residuals over k intervals, each in the axes of the body at its end.

        turn: rotation of the reference over the intervals. rate (k + 1, 3), time (k + 1,): at their ends.
        """
        k = len(turn)
        timing, back, n = self.timing_covariance(rate), turn.inv().as_matrix(), np.arange(k)
        C = np.zeros((k, 3, k, 3))
        C[n, :, n, :] = back @ timing[:-1] @ np.swapaxes(back, 1, 2) + timing[1:]
        shared = -timing[1:-1] @ np.swapaxes(back[1:], 1, 2)
        C[n[:-1], :, n[1:], :] = shared
        C[n[1:], :, n[:-1], :] = np.swapaxes(shared, 1, 2)
        relative = self.turn_covariance(turn.magnitude(), (time[1:] + time[:-1]) / 2)
        return C.reshape(3 * k, 3 * k) + np.kron(relative, np.eye(3))


BLOCK = 150  # intervals with correlated noise, ten seconds: keeps the cost linear in their number


def blocks_of(count: int) -> list[slice]:
    """Intervals 0 .. count in consecutive blocks of equal length, at most `BLOCK`."""
    edges = np.linspace(0, count, max(1, -(-count // BLOCK)) + 1).round().astype(int)
    return [slice(int(a), int(b)) for a, b in pairwise(edges)]


def factors(noise: ReferenceNoise, turn: Rotation, rate: np.ndarray, time: np.ndarray) -> list[np.ndarray]:
    """Cholesky factors of the residual covariance of each block; blocks count as independent.

    Raises LinAlgError if one is not positive definite.
    """
    return [
        np.linalg.cholesky(noise.covariance(turn[b], rate[b.start : b.stop + 1], time[b.start : b.stop + 1]))
        for b in blocks_of(len(turn))
    ]


def whitened(roots: Sequence[np.ndarray], rows: np.ndarray) -> np.ndarray:
    """Rows (3 k, ...), whitened block by block."""
    ends = np.cumsum([0, *(len(L) for L in roots)])
    parts = [
        scipy.linalg.solve_triangular(L, rows[a:b], lower=True)
        for L, a, b in zip(roots, ends[:-1], ends[1:], strict=True)
    ]
    return np.concatenate(parts)


@dataclass(frozen=True, eq=False)
class NoiseChain:
    """The residuals as a Markov chain, for `ReferenceNoise.covariance` at a cost linear in the number of intervals.

    Each of k intervals has three gyro errors, an Ornstein-Uhlenbeck process with unit deviation, and each reference an
    error of its stamp. They are ordered stamp, gyro, stamp, gyro, ..., stamp: their precision, and that after the
    residuals are known, has four bands beside the diagonal.

    angle: rotation over each interval (k,). step: time between the middles (k - 1,) [s]. before, after: derivative of a
    residual by the stamp errors before and after it (k, 3).
    """

    angle: np.ndarray
    step: np.ndarray
    before: np.ndarray
    after: np.ndarray

    @classmethod
    def of(cls, turn: Rotation, rate: np.ndarray, time: np.ndarray) -> NoiseChain:
        """Arguments as in `ReferenceNoise.covariance`."""
        middle = (time[1:] + time[:-1]) / 2
        return cls(turn.magnitude(), np.diff(middle), -turn.inv().apply(rate[:-1]), rate[1:])

    def gram(self, noise: ReferenceNoise, rows: np.ndarray) -> tuple[np.ndarray, float]:
        """Return rows' C^-1 rows (m, m) of rows (3 k, m), and log det C, for the covariance C of the residuals.

        By the matrix inversion lemma on the banded precision. The relative error is about round-off times the ratio of
        C to floor^2. Raises LinAlgError if C is not positive definite.
        """
        k, gyro = len(self.angle), slice(1, None)
        a = self.angle * noise.relative / noise.floor
        before, after = (noise.timing / noise.floor * d for d in (self.before, self.after))
        scaled = rows.reshape(k, 3, -1) / noise.floor
        memory = np.exp(-self.step / noise.persistence)
        fresh = 1 - memory**2
        bands = np.zeros((5, 4 * k + 1))  # bands[d, i] is the entry (i + d, i)
        per_interval = bands[:, :-1].reshape(5, k, 4)  # stamp before it, then its three gyro errors
        per_interval[0, :, 0] = 1 + np.sum(before**2, axis=1)
        bands[0, -1] = 1.0
        bands[0, 4::4] += np.sum(after**2, axis=1)
        process = np.ones(k)
        process[1:] = 1 / fresh
        process[:-1] += memory**2 / fresh
        per_interval[0, :, gyro] = (process + a**2)[:, None]
        per_interval[4, :-1, gyro] = (-memory / fresh)[:, None]
        per_interval[4, :, 0] = np.sum(before * after, axis=1)
        for axis in range(3):
            per_interval[1 + axis, :, 0] = a * before[:, axis]
            per_interval[3 - axis, :, 1 + axis] = a * after[:, axis]
        root = scipy.linalg.cholesky_banded(bands, lower=True, overwrite_ab=True, check_finite=False)
        seen = np.zeros((4 * k + 1, rows.shape[1]))  # derivatives of the residuals, transposed, times the rows
        by_interval = seen[:-1].reshape(k, 4, -1)
        by_interval[:, 0] = np.einsum("ka,kam->km", before, scaled)
        by_interval[:, gyro] = a[:, None, None] * scaled
        seen[4::4] += np.einsum("ka,kam->km", after, scaled)
        explained = seen.T @ scipy.linalg.cho_solve_banded((root, True), seen, check_finite=False)
        flat = scaled.reshape(3 * k, -1)
        log_determinant = 2 * np.log(root[0]).sum() + 3 * np.log(fresh).sum() + 6 * k * np.log(noise.floor)
        return flat.T @ flat - explained, float(log_determinant)


def likeliest_noise(
    residual: np.ndarray,
    J: np.ndarray,
    turn: Rotation,
    rate: np.ndarray,
    time: np.ndarray,
    guess: ReferenceNoise,
    ask: Callable[[], None] = lambda: None,
) -> tuple[ReferenceNoise, float]:
    """Maximum-likelihood noise of residuals (3 k,), and their log-likelihood.

    J (3 k, n): Jacobian of the residuals by the fitted numbers. ask: called at each evaluation; may raise.
    The likelihood is the restricted one (REML), since the full one underestimates the noise after a fit: Patterson and
    Thompson 1971, Biometrika 58, 545-554.
    """
    low, high = np.log(np.array(LIMITS)).T
    rows = np.column_stack([J, residual])
    size = np.linalg.norm(rows, axis=0)
    rows, chain = rows / size, NoiseChain.of(turn, rate, time)

    def cost(x: np.ndarray) -> float:
        if np.any(x < low) or np.any(x > high):
            return np.inf
        ask()
        try:
            gram, log_determinant = chain.gram(ReferenceNoise(*np.exp(x)), rows)
            root = np.diag(np.linalg.cholesky(gram)) * size
        except np.linalg.LinAlgError:
            return np.inf
        squares, logs = root[-1] ** 2, np.log(root[:-1]).sum() + 0.5 * log_determinant
        return float(0.5 * squares + logs + 0.5 * (len(rows) - J.shape[1]) * np.log(2 * np.pi))

    start = (guess.timing, guess.relative, guess.floor, guess.persistence)
    options = {"xatol": 0.02, "fatol": 0.02, "maxfev": SEARCH}
    best = scipy.optimize.minimize(cost, np.log(start), method="Nelder-Mead", options=options)
    return ReferenceNoise(*(float(v) for v in np.exp(best.x))), -float(best.fun)
