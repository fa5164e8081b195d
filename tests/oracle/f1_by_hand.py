"""The F1 by hand in NumPy and mpmath: joints by its own matrices, closure by Newton. Nothing here knows gtmodel.

Written from Dressler 2012, eqs. (4.16)-(4.24) and (4.34), with 4 x 4 homogeneous matrices as printed there.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import mpmath
import numpy as np

Array = np.ndarray
DIGITS = 30


def from_quaternion(u: Any) -> Any:
    """The matrix below eq. (4.34): w^2 - x.x on the diagonal, twice the dyad, twice the cross product; raw."""
    w, x = u[0], np.array(u[1:])
    K = np.array([[0 * w, -x[2], x[1]], [x[2], 0 * w, -x[0]], [-x[1], x[0], 0 * w]])
    return (w * w - x @ x) * np.eye(3, dtype=int) + 2 * np.outer(x, x) + 2 * w * K


def homogeneous(R: Any, r: Any) -> Any:
    H = np.array([[0] * 4] * 4, dtype=object if np.asarray(R).dtype == object else float)
    H[:3, :3], H[:3, 3], H[3, 3] = R, r, 1
    return H


def about(axis: int, angle: Any, m: Any) -> Any:
    """Rotation about coordinate axis 0, 1 or 2; m is the module whose sin and cos are meant."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    R = np.array(np.eye(3), dtype=float if m is np else object)
    R[i, i], R[i, j], R[j, i], R[j, j] = m.cos(angle), -m.sin(angle), m.sin(angle), m.cos(angle)
    return R


@dataclass(frozen=True)
class F1ByHand:
    """A printed table in metres; masses of `energy` in kg."""

    A0: Array
    v: Array
    L: Array
    A: Array
    B: Array
    u1_2: Array
    u1_3: Array
    u2_3: Array
    r3: Array
    masses: dict[str, Array] = field(default_factory=dict)

    @classmethod
    def printed(cls, table: dict[str, Any]) -> F1ByHand:
        mm = {new: np.array(table[old]) / 1000 for new, old in
              dict(A0="A0_mm", L="L_mm", A="A_bj_mm", B="B0_mm", r3="r3_mm").items()}  # fmt: skip
        raw = {k: np.array(table[k]) for k in ("u1_2", "u1_3", "u2_3")}
        return cls(v=np.array([table["v"]] * 3), **mm, **raw)

    def cart_joints(self, q: Any, m: Any = np) -> Any:
        """(6, 3) by H_1, H_2 and H_3."""
        I = np.eye(3)
        H1 = homogeneous(I, self.A0[0] + q[0] * self.v[0])
        H2 = homogeneous(from_quaternion(self.u1_2) @ about(1, q[3], m), self.A0[1] + q[1] * self.v[1])
        outer = from_quaternion(self.u1_3) @ about(1, q[4], m)
        H3 = homogeneous(
            outer @ from_quaternion(self.u2_3) @ about(0, q[5], m), self.A0[2] + q[2] * self.v[2] + outer @ self.r3
        )
        hs = (H1, H2, H2, H3, H3, H3)
        return np.array([(H @ np.append(a, 1))[:3] for H, a in zip(hs, self.A, strict=True)])

    def links(self, q: Any, T: Any, R: Any, m: Any = np) -> Any:
        """Vectors from cart joints to plate joints (6, 3)."""
        return np.asarray(T) + self.B @ np.asarray(R).T - self.cart_joints(q, m)

    def rows(self, d: Array, R: Array) -> Array:
        """d_k . (Tdot + w x R B_k) as a matrix on (Tdot, w)."""
        return np.hstack([d, np.cross(self.B @ R.T, d)])

    def pose(self, q: Array, T: Array, R: Array) -> tuple[Array, Array]:
        """Forward kinematics from a nearby pose: the Stewart platform's Newton on (T, w) with R = exp(w) R."""
        for _ in range(40):
            d = self.links(q, T, R)
            step = np.linalg.solve(self.rows(d, R), (self.L**2 - np.sum(d * d, axis=1)) / 2)
            angle = np.linalg.norm(step[3:])
            half = np.append(np.cos(angle / 2), np.sinc(angle / 2 / np.pi) / 2 * step[3:])
            T, R = T + step[:3], from_quaternion(half) @ R
            if np.max(np.abs(step)) < 1e-15:
                break
        return T, R

    def exact_pose(self, q: Array, T: Array, e: Array) -> tuple[Array, Array]:
        """(T, e) refined from nearby with thirty digits."""
        with mpmath.workdps(DIGITS):
            q = np.array([mpmath.mpf(float(x)) for x in q], dtype=object)

            def closure(*x: Any) -> list[Any]:
                e = np.array(x[3:], dtype=object)
                d = self.links(q, np.array(x[:3], dtype=object), from_quaternion(e), mpmath)
                return [*(np.sum(d * d, axis=1) - self.L**2), e @ e - 1]

            x = np.array([float(y) for y in mpmath.findroot(closure, [float(y) for y in [*T, *e]])])
        return x[:3], x[3:]

    def potential_energy(self, q: Array, T: Array, R: Array) -> float:
        """Weight of plate, carts and links, these at mid-length, along -z [J]."""
        m, ends = self.masses, (self.cart_joints(q) + T + self.B @ R.T) / 2
        carts = self.A0[:, 2] + q[:3] * self.v[:, 2]
        return 9.81 * float(m["m_p"] * T[2] + m["m_a"] @ ends[:, 2] + m["m_c"] @ carts)
