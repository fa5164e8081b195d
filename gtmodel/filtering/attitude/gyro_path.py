"""Orientation from angular rates: integrated on the rotations themselves, with derivatives by the correction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ...geometry.quaternions import product
from ...geometry.rotations import cross_matrix, left_jacobian

SMALL = 1e-2  # rad; below it sines over angles are their series, whose next term is 1e-14 of the first


@dataclass(frozen=True, eq=False)
class RateCorrection:
    """What makes angular rates of the body out of what a gyro reads: rate = matrix reading - bias [rad/s].

    matrix: (3, 3); it holds scale, misalignment of the axes, and the turn from the sensor to the body. bias: (3,).
    offset: stamp of an event by the clock of the reference less its stamp by the clock of the gyro [s].

    >>> correction = gt.filtering.RateCorrection(1.02 * np.eye(3), np.array([0.0, 0.0, 0.01]))
    >>> correction(np.array([[0.0, 0.0, 1.0]])).round(3).tolist()
    [[0.0, 0.0, 1.01]]
    """

    matrix: np.ndarray
    bias: np.ndarray
    offset: float = 0.0

    @classmethod
    def of(cls, numbers: np.ndarray) -> RateCorrection:
        """From its thirteen numbers: matrix by rows, bias, offset."""
        return cls(np.asarray(numbers[:9]).reshape(3, 3), np.asarray(numbers[9:12]), float(numbers[12]))

    @property
    def numbers(self) -> np.ndarray:
        """Its thirteen numbers."""
        return np.concatenate([self.matrix.ravel(), self.bias, [self.offset]])

    def __call__(self, reading: np.ndarray) -> np.ndarray:
        """Rates of the body (n, 3) from readings (n, 3)."""
        return reading @ self.matrix.T - self.bias


@dataclass(frozen=True, eq=False)
class GyroPath:
    """Turns from the first of k instants to each of them, in the axes of the body at the first one.

    rate: of the body (k, 3) at these instants [rad/s]. derivative: (k, 3, 13), of the error of each turn, in the axes
    of the first instant, by matrix, bias and offset; None where it was not asked for.
    """

    turn: Rotation
    rate: np.ndarray
    derivative: np.ndarray | None = None

    @property
    def between(self) -> Rotation:
        """The turns (k - 1) from each instant to the next one, in the axes of the body."""
        return self.turn[:-1].inv() * self.turn[1:]


def gyro_path(
    time: np.ndarray, reading: np.ndarray, at: np.ndarray, correction: RateCorrection, *, derivative: bool = False
) -> GyroPath:
    """Turns from the first of the instants `at` (k,), by the reference's clock and ascending, to each of them.

    time (n,), reading (n, 3): of the gyro, by its own clock. Rates run straight from sample to sample; the turn of one
    step is exact to the fourth order of its length (Magnus), and steps are multiplied as rotations.
    """
    at = np.asarray(at, float) - correction.offset
    inside = time[(time > at[0]) & (time < at[-1])]
    nodes, place = np.unique(np.concatenate([at, inside]), return_inverse=True)
    own = place[: len(at)]
    read = np.column_stack([np.interp(nodes, time, reading[:, k]) for k in range(3)])
    rate = correction(read)
    h = np.diff(nodes)[:, None]
    a, b = rate[:-1], rate[1:]
    step = h / 2 * (a + b) + h**2 / 12 * _cross(a, b)
    turn = turns(Rotation.from_rotvec(step))
    if not derivative:
        return GyroPath(picked(turn, own), rate[own])
    h, A, B, unit = h[:, :, None], cross_matrix(a), cross_matrix(b), np.eye(3)
    r0, r1 = read[:-1, None, None, :], read[1:, None, None, :]  # against (n, 3, row of the matrix, column of it)
    by_matrix = h[..., None] / 2 * unit[..., None] * (r0 + r1) + h[..., None] ** 2 / 12 * (
        A[..., None] * r1 - B[..., None] * r0
    )
    by_bias = -h * unit + h**2 / 12 * (B - A)
    by = left_jacobian(step) @ np.concatenate([by_matrix.reshape(-1, 3, 9), by_bias], axis=2)
    total = np.concatenate([np.zeros((1, 3, 12)), np.cumsum(turn[:-1].as_matrix() @ by, axis=0)])
    by_offset = rate[own[0]] - picked(turn, own).apply(rate[own])  # both ends of the turn come earlier
    return GyroPath(picked(turn, own), rate[own], np.concatenate([total[own], by_offset[:, :, None]], axis=2))


def picked(rotation: Rotation, rows: Any) -> Rotation:
    """Those that stand in these rows: indices or a mask."""
    return rotation[rows]


def turns(steps: Rotation) -> Rotation:
    """The turns (n + 1) after 0, 1, ... n of these steps, each step in the axes that those before have led to."""
    n = len(steps) + 1
    rows = int(np.ceil(np.sqrt(n)))
    q = np.tile([1.0, 0.0, 0.0, 0.0], (rows * rows, 1))
    q[1:n] = steps.as_quat(scalar_first=True)
    q = q.reshape(rows, rows, 4)
    for k in range(1, rows):  # along all rows at once, then what comes before each row
        q[:, k] = product(q[:, k - 1], q[:, k])
    before = q[:, -1].copy()
    for k in range(1, rows):
        before[k] = product(before[k - 1], before[k])
    q[1:] = product(before[:-1, None], q[1:])
    return Rotation.from_quat(q.reshape(-1, 4)[:n], scalar_first=True)


def _cross(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    return u[..., [1, 2, 0]] * v[..., [2, 0, 1]] - u[..., [2, 0, 1]] * v[..., [1, 2, 0]]
