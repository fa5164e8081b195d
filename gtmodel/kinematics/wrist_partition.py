"""All branches of the inverse kinematics of a six-axis arm with a spherical wrist, partitioned at the wrist centre."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..geometry.rotations import within_pi
from ..results import Status

# below this sine or relative distance, the angle that it determines has fewer than ten correct digits
SINGULAR = 1e-6
# tolerance of the elbow's cosine: with the arm straight, rounding can exceed 1
EDGE = 1e-12
# tolerance of joint limits against rounding [rad]
ON_LIMIT = 1e-9
AXES = np.array([[0, 0, -1], [0, 1, 0], [0, 1, 0], [-1, 0, 0], [0, 1, 0], [-1, 0, 0]], float)
# for each branch: shoulder in front (1) or behind (-1), sign of the elbow angle, sign of q5
SIDES = np.array([[s, e, w] for s in (1, -1) for e in (1, -1) for w in (1, -1)])


@dataclass(frozen=True, eq=False)
class InverseBranches:
    """Joint angles on the eight branches of n poses: q (n, 8, 6) [rad], NaN without a solution, and status (n, 8).

    SINGULAR: the branch exists, but the shoulder (wrist centre on axis 1), the elbow (arm straight or folded) or the
    wrist (axes 4 and 6 aligned) is singular: joints can move while the pose stays constant, or two branches meet. q is
    then one of the solutions. OUT_OF_RANGE: the wrist centre is out of reach.
    """

    q: np.ndarray
    status: np.ndarray

    def within(self, limits: ArrayLike, pose: int = 0) -> tuple[np.ndarray, np.ndarray]:
        """Return all joint angles (k, 6) of one pose within the limits (6, 2) [rad], and their branches (k,).

        Each joint may be rotated by multiples of 360 degrees. The result is empty if no solution is within the limits.
        """
        low, high = np.asarray(limits, float).reshape(6, 2).T
        rows, branches = [], []
        for branch, angles in enumerate(self.q[pose]):
            if not np.all(np.isfinite(angles)):
                continue
            first = np.ceil((low - ON_LIMIT - angles) / (2 * np.pi))
            last = np.floor((high + ON_LIMIT - angles) / (2 * np.pi))
            turns = [np.arange(a, b + 1) for a, b in zip(first, last, strict=True)]
            grid = np.stack(np.meshgrid(*turns, indexing="ij"), axis=-1).reshape(-1, 6)
            rows.append(angles + 2 * np.pi * grid)
            branches.append(np.full(len(grid), branch))
        if not rows:
            return np.zeros((0, 6)), np.zeros(0, int)
        return np.concatenate(rows), np.concatenate(branches)


@dataclass(frozen=True)
class WristPartition:
    """Inverse kinematics of a six-axis arm with a spherical wrist, from its lengths [m].

    At q = 0 the axes point along -z, y, y, -x, y, -x, and the flange points along x, with orientation Ry(90 deg).

    `base` is the position of axis 2 (offset along x, height), `upper` the distance from axis 2 to axis 3, `fore` (2,)
    the displacement from axis 3 to the wrist centre along x and z, `flange` the distance from the wrist centre to the
    flange.

    >>> robot = gt.robots.kr500()
    >>> arm = gt.kinematics.WristPartition.of(robot.origins, robot.axes)
    >>> branches = arm.inverse([1.5, 0.4, 1.2], np.diag([1.0, -1.0, -1.0]))  # flange points down
    >>> np.degrees(branches.q[0, 0, :3]).round(1), (branches.status == gt.Status.OK).all()  # all eight branches exist
    (array([-14.9, -72.1, 119.5]), np.True_)
    """

    base: tuple[float, float]
    upper: float
    fore: tuple[float, float]
    flange: float

    @classmethod
    def of(cls, origins: ArrayLike, axes: ArrayLike) -> WristPartition:
        """Return the arm with axis origins (6, 3) [m], each in the preceding frame, and axis directions (6, 3).

        `kr500` and the other arms of `SphericalWristArm` have both as parameters; arms from a URDF do not. Raises
        ValueError for an arm of another kind.
        """
        o, a = np.asarray(origins, float), np.asarray(axes, float)
        if a.shape != (6, 3) or not np.allclose(a, AXES):
            raise ValueError(
                f"this arm has no wrist of the expected form: its axes are {a.tolist()}; expected -z, y, y, -x, "
                "y, -x at q = 0, as in the KR 500-3"
            )
        expected = o * [[0, 0, 1], [1, 0, 1], [1, 0, 0], [1, 0, 1], [0, 0, 0], [1, 0, 0]]
        if o.shape != (6, 3) or not np.array_equal(o, expected):
            raise ValueError(
                "the axis origins must lie in the plane y = 0 at q = 0, and axes 4, 5 and 6 must intersect in one point"
            )
        return cls((o[1, 0], o[0, 2] + o[1, 2]), o[2, 0], (o[3, 0], o[3, 2]), o[5, 0])

    @property
    def reach(self) -> tuple[float, float]:
        """Smallest and largest distance of the wrist centre from axis 2 [m]."""
        fore = float(np.hypot(*self.fore))
        return abs(self.upper - fore), self.upper + fore

    def inverse(self, T: ArrayLike, R: ArrayLike) -> InverseBranches:
        """Return the branches of flange poses T (n, 3) [m] and R (n, 3, 3), in the order of SIDES.

        A pose that is not finite has the status NOT_FINITE. Raises ValueError for other shapes.
        """
        T, R = np.atleast_2d(np.asarray(T, float)), np.asarray(R, float).reshape(-1, 3, 3)
        if T.ndim != 2 or T.shape[1] != 3 or len(T) != len(R):
            raise ValueError(f"T has shape {T.shape} for {len(R)} orientations; expected ({len(R)}, 3)")
        centre = T - self.flange * R[:, :, 2]
        q, status = np.full((len(T), 8, 6), np.nan), np.empty((len(T), 8), int)
        for k, (shoulder, elbow, wrist) in enumerate(SIDES):
            q[:, k, :3], arm, ok = self._arm(centre, shoulder, elbow)
            q[:, k, 3:], wrist_singular = self._wrist(R, q[:, k, :3], wrist)
            status[:, k] = np.where(ok, np.where(arm | wrist_singular, Status.SINGULAR, Status.OK), Status.OUT_OF_RANGE)
        finite = np.isfinite(T).all(axis=1) & np.isfinite(R).all(axis=(1, 2))
        status[~finite] = Status.NOT_FINITE
        return InverseBranches(q, status)

    def _arm(self, centre: np.ndarray, shoulder: int, elbow: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return q1..q3 (n, 3), whether they are singular (n,) and whether they exist (n,)."""
        x, y, z = centre.T
        radius = np.hypot(x, y)
        on_axis = radius < SINGULAR * self.upper
        q1 = -np.arctan2(shoulder * y, shoulder * x)
        # wrist centre from axis 2 in the plane of the arm, forwards and downwards, so that angles about y are positive
        u, v = shoulder * radius - self.base[0], self.base[1] - z
        fore, bend = float(np.hypot(*self.fore)), float(np.arctan2(-self.fore[1], self.fore[0]))
        cosine = (u**2 + v**2 - self.upper**2 - fore**2) / (2 * self.upper * fore)
        exists = np.abs(cosine) <= 1 + EDGE
        angle = elbow * np.arccos(np.clip(cosine, -1, 1))
        q2 = np.arctan2(v, u) - np.arctan2(fore * np.sin(angle), self.upper + fore * np.cos(angle))
        q = np.stack([q1, within_pi(q2), within_pi(angle - bend)], axis=1)
        q[~exists] = np.nan
        return q, on_axis | (np.abs(np.sin(angle)) < SINGULAR), exists

    def _wrist(self, R: np.ndarray, q: np.ndarray, side: int) -> tuple[np.ndarray, np.ndarray]:
        """Return q4..q6 (n, 3) and whether they are singular (n,), from Rx(-q4) Ry(q5) Rx(-q6) = M."""
        c1, s1, c, s = np.cos(q[:, 0]), np.sin(q[:, 0]), np.cos(q[:, 1] + q[:, 2]), np.sin(q[:, 1] + q[:, 2])
        zero = np.zeros_like(c1)
        arm = np.stack([c1 * c, s1, c1 * s, -s1 * c, c1, -s1 * s, -s, zero, c], axis=1).reshape(-1, 3, 3)
        last = np.stack([R[:, :, 2], R[:, :, 1], -R[:, :, 0]], axis=2)  # R Ry(-90 deg)
        M = np.swapaxes(arm, 1, 2) @ last
        sine = np.hypot(M[:, 0, 1], M[:, 0, 2])
        q4 = np.arctan2(-side * M[:, 1, 0], -side * M[:, 2, 0])
        q5 = np.arctan2(side * sine, M[:, 0, 0])
        # q6 from q4 and M: with axes 4 and 6 aligned, M determines only q4 + q6
        across = np.cos(q4)[:, None] * M[:, 1] - np.sin(q4)[:, None] * M[:, 2]
        q6 = np.arctan2(across[:, 2], across[:, 1])
        return np.stack([q4, q5, q6], axis=1), sine < SINGULAR
