"""Serial chains as lines in space: a product of exponentials, read from any function of joint coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from ...results import ArgumentError
from ..rotations import cross_matrix, rotation_about

SCREW = 1e-11  # relative: a function that differs more is no product of exponentials
TRIALS = 4  # random joint positions at which a function is compared with its product of exponentials
ROUND_OFF = 1e-14  # directions and relative lengths below it are zero


def snapped(x: ArrayLike, size: float = 1.0) -> np.ndarray:
    """Return x with entries within round-off of 0 and +-1 times `size` set to these: fewer operations later."""
    x = np.asarray(x, float) / size
    near = np.round(np.clip(x, -1, 1))
    return np.where(np.abs(x - near) < ROUND_OFF, near, x) * size + 0.0  # no -0


@dataclass(frozen=True, eq=False)
class Chain:
    """A serial chain of n revolute and prismatic joints: pose = exp(S1 q1) ... exp(Sn qn) home.

    At q = 0 axis i has the direction `axes[i]` (unit) and passes through `points[i]` [m]; the point of a prismatic
    joint has no effect. `revolute` (n) tells the kinds, `T` (3) [m] and `R` (3, 3) are the pose at q = 0. Joint
    coordinates are in rad and m, positive about and along the axes. All coordinates are those of the base. Raises
    ArgumentError for other shapes and for directions that are zero.

    >>> from gtmodel.geometry.chains import Chain
    >>> arm = Chain([[0, 0, 1], [0, 0, 1]], [[0, 0, 0], [0.4, 0, 0]], [True, True], T=[0.7, 0, 0])
    >>> T, R = arm.pose([0.0, np.pi / 2])
    >>> T.round(6)
    array([[0.4, 0.3, 0. ]])
    """

    axes: np.ndarray
    points: np.ndarray
    revolute: tuple[bool, ...]
    T: np.ndarray
    R: np.ndarray

    def __init__(
        self, axes: ArrayLike, points: ArrayLike, revolute: Sequence[bool] | None = None,
        T: ArrayLike = (0.0, 0.0, 0.0), R: ArrayLike | None = None,
    ) -> None:  # fmt: skip
        h, o = np.asarray(axes, float), np.asarray(points, float)
        kinds = (True,) * len(h) if revolute is None else tuple(bool(r) for r in revolute)
        if h.ndim != 2 or h.shape[1] != 3 or o.shape != h.shape or len(kinds) != len(h):
            raise ArgumentError(
                f"have the shapes {h.shape} and {o.shape} for {len(kinds)} joints; expected (n, 3) each", "axes"
            )
        lengths = np.linalg.norm(h, axis=1)
        if not np.all(lengths > 0) or not np.isfinite(o).all() or not np.isfinite(lengths).all():
            raise ArgumentError(f"are {h.tolist()}; expected finite directions that are not zero", "axes")
        for name, value in {
            "axes": snapped(h / lengths[:, None]),
            "points": o + 0.0,
            "revolute": kinds,
            "T": np.asarray(T, float).reshape(3),
            "R": snapped(np.eye(3) if R is None else np.asarray(R, float).reshape(3, 3)),
        }.items():
            object.__setattr__(self, name, value)

    def __len__(self) -> int:
        return len(self.axes)

    @cached_property
    def size(self) -> float:
        """Length of the chain [m]: distances between neighbouring axes and to the end, added."""
        feet, lengths = [self.T], []
        for h, o in zip(self.axes[::-1], self.points[::-1], strict=True):
            foot = o + h * (h @ (feet[-1] - o))
            lengths.append(float(np.linalg.norm(foot - feet[-1])))
            feet.append(foot)
        return sum(lengths) or 1.0

    def exponentials(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return rotations (n + 1, m, 3, 3) and translations (n + 1, m, 3): products of the first 0 to n motions."""
        R, p = np.tile(np.eye(3), (len(q), 1, 1)), np.zeros((len(q), 3))
        rotations, translations = [R], [p]
        for h, o, turns, angle in zip(self.axes, self.points, self.revolute, q.T, strict=True):
            if turns:
                step = rotation_about(h, angle)
                p = p + np.einsum("mij,mj->mi", R, o - step @ o)
                R = R @ step
            else:
                p = p + np.einsum("mij,j->mi", R, h) * angle[:, None]
            rotations.append(R)
            translations.append(p)
        return np.array(rotations), np.array(translations)

    def pose(self, q: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Return T (m, 3) [m] and R (m, 3, 3) at joint coordinates q (m, n) or (n,) [rad or m]."""
        R, p = self.exponentials(self._rows(q))
        return R[-1] @ self.T + p[-1], R[-1] @ self.R

    def jacobian(self, q: ArrayLike) -> np.ndarray:
        """Return the geometric Jacobian (m, 6, n): velocity of T, then angular velocity, in base coordinates."""
        R, p = self.exponentials(self._rows(q))
        T = R[-1] @ self.T + p[-1]
        J = np.zeros((len(T), 6, len(self)))
        for i, (h, o, turns) in enumerate(zip(self.axes, self.points, self.revolute, strict=True)):
            direction = R[i] @ h
            if turns:
                J[:, :3, i] = np.cross(direction, T - R[i] @ o - p[i])
                J[:, 3:, i] = direction
            else:
                J[:, :3, i] = direction
        return J

    def symbolic_pose(self, c: Sequence[Any], s: Sequence[Any]) -> tuple[ca.SX, ca.SX, list[ca.SX]]:
        """Return T, R and the columns of the geometric Jacobian from cosines and sines; prismatic: s is the length."""
        R, p, lines = ca.SX.eye(3), ca.SX.zeros(3), []
        for h, o, turns, ci, si in zip(self.axes, self.points, self.revolute, c, s, strict=True):
            h, o = ca.SX(h), ca.SX(o)
            lines.append((R @ h, p + R @ o))
            if turns:
                step = turned(h, ci, si)
                p += R @ (o - step @ o)
                R = R @ step
            else:
                p += R @ h * si
        T = R @ ca.SX(self.T) + p
        columns = [
            ca.vertcat(ca.cross(d, T - o), d) if turns else ca.vertcat(d, ca.SX.zeros(3))
            for (d, o), turns in zip(lines, self.revolute, strict=True)
        ]
        return T, R @ ca.SX(self.R), columns

    def reversed(self) -> Chain:
        """Return the chain from the end to the base: its pose at -q in reverse order is the inverse of this one's.

        The home pose of both is taken as the unit: exp(-Sn qn) ... exp(-S1 q1).
        """
        return Chain(self.axes[::-1], self.points[::-1], self.revolute[::-1])

    def locked(self, joint: int, value: float) -> Chain:
        """Return the chain of the other joints, with one (counted from 0) held at a value [rad or m]."""
        if not -len(self) <= joint < len(self):
            raise ArgumentError(f"is {joint}; the chain has the joints 0 to {len(self) - 1}", "joint")
        joint %= len(self)
        q = np.zeros((1, len(self)))
        q[0, joint] = value
        R, p = (x[-1, 0] for x in self.exponentials(q))
        after = np.arange(len(self)) > joint
        axes = np.where(after[:, None], self.axes @ R.T, self.axes)
        points = np.where(after[:, None], self.points @ R.T + p, self.points)
        keep = np.arange(len(self)) != joint
        kinds = tuple(r for r, k in zip(self.revolute, keep, strict=True) if k)
        return Chain(axes[keep], points[keep], kinds, R @ self.T + p, R @ self.R)

    @staticmethod
    def of_function(f: ca.Function) -> Chain | None:
        """Return the chain of a function of n joint coordinates with the results T (3) and R (3, 3), or (9) by rows.

        Joint axes are exact derivatives at zero. Returns None if the function is no product of exponentials: another
        result at random joint coordinates, a screw of pitch, or a joint that does not turn by its coordinate.
        """
        u = ca.MX.sym("u", f.numel_in(0))
        T, R, *_ = f(u)
        pose = ca.vertcat(ca.vec(T), ca.vec(R.T) if R.shape == (3, 3) else R)  # entries of R by rows
        both = ca.Function("both", [u], [pose, ca.jacobian(pose, u)])
        home, slopes = (np.asarray(ca.densify(x)) for x in both(np.zeros(f.numel_in(0))))
        T, R = home[:3, 0], home[3:, 0].reshape(3, 3)
        axes, points, kinds = [], [], []
        for slope in slopes.T:
            turning = slope[3:].reshape(3, 3) @ R.T
            w = np.array([turning[2, 1], turning[0, 2], turning[1, 0]])
            v = slope[:3] - np.cross(w, T)
            kinds.append(bool(np.linalg.norm(w) > 0.5))
            axes.append(w if kinds[-1] else v)
            points.append(np.cross(w, v) if kinds[-1] else np.zeros(3))
            if not abs(np.linalg.norm(axes[-1]) - 1) < SCREW:
                return None
        chain = Chain(axes, points, kinds, T, R)
        scale = np.where(kinds, np.pi, chain.size)
        for q in np.random.default_rng(0).uniform(-scale, scale, (TRIALS, len(scale))):
            wanted = np.asarray(ca.densify(both(q)[0]))[:, 0]
            reached = np.concatenate([x[0].ravel() for x in chain.pose(q)])
            off = np.abs(reached - wanted) / np.concatenate([np.full(3, max(1.0, chain.size)), np.ones(9)])
            if not np.all(off < SCREW):
                return None
        return chain

    def _rows(self, q: ArrayLike) -> np.ndarray:
        q = np.atleast_2d(np.asarray(q, float))
        if q.shape[1:] != (len(self),):
            raise ArgumentError(f"have the shape {q.shape}; expected (m, {len(self)})", "q")
        return q


def turned(h: Any, c: Any, s: Any) -> Any:
    """Return the rotation about the constant unit vector h by the angle of cosine c and sine s, as a CasADi matrix."""
    import casadi as ca

    h = np.asarray(ca.DM(h), float).ravel()
    dyad = snapped(np.outer(h, h))
    return ca.SX(dyad) + c * ca.SX(snapped(np.eye(3) - dyad)) + s * ca.SX(cross_matrix(h))
