"""Arms of seven revolute joints with a declared elbow: the angle of shoulder, elbow and wrist about a direction.

Kreutz-Delgado, Long, Seraji, IJRR 11(5), 1992.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import ArrayLike

from ...results import ArgumentError
from ..rotations import within_pi
from .chain import Chain
from .closed import ClosedForm, closed_form
from .structure import EXACT, common_point

GRID = 96  # angles of joint 7 at which the elbow is compared with the declared one
BISECTIONS = 50
REFINED = 0.5  # rad: nearest approach to the declared angle between grid points that is looked at more closely


@dataclass(frozen=True, eq=False)
class ElbowAngle:
    """Redundancy of seven joints resolved by the position of the elbow.

    `angle` [rad], a number or one per pose, is that of the plane of shoulder, elbow and wrist about the line from
    shoulder to wrist, positive by the right hand, from the side that `direction` (3) points to. The shoulder is the
    point where axes 1, 2 and 3 meet; the elbow the point of axis 4 nearest to it at q = 0; the wrist the point where
    axes 5 and 6 meet.
    """

    angle: ArrayLike
    direction: tuple[float, float, float] = (0.0, 0.0, 1.0)


@dataclass(frozen=True, eq=False)
class _Arm:
    chain: Chain
    shoulder: np.ndarray
    elbow: np.ndarray
    wrist: np.ndarray

    @staticmethod
    def of(chain: Chain) -> _Arm:
        if len(chain) != 7 or not all(chain.revolute):
            raise ArgumentError(f"is for seven revolute joints; this chain has {len(chain)} joints", "redundancy")
        shoulder, wrist = (common_point(chain.axes[part], chain.points[part]) for part in (slice(3), slice(4, 6)))
        for group, point, words in ((range(3), shoulder, "1, 2 and 3"), (range(4, 6), wrist, "5 and 6")):
            off = max(np.linalg.norm(np.cross(chain.axes[i], point - chain.points[i])) for i in group)
            if off > EXACT * chain.size:
                raise ArgumentError(
                    f"is an elbow angle, for which axes {words} must meet in a point; they miss it by {off:.3g} m",
                    "redundancy",
                )
        elbow = chain.points[3] + chain.axes[3] * (chain.axes[3] @ (shoulder - chain.points[3]))
        return _Arm(chain, shoulder, elbow, wrist)

    def angle(self, q: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Return the elbow's angle (m,) at joint coordinates (m, 7)."""
        R, p = self.chain.exponentials(q)
        elbow, wrist = R[3] @ self.elbow + p[3], R[5] @ self.wrist + p[5]
        along, side, normal = _frame(wrist - self.shoulder, direction)
        away = elbow - self.shoulder
        return np.arctan2((away * normal).sum(axis=1), (away * side).sum(axis=1)) + 0 * along[:, 0]


def elbow_angle(chain: Chain, q: ArrayLike, direction: ArrayLike = (0.0, 0.0, 1.0)) -> np.ndarray:
    """Return the elbow's angle (m,) [rad] as in `ElbowAngle` at joint coordinates (m, 7) or (7,)."""
    return _Arm.of(chain).angle(np.atleast_2d(np.asarray(q, float)), np.asarray(direction, float))


def elbow_postures(
    chain: Chain, T: np.ndarray, R: np.ndarray, elbow: ElbowAngle
) -> tuple[np.ndarray, tuple[str, ...], bool]:
    """Return q (m, k, 7), NaN where there is no posture, names, and whether the set is complete."""
    arm = _Arm.of(chain)
    psi = np.broadcast_to(np.asarray(elbow.angle, float), len(T))
    direction = np.asarray(elbow.direction, float)
    if direction.shape != (3,) or not np.linalg.norm(direction) > 0:
        raise ArgumentError(f"is {elbow.direction}; expected three numbers, not all zero", "direction")
    last = np.cross(chain.axes[6], arm.wrist - chain.points[6])
    if np.linalg.norm(last) < EXACT * chain.size:
        return *_spherical(arm, T, R, psi, direction), True
    return _searched(arm, T, R, psi, direction), (), False


