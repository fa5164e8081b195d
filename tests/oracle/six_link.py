"""The six-link Gantry-Tau by hand in NumPy: closure by Newton, Jacobians by geometry, dynamics by virtual work."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Array = np.ndarray
ARM = np.array([0, 1, 1, 2, 2, 2])
GRAVITY = np.array([0.0, 0.0, -9.81])


def turned(R: Array, w: Array) -> Array:
    """The rotation R turned further by the rotation vector w (Rodrigues)."""
    angle = np.linalg.norm(w)
    if angle == 0.0:
        return R
    k = cross_matrix(w / angle)
    return (np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k) @ R


def cross_matrix(w: Array) -> Array:
    return np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])


def rotation(e: Array) -> Array:
    """Rotation of a unit quaternion, scalar first."""
    k = cross_matrix(e[1:])
    return np.eye(3) + 2 * e[0] * k + 2 * k @ k


@dataclass(frozen=True)
class SixLinkByHand:
    """Numbers of the robot; rod masses sit at mid-length, cart masses move with the mean v of their links."""

    A: Array
    v: Array
    L: Array
    B: Array
    m_p: float
    c_p: Array
    I_p: Array
    m_c: Array
    m_a: Array
    coulomb: Array
    viscous: Array
    velocity_scale: float
    arm = ARM

    def links(self, q: Array, T: Array, R: Array) -> Array:
        """Vectors from cart joints to plate joints (6, 3)."""
        return T + self.B @ R.T - self.A - q[ARM][:, None] * self.v

    def pose(self, q: Array, T: Array, R: Array) -> tuple[Array, Array]:
        """Forward kinematics from a nearby pose."""
        for _ in range(50):
            d = self.links(q, T, R)
            step = np.linalg.solve(self.rows(d, R), (self.L**2 - np.sum(d * d, axis=1)) / 2)
            T, R = T + step[:3], turned(R, step[3:])
            if np.max(np.abs(step)) < 1e-15:
                break
        return T, R

    def rows(self, d: Array, R: Array) -> Array:
        """d_k . (Tdot + w x R B_k) as a matrix on (Tdot, w)."""
        return np.hstack([d, np.cross(self.B @ R.T, d)])

    def twist(self, q: Array, T: Array, R: Array, qd: Array) -> Array:
        """(Tdot, w) from cart velocities."""
        d = self.links(q, T, R)
        return np.linalg.solve(self.rows(d, R), np.sum(d * self.v, axis=1) * qd[ARM])

    def accelerations(self, q: Array, T: Array, R: Array, qd: Array, qdd: Array) -> Array:
        """(Tddot, dw/dt) from cart accelerations."""
        d, twist = self.links(q, T, R), self.twist(q, T, R, qd)
        arm = self.B @ R.T
        w = twist[3:]
        dd = twist[:3] + np.cross(w, arm) - qd[ARM][:, None] * self.v
        centripetal = np.cross(w, np.cross(w, arm))
        right = np.sum(d * self.v, axis=1) * qdd[ARM] - np.sum(dd * dd, axis=1) - np.sum(d * centripetal, axis=1)
        return np.linalg.solve(self.rows(d, R), right)

    def motor_forces(self, q: Array, T: Array, R: Array, qd: Array, qdd: Array) -> Array:
        """Virtual work: inertial forces of every mass through its velocity per cart velocity."""
        unit = np.column_stack([self.twist(q, T, R, x) for x in np.eye(3)])  # (6, 3)
        twist, change = self.twist(q, T, R, qd), self.accelerations(q, T, R, qd, qdd)
        w, turn = twist[3:], change[3:]

        def plate_point(b: Array) -> tuple[Array, Array]:
            """Velocity per qd (3, 3) and acceleration of a plate point at R b."""
            arm = R @ b
            jacobian = unit[:3] - cross_matrix(arm) @ unit[3:]
            return jacobian, change[:3] + np.cross(turn, arm) + np.cross(w, np.cross(w, arm))

        tau = np.zeros(3)
        jacobian, acceleration = plate_point(self.c_p)
        tau += jacobian.T @ (self.m_p * (acceleration - GRAVITY))
        inertia = R @ self.I_p @ R.T
        tau += unit[3:].T @ (inertia @ turn + np.cross(w, inertia @ w))
        for k in range(6):
            jacobian, acceleration = plate_point(self.B[k])
            cart = np.outer(self.v[k], np.eye(3)[ARM[k]])
            middle = (jacobian + cart) / 2
            tau += middle.T @ (self.m_a[k] * ((acceleration + self.v[k] * qdd[ARM[k]]) / 2 - GRAVITY))
        for i in range(3):
            v = self.v[ARM == i].mean(axis=0)
            tau[i] += self.m_c[i] * v @ (v * qdd[i] - GRAVITY)
        return tau + self.coulomb * np.tanh(qd / self.velocity_scale) + self.viscous * qd
