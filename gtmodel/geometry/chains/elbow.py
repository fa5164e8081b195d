"""Arms of seven revolute joints with a declared elbow: the angle of shoulder, elbow and wrist about a direction.

Kreutz-Delgado, Long, Seraji, IJRR 11(5), 1992.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import product

import numpy as np
from numpy.typing import ArrayLike

from ...results import ArgumentError
from ..rotations import within_pi
from .chain import Chain
from .closed import ClosedForm, closed_form
from .structure import EXACT, common_point

SAME = 1e-6  # rad between two postures that are one
PARTS, LEVELS = 8, 2  # of a cell that is looked at more closely, again and again
GRID = 96  # angles of joint 7 at which the elbow is compared with the declared one
BISECTIONS, SECANTS = 12, 30
LAST = 45  # bisections for the end of what a branch reaches
ANGLE = 1e-11  # rad: the elbow is where it was declared
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
        R, p = Chain(self.chain.axes[:5], self.chain.points[:5]).exponentials(q[:, :5])
        elbow, wrist = R[3] @ self.elbow + p[3], R[5] @ self.wrist + p[5]
        along, side, normal = _frame(wrist - self.shoulder, direction)
        away = elbow - self.shoulder
        return np.arctan2((away * normal).sum(axis=1), (away * side).sum(axis=1)) + 0 * along[:, 0]


def elbow_angle(chain: Chain, q: ArrayLike, direction: ArrayLike = (0.0, 0.0, 1.0)) -> np.ndarray:
    """Return the elbow's angle (m,) [rad] as in `ElbowAngle` at joint coordinates (m, 7) or (7,).

    >>> arm = gt.robots.serial_arm(a=np.zeros(7), alpha=np.array([1, -1, 1, -1, 1, -1, 0]) * np.pi / 2,
    ...                            d=[0.3, 0.0, 0.4, 0.0, 0.4, 0.0, 0.1])
    >>> angle = gt.kinematics.elbow_angle(gt.kinematics.chain_of(arm), [0.0, 0.5, 0.4, 1.0, 0.0, 0.6, 0.0])
    >>> angle.round(3)
    array([0.227])
    """
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
    forms = [form for form in forms if form is not None]
    if len(forms) < 2:
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
        sides = [list(enumerate(_turns(f, r))) for f, r in zip(forms, (upper, rest), strict=True)]
        for (a, first), (b, last) in product(*sides):
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
    search = _Search.of(arm, T, R, psi, direction)
    m, k = len(T), len(search.branches)
    rows, branch = (x.ravel() for x in np.meshgrid(np.arange(m), search.branches, indexing="ij"))
    search.scan(rows, branch, np.tile(np.linspace(-np.pi, np.pi, GRID + 1)[:, None], m * k))
    return search.postures()


@dataclass(eq=False)
class _Search:
    """Postures as functions of joint 7; `branches`: those of the closed form that differ in the elbow's angle."""

    arm: _Arm
    form: ClosedForm
    T: np.ndarray
    R: np.ndarray
    psi: np.ndarray
    direction: np.ndarray
    branches: np.ndarray
    hits: list[tuple[int, np.ndarray]] = field(default_factory=list)

    @staticmethod
    def of(arm: _Arm, T: np.ndarray, R: np.ndarray, psi: np.ndarray, direction: np.ndarray) -> _Search:
        chain = arm.chain
        form = closed_form(Chain(chain.axes[:6], chain.points[:6], None, chain.T, chain.R))
        if form is None or not form.nominal.plan.reverse:
            raise ArgumentError(
                "is an elbow angle; it needs a wrist in which axes 5 and 6 meet, or all of 5, 6 and 7", "redundancy"
            )
        # both signs of the spherical shoulder have one elbow
        names = [b.name for b in form.branches]
        return _Search(arm, form, T, R, psi, direction, np.flatnonzero(form.signs[:, names.index("shoulder")] > 0))

    def values(self, rows: np.ndarray, branch: np.ndarray, q7: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return q (r, 7), the elbow's angle from the declared one (r), NaN without posture, and the least margin."""
        chain, home = self.arm.chain, self.arm.chain.R.T
        back, turned = Chain(chain.axes[6:], chain.points[6:]).pose(-q7[:, None])
        local = (home @ turned) @ chain.T + back @ home.T - home @ chain.T
        at, facing = self.T[rows] + (self.R[rows] @ local[:, :, None])[:, :, 0], self.R[rows] @ (home @ turned @ home.T)
        q, margin = self.form.branch_values(at, facing, self.form.signs[branch])
        q = np.column_stack([q, q7])
        with np.errstate(invalid="ignore"):
            off = within_pi(self.arm.angle(q, self.direction) - self.psi[rows])
        return q, np.where(margin >= 0, off, np.nan), margin

    def scan(self, rows: np.ndarray, branch: np.ndarray, nodes: np.ndarray, level: int = 0) -> None:
        """Look for postures between neighbouring angles of joint 7, nodes (g, r).

        Cells in which a branch may begin or end, or come near the declared angle and leave it, are divided.
        """
        made = [self.values(rows, branch, a)[1:] for a in nodes]
        off, margin = (np.array([x[n] for x in made]) for n in (0, 1))
        steps = np.abs(np.diff(margin, axis=0))
        steps[1:], steps[:-1] = np.maximum(steps[1:], steps[:-1]), np.maximum(steps[1:], steps[:-1])
        divided = np.minimum(np.abs(margin[:-1]), np.abs(margin[1:])) < 1.5 * steps
        size = np.where(np.isfinite(off), np.abs(off), np.inf)
        dip = np.zeros(off.shape, bool)
        dip[1:-1] = (size[1:-1] <= size[:-2]) & (size[1:-1] <= size[2:]) & (size[1:-1] < REFINED)
        divided |= dip[:-1] | dip[1:]
        if level == LEVELS:
            divided[:] = False
        cell, column = np.nonzero(~divided)
        ends = ((x[cell, column], x[cell + 1, column]) for x in (nodes, off))
        self.cells(rows[column], branch[column], *(x for pair in ends for x in pair))
        cell, column = np.nonzero(divided)
        if len(cell):
            a, b = nodes[cell, column], nodes[cell + 1, column]
            parts = np.linspace(-1 / PARTS, 1 + 1 / PARTS, PARTS + 3)[:, None]  # one more at each side, for its dips
            self.scan(rows[column], branch[column], a + parts * (b - a), level + 1)

    def cells(
        self, rows: np.ndarray, branch: np.ndarray, a: np.ndarray, b: np.ndarray, fa: np.ndarray, fb: np.ndarray
    ) -> None:
        """Look for postures between angles a and b of joint 7, with the differences there."""
        from ...linear.roots import bisected  # here: it imports SciPy

        both = np.isfinite(fa) & np.isfinite(fb)
        self.roots(*(x[both] for x in (rows, branch, a, b, fa, fb)))
        # the branch ends in between: the last posture on it by bisection
        ends = np.isfinite(fa) ^ np.isfinite(fb)
        rows, branch, a, b, fa, fb = (x[ends] for x in (rows, branch, a, b, fa, fb))
        inner, outer = np.where(np.isfinite(fa), a, b), np.where(np.isfinite(fa), b, a)
        if len(rows):
            last, _ = bisected(lambda q7: self.values(rows, branch, q7)[2] >= 0, inner, outer, LAST)
            f = self.values(rows, branch, last)[1]
            self.roots(rows, branch, inner, last, np.where(np.isfinite(fa), fa, fb), f)

    def roots(
        self, rows: np.ndarray, branch: np.ndarray, a: np.ndarray, b: np.ndarray, fa: np.ndarray, fb: np.ndarray
    ) -> None:
        """Regula falsi (Illinois) after bisections, where the difference changes its sign without a jump."""
        crossing = (fa * fb <= 0) & (np.abs(fa - fb) < np.pi)
        rows, branch, a, b, fa, fb = (x[crossing] for x in (rows, branch, a, b, fa, fb))
        for n in range(BISECTIONS + SECANTS):
            if not len(rows):
                return
            middle: np.ndarray = (a + b) / 2
            if n >= BISECTIONS:
                with np.errstate(divide="ignore", invalid="ignore"):
                    cut: np.ndarray = b - fb * (b - a) / (fb - fa)
                middle = np.where((cut - a) * (cut - b) <= 0, cut, middle)
            q: np.ndarray
            f: np.ndarray
            q, f, _ = self.values(rows, branch, middle)
            there = np.abs(f) < ANGLE
            self.hits += list(zip(rows[there].tolist(), q[there], strict=True))
            left: np.ndarray = fa * f <= 0
            half = 0.5 if n > BISECTIONS else 1.0
            a, fa = np.where(left, a, middle), np.where(left, half * fa, f)
            b, fb = np.where(left, middle, b), np.where(left, f, half * fb)
            rows, branch, a, b, fa, fb = (x[~there] for x in (rows, branch, a, b, fa, fb))

    def postures(self) -> np.ndarray:
        """Return what was found, (m, k, 7), with both signs of the shoulder."""
        if not self.hits:
            return np.full((len(self.T), 1, 7), np.nan)
        rows, q = np.array([row for row, _ in self.hits]), np.array([posture for _, posture in self.hits])
        other = flipped(q[:, :3], self.arm.chain)
        kept: list[list[np.ndarray]] = [[] for _ in range(len(self.T))]
        for row, posture in zip(np.tile(rows, 2), np.concatenate([q, np.hstack([other, q[:, 3:]])]), strict=True):
            if all(np.abs(within_pi(posture - known)).max() > SAME for known in kept[row]):
                kept[row].append(posture)
        made = np.full((len(self.T), max(map(len, kept)), 7), np.nan)
        for row, postures in enumerate(kept):
            made[row, : len(postures)] = np.array(postures).reshape(-1, 7)
        return made


def flipped(q: np.ndarray, chain: Chain) -> np.ndarray:
    """Return the other three angles (m, 3) of a spherical shoulder with the same rotation."""
    shoulder = Chain(chain.axes[:3], np.zeros((3, 3)))
    form = closed_form(shoulder)
    assert form is not None
    both = np.stack(_turns(form, shoulder.pose(q)[1]), axis=1)
    nearest = np.abs(within_pi(both - q[:, None])).max(axis=2).argmin(axis=1)
    return both[np.arange(len(q)), 1 - nearest]


def _frame(along: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return unit vectors (m, 3): along, towards the direction across it, and their cross product."""
    along = along / np.linalg.norm(along, axis=1, keepdims=True)
    side = direction - along * (along @ direction)[:, None]
    side = side / np.linalg.norm(side, axis=1, keepdims=True)
    return along, side, np.cross(along, side)
