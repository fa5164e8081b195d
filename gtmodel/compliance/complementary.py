"""What adds to joint stiffness: a load that moves with the arm, and a spring that balances joint 2."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike


def complementary_stiffness(J: ArrayLike, wrench: ArrayLike) -> np.ndarray:
    """K_c (n, k, k) [N.m/rad] of eq. (2) (Cvitanic 2021): d(J'F)_i / dq_j at a wrench (n, 6) constant in the world.

    J (n, 6, k): geometric Jacobian of an arm of revolute joints at the point where the wrench acts. K_c is not
    symmetric where a moment acts: a constant moment has no potential. Raises ValueError for other shapes.

    >>> J = gt.compliance.arm_poses(gt.robots.kr500(), [[0.3, -0.9, 2.0, 0.2, -1.1, -0.1]]).J
    >>> K_c = gt.compliance.complementary_stiffness(J, [[0, 0, -4000.0, 0, 0, 0]])
    >>> K_c.shape, np.allclose(K_c[0], K_c[0].T)  # a force alone: symmetric
    ((1, 6, 6), True)
    """
    J, F = np.asarray(J, float), np.asarray(wrench, float)
    if J.ndim != 3 or J.shape[1] != 6 or F.shape != (len(J), 6):
        raise ValueError(f"J and wrench have the shapes {J.shape} and {F.shape}; expected (n, 6, k) and (n, 6)")
    v, w = np.moveaxis(J[:, :3], 1, 2), np.moveaxis(J[:, 3:], 1, 2)  # (n, k, 3)
    k = J.shape[2]
    K = np.empty((len(J), k, k))
    for i in range(k):
        for j in range(k):
            # a joint before i turns axis and arm of i, one after it moves the tool alone
            linear = np.cross(w[:, min(i, j)], v[:, max(i, j)])
            angular = np.cross(w[:, j], w[:, i]) if j < i else np.zeros_like(linear)
            K[:, i, j] = np.sum(linear * F[:, :3] + angular * F[:, 3:], axis=1)
    return K


@dataclass(frozen=True)
class Compensator:
    """A gas or coil spring between the base and the lever of joint 2, both hinges in the plane of the arm.

    `base` [m] and `lever` [m]: distances of its hinges from the axis of joint 2; `angle` [rad]: q2 at which the lever
    points away from the base hinge and the spring is longest. Its force along itself is rate [N/m] times
    (length - rest) [m], and draws the hinges together where positive.

    >>> spring = gt.compliance.Compensator(base=0.3, lever=0.25, rate=8e5, rest=0.2)
    >>> spring.length([0.0, np.pi / 2]).round(3)  # m
    array([0.55 , 0.391])
    """

    base: float
    lever: float
    rate: float
    rest: float
    angle: float = 0.0

    def length(self, q2: ArrayLike) -> np.ndarray:
        """Length of the spring [m] at q2 [rad]."""
        turn = np.asarray(q2, float) - self.angle
        return np.sqrt(self.base**2 + self.lever**2 + 2 * self.base * self.lever * np.cos(turn))

    def torque(self, q2: ArrayLike) -> np.ndarray:
        """Torque on joint 2 [N.m], along positive q2: minus the derivative of the spring's energy."""
        turn, s = np.asarray(q2, float) - self.angle, self.length(q2)
        return self.rate * (s - self.rest) * self.base * self.lever * np.sin(turn) / s

    def stiffness(self, q2: ArrayLike) -> np.ndarray:
        """d torque / d q2 [N.m/rad]: what the spring adds to K_c at joint 2.

        The torque itself is there with and without the load and drops out of the difference.
        """
        turn, s = np.asarray(q2, float) - self.angle, self.length(q2)
        arm = self.base * self.lever
        by_turn = -arm * np.sin(turn) / s  # d length / d q2
        pull = self.rate * (s - self.rest) / s
        return self.rate * self.rest / s**2 * by_turn * arm * np.sin(turn) + pull * arm * np.cos(turn)

    def added(self, K_c: np.ndarray, q: np.ndarray) -> np.ndarray:
        """K_c (n, k, k) with the spring's part at joints q (n, k)."""
        stiffness = np.array(K_c, float)
        stiffness[:, 1, 1] += self.stiffness(np.asarray(q, float)[:, 1])
        return stiffness
