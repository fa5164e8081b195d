"""Static load tests of a serial arm: its poses, the loads, and the displacements."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from ..geometry.rotations import cross_matrix


@dataclass(frozen=True, eq=False)
class StaticTests:
    """n tests of an arm with k joints, in world coordinates. Raises ValueError for wrong shapes and for NaN.

    J (n, 6, k): geometric Jacobian at the tool centre point, rows linear [m] then angular [1]; J_wrist (n, 3, k):
    linear, of the wrist centre. wrench (n, 6) [N, N.m] acts at the tool centre point; displacement (n, 6) [m, rad] is
    the loaded less the unloaded pose. covariance (n, 6, 6): of the displacement's noise. wrist_displacement (n, 3) [m]
    with wrist_covariance (n, 3, 3): of a separately measured target at the wrist centre; otherwise it follows from the
    pose and `lever` (n, 3) [m], from the tool centre point to the wrist centre. K_c (n, k, k) [N.m/rad]: complementary
    stiffness, zero if left out (Cvitanic 2021, eq. (3)).
    """

    J: np.ndarray
    J_wrist: np.ndarray
    wrench: np.ndarray
    displacement: np.ndarray
    covariance: np.ndarray
    lever: np.ndarray
    wrist_displacement: np.ndarray | None = None
    wrist_covariance: np.ndarray | None = None
    K_c: np.ndarray | None = None

    def __post_init__(self) -> None:
        n, k = len(self.J), self.J.shape[-1]
        shapes = {
            "J": (n, 6, k), "J_wrist": (n, 3, k), "wrench": (n, 6), "displacement": (n, 6), "covariance": (n, 6, 6),
            "lever": (n, 3), "wrist_displacement": (n, 3), "wrist_covariance": (n, 3, 3), "K_c": (n, k, k),
        }  # fmt: skip
        for name, shape in shapes.items():
            value = getattr(self, name)
            if value is not None and np.shape(value) != shape:
                raise ValueError(f"{name} has the shape {np.shape(value)}; expected {shape} for {n} tests")
            if value is not None and not np.all(np.isfinite(value)):
                raise ValueError(f"{name} is not finite in test {int(np.argwhere(~np.isfinite(value))[0, 0])}")
        if (self.wrist_displacement is None) != (self.wrist_covariance is None):
            raise ValueError("give both wrist_displacement and wrist_covariance, or neither")

    def with_(self, **changes: np.ndarray | None) -> StaticTests:
        """Return the tests with some arrays replaced. Raises ValueError as the constructor."""
        return replace(self, **changes)

    @property
    def torque(self) -> np.ndarray:
        """Joint torques J'F (n, k) [N.m] of the load, eq. (6)."""
        return np.einsum("nik,ni->nk", self.J, self.wrench)

    def wrist(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the displacement of the wrist centre (n, 3), its covariance (n, 3, 3), and its covariance with the
        tool's linear displacement, tool by wrist (n, 3, 3)."""
        if self.wrist_displacement is not None and self.wrist_covariance is not None:
            return self.wrist_displacement, self.wrist_covariance, np.zeros((len(self.J), 3, 3))
        B = np.concatenate([np.tile(np.eye(3), (len(self.J), 1, 1)), -cross_matrix(self.lever)], axis=2)
        displacement = np.einsum("nij,nj->ni", B, self.displacement)
        with_pose = self.covariance @ np.swapaxes(B, 1, 2)
        return displacement, B @ with_pose, with_pose[:, :3]


def at_tool(J: ArrayLike, arm: ArrayLike) -> np.ndarray:
    """Return Jacobians (n, 6, k) of a point displaced by `arm` (n, 3) [m], world coordinates, from J (n, 6, k).

    >>> J = np.array([[[0], [0], [0], [0], [0], [1.0]]])  # one joint about z through the point
    >>> gt.compliance.at_tool(J, [[0.5, 0, 0]])[0, :, 0]
    array([0. , 0.5, 0. , 0. , 0. , 1. ])
    """
    J, arm = np.asarray(J, float), np.asarray(arm, float)
    linear = J[:, :3] + np.cross(J[:, 3:], arm[:, :, None], axis=1)
    return np.concatenate([linear, J[:, 3:]], axis=1)