def _spherical(
    arm: _Arm, T: np.ndarray, R: np.ndarray, psi: np.ndarray, direction: np.ndarray
) -> tuple[np.ndarray, tuple[str, ...]]:
    """Spherical shoulder and wrist: joint 4 by the distance, the shoulder by the elbow's angle, then the wrist."""
    chain, S, W = arm.chain, arm.shoulder, arm.wrist
    X = R @ chain.R.T
    wrist = X @ (W - chain.T) + T - S
    h, o = chain.axes[3], arm.elbow
    u, v = o - S, W - o
    A, B = u @ v - (u @ h) * (v @ h), u @ np.cross(h, v)
    D = ((wrist**2).sum(axis=1) - u @ u - v @ v) / 2 - (u @ h) * (v @ h)
    size = np.hypot(A, B)
    with np.errstate(invalid="ignore"):
        bend = np.arccos(np.where(np.abs(D) <= size * (1 + EXACT), np.clip(D / size, -1, 1), np.nan))
    still = Chain(chain.axes[:3], np.tile(S, (3, 1)), None, S)
    hand = Chain(chain.axes[4:], np.tile(W, (3, 1)), None, W)
    forms = [closed_form(part) for part in (still, hand)]
    if forms[0] is None or forms[1] is None:
        raise ArgumentError("is an elbow angle; the shoulder and the wrist need three independent axes", "redundancy")
    q = np.full((len(T), 8, 7), np.nan)
    aim = np.stack(_frame(wrist, direction), axis=2)
    c, s = np.cos(psi)[:, None], np.sin(psi)[:, None]
    aim = np.stack([aim[..., 0], c * aim[..., 1] + s * aim[..., 2], c * aim[..., 2] - s * aim[..., 1]], axis=2)
    for k, sign in enumerate((1, -1)):
        q4 = within_pi(np.arctan2(B, A) + sign * bend)
        usable = np.isfinite(q4)
        fore = Chain(chain.axes[3:4], chain.points[3:4], None, W)
        at, turned = fore.pose(np.where(usable, q4, 0.0)[:, None])
        home = np.stack(_frame(at - S, u), axis=2)
        upper = aim @ home.transpose(0, 2, 1)
        rest = (upper @ turned).transpose(0, 2, 1) @ X
        for (a, first), (b, last) in product(*(enumerate(_turns(f, r)) for f, r in zip(forms, (upper, rest), strict=True))):
            q[:, 4 * a + 2 * k + b] = np.column_stack([first, q4, last])
    q[~np.isfinite(q).all(axis=2)] = np.nan
    words = [f.branches[0].words for f in forms]
    names = [f"shoulder {a}, elbow {b}, wrist {c}" for a, b, c in product(words[0], ("up", "down"), words[1])]
    return q, tuple(names)


def _turns(form: ClosedForm, R: np.ndarray) -> list[np.ndarray]:
    """Return both sets of three angles (m, 3) with the rotation R (m, 3, 3)."""
    q = form.values(np.tile(form.chain.T, (len(R), 1)), R)[0]
    return [q[:, 0], q[:, 1]]


