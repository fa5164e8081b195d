"""The L1 prototype as a careful user writes it for a rival: closed forms in SX, eqs. (6.3)-(6.8) of Dressler 2012.

Massless links and guideways along x let everything be said with the three vectors along the links; the two 3 x 3
systems are solved by Cramer's rule.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

import gtmodel as gt
from gtmodel.compiler.causal import compile_causal
from gtmodel.motion.task import line_guess
from gtmodel.results import Trajectory

GRAVITY = 9.81  # m/s2
FRICTION_SPEED = 0.1  # m/s, of tanh in place of the sign
FORCE = 700.0  # N
FORCE_UNIT = FORCE / 6.2
START, GOAL = np.array([0.0, -0.9, 0.1]), np.array([0.9, -0.9, 0.45])
SHORTEST = 0.05  # s


@dataclass(frozen=True, eq=False)
class Motion:
    """From START to GOAL, rest to rest, forces within FORCE: minimise T + weight * int |tau / FORCE_UNIT|^2 dt."""

    weight: float

    @cached_property
    def robot(self) -> gt.Model:
        return gt.robots.gantry_tau("l1_tape")

    @cached_property
    def guess(self) -> Trajectory:
        """Trapezoid of 1 s on the line: the same guess for everyone."""
        return line_guess(compile_causal(self.robot, known="T", targets="tau"), START, GOAL, FORCE)

    def guessed(self, name: str, fractions: np.ndarray) -> np.ndarray:
        """Values (n, 3) of the guess at fractions of its second: "T", "der(T)" or "tau"."""
        name = f"der(robot.{name[4:]}" if name.startswith("der(") else f"robot.{name}"
        return np.column_stack([np.interp(fractions, self.guess.time, c) for c in self.guess[name].T])


@dataclass(frozen=True)
class Data:
    """Printed parameters; ahead[i] = +1: the plate lies ahead of cart i along x."""

    A: np.ndarray
    L: np.ndarray
    m_p: float
    m_c: np.ndarray
    coulomb: np.ndarray
    viscous: np.ndarray
    ahead: np.ndarray


def data(robot: gt.Model) -> Data:
    """The catalogue's numbers; on which side the links lie is read from the home pose."""
    values = {n: np.array(getattr(robot, n), float) for n in ("A", "L", "m_c", "coulomb", "viscous", "home")}
    home = values.pop("home")
    q, *_ = compile_causal(robot, known="T", targets="q")(home)
    return Data(**values, m_p=float(robot.m_p), ahead=np.sign(home[0] - values["A"][:, 0] - q))


def _cramer(columns: list[ca.SX], right: ca.SX) -> ca.SX:
    a, b, c = columns
    bc, det = ca.cross(b, c), ca.dot(a, ca.cross(b, c))
    return ca.vertcat(ca.dot(right, bc), ca.dot(a, ca.cross(right, c)), ca.dot(a, ca.cross(b, right))) / det


def _kinematics(d: Data, p: ca.SX, v: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Rows (1, y, z) of the inverse Jacobian, cart speeds, and what cart accelerations have of the speeds alone."""
    offset = ca.repmat(p.T, 3, 1) - ca.DM(d.A)
    along = ca.DM(d.ahead) * ca.sqrt(ca.DM(d.L**2) - offset[:, 1] ** 2 - offset[:, 2] ** 2)
    rows = ca.horzcat(ca.SX.ones(3, 1), offset[:, 1] / along, offset[:, 2] / along)
    speeds = rows @ v
    return rows, speeds, ((v[0] - speeds) ** 2 + v[1] ** 2 + v[2] ** 2) / along


def _friction(d: Data, speeds: ca.SX) -> ca.SX:
    return ca.DM(d.coulomb) * ca.tanh(speeds / FRICTION_SPEED) + ca.DM(d.viscous) * speeds


def inverse_dynamics(d: Data) -> ca.Function:
    """(p, v, a) -> tau."""
    p, v, a = (ca.SX.sym(n, 3) for n in "pva")
    rows, speeds, square = _kinematics(d, p, v)
    f = _cramer([rows[i, :].T for i in range(3)], d.m_p * (a + ca.DM([0.0, 0.0, GRAVITY])))
    tau = f + ca.DM(d.m_c) * (rows @ a + square) + _friction(d, speeds)
    return ca.Function("inverse_dynamics", [p, v, a], [tau], {"cse": True})


def forward_dynamics(d: Data) -> ca.Function:
    """(p, v, tau) -> a."""
    p, v, tau = (ca.SX.sym(n, 3) for n in ("p", "v", "tau"))
    rows, speeds, square = _kinematics(d, p, v)
    m_c = ca.DM(d.m_c)
    mass = d.m_p * ca.SX.eye(3) + rows.T @ (m_c * rows)
    right = rows.T @ (tau - _friction(d, speeds) - m_c * square) - ca.DM([0.0, 0.0, d.m_p * GRAVITY])
    a = _cramer([mass[:, i] for i in range(3)], right)
    return ca.Function("forward_dynamics", [p, v, tau], [a], {"cse": True})
