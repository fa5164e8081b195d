"""Closures of links, their rates and motor forces by virtual work, in extended precision and row by row.

Written from Dressler 2012, eqs. (4.16)-(4.24), (6.3)-(6.8) and section 4.4; nothing here knows gtmodel. What a
function answered is judged backwards: by how much its own numbers miss an equation, over the size of its terms.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Array = np.ndarray
REAL = np.longdouble  # 64 bits of mantissa on x86: three more digits than what is judged
GRAVITY = np.array([0, 0, -9.81], REAL)
ARM = np.array([0, 1, 1, 2, 2, 2])
TINY = REAL(np.finfo(np.float32).tiny)  # a speed like this is none; keeps 0/0 from a row at rest


def extended(values: object) -> Array:
    """The same numbers with more bits."""
    return np.asarray(values).astype(REAL)


def dot(a: Array, b: Array) -> Array:
    return np.sum(a * b, axis=-1)


def rotation(e: Array) -> Array:
    """(rows, 3, 3) of quaternions (rows, 4), scalar first, raw: w^2 - x.x on the diagonal, twice dyad and cross."""
    return product(e, e)


def product(a: Array, b: Array) -> Array:
    """The bilinear form behind `rotation`, symmetric: its rate at e is 2 product(e, de/dt)."""
    w, x, v, y = a[:, 0, None, None], a[:, 1:], b[:, 0, None, None], b[:, 1:]
    same = (w * v) - dot(x, y)[:, None, None]
    dyad = x[:, :, None] * y[:, None, :] + y[:, :, None] * x[:, None, :]
    return same * np.eye(3, dtype=REAL) + dyad + w * cross_matrix(y) + v * cross_matrix(x)


def cross_matrix(x: Array) -> Array:
    z = np.zeros(len(x), REAL)
    a, b, c = x.T
    return np.array([[z, -c, b], [c, z, -a], [-b, a, z]]).transpose(2, 0, 1)


def solve(matrices: Array, right: Array) -> Array:
    """Solutions (rows, n) by Gauss with column pivots; NumPy's own knows no extended precision."""
    a, b = matrices.copy(), right.copy()
    n, every = a.shape[1], np.arange(len(a))
    for k in range(n):
        row = k + np.argmax(np.abs(a[:, k:, k]), axis=1)
        a[every, k], a[every, row] = a[every, row].copy(), a[every, k].copy()
        b[every, k], b[every, row] = b[every, row].copy(), b[every, k].copy()
        for i in range(k + 1, n):
            factor = a[:, i, k] / a[:, k, k]
            a[:, i, k:] -= factor[:, None] * a[:, k, k:]
            b[:, i] -= factor * b[:, k]
    for k in range(n - 1, -1, -1):
        b[:, k] = (b[:, k] - dot(a[:, k, k + 1 :], b[:, k + 1 :])) / a[:, k, k]
    return b


@dataclass(frozen=True)
class StraightGuideways:
    """L1 and D1: link k from A_k + q_i v_k to T + R B_k, i its arm; without B the plate is a point."""

    A: Array
    v: Array
    L: Array
    arm: Array
    B: Array | None = None

    def links(self, q: Array, T: Array, e: Array | None = None) -> Array:
        """Vectors along the links, (rows, links, 3)."""
        d = T[:, None] - self.A - q[:, self.arm, None] * self.v
        return d if self.B is None else d + self.B @ rotation(e).transpose(0, 2, 1)

    def closure_m(self, q: Array, T: Array, e: Array | None = None) -> Array:
        """By how much each link is too long (rows,): the largest [m]."""
        with np.errstate(all="ignore"):
            d = self.links(q, T, e)
            return np.max(np.abs(np.sqrt(dot(d, d)) - self.L), axis=1)

    def carts(self, T: Array, e: Array | None = None, beside: Array | None = None) -> Array:
        """Carts (rows, 3) by the first link of each, behind the plate or on the side where `beside` has them; NaN out
        of reach."""
        zero = np.zeros((len(T), 3), REAL)
        found = []
        for i in range(3):
            k = int(np.argmax(self.arm == i))
            d, v = self.links(zero, T, e)[:, k], self.v[k]
            with np.errstate(invalid="ignore"):
                root = np.sqrt((d @ v) ** 2 - (v @ v) * (dot(d, d) - self.L[k] ** 2))
            side = -1 if beside is None else np.where(beside[:, i] * (v @ v) > d @ v, 1, -1)
            found.append((d @ v + side * root) / (v @ v))
        return np.stack(found, axis=1)

    def all_ahead(self, q: Array, T: Array, e: Array | None = None, most_m: float = 0.0) -> Array:
        """Whether the plate joint of every link lies ahead of its cart, as the models declare, or behind it by at most
        this (rows,)."""
        d = self.links(q, T, e)
        return np.all(np.stack([d[:, k] @ v for k, v in enumerate(self.v)]) > -most_m, axis=0)

    def rate(self, q: Array, T: Array, qd: Array, Td: Array, e: Array | None = None) -> Array:
        """Largest rate of a link's length over the speeds of its ends (rows,); the plate turns as suits it best."""
        d = self.links(q, T, e)
        plate = Td[:, None] + np.zeros_like(d)
        cart = qd[:, self.arm, None] * self.v
        if self.B is not None:
            arm = self.B @ rotation(e).transpose(0, 2, 1)
            rows = np.cross(arm, d)  # d.(w x arm) = w.(arm x d)
            missing = dot(d, cart - plate)
            w = solve(rows.transpose(0, 2, 1) @ rows, np.einsum("nki,nk->ni", rows, missing))
            plate = plate + np.cross(w[:, None], arm)
        return _rate(d, plate, cart)


