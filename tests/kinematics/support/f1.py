"""The legs of the F1 prototype for a pose of its plate: Dressler 2012, section 4.5, numbers from Table 5.5.

Only what the tests of the assembly modes need, in plain NumPy. Metres and radians. The reading of the figures and
the repairs of the table are those of `gtmodel/robots/data/gantry_tau.toml`.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from functools import cache, cached_property
from importlib.resources import files

import numpy as np
from scipy.optimize import fsolve
from scipy.spatial.transform import Rotation

ARMS = ([0], [1, 2], [3, 4, 5])  # legs of each arm
COORDINATES = ([0], [1, 3], [2, 4, 5])  # of q1..q6 that move each arm
STAGES = 4  # from home to a pose, for the inverse
NEWTON_STEPS = 7
LARGEST_STEP = 0.3  # m or rad
DIFFERENCE = 1e-5  # m or rad


def raw_rotation(u: np.ndarray) -> np.ndarray:
    """The matrix (3, 3) of a quaternion (4,), scalar first, not divided by its norm (below eq. (4.34))."""
    a, b, c, d = u
    return np.array(
        [
            [a * a + b * b - c * c - d * d, 2 * b * c - 2 * a * d, 2 * a * c + 2 * b * d],
            [2 * a * d + 2 * b * c, a * a - b * b + c * c - d * d, 2 * c * d - 2 * a * b],
            [2 * b * d - 2 * a * c, 2 * a * b + 2 * c * d, a * a - b * b - c * c + d * d],
        ]
    )


def turn_x(angle: float) -> np.ndarray:
    """Rotation matrix about x by an angle [rad]."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1, 0, 0], [0, c, -s], [0, s, c]])


def turn_y(angle: float) -> np.ndarray:
    """Rotation matrix about y by an angle [rad]."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


@dataclass(frozen=True)
class F1:
    """The printed numbers in metres: L (6,), A0 (3, 3), v (3,), u1_2, u1_3, u2_3 (4,), r3 (3,), A, B (6, 3)."""

    L: np.ndarray
    A0: np.ndarray
    v: np.ndarray
    u1_2: np.ndarray
    u1_3: np.ndarray
    u2_3: np.ndarray
    r3: np.ndarray
    A: np.ndarray
    B: np.ndarray

    def cart_joints(self, q: np.ndarray) -> np.ndarray:
        """The six joints at the carts (6, 3) for q1..q6."""
        carts = self.A0 + np.outer(q[:3], self.v)
        second = raw_rotation(self.u1_2) @ turn_y(q[3])
        outer, inner = raw_rotation(self.u1_3) @ turn_y(q[4]), raw_rotation(self.u2_3) @ turn_x(q[5])
        return np.vstack(
            [
                carts[0] + self.A[0],
                carts[1] + self.A[1:3] @ second.T,
                carts[2] + (self.r3 + self.A[3:6] @ inner.T) @ outer.T,
            ]
        )

    @cached_property
    def home(self) -> tuple[np.ndarray, np.ndarray]:
        """R and T where all carts are about at q = 0 and the links of each arm about parallel."""
        joints, first = self.cart_joints(np.zeros(6)), (0, 1, 1, 3, 3, 3)
        sides = [2, 4, 5]
        R = Rotation.align_vectors(
            np.array([joints[i] - joints[first[i]] for i in sides]),
            np.array([self.B[i] - self.B[first[i]] for i in sides]),
        )[0].as_matrix()
        centres = np.array([(joints[legs] - self.B[legs] @ R.T).mean(axis=0) for legs in ARMS])
        radii = np.array([self.L[legs].mean() for legs in ARMS])
        guess = centres.mean(axis=0) - [0.0, 1.0, 0.3]
        return R, fsolve(lambda T: np.linalg.norm(T - centres, axis=1) - radii, guess)

    def inverse(self, R: np.ndarray, T: np.ndarray) -> np.ndarray:
        """q1..q6 for a pose, arm by arm, on the branch that home stands on; raises ValueError out of reach."""
        R_home, T_home = self.home
        turned = Rotation.from_matrix(R @ R_home.T).as_rotvec()
        q = np.zeros(6)
        for s in np.linspace(0, 1, STAGES):
            attitude = Rotation.from_rotvec(s * turned).as_matrix() @ R_home
            ends = T_home + s * (T - T_home) + self.B @ attitude.T
            for legs, moved in zip(ARMS, COORDINATES, strict=True):
                self._move(q, moved, legs, ends[legs])
            error = np.max(np.abs(np.linalg.norm(ends - self.cart_joints(q), axis=1) - self.L))
            if not error < 1e-10:
                raise ValueError(f"the pose is out of reach: a leg misses by {error:.1e} m")
        return q

    def _move(self, q: np.ndarray, moved: list[int], legs: list[int], ends: np.ndarray) -> None:
        """Newton with central differences and clipped steps on the coordinates of one arm."""

        def closure(part: np.ndarray) -> np.ndarray:
            trial = q.copy()
            trial[moved] = part
            return np.linalg.norm(ends - self.cart_joints(trial)[legs], axis=1) - self.L[legs]

        for _ in range(NEWTON_STEPS):
            shifts = DIFFERENCE * np.eye(len(moved))
            J = np.array([(closure(q[moved] + d) - closure(q[moved] - d)) / (2 * DIFFERENCE) for d in shifts]).T
            q[moved] += np.clip(np.linalg.lstsq(J, -closure(q[moved]))[0], -LARGEST_STEP, LARGEST_STEP)


@cache
def f1() -> F1:
    """The F1 of Table 5.5."""
    record = tomllib.loads(files("gtmodel.robots").joinpath("data/gantry_tau.toml").read_text())["f1"]
    mm = {k: np.array(record[k]) * 1e-3 for k in ("L_mm", "A0_mm", "r3_mm", "A_bj_mm", "B0_mm")}
    u1_2, u1_3, u2_3, v = (np.array(record[k]) for k in ("u1_2", "u1_3", "u2_3", "v"))
    return F1(mm["L_mm"], mm["A0_mm"], v, u1_2, u1_3, u2_3, mm["r3_mm"], mm["A_bj_mm"], mm["B0_mm"])


@dataclass(frozen=True)
class Poses:
    """n poses with their legs: R (n, 3, 3), T (n, 3), A (n, 6, 3), B (6, 3), L (6,)."""

    R: np.ndarray
    T: np.ndarray
    A: np.ndarray
    B: np.ndarray
    L: np.ndarray


def random_f1_poses(n: int, seed: int, reach: float = 0.3, angle_deg: float = 25.0) -> Poses:
    """n reachable poses within +-reach [m] in each direction and angle_deg about a random axis from home."""
    robot, random = f1(), np.random.default_rng(seed)
    R_home, T_home = robot.home
    R, T, A = [], [], []
    while len(T) < n:
        axis = random.normal(size=3)
        angle = np.radians(angle_deg) * random.uniform(-1, 1)
        attitude = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis)).as_matrix() @ R_home
        position = T_home + random.uniform(-reach, reach, 3)
        try:
            q = robot.inverse(attitude, position)
        except ValueError:
            continue
        R.append(attitude)
        T.append(position)
        A.append(robot.cart_joints(q))
    return Poses(np.array(R), np.array(T), np.array(A), robot.B, robot.L)
