"""The closed forms of nominal chains: one equation after the other, for the plans of `structure`."""

from __future__ import annotations

from typing import Any, Protocol

import casadi as ca
import numpy as np

from .chain import snapped, turned
from .equations import JointSteps, NoSolution
from .structure import Nominal


class Displacement(Protocol):
    """Displacement from the home pose of a nominal chain, applied to constant points and directions."""

    def point(self, p: np.ndarray) -> Any: ...

    def vector(self, v: np.ndarray) -> Any: ...


def solve(nominal: Nominal, steps: JointSteps, X: Displacement) -> None:
    """Fill in the steps of a nominal chain for a displacement. Raises NoSolution if the plan does not suit it."""
    arm = _Arm(nominal, steps, X)
    if nominal.plan.kind == "parallel":
        arm.three_parallel()
    else:
        arm.wrist_at_the_end()


class _Arm:
    def __init__(self, nominal: Nominal, steps: JointSteps, X: Displacement) -> None:
        self.plan, self.steps, self.X = nominal.plan, steps, X
        self.h, self.o, self.revolute = nominal.chain.axes, nominal.chain.points, nominal.chain.revolute
        self.centre, self.size = nominal.centre, steps.size

    def rotation(self, *joints: int) -> Any:
        """Return the product of rotations of joints that follow each other; those about parallel axes are added."""
        product, pending = None, None
        for j in joints:
            if not self.revolute[j]:
                continue
            c, s = self.steps.cosine[j], self.steps.sine[j]
            if pending is not None and np.array_equal(pending[0], self.h[j]):
                _, a, b = pending
                c, s = a * c - b * s, b * c + a * s
            elif pending is not None:
                product = _times(product, turned(*pending))
            pending = (self.h[j], c, s)
        return _times(product, turned(*pending)) if pending is not None else ca.SX.eye(3)

    def moved(self, j: int, x: Any) -> Any:
        """Return the point x moved by joint j."""
        if not self.revolute[j]:
            return x + self.h[j] * self.steps.sine[j]
        o = ca.SX(self.o[j])
        return o + turned(self.h[j], self.steps.cosine[j], self.steps.sine[j]) @ (x - o)

    def back(self, j: int, x: Any) -> Any:
        """Return the point x moved by the inverse of joint j."""
        if not self.revolute[j]:
            return x - self.h[j] * self.steps.sine[j]
        o = ca.SX(self.o[j])
        return o + turned(self.h[j], self.steps.cosine[j], self.steps.sine[j]).T @ (x - o)

    # the wrist's centre is brought to its place by up to three joints, then the wrist turns

    def wrist_at_the_end(self) -> None:
        plan, centre, place = self.plan, ca.SX(self.centre), self.X.point(self.centre)
        if plan.pair is None:
            if plan.single is not None:
                self.one(plan.single, centre, place)
        elif plan.single is None:
            self.two(centre, place)
        elif plan.single == 0:
            self.first(place)
            self.two(centre, self.back(0, place))
        else:
            self.last(place)
            self.two(self.moved(2, centre), place)
        n = len(self.h)
        arm = self.rotation(*range(n - plan.wrist))
        [lambda *_: None, self.turn, self.two_turns, self.three_turns][plan.wrist](arm)

    def one(self, j: int, x: Any, y: Any) -> None:
        """Solve moved(j, x) = y, as far as the joint can."""
        h, o = ca.SX(self.h[j]), ca.SX(self.o[j])
        if self.revolute[j]:
            self.about(j, x - o, y - o)
        else:
            self.steps.linear(j, ca.dot(h, y - x))

    def about(self, j: int, v: Any, u: Any, pivot: float = 0.0) -> None:
        """Solve R_j v = u across the axis."""
        h = ca.SX(self.h[j])
        v, u = v - h * ca.dot(h, v), u - h * ca.dot(h, u)
        square = ca.dot(v, v)
        if square.is_zero():
            raise NoSolution
        # near the axis the lengths of v and u differ by round-off: only a norm of their own gives a rotation
        norm = square if square.is_constant() else None
        self.steps.direction(j, ca.dot(v, u), ca.dot(h, ca.cross(v, u)), norm, pivot)

    def invariant(self) -> tuple[str, Any, Any]:
        """Return what the pair leaves unchanged: a coordinate along n, or the distance from a point or an axis."""
        a, b = self.plan.pair or (0, 1)
        turning = a if self.revolute[a] else b
        if self.plan.motion in ("parallel", "plane"):
            return ("along", self.h[turning], None)
        if self.plan.motion == "slide":
            return ("along", np.cross(self.h[a], self.h[b]), None)
        across = np.eye(3)
        if self.plan.motion == "cylinder":
            across = across - np.outer(self.h[turning], self.h[turning])
        return ("distance", snapped(across), self.o[turning])

    def first(self, place: Any) -> None:
        """Solve I(back(0, place)) = I(centre)."""
        kind, n, point = self.invariant()
        h, o, w = self.h[0], self.o[0], self.centre
        if kind == "along" and self.revolute[0]:
            v = place - ca.SX(o)
            D = float(_clean(n @ (w - o), self.size))
            D = D - float(_clean(n @ h)) * ca.dot(ca.SX(h), v)
            self.trigonometric(0, n - (n @ h) * h, -np.cross(n, h), v, D, self.size)
        elif kind == "along":
            self.slide(0, n, ca.dot(ca.SX(n), place - ca.SX(w)))
        elif self.revolute[0]:
            self.parallel_to_distance(n, h)
            foot = o + h * (h @ (point - o))
            u, v = n @ (foot - point), ca.SX(n) @ (place - ca.SX(foot))
            rest = n @ (w - point)
            D = (float(rest @ rest - u @ u) - ca.dot(v, v)) / 2
            self.trigonometric(0, u - (u @ h) * h, -np.cross(u, h), v, D, self.size**2)
        else:
            u, rest = ca.SX(n) @ (place - ca.SX(point)), n @ (w - point)
            self.square(0, n @ h, -ca.dot(ca.SX(n @ h), u), ca.dot(u, u) - float(rest @ rest))

    def last(self, place: Any) -> None:
        """Solve I(moved(2, centre)) = I(place)."""
        kind, n, point = self.invariant()
        h, o, w = self.h[2], self.o[2], self.centre
        if kind == "along" and self.revolute[2]:
            foot = o + h * (h @ (w - o))
            D = ca.dot(ca.SX(n), place - ca.SX(foot))
            self.trigonometric(2, n - (n @ h) * h, np.cross(n, h), ca.SX(_clean(w - foot, self.size)), D, self.size)
        elif kind == "along":
            self.slide(2, n, ca.dot(ca.SX(n), place - ca.SX(w)))
        elif self.revolute[2]:
            self.parallel_to_distance(n, h)
            foot = o + h * (h @ (point - o))
            u, v, rest = n @ (foot - point), n @ (w - foot), ca.SX(n) @ (place - ca.SX(point))
            D = (ca.dot(rest, rest) - float(u @ u + v @ v)) / 2
            self.trigonometric(2, u - (u @ h) * h, np.cross(u, h), ca.SX(_clean(v, self.size)), D, self.size**2)
        else:
            u, rest = n @ (w - point), ca.SX(n) @ (place - ca.SX(point))
            self.square(2, n @ h, float(n @ h @ u), float(u @ u) - ca.dot(rest, rest))

    def parallel_to_distance(self, n: np.ndarray, h: np.ndarray) -> None:
        """A distance from an axis is an equation of one angle if that turns about a parallel axis only."""
        if np.trace(n) < 2.5 and np.linalg.norm(n @ h) > 1e-9:
            raise NoSolution

    def trigonometric(self, j: int, a: np.ndarray, b: np.ndarray, v: Any, D: Any, scale: float) -> None:
        self.steps.trigonometric(j, _dot(_clean(a, self.size), v), _dot(_clean(b, self.size), v), D, scale)

    def slide(self, j: int, n: np.ndarray, value: Any) -> None:
        if abs(n @ self.h[j]) < 1e-9:
            raise NoSolution
        self.steps.linear(j, value / float(_clean(n @ self.h[j])))

    def square(self, j: int, d: np.ndarray, b: Any, c: Any) -> None:
        a = float(_clean(d @ d))
        if a < 1e-9:
            raise NoSolution
        self.steps.quadratic(j, b / a, c / a)

    def two(self, x: Any, y: Any) -> None:
        """Solve moved(a, moved(b, x)) = y."""
        a, b = self.plan.pair or (0, 1)
        getattr(self, f"two_{self.plan.motion}")(a, b, x, y)

    def two_parallel(self, a: int, b: int, x: Any, y: Any) -> None:
        h, link = self.h[a], self.o[b] - self.o[a]
        link = link - h * (h @ link)
        length = float(np.linalg.norm(link))
        if length < 1e-9 * self.size:
            raise NoSolution
        plane = snapped(np.array([link / length, np.cross(h, link / length)]))
        w, u = ca.SX(plane) @ (x - ca.SX(self.o[b])), ca.SX(plane) @ (y - ca.SX(self.o[a]))
        w, square = _simple(w, self.size), u[0] * u[0] + u[1] * u[1]
        D = (square - (length**2 + ca.dot(w, w))) / 2
        self.steps.trigonometric(b, length * w[0], -length * w[1], D, self.size**2)
        c, s = self.steps.cosine[b], self.steps.sine[b]
        p = [length + (c * w[0] - s * w[1]), s * w[0] + c * w[1]]
        self.steps.direction(a, p[0] * u[0] + p[1] * u[1], p[0] * u[1] - p[1] * u[0])

    def two_meet(self, a: int, b: int, x: Any, y: Any) -> None:
        ha, hb, point = self.h[a], self.h[b], ca.SX(self.o[a])
        v, u = _simple(x - point, self.size), y - point
        along = ca.dot(ca.SX(ha), u)
        D = along - float(_clean(ha @ hb)) * ca.dot(ca.SX(hb), v)
        A, B = _dot(_clean(ha - (ha @ hb) * hb), v), _dot(_clean(np.cross(ha, hb)), v)
        self.steps.trigonometric(b, A, B, D, self.size)
        self.about(a, turned(hb, self.steps.cosine[b], self.steps.sine[b]) @ v, u)

    def two_slide(self, a: int, b: int, x: Any, y: Any) -> None:
        lengths = ca.SX(snapped(np.linalg.pinv(np.column_stack([self.h[a], self.h[b]])))) @ (y - x)
        self.steps.linear(a, lengths[0])
        self.steps.linear(b, lengths[1])

    def two_cylinder(self, a: int, b: int, x: Any, y: Any) -> None:
        turning, sliding = (a, b) if self.revolute[a] else (b, a)
        self.steps.linear(sliding, ca.dot(ca.SX(self.h[sliding]), y - x))
        o = ca.SX(self.o[turning])
        self.about(turning, x - o, y - o, pivot=0.0 if ca.SX(x).is_constant() else self.size**2)

    def two_plane(self, a: int, b: int, x: Any, y: Any) -> None:
        turning, sliding = (a, b) if self.revolute[a] else (b, a)
        h, d, o = self.h[turning], self.h[sliding], ca.SX(self.o[turning])
        across = ca.SX(snapped(np.eye(3) - np.outer(h, h)))
        w, u, d = _simple(across @ (x - o), self.size), across @ (y - o), ca.SX(d)
        w2, u2 = ca.dot(w, w), ca.dot(u, u)
        if turning == a:  # |w + q d| = |u|
            self.steps.quadratic(sliding, ca.dot(d, w), w2 - u2)
            w = w + d * self.steps.sine[sliding]
        else:  # |u - q d| = |w|
            self.steps.quadratic(sliding, -ca.dot(d, u), u2 - w2)
            u = u - d * self.steps.sine[sliding]
        self.about(turning, w, u, pivot=0.0 if w2.is_constant() and turning == b else self.size**2)

    # the wrist turns by the displacement's rotation without that of the arm

    def read(self, j: int, x: Any, f: np.ndarray) -> None:
        """Solve R_j' f = x across the axis, with x given as a function of two constant directions across it."""
        h = self.h[j]
        one = f - h * (h @ f)
        two = np.cross(h, one)
        norm = float(one @ one)
        self.steps.direction(j, x(snapped(one)), -x(snapped(two)), norm=norm)

    def turn(self, arm: Any) -> None:
        j = len(self.h) - 1
        h = self.h[j]
        across = np.cross(h, np.eye(3)[np.argmin(np.abs(h))])
        image = arm @ ca.SX(snapped(across / np.linalg.norm(across)))
        self.read(j, lambda f: ca.dot(self.X.vector(f), image), snapped(across / np.linalg.norm(across)))

    def two_turns(self, arm: Any) -> None:
        a, b = len(self.h) - 2, len(self.h) - 1
        hb = ca.SX(self.h[b])
        self.about(a, hb, arm.T @ (self.X.vector(self.h[b])))
        image = arm @ ca.SX(self.h[a])
        self.read(b, lambda f: ca.dot(self.X.vector(f), image), self.h[a])

    def three_turns(self, arm: Any) -> None:
        a, b, c = (len(self.h) - k for k in (3, 2, 1))
        ha, hb, hc = self.h[a], self.h[b], self.h[c]
        v = arm.T @ (self.X.vector(hc))  # R_a R_b hc = v
        one = np.cross(ha, hb)
        one = one / np.linalg.norm(one)
        one, two = snapped(one), snapped(np.cross(ha, one))
        x, y = _dot(one, v), _dot(two, v)
        A, B, D = self.wrist_equation(a, b, c, _dot(ha, v))
        slope = self.steps.wrist_root(b, A, B, D, (x, y))
        # R_b hc across axis a: -slope along ha x hb, and what the angle between the axes leaves along the other
        along, rest = float(np.linalg.norm(np.cross(ha, hb))), float(_clean(hb @ hc))
        p = -slope / along
        if abs(ha @ hb) < 1e-12 and abs(rest) < 1e-12:
            self.steps.direction(a, p * x, p * y, norm=p * p)
        else:
            r = (float(ha @ hb) * _dot(ha, v) - rest) / along
            self.steps.direction(a, p * x + r * y, p * y - r * x)
        turn = turned(ha, self.steps.cosine[a], self.steps.sine[a])
        image = arm @ (turn @ ca.SX(hb))  # R_c' hb is its image under the rest of the rotation
        self.read(c, lambda f: ca.dot(self.X.vector(f), image), hb)

    def wrist_equation(self, a: int, b: int, c: int, along: Any) -> tuple[float, float, Any]:
        """Return A, B, D of ha . R_b hc = along."""
        ha, hb, hc = self.h[a], self.h[b], self.h[c]
        both = float(_clean((ha @ hb) * (hb @ hc)))
        return (
            float(_clean(ha @ hc - both)),
            float(_clean(ha @ np.cross(hb, hc))),
            along - both,
        )

    # axes 2, 3 and 4 parallel, axes 5 and 6 meet

    def three_parallel(self) -> None:
        h, centre = self.h[1], self.centre
        place = self.X.point(centre)
        o, h1 = self.o[0], self.h[0]
        v = place - ca.SX(o)
        D = float(_clean(h @ (centre - o), self.size)) - float(_clean(h @ h1)) * ca.dot(ca.SX(h1), v)
        self.trigonometric(0, h - (h @ h1) * h1, -np.cross(h, h1), v, D, self.size)
        first = self.rotation(0)
        n = first @ ca.SX(h)  # direction of the parallel axes
        # n . X h6 = h . R5 h6
        h5, h6 = self.h[4], self.h[5]
        one = np.cross(h6, h5)
        one = snapped(one / np.linalg.norm(one))
        two = snapped(np.cross(h6, one))
        x, y, z = (ca.dot(n, self.X.vector(f)) for f in (one, two, h6))
        A, B, D = self.wrist_equation(1, 4, 5, z)
        slope = self.steps.wrist_root(4, A, B, D, (x, y))
        # R6' R5' h = X' n; across axis 6: +slope along h6 x h5, and what the angles between the axes leave
        along, rest = float(np.linalg.norm(np.cross(h6, h5))), float(_clean(h @ h5))
        p = slope / along
        if abs(h5 @ h6) < 1e-12 and abs(rest) < 1e-12:
            self.steps.direction(5, p * x, -(p * y), norm=p * p)
        else:
            r = (float(h5 @ h6) * z - rest) / along
            self.steps.direction(5, p * x + r * y, -(p * y - r * x))
        # R2 R3 R4 h5 = R1' X R6' h5
        c, s = self.steps.cosine[5], self.steps.sine[5]
        rest, side = snapped(h5 - h6 * (h6 @ h5)), snapped(np.cross(h6, h5))
        spun = c * self.X.vector(rest) - s * self.X.vector(side)
        if along < 1 - 1e-12:
            spun += self.X.vector(snapped(h6 * (h6 @ h5)))
        carried = first.T @ spun
        across = h5 - h * (h @ h5)
        norm = float(across @ across)
        cosine = _dot(snapped(across), carried) / norm
        sine = _dot(snapped(np.cross(h, across)), carried) / norm
        o4 = ca.SX(self.o[3])
        reach = turned(h, cosine, sine) @ (ca.SX(centre) - o4)
        self.two_parallel(1, 2, o4, self.back(0, place) - reach)
        steps = self.steps
        c23 = steps.cosine[1] * steps.cosine[2] - steps.sine[1] * steps.sine[2]
        s23 = steps.sine[1] * steps.cosine[2] + steps.cosine[1] * steps.sine[2]
        steps.direction(3, cosine * c23 + sine * s23, sine * c23 - cosine * s23, norm=1.0)


def _times(a: Any, b: Any) -> Any:
    return b if a is None else a @ b


def _clean(x: Any, size: float = 1.0) -> Any:
    """Return x without entries that are round-off."""
    return snapped(x, size)


def _dot(n: np.ndarray, v: Any) -> Any:
    return ca.dot(ca.SX(n), v)


def _simple(v: Any, size: float) -> Any:
    """Return a constant vector without round-off, others as they are."""
    v = ca.SX(v)
    return ca.SX(snapped(np.asarray(ca.DM(v)).ravel(), size)) if v.is_constant() else v