def _rate(d: Array, plate: Array, cart: Array) -> Array:
    speed = np.sqrt(dot(plate, plate)) + np.sqrt(dot(cart, cart))
    return np.max(np.abs(dot(d, plate - cart)) / (np.sqrt(dot(d, d)) * np.max(speed, axis=1)[:, None] + TINY), axis=1)


@dataclass(frozen=True)
class TurningCarts:
    """The F1: arm 1 stands on a cart, arm 2 on a plate that turns by q_4, arm 3 on one that turns by q_5 and q_6."""

    A0: Array
    v: Array
    L: Array
    A: Array
    B: Array
    u1_2: Array
    u1_3: Array
    u2_3: Array
    r3: Array

    def _joints(self, q: Array, qd: Array) -> tuple[Array, Array]:
        """Cart joints (rows, 6, 3) and their velocities."""
        fixed = [rotation(u[None])[0] for u in (self.u1_2, self.u1_3, self.u2_3)]
        (two, two_d), (five, five_d), (six, six_d) = (_about(k, q[:, i], qd[:, i]) for k, i in ((1, 3), (1, 4), (0, 5)))
        outer, outer_d = fixed[1] @ five, fixed[1] @ five_d
        inner, inner_d = outer @ fixed[2], outer_d @ fixed[2]
        turns = [np.broadcast_to(np.eye(3, dtype=REAL), two.shape), fixed[0] @ two, inner @ six]
        turns_d = [np.zeros_like(two), fixed[0] @ two_d, inner_d @ six + inner @ six_d]
        place = self.A0 + q[:, :3, None] * self.v
        place_d = qd[:, :3, None] * self.v
        place[:, 2] += outer @ self.r3
        place_d[:, 2] += outer_d @ self.r3
        at = [place[:, i] + turns[i] @ self.A[k] for k, i in enumerate(ARM)]
        rate = [place_d[:, i] + turns_d[i] @ self.A[k] for k, i in enumerate(ARM)]
        return np.stack(at, axis=1), np.stack(rate, axis=1)

    def first_below(self, q: Array, T: Array, e: Array) -> Array:
        """Whether the plate joint of arm 1, whose cart does not turn, lies below it, as the F1 declares (rows,)."""
        joint = self._joints(q, 0 * q)[0][:, 0]
        return (joint - T - rotation(e) @ self.B[0]) @ self.v[0] > 0

    def closure_m(self, q: Array, T: Array, e: Array) -> Array:
        with np.errstate(all="ignore"):
            d = T[:, None] + self.B @ rotation(e).transpose(0, 2, 1) - self._joints(q, 0 * q)[0]
            return np.max(np.abs(np.sqrt(dot(d, d)) - self.L), axis=1)

    def rate(self, q: Array, T: Array, qd: Array, Td: Array, e: Array, ed: Array) -> Array:
        joints, cart = self._joints(q, qd)
        d = T[:, None] + self.B @ rotation(e).transpose(0, 2, 1) - joints
        return _rate(d, Td[:, None] + self.B @ (2 * product(e, ed)).transpose(0, 2, 1), cart)


