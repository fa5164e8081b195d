"""Two motions written out by hand as ordinary differential equations: for CVODES by CasADi, and for SciPy's DOP853."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
from scipy.integrate import solve_ivp

from tests.oracle.hand_written import ThreeLink

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class ByHand:
    """y' = f(y, u) with rows of outputs: the rates and rows once in CasADi, once in NumPy."""

    y: ca.SX
    u: ca.SX
    rates: ca.SX
    row: ca.SX
    numpy_rates: Callable[[Array, Array], Array]


def pendulum(length: float = 1.0, mass: float = 1.0, g: float = 9.81) -> ByHand:
    """In the angle from hanging; rows x, x', y, y', tension, stored energy."""
    return _pendulum(length, mass, g, ca.SX.sym("u", 0))


def pendulum_of_any_mass(length: float = 1.0, g: float = 9.81) -> ByHand:
    """The same with its mass [kg] for u."""
    mass = ca.SX.sym("mass")
    return _pendulum(length, mass, g, mass)


def _pendulum(length: float, mass: float | ca.SX, g: float, u: ca.SX) -> ByHand:
    y = ca.SX.sym("y", 2)
    s, c = ca.sin(y[0]), ca.cos(y[0])
    rates = ca.vertcat(y[1], -g / length * s)
    tension = mass * (length * y[1] ** 2 + g * c) / length
    energy = mass * length**2 * y[1] ** 2 / 2 - mass * g * length * c
    row = ca.vertcat(length * s, length * c * y[1], -length * c, length * s * y[1], tension, energy)
    return ByHand(y, u, rates, row, lambda y, _: np.array([y[1], -g / length * np.sin(y[0])]))


def three_link(robot: ThreeLink) -> ByHand:
    """Eqs. (6.3)-(6.8) of Dressler 2012, plate ahead of all carts; states T, T', and the energies supplied and
    dissipated; rows q, T, T', tau, stored energy, and those two."""
    return _three_link(robot, robot.m_p, ca.SX(0, 1))


def three_link_of_any_payload(robot: ThreeLink) -> ByHand:
    """The same with the mass of the plate [kg] as a fourth number of u."""
    mass = ca.SX.sym("m_p")
    return _three_link(robot, mass, mass)


def _three_link(robot: ThreeLink, m_p: float | ca.SX, more: ca.SX) -> ByHand:
    y, tau = ca.SX.sym("y", 8), ca.SX.sym("tau", 3)
    T, v = y[:3], y[3:6]
    A, square = robot.A, robot.L**2
    dy, dz = T[1] - ca.DM(A[:, 1]), T[2] - ca.DM(A[:, 2])
    dx = ca.sqrt(ca.DM(square) - dy**2 - dz**2)
    q = T[0] - ca.DM(A[:, 0]) - dx
    j = ca.horzcat(ca.SX.ones(3), dy / dx, dz / dx)
    qd = j @ v
    bent = ((v[0] - qd) ** 2 + v[1] ** 2 + v[2] ** 2) / dx  # J times the last product of (6.6)
    quarter = robot.m_a / 4
    m1 = ca.vertcat(
        ca.horzcat(m_p + np.sum(robot.m_a / 2), 0, 0),
        ca.horzcat(ca.dot(ca.DM(quarter), j[:, 1]), m_p + np.sum(quarter), 0),
        ca.horzcat(ca.dot(ca.DM(quarter), j[:, 2]), 0, m_p + np.sum(quarter)),
    )
    along, across = robot.m_c + robot.m_a / 2, robot.m_c + quarter
    m2 = ca.vertcat(*[ca.horzcat(*[j[i, k] * (along if k == 0 else across)[i] for i in range(3)]) for k in range(3)])
    gravity = ca.vertcat(0, 0, robot.g * (m_p + np.sum(robot.m_a / 2)))
    friction = ca.DM(robot.coulomb) * ca.tanh(qd / robot.velocity_scale) + ca.DM(robot.viscous) * qd
    right = j.T @ (tau - friction) - gravity - m2 @ bent
    acceleration = ca.inv_minor(m1 + m2 @ j) @ right
    kinetic = (m_p * ca.dot(v, v) + ca.dot(ca.DM(robot.m_c), qd**2)) / 2
    for i in range(3):
        half = (v + ca.vertcat(qd[i], 0, 0)) / 2
        kinetic += robot.m_a[i] * ca.dot(half, half) / 2
    rates = ca.vertcat(v, acceleration, ca.dot(tau, qd), ca.dot(friction, qd))
    row = ca.vertcat(q, T, v, tau, kinetic + gravity[2] * T[2], y[6:])
    ahead = np.ones(3)

    def numpy_rates(y: Array, u: Array) -> Array:
        q = robot.inverse_kinematics(y[:3], ahead)
        qd = robot.inverse_jacobian(y[:3], q) @ y[3:6]
        loaded = replace(robot, m_p=u[3]) if u.size == 4 else robot
        works = [u[:3] @ qd, robot.friction(qd) @ qd]
        return np.concatenate([y[3:6], loaded.forward_dynamics(y[:3], q, y[3:6], u[:3])[0], works])

    return ByHand(y, ca.vertcat(tau, more), rates, row, numpy_rates)


class Cvodes:
    """CVODES on a grid of equal intervals, and the rows mapped over it: made once, run for any start and input."""

    def __init__(self, motion: ByHand, end: float, rows: int, tolerance: float) -> None:
        self._n = rows
        grid = np.linspace(0.0, end, rows)[1:].tolist()
        dae = {"x": motion.y, "p": motion.u, "ode": motion.rates}
        self._integrator = ca.integrator("motion", "cvodes", dae, 0.0, grid, {"abstol": tolerance, "reltol": tolerance})
        self._row = ca.Function("row", [motion.y, motion.u], [motion.row]).map(rows)

    def __call__(self, start: Array, u: Array) -> tuple[Array, Array]:
        """States (rows, n) and rows (rows, outputs)."""
        states = np.column_stack([start, self._integrator(x0=start, p=u)["xf"].full()])
        return states.T, self._row(states, np.repeat(u[:, None], self._n, axis=1)).full().T


def by_scipy(motion: ByHand, end: float, rows: int, tolerance: float, start: Array, u: Array) -> tuple[Array, Array]:
    """The same with DOP853 on the equations in NumPy; the rows by CasADi."""
    times = np.linspace(0.0, end, rows)
    run = solve_ivp(
        lambda _, y: motion.numpy_rates(y, u), (0.0, end), start, "DOP853", times, rtol=tolerance, atol=tolerance
    )
    row = ca.Function("row", [motion.y, motion.u], [motion.row])
    return run.y.T, row(run.y, np.repeat(u[:, None], rows, axis=1)).full().T
