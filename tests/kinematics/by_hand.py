"""A three-link robot on guideways in plain NumPy: the engines are tested on arrays, without any model."""

from dataclasses import dataclass

import numpy as np

from gtmodel.results import Status


@dataclass(frozen=True)
class ByHand:
    """Closed-form inverse kinematics, carts behind the plate. Called as `InverseKinematics` wants it."""

    A: np.ndarray
    v: np.ndarray
    L: np.ndarray

    def __call__(self, T: np.ndarray):
        n = len(T)
        q, ends = np.full((n, 3), np.nan), []
        status = np.where(np.isfinite(T).all(axis=1), Status.OK, Status.NOT_FINITE)
        for i in range(3):
            d = T - self.A[i]
            dv, vv = d @ self.v[i], self.v[i] @ self.v[i]
            root = dv**2 - vv * ((d**2).sum(axis=1) - self.L[i] ** 2)
            status = np.where((status == Status.OK) & ~(root >= 0), Status.OUT_OF_RANGE, status)
            q[:, i] = (dv - np.sqrt(np.maximum(root, 0.0))) / vv
        q[status != Status.OK] = np.nan
        for i in range(3):
            ends += [self.A[i] + q[:, [i]] * self.v[i], np.where(status[:, None] == Status.OK, T, np.nan)]
        return (q, *ends, status)


# Dressler 2012, Table 5.7, tape measure
L1 = ByHand(
    np.array([[0.04, 0.0, 1.44], [0.25, -1.31, 1.46], [0.0, 0.0, 0.0]]),
    np.array([[1.0, 0.0, 0.0]] * 3),
    np.array([2.05, 1.82, 1.81]),
)
HOME = L1.A.mean(axis=0) + 0.7 * L1.L.mean() * L1.v.mean(axis=0)


def disc_intersection_area(centres: np.ndarray, radii: np.ndarray, count: int = 20001) -> float:
    """Area common to three discs, by the trapezoidal rule over the chords' common part."""
    y = np.linspace((centres[:, 0] - radii).max(), (centres[:, 0] + radii).min(), count)
    half = np.sqrt(np.maximum(radii**2 - (y[:, None] - centres[:, 0]) ** 2, 0.0))
    low, high = (centres[:, 1] - half).max(axis=1), (centres[:, 1] + half).min(axis=1)
    return float(np.trapezoid(np.maximum(high - low, 0.0), y))