def _searched(arm: _Arm, T: np.ndarray, R: np.ndarray, psi: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Joint 7 away from the wrist: a search along its angle, with the closed form of the other six at each."""
    chain = arm.chain
    six = Chain(chain.axes[:6], chain.points[:6], None, chain.T, chain.R)
    form = closed_form(six)
    if form is None:
        raise ArgumentError("is an elbow angle; the first six joints of this chain have no closed form", "redundancy")
    last = Chain(chain.axes[6:], chain.points[6:])

    def values(rows: np.ndarray, q7: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return q (r, k, 7) and the difference (r, k) of the elbow's angle from the declared one; NaN: no posture."""
        back, turned = last.pose(-q7[:, None])
        rest = turned @ chain.R
        local = (chain.R.T @ turned) @ chain.T + back @ chain.R - chain.R.T @ chain.T
        q, exists, _ = form.values(T[rows] + np.einsum("rij,rj->ri", R[rows], local), R[rows] @ chain.R.T @ rest)
        q = np.concatenate([q, np.broadcast_to(q7[:, None, None], (*q.shape[:2], 1))], axis=2)
        angle = arm.angle(q.reshape(-1, 7), direction).reshape(exists.shape)
        return q, np.where(exists, within_pi(angle - psi[rows, None]), np.nan)

    m, k = len(T), len(form.signs)
    grid = np.linspace(-np.pi, np.pi, GRID + 1)
    everywhere = np.array([values(np.arange(m), np.full(m, a))[1] for a in grid])  # (GRID + 1, m, k)
    found: list[list[np.ndarray]] = [[] for _ in range(m)]

    def at(rows: np.ndarray, branch: np.ndarray, q7: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        q, off = values(rows, q7)
        n = np.arange(len(rows))
        return q[n, branch], off[n, branch]

    def search(rows: np.ndarray, branch: np.ndarray, a: np.ndarray, b: np.ndarray, fa: np.ndarray, fb: np.ndarray) -> None:
        crossing = (fa * fb <= 0) & (np.abs(fa - fb) < np.pi)
        rows, branch, a, b, fa = (x[crossing] for x in (rows, branch, a, b, fa))
        if not len(rows):
            return
        for _ in range(BISECTIONS):
            middle = (a + b) / 2
            _, f = at(rows, branch, middle)
            left = fa * f <= 0
            a, fa, b = np.where(left, a, middle), np.where(left, fa, f), np.where(left, middle, b)
        q, off = at(rows, branch, (a + b) / 2)
        for row, posture, f in zip(rows, q, off, strict=True):
            if abs(f) < 1e-6:
                found[row].append(posture)

    low, high = everywhere[:-1], everywhere[1:]
    both = np.isfinite(low) & np.isfinite(high)
    cell, row, branch = np.nonzero(both)
    search(row, branch, grid[cell], grid[cell + 1], low[both], high[both])
    # the ends of what a branch reaches: the last posture on it by bisection
    cell, row, branch = np.nonzero(np.isfinite(low) ^ np.isfinite(high))
    if len(cell):
        inside_low = np.isfinite(low[cell, row, branch])
        inner, outer = grid[np.where(inside_low, cell, cell + 1)], grid[np.where(inside_low, cell + 1, cell)]
        f_inner = np.where(inside_low, low[cell, row, branch], high[cell, row, branch])
        a, b = inner, outer
        for _ in range(BISECTIONS):
            middle = (a + b) / 2
            exists = np.isfinite(at(row, branch, middle)[1])
            a, b = np.where(exists, middle, a), np.where(exists, b, middle)
        search(row, branch, inner, a, f_inner, at(row, branch, a)[1])
    # nearest approaches between grid points
    distance = np.abs(everywhere)
    middle = distance[1:-1]
    dip = (middle <= distance[:-2]) & (middle <= distance[2:]) & (middle < REFINED)
    cell, row, branch = np.nonzero(dip)
    if len(cell):
        fine = np.linspace(-1, 1, 33) * (grid[1] - grid[0])
        closer = np.array([at(row, branch, grid[cell + 1] + x)[1] for x in fine])
        for n in range(len(fine) - 1):
            search(row, branch, grid[cell + 1] + fine[n], grid[cell + 1] + fine[n + 1], closer[n], closer[n + 1])
    kept = [_unlike(np.array(rows).reshape(-1, 7)) for rows in found]
    q = np.full((m, max([1, *map(len, kept)]), 7), np.nan)
    for n, rows in enumerate(kept):
        q[n, : len(rows)] = rows
    return q


def _unlike(q: np.ndarray) -> np.ndarray:
    kept: list[np.ndarray] = []
    for row in q:
        if all(np.abs(within_pi(row - other)).max() > 1e-6 for other in kept):
            kept.append(row)
    return np.array(kept).reshape(-1, 7)


def _frame(along: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return unit vectors (m, 3): along, towards the direction across it, and their cross product."""
    along = along / np.linalg.norm(along, axis=1, keepdims=True)
    side = direction - along * (along @ direction)[:, None]
    side = side / np.linalg.norm(side, axis=1, keepdims=True)
    return along, side, np.cross(along, side)
