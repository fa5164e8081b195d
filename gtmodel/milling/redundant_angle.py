"""The angle about the spindle axis that a milling task leaves free, and where an arm can take it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..geometry.rotations import rotation_by
from ..kinematics.wrist_partition import WristPartition

ANGLES = np.deg2rad(np.arange(-180.0, 181.0))  # 361, one degree apart


@dataclass(frozen=True, eq=False)
class AngleSweep:
    """All ways in which an arm can hold the tool at one place, over the angle about the spindle.

    angles (n,) [rad]. q (s, 6) [rad]: solutions; solution i belongs to angle number row[i] and branch branch[i], and at
    each angle a branch has one solution at most. in_reach (n,): whether the geometry allows the angle, though joint
    limits may not.
    """

    angles: np.ndarray
    q: np.ndarray
    row: np.ndarray
    branch: np.ndarray
    in_reach: np.ndarray

    @property
    def reachable(self) -> np.ndarray:
        """(n,) whether some branch holds the angle within its joint limits."""
        reachable = np.zeros(len(self.angles), bool)
        reachable[self.row] = True
        return reachable

    def least(self, value: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """By angle (n,): the least of values (s,) of its solutions and the number of that solution; NaN, -1: none."""
        value = np.asarray(value, float)
        best, which = np.full(len(self.angles), np.nan), np.full(len(self.angles), -1)
        order = np.lexsort((value, self.row))
        first = order[np.unique(self.row[order], return_index=True)[1]]
        best[self.row[first]], which[self.row[first]] = value[first], first
        return best, which


def runs_of(there: np.ndarray) -> np.ndarray:
    """First and last row (n, 2) of each run of rows that are `there`."""
    edges = np.diff(np.concatenate([[0], there, [0]]).astype(int))
    return np.column_stack([np.flatnonzero(edges > 0), np.flatnonzero(edges < 0) - 1])


def tool_rotations(angles: ArrayLike, axis: ArrayLike, spindle: ArrayLike, zero: float = 0.0) -> np.ndarray:
    """Flange orientations (n, 3, 3) that point the spindle along `axis` (3), world, turned about it by angles (n,)
    [rad].

    spindle (3): from spindle to tip, flange coordinates. The angle turns about -axis, as about the vertical for a
    tool that points down. At the turn 0 the part of the flange's z axis (of its x axis where the spindle lies along
    z) across the spindle points towards world x (y where the tool lies along x); at angle 0 the turn is `zero` [rad].
    The thesis does not print its own. Raises ValueError for a direction without length.

    >>> R = gt.milling.tool_rotations(np.radians([0.0, 90.0]), axis=[0.0, 0.0, -1.0], spindle=[0.0, 0.0, 1.0])
    >>> R[0].round(6) + 0.0
    array([[ 1.,  0.,  0.],
           [ 0., -1.,  0.],
           [ 0.,  0., -1.]])
    """
    frame_world, frame_flange = _frame(axis, (1, 0, 0), (0, 1, 0)), _frame(spindle, (0, 0, 1), (1, 0, 0))
    start = frame_world @ frame_flange.T
    turns = (np.asarray(angles, float).reshape(-1, 1) + zero) * -frame_world[:, 0]
    return rotation_by(turns) @ start


def angle_sweep(
    arm: WristPartition, limits: ArrayLike, place: ArrayLike, *, axis: ArrayLike = (0.0, 0.0, -1.0),
    tool: ArrayLike = (0.0, 0.0, 0.0), spindle: ArrayLike = (0.0, 0.0, 1.0), angles: ArrayLike = ANGLES,
    zero: float = 0.0,
) -> AngleSweep:  # fmt: skip
    """Joint angles that hold the tool centre point at `place` (3) [m] over the angles (n,) [rad]: all branches within
    limits.

    limits (6, 2) [rad]; tool (3) [m]: tool centre point in flange coordinates; axis, spindle, zero: see
    `tool_rotations`.
    Of a branch's whole turns the one farthest from its limits is kept. Raises ValueError for wrong shapes.

    >>> robot = gt.robots.kr500()
    >>> arm = gt.kinematics.WristPartition.of(robot.origins, robot.axes)
    >>> sweep = gt.milling.angle_sweep(arm, robot.joint_limits, place=[1.2, 0.0, 0.3], angles=[0.0, 1.5, 3.0])
    >>> sweep.reachable, sweep.q.shape
    (array([ True,  True,  True]), (6, 6))
    """
    angles = np.asarray(angles, float).ravel()
    low, high = np.asarray(limits, float).reshape(6, 2).T
    R = tool_rotations(angles, axis, spindle, zero)
    solutions = arm.inverse(np.asarray(place, float) - R @ np.asarray(tool, float), R)
    q, row, branch = [], [], []
    for n in range(len(angles)):
        turns, branches = solutions.within(limits, n)
        margin = np.minimum(turns - low, high - turns).min(axis=1)
        for b in np.unique(branches):
            mine = np.flatnonzero(branches == b)
            q.append(turns[mine[np.argmax(margin[mine])]])
            row.append(n)
            branch.append(b)
    in_reach = np.any(np.isfinite(solutions.q).all(axis=2), axis=1)
    return AngleSweep(angles, np.array(q).reshape(-1, 6), np.array(row, int), np.array(branch, int), in_reach)


def _frame(first: ArrayLike, second: tuple[int, int, int], instead: tuple[int, int, int]) -> np.ndarray:
    """Columns: `first`, then the part of `second` across it (`instead` where they are parallel), then the third."""
    x = np.asarray(first, float)
    length = np.linalg.norm(x)
    if x.shape != (3,) or not length > 0:
        raise ValueError(f"the direction {x.tolist()} has no length; expected three numbers, not all zero")
    x = x / length
    y = np.asarray(second if np.linalg.norm(np.cross(x, second)) > 1e-6 else instead, float)
    y = y - (x @ y) * x
    y /= np.linalg.norm(y)
    return np.column_stack([x, y, np.cross(x, y)])
