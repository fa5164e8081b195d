"""Pyomo.dae with the equations lifted by hand: 24 variables per point, no root, no nested expression.

Its NL file holds no common subexpressions, so lifting is what a careful user does. CasADi's NlpBuilder reads the file
and IPOPT solves it with the same options: pip brings no ipopt executable.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import casadi as ca
import numpy as np

from .l1_by_hand import FORCE, FORCE_UNIT, FRICTION_SPEED, GOAL, GRAVITY, SHORTEST, START, Motion, data
from .plain_casadi import POINTS
from .timing import NLPSOL, Clock, Result


def solve_pyomo(motion: Motion, elements: int) -> Result:
    import pyomo.environ as pyo
    from pyomo.dae import ContinuousSet, DerivativeVar

    clock = Clock()
    d = data(motion.robot)
    m = pyo.ConcreteModel()
    m.t = ContinuousSet(bounds=(0.0, 1.0))
    m.i = pyo.RangeSet(0, 2)
    m.T = pyo.Var(bounds=(SHORTEST, None), initialize=1.0)
    for name in ("p", "v", "a", "q", "qd", "qdd", "s"):
        setattr(m, name, pyo.Var(m.t, m.i))
    m.tau = pyo.Var(m.t, m.i, bounds=(-1.0, 1.0))  # forces in units of their limit
    m.dp, m.dv = DerivativeVar(m.p, wrt=m.t), DerivativeVar(m.v, wrt=m.t)

    def at_points(rule):
        """Nothing is asked for at the start: it is no collocation point."""
        return pyo.Constraint(m.t, m.i, rule=lambda m, t, i: pyo.Constraint.Skip if t == 0 else rule(m, t, i))

    def link(m, t, i):
        return [m.p[t, j] - float(d.A[i, j]) - (m.q[t, i] if j == 0 else 0.0) for j in range(3)]

    def balance(m, t, j):
        weight = d.m_p * (m.a[t, j] + (GRAVITY if j == 2 else 0.0))
        return weight / FORCE == sum(m.s[t, i] * link(m, t, i)[j] for i in range(3))

    def velocity(m, t, i):
        x, y, z = link(m, t, i)
        return x * (m.v[t, 0] - m.qd[t, i]) + y * m.v[t, 1] + z * m.v[t, 2] == 0

    def acceleration(m, t, i):
        x, y, z = link(m, t, i)
        square = (m.v[t, 0] - m.qd[t, i]) ** 2 + m.v[t, 1] ** 2 + m.v[t, 2] ** 2
        return x * (m.a[t, 0] - m.qdd[t, i]) + y * m.a[t, 1] + z * m.a[t, 2] + square == 0

    def cart(m, t, i):
        speed = m.qd[t, i]
        friction = float(d.coulomb[i]) * pyo.tanh(speed / FRICTION_SPEED) + float(d.viscous[i]) * speed
        return m.tau[t, i] == (float(d.m_c[i]) * m.qdd[t, i] + friction) / FORCE + m.s[t, i] * link(m, t, i)[0]

    m.c_p = at_points(lambda m, t, i: m.dp[t, i] == m.T * m.v[t, i])
    m.c_v = at_points(lambda m, t, i: m.dv[t, i] == m.T * m.a[t, i])
    m.c_q = at_points(lambda m, t, i: sum(x**2 for x in link(m, t, i)) == float(d.L[i]) ** 2)
    m.c_qd, m.c_qdd = at_points(velocity), at_points(acceleration)
    m.c_f, m.c_tau = at_points(balance), at_points(cart)
    if motion.weight:  # pyomo's Integral is the trapezoidal rule: the energy is a state instead
        m.e = pyo.Var(m.t, initialize=0.0)
        m.de = DerivativeVar(m.e, wrt=m.t)
        m.c_e = pyo.Constraint(m.t, rule=lambda m, t: pyo.Constraint.Skip if t == 0 else (
            m.de[t] == m.T * sum((m.tau[t, i] * (FORCE / FORCE_UNIT)) ** 2 for i in range(3))))  # fmt: skip
        m.e[0.0].fix(0.0)
    m.cost = pyo.Objective(expr=m.T + (motion.weight * m.e[1.0] if motion.weight else 0.0))
    pyo.TransformationFactory("dae.collocation").apply_to(m, nfe=elements, ncp=POINTS, scheme="LAGRANGE-RADAU")
    for t in m.t:
        p, v, tau = (motion.guessed(n, np.array([t]))[0] for n in ("T", "der(T)", "tau"))
        y, z = (p - d.A)[:, 1], (p - d.A)[:, 2]
        x = d.ahead * np.sqrt(d.L**2 - y**2 - z**2)
        for i in range(3):
            m.p[t, i], m.v[t, i], m.tau[t, i], m.s[t, i] = p[i], v[i], tau[i] / FORCE, 0.0
            m.q[t, i], m.qd[t, i] = p[0] - d.A[i, 0] - x[i], v[0] + (y[i] * v[1] + z[i] * v[2]) / x[i]
            m.a[t, i], m.qdd[t, i] = 0.0, 0.0
    for i in range(3):
        for t, p in ((0.0, START), (1.0, GOAL)):
            m.p[t, i].fix(float(p[i]))
            m.v[t, i].fix(0.0)
    builder = ca.NlpBuilder()
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "motion.nl"
        m.write(str(file))
        builder.import_nl(str(file))
    nlp = {"x": ca.vertcat(*builder.x), "f": builder.f, "g": ca.vertcat(*builder.g)}
    solver = ca.nlpsol("pyomo", "ipopt", nlp, {**NLPSOL, "expand": isinstance(nlp["x"], ca.MX)})
    setup = clock.lap()
    found = solver(x0=builder.x_init, lbx=builder.x_lb, ubx=builder.x_ub, lbg=builder.g_lb, ubg=builder.g_ub)
    stats = solver.stats()
    return Result(float(found["f"]), int(stats["iter_count"]), setup, clock.lap(), bool(stats["success"]))
