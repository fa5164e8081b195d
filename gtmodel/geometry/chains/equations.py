"""The equations of one joint that closed forms consist of, solved in expressions or evaluated at known joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np

EDGE = 1e-12  # a discriminant, relative to the largest of its kind, that is round-off below zero
TINY = 1e-150  # makes the direction of a zero vector the first axis: the declared member at a singular pose


class NoSolution(Exception):
    """The equation does not depend on the joint: another structure is needed."""


@dataclass(eq=False)
class TwoValued:
    """A two-valued step: the joint, its sign in the expressions, and the slope that has the same sign.

    `fixed`: the equation has no constant term, so that both values exist everywhere.
    """

    joint: int
    sign: ca.SX
    slope: ca.SX
    fixed: bool = False


@dataclass(eq=False)
class JointSteps:
    """Joint coordinates of a chain, found one after the other; `cosine` and `sine` (prismatic: 1 and the length).

    With `known` joints the steps are not solved: their cosines and sines are those of `known`, and each root takes the
    slope there. `clip` is the length, relative to the largest, by which a discriminant may be negative.
    """

    n: int
    size: float
    signs: Sequence[ca.SX] = ()
    known: Sequence[ca.SX] | None = None
    clip: float = EDGE
    q: list[ca.SX] = field(default_factory=list)
    cosine: list[Any] = field(default_factory=list)
    sine: list[Any] = field(default_factory=list)
    roots: list[TwoValued] = field(default_factory=list)
    margins: list[tuple[str, ca.SX, int]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.q = [ca.SX(0)] * self.n
        self.cosine, self.sine = [ca.SX(1)] * self.n, [ca.SX(0)] * self.n

    def trigonometric(self, j: int, A: Any, B: Any, D: Any, scale: float, square: Any = None) -> None:
        """Solve A cos q + B sin q = D; `scale`: the largest size of A and B; `square`: A^2 + B^2 - D^2, if known."""
        A, B, D = ca.SX(A), ca.SX(B), ca.SX(D)
        fixed = D.is_zero() and square is None
        if A.is_zero() and B.is_zero():
            raise NoSolution
        if self._known(j, lambda c, s: A * s - B * c, fixed):
            return
        sign = self._sign(j, fixed)
        r2 = A * A + B * B
        if fixed or square is not None:
            root = ca.sqrt(r2 if square is None else square)
            self.margins.append(("pivot", root / scale, j))
        else:
            root = self._root(r2 - D * D, scale, j)
        if fixed:
            self._set(j, -(sign * B), sign * A, root)
        else:
            turned = sign * root
            self._set(j, D * A - turned * B, D * B + turned * A, r2, regular=True)

    def direction(self, j: int, x: Any, y: Any, norm: Any = None, pivot: float = 0.0) -> None:
        """Solve (cos q, sin q) = (x, y) / norm; `pivot`: the size of a norm that can vanish."""
        if self._known(j):
            return
        x, y = ca.SX(x), ca.SX(y)
        norm = ca.sqrt(x * x + y * y) if norm is None else ca.SX(norm)
        if pivot:
            self.margins.append(("pivot", norm / pivot, j))
        self._set(j, x, y, norm, regular=norm.is_constant())

    def quadratic(self, j: int, b: Any, c: Any) -> None:
        """Solve q^2 + 2 b q + c = 0 for a prismatic joint."""
        if self._known(j, lambda _, q: q + b, slides=True):
            return
        sign = self._sign(j, False)
        self._slide(j, sign * self._root(b * b - c, self.size, j) - b)

    def linear(self, j: int, value: Any) -> None:
        """Set a prismatic joint."""
        if not self._known(j, slides=True):
            self._slide(j, ca.SX(value))

    def wrist_root(self, j: int, A: float, B: float, D: Any, others: tuple[Any, Any] | None) -> ca.SX:
        """Solve A cos q + B sin q = D of a wrist and return slope = A sin q - B cos q.

        others: D and these two make a unit vector; with A^2 + B^2 = 1 they give a root without cancellation.
        """
        exact = others is not None and abs(A * A + B * B - 1) < EDGE
        square = others[0] * others[0] + others[1] * others[1] if exact and others is not None else None
        self.trigonometric(j, A, B, D, float(np.hypot(A, B)), square)
        return A * self.sine[j] - B * self.cosine[j]

    def _root(self, discriminant: Any, scale: float, j: int) -> Any:
        relative = discriminant / scale**2
        self.margins.append(("discriminant", relative + self.clip, j))
        root = ca.sqrt(ca.fmax(discriminant, 0))
        self.margins.append(("pivot", root / scale, j))
        return root

    def _known(self, j: int, slope: Any = None, fixed: bool = False, slides: bool = False) -> bool:
        if self.known is None:
            return False
        value = self.known[j]
        self.q[j] = value
        self.cosine[j], self.sine[j] = (ca.SX(1), value) if slides else (ca.cos(value), ca.sin(value))
        if slope is not None:
            self.roots.append(TwoValued(j, ca.SX(0), slope(self.cosine[j], self.sine[j]), fixed))
        return True

    def _sign(self, j: int, fixed: bool) -> ca.SX:
        sign = self.signs[len(self.roots)]
        self.roots.append(TwoValued(j, sign, ca.SX(0), fixed))
        return sign

    def _set(self, j: int, x: Any, y: Any, norm: Any, regular: bool = False) -> None:
        if not regular:
            x, norm = x + TINY, norm + TINY
        self.q[j] = ca.atan2(y, x)
        self.cosine[j], self.sine[j] = x / norm, y / norm

    def _slide(self, j: int, value: ca.SX) -> None:
        self.q[j] = self.sine[j] = value
