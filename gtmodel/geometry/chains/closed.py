"""Closed forms of inverse kinematics, with named branches: expressions for any compiler, found from the axes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from itertools import product
from typing import Any

import casadi as ca
import numpy as np

from .chain import Chain
from .equations import EDGE, JointSteps, NoSolution, TwoValued
from .recipes import solve
from .structure import EXACT, NEAR, Nominal, nominal, plans

STEPS = 3  # Newton steps of a chain that has a structure nearly: an error of 1e-3 leaves 1e-6, 1e-12, 1e-24
NEAR_CLIP = 1e-2  # of the discriminants of a nominal chain, whose reach differs from the true one
CONDITION = 1e-9  # relative length and angle by which a pose may miss what fewer joints reach
PROBES = 24  # random joint positions at which a closed form must return where it came from
RETURNED = 1e-6  # their largest error: next to singular positions half of the digits are lost


@dataclass(frozen=True)
class BranchSign:
    """A two-valued choice: its name, the words for +1 and -1, and the joint (from 0) whose equation has two roots."""

    name: str
    words: tuple[str, str]
    joint: int


@dataclass(frozen=True, eq=False)
class Expressions:
    """A closed form in expressions of T (3), R (3, 3) and signs.

    `q`: one expression for each joint, to be assigned in this order. `margins`: kind, expression and label;
    "discriminant" and "condition" are >= 0 where a solution exists, the size of a "pivot", relative to its largest, is
    the distance from a singularity.
    """

    q: list[ca.SX]
    margins: list[tuple[str, ca.SX, str]]

    def assignments(self, symbols: Sequence[ca.SX]) -> list[tuple[ca.SX, ca.SX]]:
        """Return (symbol, expression) for each joint."""
        return list(zip(symbols, self.q, strict=True))


@dataclass(frozen=True, eq=False)
class ClosedForm:
    """All postures of a chain in closed form.

    `branches` (k) are the two-valued choices: shoulder, elbow, wrist. The 2^k postures are numbered as in `signs`: the
    first choice changes last, +1 comes first. Signs change at singular positions only. `near`: the chain has the
    structure only nearly; three Newton steps lead from its nominal closed form to a posture of the chain itself.
    `oriented`: the orientation is known besides the position. `structure` says in words what was found.
    """

    chain: Chain
    nominal: Nominal
    oriented: bool
    near: bool
    branches: tuple[BranchSign, ...]
    _factors: tuple[tuple[float, tuple[int, ...]], ...] = field(repr=False)

    @property
    def signs(self) -> np.ndarray:
        """Signs (2^k, k) of all postures in order."""
        return np.array(list(product((1, -1), repeat=len(self.branches))), float).reshape(2 ** len(self.branches), -1)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the 2^k postures, such as "left, up, no flip"; "" if there is one only."""
        return tuple(
            ", ".join(b.words[0 if s > 0 else 1] for b, s in zip(self.branches, row, strict=True)) for row in self.signs
        )

    @property
    def structure(self) -> str:
        """The structure in words."""
        plan, number = self.nominal.plan, [i + 1 for i in self.nominal.plan.order]
        wrist = [str(i) for i in sorted(number[len(number) - plan.wrist :])]
        if plan.kind == "parallel":
            parallel = " ".join(str(i) for i in sorted(number[1:4]))
            text = f"axes {parallel} parallel, {' and '.join(wrist)} meet"
        else:
            text = f"axes {' '.join(wrist)} meet in a point" if plan.wrist > 1 else ""
            if plan.pair and plan.motion:
                a, b = sorted(number[i] for i in plan.pair)
                words = {"parallel": "parallel", "meet": "meet", "cylinder": "parallel", "plane": "square"}
                text += f"{', ' if text else ''}axes {a} and {b} {words.get(plan.motion, 'linear')}"
        return ("nearly: " if self.near else "") + (text or "one joint")

    def expressions(self, T: ca.SX, R: ca.SX | None, signs: Sequence[ca.SX]) -> Expressions:
        """Return the joints and margins in expressions of T (3), R (3, 3) and the signs of `branches`.

        R is not used, and may be None, if the closed form is not `oriented`.
        """
        raw = []
        for k, (factor, others) in enumerate(self._factors):
            sign = ca.SX(factor) * signs[k]
            for i in others:
                sign = sign * raw[i]
            raw.append(sign)
        by_root = [raw[k] for k in self._order]
        steps = JointSteps(len(self.chain), self.chain.size, by_root, clip=NEAR_CLIP if self.near else EDGE)
        solve(self.nominal, steps, _Given(self.nominal, T, R))
        margins = [(kind, e, self._label(kind, j)) for kind, e, j in steps.margins]
        plan = self.nominal.plan
        q: list[Any] = [None] * len(self.chain)
        c, s = list(q), list(q)
        for j, original in enumerate(plan.order):
            sign = float(self.nominal.sign[j])
            q[original] = sign * steps.q[j]
            c[original], s[original] = steps.cosine[j], sign * steps.sine[j]
        n = len(self.chain)
        checked = self.near or n < (6 if self.oriented else 3)
        if self.near:
            for _ in range(STEPS):
                e, J = self._error(T, R, *_cosines(self.chain, q))
                step = ca.solve(J, e) if J.is_square() else ca.solve(J.T @ J, J.T @ e)
                q = [x + step[i] for i, x in enumerate(q)]
            c, s = _cosines(self.chain, q)
        if checked:
            e, _ = self._error(T, R, c, s)
            e = e / ca.SX([self.chain.size] * 3 + [1.0] * (e.numel() - 3))
            what = "the pose is one that the joints reach"
            margins.append(("condition", CONDITION**2 - ca.dot(e, e), what))
        return Expressions(q, margins)

    def slopes(self, q: ca.SX) -> list[ca.SX]:
        """Return an expression of joint coordinates for each branch, with the sign of the branch that they are on.

        They are factors of det J, and vanish at singular positions.
        """
        roots = self._roots_at(q)
        raw = [roots[k].slope for k in self._place]
        values = []
        for factor, others in self._factors:
            value = factor * raw[len(values)]
            for i in others:
                value = value * raw[i]
            values.append(value)
        return values

    @cached_property
    def function(self) -> ca.Function:
        """Columns T (3), R (9, by columns) and signs (k) to q (n) and margins."""
        T, R, s = ca.SX.sym("T", 3), ca.SX.sym("R", 3, 3), ca.SX.sym("s", len(self.branches))
        e = self.expressions(T, R, ca.vertsplit(s) if len(self.branches) else [])
        margins = ca.vertcat(*[m for _, m, _ in e.margins]) if e.margins else ca.SX(0, 1)
        return ca.Function("postures", [T, ca.vec(R), s], [ca.vertcat(*e.q), margins], {"cse": True})

    @cached_property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of the margins of `function`."""
        e = self.expressions(ca.SX.sym("T", 3), ca.SX.sym("R", 3, 3), [ca.SX(1)] * len(self.branches))
        return tuple(kind for kind, _, _ in e.margins)

    def values(self, T: np.ndarray, R: np.ndarray | None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return q (m, 2^k, n), where it exists (m, 2^k) and the smallest pivot (m, 2^k), for T (m, 3), R (m, 3, 3)."""
        m, k = len(T), len(self.signs)
        q, margins = self._columns(np.repeat(T, k, axis=0), None if R is None else np.repeat(R, k, axis=0),
                                   np.tile(self.signs, (m, 1)))  # fmt: skip
        exists, pivot = np.isfinite(q).all(axis=1), np.full(m * k, np.inf)
        for kind, margin in zip(self.kinds, margins.T, strict=True):
            if kind == "pivot":
                pivot = np.minimum(pivot, np.abs(margin))
            else:
                exists &= margin >= 0
        return q.reshape(m, k, -1), exists.reshape(m, k), pivot.reshape(m, k)

    def branch_values(self, T: np.ndarray, R: np.ndarray | None, signs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return q (m, n) on one branch for each pose, and the smallest margin (m): >= 0 where the posture exists."""
        q, margins = self._columns(T, R, signs)
        deciding = [kind != "pivot" for kind in self.kinds]
        margin = margins[:, deciding].min(axis=1, initial=np.inf)
        return q, np.where(np.isfinite(q).all(axis=1), margin, -np.inf)

    def _columns(self, T: np.ndarray, R: np.ndarray | None, signs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        turned = np.zeros((len(T), 9)) if R is None else R.transpose(0, 2, 1).reshape(-1, 9)
        q, margins = (np.asarray(ca.densify(x)).T for x in self.function(T.T, turned.T, signs.T))
        return q, margins

    @cached_property
    def slope_function(self) -> ca.Function:
        """Joint coordinates (n) to the slopes (k)."""
        q = ca.SX.sym("q", len(self.chain))
        return ca.Function("slopes", [q], [ca.vertcat(*self.slopes(q)) if self.branches else ca.SX(0, 1)])

    # root i of the recipe belongs to branch _order[i]; branch k is root _place[k] of the recipe

    @cached_property
    def _order(self) -> list[int]:
        joints = [b.joint for b in self.branches]
        roots = self._roots_at(ca.SX.sym("q", len(self.chain)))
        return [joints.index(self.nominal.plan.order[r.joint]) for r in roots]

    @cached_property
    def _place(self) -> list[int]:
        return [self._order.index(k) for k in range(len(self.branches))]

    def _roots_at(self, q: ca.SX) -> list[TwoValued]:
        return roots_at(self.nominal, q)

    def _error(self, T: ca.SX, R: ca.SX | None, c: Any, s: Any) -> tuple[ca.SX, ca.SX]:
        """Return the pose error (6 or 3) and the Jacobian for a Newton step."""
        at, turned, columns = self.chain.symbolic_pose(c, s)
        J = ca.horzcat(*columns)
        if not self.oriented or R is None:
            return T - at, J[:3, :]
        twist = sum((ca.cross(turned[:, k], R[:, k]) for k in range(3)), ca.SX.zeros(3)) / 2
        return ca.vertcat(T - at, twist), J

    def _label(self, kind: str, joint: int) -> str:
        j = self.nominal.plan.order[joint]
        name = next((b.name for b in self.branches if b.joint == j), "")
        return f"q[{j}]" + (f" ({name})" if name else "")


@lru_cache(maxsize=64)
def closed_form(chain: Chain, *, oriented: bool = True) -> ClosedForm | None:
    """Return the closed form of the inverse kinematics of a chain, or None if its axes have no structure for it.

    `oriented`: T and R are known, else T alone, for up to three joints. The structure is looked for exactly, then
    nearly: axes that are parallel or meet within 5e-3 (rad, or relative to the chain's length), as in a calibrated arm.
    Fewer joints than the pose has degrees of freedom are solved and the remaining conditions checked.

    >>> from gtmodel.geometry.chains import Chain, closed_form
    >>> arm = Chain([[0, 0, 1], [0, 0, 1]], [[0, 0, 0], [0.4, 0, 0]], T=[0.7, 0, 0])
    >>> closed_form(arm, oriented=False).names
    ('left', 'right')
    """
    if len(chain) > 6 or (not oriented and len(chain) > 3):
        return None
    for tolerance in (EXACT, NEAR):
        for plan in plans(chain, oriented, tolerance):
            near = tolerance != EXACT
            candidate = nominal(chain, plan)
            if candidate.off > tolerance:
                continue
            form = _named(chain, candidate, oriented, near)
            if form is not None and _returns(form):
                return form
    return None


def roots_at(arm: Nominal, q: ca.SX) -> list[TwoValued]:
    """Return the roots of a recipe with their slopes at joint coordinates of the original chain."""
    known = [float(arm.sign[j]) * q[i] for j, i in enumerate(arm.plan.order)]
    steps = JointSteps(len(known), arm.chain.size, known=known)
    c, s = _cosines(arm.chain, known)
    solve(arm, steps, _Displaced(arm.chain, c, s))
    return steps.roots


def _cosines(chain: Chain, q: Sequence[ca.SX]) -> tuple[list[Any], list[Any]]:
    """Return cosines and sines; for prismatic joints 1 and the length."""
    pairs = [(ca.cos(x), ca.sin(x)) if r else (1.0, x) for x, r in zip(q, chain.revolute, strict=True)]
    return [c for c, _ in pairs], [s for _, s in pairs]


class _Given:
    """The displacement of a given pose from the home pose, inverted for a chain from end to base."""

    def __init__(self, arm: Nominal, T: ca.SX, R: ca.SX | None) -> None:
        self.reverse, self.T, self.T0, self.R0 = arm.plan.reverse, T, arm.chain.T, arm.chain.R
        self.R = ca.SX.eye(3) if R is None else R  # T alone: the wrist is the end, and R has no effect

    def point(self, p: np.ndarray) -> Any:
        if self.reverse:
            return ca.SX(self.T0) + ca.SX(self.R0) @ (self.R.T @ (ca.SX(p) - self.T))
        local = self.R0.T @ (p - self.T0)
        local[np.abs(local) < 1e-14] = 0.0
        if not np.any(local):
            return self.T + ca.SX(local)
        return self.T + self.R @ ca.SX(local)

    def vector(self, v: np.ndarray) -> Any:
        if self.reverse:
            return ca.SX(self.R0) @ (self.R.T @ ca.SX(v))
        return self.R @ ca.SX(self.R0.T @ v)


class _Displaced:
    """The displacement of a chain at joint coordinates."""

    def __init__(self, chain: Chain, c: Any, s: Any) -> None:
        still = Chain(chain.axes, chain.points, chain.revolute)
        self.p, self.R, _ = still.symbolic_pose(c, s)

    def point(self, p: np.ndarray) -> Any:
        return self.R @ ca.SX(p) + self.p

    def vector(self, v: np.ndarray) -> Any:
        return self.R @ ca.SX(v)


def _named(chain: Chain, arm: Nominal, oriented: bool, near: bool) -> ClosedForm | None:
    """Return the closed form with names from the geometry; None if an equation of it is degenerate."""
    try:
        roots = roots_at(arm, ca.SX.sym("q", len(chain)))
    except NoSolution:
        return None
    plan, n = arm.plan, len(arm.chain)
    turning = n - 2 if plan.wrist == 3 else None  # the middle axis of a spherical wrist
    places = sorted((plan.order[r.joint], k) for k, r in enumerate(roots) if r.joint != turning)
    if plan.kind == "parallel" or len(places) == 3:
        names = ["shoulder", "elbow", "wrist"]
    elif len(places) == 2:
        names = ["elbow", "wrist"] if plan.reverse else ["shoulder", "elbow"]
    else:
        names = ["elbow"]
    named = dict(zip((k for _, k in places), names, strict=False))
    named.update({k: "shoulder" if plan.reverse else "wrist" for k, r in enumerate(roots) if r.joint == turning})
    branches, factors = [], []
    ranked = sorted(named, key=lambda k: ("shoulder", "elbow", "wrist").index(named[k]))
    for k in ranked:
        words, factor, others = _words(arm, roots[k], named[k], k, [r for r in ranked if named[r] == "shoulder"])
        branches.append(BranchSign(named[k], words, plan.order[roots[k].joint]))
        factors.append((factor, tuple(ranked.index(i) for i in others)))
    return ClosedForm(chain, arm, oriented, near, tuple(branches), tuple(factors))


def _words(
    arm: Nominal, root: TwoValued, name: str, k: int, shoulder: list[int]
) -> tuple[tuple[str, str], float, tuple[int, ...]]:
    """Return the words of a root, the factor between its sign and its branch's, and the roots that multiply it."""
    plan, h, o = arm.plan, arm.chain.axes, arm.chain.points
    revolute, straight = arm.chain.revolute, not plan.reverse
    parallel = plan.kind == "parallel" or plan.motion == "parallel"
    first = plan.kind == "parallel" or plan.single == 0
    a, b = (1, 2) if plan.kind == "parallel" else plan.pair or (0, 1)
    if not revolute[root.joint]:
        return ("out", "in"), 1.0, ()
    if name == "wrist" or (name == "shoulder" and plan.reverse):
        return ("no flip", "flip"), 1.0, ()
    up = h[0] * _sense(h[0])
    if straight and parallel and first and root.joint == 0:
        ahead, across = np.cross(h[a], h[0]), float(h[a] @ (arm.centre - o[0]))
        if not root.fixed:  # left: the arm is on the left of the line from axis 1 to the wrist, seen from above
            return ("left", "right"), float(np.sign(across * (up @ h[0])) or 1.0), ()
        places = [float(ahead @ (x - o[0])) for x in (o[a], arm.centre)]
        return ("front", "back"), next((float(np.sign(x)) for x in places if abs(x) > 1e-9 * arm.chain.size), 1.0), ()
    if straight and parallel and root.joint == b:
        if first and revolute[0] and shoulder:
            # up: the elbow is above the line from shoulder to wrist, with the wrist ahead
            return ("up", "down"), float(np.sign(h[0] @ up)), tuple(shoulder)
        vertical = h[a] @ np.array([0.0, 0.0, 1.0])
        if abs(vertical) > 0.7:  # left: the elbow is on the left of the line to the end, seen from above
            return ("left", "right"), -float(np.sign(vertical)), ()
        heading = np.cross(h[a], [0.0, 0.0, 1.0])
        heading = heading * _sense(heading[[2, 1, 0]])
        return ("up", "down"), -float(np.sign(np.cross(h[a], heading) @ [0.0, 0.0, 1.0])), ()
    return {"shoulder": ("left", "right"), "elbow": ("up", "down")}[name], 1.0, ()


def _sense(v: np.ndarray) -> float:
    """Return the sign of the last entry of v that is not zero."""
    return next((float(np.sign(x)) for x in v[::-1] if abs(x) > 1e-6), 1.0)


def _returns(form: ClosedForm) -> bool:
    """Return whether the closed form gives back random joint coordinates on the branch that the slopes tell."""
    chain = form.chain
    scale = np.where(chain.revolute, np.pi, chain.size)
    q = np.random.default_rng(1).uniform(-scale, scale, (PROBES, len(scale)))
    try:
        f, slopes = form.function, form.slope_function
    except NoSolution:
        return False
    T, R = chain.pose(q)
    signs = np.sign(np.asarray(ca.densify(slopes(q.T)))) if form.branches else np.zeros((0, PROBES))
    back = np.asarray(ca.densify(f(T.T, R.transpose(0, 2, 1).reshape(-1, 9).T, signs)[0])).T
    if not np.all(np.isfinite(back)):
        return False
    at, turned = chain.pose(back)
    off = np.maximum(np.abs(at - T).max(axis=1) / chain.size, np.abs(turned - R).max(axis=(1, 2)) * form.oriented)
    if form.near:
        return bool(np.mean(off < RETURNED) > 0.7)
    difference = np.where(chain.revolute, np.abs(np.exp(1j * back) - np.exp(1j * q)), np.abs(back - q))
    return bool(np.all(off < RETURNED) and np.mean(difference.max(axis=1) < RETURNED) > 0.9)