def _about(axis: int, angle: Array, rate: Array) -> tuple[Array, Array]:
    """Rotations about a coordinate axis and their rates."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    c, s = np.cos(angle), np.sin(angle)
    R = np.zeros((len(angle), 3, 3), REAL)
    R[:, axis, axis] = 1
    R[:, i, i] = R[:, j, j] = c
    R[:, i, j], R[:, j, i] = -s, s
    change = np.zeros_like(R)
    change[:, i, i] = change[:, j, j] = -s * rate
    change[:, i, j], change[:, j, i] = -c * rate, c * rate
    return R, change


@dataclass(frozen=True)
class Masses:
    """Of plate, carts and links (at mid-length); friction of the carts with a smoothed sign."""

    m_p: Array
    m_c: Array
    m_a: Array
    coulomb: Array
    viscous: Array
    velocity_scale: Array
    c_p: Array | None = None
    I_p: Array | None = None


def motor_forces(
    robot: StraightGuideways, masses: Masses, q: Array, T: Array, Td: Array, Tdd: Array, tau: Array, e: Array | None
) -> Array:
    """By how much motor forces miss virtual work along the motions that the links allow, over the work's terms (rows,).

    T is free in three directions; carts, and the plate's turn where it has one, follow.
    """
    d, n = robot.links(q, T, e), len(T)
    arm = np.zeros((n, len(robot.L), 3), REAL) if robot.B is None else robot.B @ rotation(e).transpose(0, 2, 1)
    carts = np.zeros((n, len(robot.L), 3), REAL)
    carts[:, np.arange(len(robot.L)), robot.arm] = dot(d, robot.v)
    left = carts if robot.B is None else np.concatenate([carts, -np.cross(arm, d)], axis=2)
    # d.(Tdot + w x arm - v qd) = 0: (qd, w) per Tdot, columns of `follow`
    follow = np.stack([solve(left, d[:, :, k]) for k in range(3)], axis=2)
    first = np.einsum("nij,nj->ni", follow, Td)
    qd, w = first[:, :3], first[:, 3:] if robot.B is not None else np.zeros((n, 3), REAL)
    dd = Td[:, None] + np.cross(w[:, None], arm) - qd[:, robot.arm, None] * robot.v
    inward = np.cross(w[:, None], np.cross(w[:, None], arm))
    second = solve(left, dot(d, Tdd[:, None] + inward) + dot(dd, dd))
    qdd, turn = second[:, :3], second[:, 3:] if robot.B is not None else np.zeros((n, 3), REAL)

    def point(b: Array) -> tuple[Array, Array]:
        """Motion per Tdot (rows, 3, 3) and acceleration of the plate's point T + b, b in world axes (rows, 3)."""
        per_turn = follow[:, 3:] if robot.B is not None else np.zeros((n, 3, 3), REAL)
        motion = np.eye(3, dtype=REAL) - cross_matrix(b) @ per_turn
        return motion, Tdd + np.cross(turn, b) + np.cross(w, np.cross(w, b))

    work: list[Array] = []

    def add(motion: Array, force: Array) -> None:
        work.append(np.einsum("nij,ni->nij", motion, force).reshape(n, -1, 3))

    middle = np.zeros((n, 3), REAL)
    if masses.c_p is not None:
        R = rotation(e)
        middle = R @ masses.c_p
        inertia = R @ masses.I_p @ R.transpose(0, 2, 1)
        momentum = np.einsum("nij,nj->ni", inertia, w)
        add(follow[:, 3:], np.einsum("nij,nj->ni", inertia, turn) + np.cross(w, momentum))
    motion, acceleration = point(middle)
    add(motion, masses.m_p * (acceleration - GRAVITY))
    for k, i in enumerate(robot.arm):
        motion, acceleration = point(arm[:, k])
        cart = robot.v[k][:, None] * follow[:, i, None, :]
        add((motion + cart) / 2, masses.m_a[k] * ((acceleration + qdd[:, i, None] * robot.v[k]) / 2 - GRAVITY))
    for i in range(3):
        v = robot.v[robot.arm == i].mean(axis=0)
        along = qdd[:, i] * (v @ v) - v @ GRAVITY
        rub = masses.coulomb[i] * np.tanh(qd[:, i] / masses.velocity_scale) + masses.viscous[i] * qd[:, i]
        add(follow[:, i, None, :], (masses.m_c[i] * along + rub)[:, None])
        add(follow[:, i, None, :], -tau[:, i, None])
    terms = np.concatenate(work, axis=1)
    missed = np.max(np.abs(np.sum(terms, axis=1)), axis=1)
    return missed / (np.max(np.sum(np.abs(terms), axis=1), axis=1) + TINY)
