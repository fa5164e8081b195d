"""Dressler 2012, eqs. (6.3)-(6.8), transcribed by hand in NumPy: the oracle of the three-link Gantry-Tau.

Valid for guideways along the global x axis, v = (1, 0, 0). Nothing here knows gtmodel. Misprint mended: the first
vector of (6.7) is the TCP's acceleration. The sign in (6.8) is smoothed by tanh.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Array = np.ndarray


@dataclass(frozen=True)
class ThreeLink:
    """Cart joints A (3, 3) at q = 0 [m], link lengths L (3,) [m], masses [kg] of plate, carts, link clusters.

    coulomb (3,) [N] and viscous (3,) [kg/s]: eq. (6.8); velocity_scale [m/s]: of the smoothed sign; g [m/s2].
    """

    A: Array
    L: Array
    m_p: float
    m_c: Array
    m_a: Array
    coulomb: Array
    viscous: Array
    velocity_scale: float
    g: float = 9.81

    def delta(self, T: Array, q: Array) -> Array:
        """Vectors along the links, one per row: (6.4)."""
        carts = self.A.copy()
        carts[:, 0] += q
        return T - carts

    def closure(self, T: Array, q: Array) -> Array:
        """Residuals of (6.3) [m2]."""
        return self.L**2 - np.sum(self.delta(T, q) ** 2, axis=1)

    def inverse_kinematics(self, T: Array, ahead: Array) -> Array:
        """Carts q (3,) from (6.3); ahead[i] = +1: the plate lies ahead of cart i, -1: behind."""
        d = T - self.A
        return d[:, 0] - ahead * np.sqrt(self.L**2 - d[:, 1] ** 2 - d[:, 2] ** 2)

    def forward_kinematics(self, q: Array, ahead: int) -> Array:
        """T (3,) by textbook trilateration in a frame of the three carts; ahead: side of their plane along x."""
        p1, p2, p3 = self.A + np.outer(q, [1.0, 0.0, 0.0])
        d = np.linalg.norm(p2 - p1)
        ex = (p2 - p1) / d
        i = ex @ (p3 - p1)
        ey = p3 - p1 - i * ex
        ey /= np.linalg.norm(ey)
        ez = np.cross(ex, ey)
        j = ey @ (p3 - p1)
        r1, r2, r3 = self.L**2
        x = (r1 - r2 + d**2) / (2 * d)
        y = (r1 - r3 + i**2 + j**2 - 2 * i * x) / (2 * j)
        z = np.sqrt(r1 - x**2 - y**2)
        return p1 + x * ex + y * ey + ahead * np.sign(ez[0]) * z * ez

    def inverse_jacobian(self, T: Array, q: Array) -> Array:
        """qdot = J^-1 Tdot: (6.5)."""
        d = self.delta(T, q)
        return np.column_stack([np.ones(3), d[:, 1] / d[:, 0], d[:, 2] / d[:, 0]])

    def centripetal(self, T: Array, q: Array, Td: Array) -> Array:
        """The last product of (6.6): what Tdd lacks from J qdd."""
        qd = self.inverse_jacobian(T, q) @ Td
        square = (Td[0] - qd) ** 2 + Td[1] ** 2 + Td[2] ** 2
        return np.linalg.solve(self.delta(T, q), square)

    def tcp_acceleration(self, T: Array, q: Array, Td: Array, qdd: Array) -> Array:
        """Tdd from qdd: (6.6)."""
        return np.linalg.solve(self.inverse_jacobian(T, q), qdd) - self.centripetal(T, q, Td)

    def cart_acceleration(self, T: Array, q: Array, Td: Array, Tdd: Array) -> Array:
        """qdd from Tdd: (6.6) solved for it."""
        return self.inverse_jacobian(T, q) @ (Tdd + self.centripetal(T, q, Td))

    def masses(self, T: Array, q: Array) -> tuple[Array, Array, Array]:
        """M1, M2 and G of (6.7)."""
        d = self.delta(T, q)
        y, z = d[:, 1] / d[:, 0], d[:, 2] / d[:, 0]
        quarter = self.m_a / 4
        m1 = np.array(
            [
                [self.m_p + np.sum(self.m_a / 2), 0.0, 0.0],
                [np.sum(quarter * y), self.m_p + np.sum(quarter), 0.0],
                [np.sum(quarter * z), 0.0, self.m_p + np.sum(quarter)],
            ]
        )
        m2 = np.array([self.m_c + self.m_a / 2, y * (self.m_c + quarter), z * (self.m_c + quarter)])
        gravity = self.g * np.array([0.0, 0.0, self.m_p + np.sum(self.m_a / 2)])
        return m1, m2, gravity

    def friction(self, qd: Array) -> Array:
        """What (6.8) takes from the motor forces [N]."""
        return self.coulomb * np.tanh(qd / self.velocity_scale) + self.viscous * qd

    def inverse_dynamics(self, T: Array, q: Array, Td: Array, Tdd: Array) -> Array:
        """Motor forces tau (3,) [N]: (6.7) and (6.8)."""
        j_inv = self.inverse_jacobian(T, q)
        m1, m2, gravity = self.masses(T, q)
        f = np.linalg.solve(j_inv.T, m1 @ Tdd + m2 @ self.cart_acceleration(T, q, Td, Tdd) + gravity)
        return f + self.friction(j_inv @ Td)

    def forward_dynamics(self, T: Array, q: Array, Td: Array, tau: Array) -> tuple[Array, Array]:
        """(Tdd, qdd) from motor forces: (6.7) with qdd of (6.6) put in, solved for Tdd."""
        j_inv = self.inverse_jacobian(T, q)
        m1, m2, gravity = self.masses(T, q)
        right = j_inv.T @ (tau - self.friction(j_inv @ Td)) - gravity - m2 @ j_inv @ self.centripetal(T, q, Td)
        Tdd = np.linalg.solve(m1 + m2 @ j_inv, right)
        return Tdd, self.cart_acceleration(T, q, Td, Tdd)
