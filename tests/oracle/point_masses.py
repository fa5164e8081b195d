"""The three-link Gantry-Tau by virtual work in the redundant coordinates (T, q), for any guideways and rods.

In (T, q) the mass matrix is constant, because a rod's kinetic energy is a quadratic form of its two end velocities:
(m/6)(va.va + va.vb + vb.vb) for a uniform rod, (m/8)(va + vb).(va + vb) for a mass at mid-length. Nothing here knows
gtmodel, and nothing is taken from eqs. (6.5)-(6.7).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Array = np.ndarray

# (factor of va.va and vb.vb, factor of va.vb) in the kinetic energy of a rod of mass 1
UNIFORM = (1 / 6, 1 / 6)
MIDPOINT = (1 / 8, 1 / 4)


@dataclass(frozen=True)
class Mechanism:
    """Guideways A + q v (3, 3), |v| free, link lengths L (3,), masses [kg], friction as in (6.8) with tanh."""

    A: Array
    v: Array
    L: Array
    m_p: float
    m_c: Array
    m_a: Array
    coulomb: Array
    viscous: Array
    velocity_scale: float
    rod: tuple[float, float] = MIDPOINT
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)

    def inverse_kinematics(self, T: Array, ahead: Array) -> Array:
        """q (3,); complex T allowed. ahead[i] is the sign of d_i.v_i."""
        d = T - self.A
        dv = np.sum(d * self.v, axis=1)
        vv = np.sum(self.v**2, axis=1)
        return (dv - ahead * np.sqrt(dv**2 - vv * (np.sum(d**2, axis=1) - self.L**2))) / vv

    def links(self, T: Array, q: Array) -> Array:
        """Vectors from cart joints to the plate, one per row."""
        return T - self.A - q[:, None] * self.v

    def rates(self, T: Array, q: Array) -> Array:
        """d q / d T (3, 3): d.Tdot = (d.v) qdot."""
        d = self.links(T, q)
        return d / np.sum(d * self.v, axis=1)[:, None]

    def cart_acceleration(self, T: Array, q: Array, Td: Array, Tdd: Array) -> Array:
        """qdd: the closure equation differentiated twice."""
        d = self.links(T, q)
        w = Td - (self.rates(T, q) @ Td)[:, None] * self.v
        return (d @ Tdd + np.sum(w**2, axis=1)) / np.sum(d * self.v, axis=1)

    def mass_matrix(self) -> Array:
        """Constant mass matrix (6, 6) of the velocities (Tdot, qdot)."""
        same, mixed = self.rod
        m = np.zeros((6, 6))
        m[:3, :3] = np.eye(3) * (self.m_p + 2 * same * np.sum(self.m_a))
        for i in range(3):
            m[3 + i, 3 + i] = (self.m_c[i] + 2 * same * self.m_a[i]) * self.v[i] @ self.v[i]
            m[:3, 3 + i] = m[3 + i, :3] = mixed * self.m_a[i] * self.v[i]
        return m

    def weight(self) -> Array:
        """Generalised forces of gravity (6,) in (T, q)."""
        g = np.array(self.gravity)
        return np.concatenate([g * (self.m_p + np.sum(self.m_a) / 2), (self.m_c + self.m_a / 2) * (self.v @ g)])

    def friction(self, qd: Array) -> Array:
        return self.coulomb * np.tanh(qd / self.velocity_scale) + self.viscous * qd

    def inverse_dynamics(self, T: Array, q: Array, Td: Array, Tdd: Array) -> Array:
        """tau (3,) [N] from virtual work of all forces along the motions (I, dq/dT) that the rods allow."""
        rates = self.rates(T, q)
        acceleration = np.concatenate([Tdd, self.cart_acceleration(T, q, Td, Tdd)])
        allowed = np.vstack([np.eye(3), rates])
        load = allowed.T @ (self.mass_matrix() @ acceleration - self.weight())
        return np.linalg.solve(rates.T, load) + self.friction(rates @ Td)

    def energy(self, T: Array, Td: Array, ahead: Array) -> complex:
        """Kinetic and potential energy [J]; an analytic function of T and Td, for complex steps."""
        q = self.inverse_kinematics(T, ahead)
        speed = np.concatenate([Td, self.rates(T, q) @ Td])
        return speed @ self.mass_matrix() @ speed / 2 - self.weight() @ np.concatenate([T, q])
