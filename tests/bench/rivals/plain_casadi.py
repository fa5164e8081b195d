"""Plain CasADi: the collocation NLP written out in SX, or in MX with one SX element mapped over the mesh.

Formulation imp_tau: p, v and tau at each point, tau == inverse dynamics; forces in units of their limit, which saves a
third of the iterations. Explicit dynamics and other units were tried and were slower.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from gtmodel.optimize.mesh import table

from .l1_by_hand import FORCE, FORCE_UNIT, GOAL, SHORTEST, START, Motion, data, inverse_dynamics
from .timing import Clock, Result, of_size

POINTS = 3


def solve_sx(motion: Motion, elements: int) -> Result:
    """Everything in SX; CasADi differentiates the whole NLP."""
    clock = Clock()
    radau = table("radau", POINTS)
    tau_of = inverse_dynamics(data(motion.robot))
    T = ca.SX.sym("T")
    h = T / elements
    x, g, cost = [T], [], T
    low, high, x0 = [np.array([SHORTEST])], [np.array([np.inf])], [np.array([1.0])]
    free, bound = np.full(3, np.inf), np.ones(3)

    def unknown(name: str, at: float, limits: tuple[np.ndarray, np.ndarray], guess: str) -> ca.SX:
        new = ca.SX.sym("x", 3)
        x.append(new)
        low.append(limits[0])
        high.append(limits[1])
        x0.append(motion.guessed(guess, np.array([at]))[0] / (FORCE if guess == "tau" else 1.0))
        return new

    rest = (np.zeros(3), np.zeros(3))
    p0, v0 = unknown("p", 0.0, (START, START), "T"), unknown("v", 0.0, rest, "der(T)")
    for k in range(elements):
        P, V, U = [p0], [v0], []
        for c in range(POINTS):
            at = (k + radau.points[c]) / elements
            last = k == elements - 1 and c == POINTS - 1  # Radau: the last point is the end
            P.append(unknown("p", at, (GOAL, GOAL) if last else (-free, free), "T"))
            V.append(unknown("v", at, rest if last else (-free, free), "der(T)"))
            U.append(unknown("tau", at, (-bound, bound), "tau"))
        for c in range(POINTS):
            slope_p = sum(float(radau.derivative[j, c]) * P[j] for j in range(POINTS + 1))
            slope_v = sum(float(radau.derivative[j, c]) * V[j] for j in range(POINTS + 1))
            g += [slope_p - h * V[c + 1], U[c] - tau_of(P[c + 1], V[c + 1], slope_v / h) / FORCE]
            if motion.weight:
                cost += motion.weight * h * float(radau.weights[c]) * ca.sumsqr(U[c] * (FORCE / FORCE_UNIT))
        p0, v0 = P[-1], V[-1]
    solver = ca.nlpsol("sx", "ipopt", {"x": ca.vertcat(*x), "f": cost, "g": ca.vertcat(*g)}, of_size(sum(map(len, x0))))
    start = np.concatenate(x0), np.concatenate(low), np.concatenate(high)
    setup = clock.lap()
    return _run(solver, start, clock, setup)


def solve_mx(motion: Motion, elements: int) -> Result:
    """One SX element mapped over the mesh, unknowns MX: little to build, slow to evaluate."""
    clock = Clock()
    radau = table("radau", POINTS)
    tau_of = inverse_dynamics(data(motion.robot))
    x0s, z, T = ca.SX.sym("x0", 6), ca.SX.sym("z", 9, POINTS), ca.SX.sym("T")
    h = T / elements
    X = ca.horzcat(x0s, z[:6, :])
    slope = X @ ca.DM(radau.derivative)
    rows, cost = [], ca.SX(0)
    for c in range(POINTS):
        p, v, u = z[:3, c], z[3:6, c], z[6:, c]
        rows += [slope[:3, c] - h * v, u - tau_of(p, v, slope[3:, c] / h) / FORCE]
        cost += motion.weight * h * float(radau.weights[c]) * ca.sumsqr(u * (FORCE / FORCE_UNIT))
    element = ca.Function("element", [x0s, ca.vec(z), T], [ca.vertcat(*rows), cost], {"cse": True})
    n = 9 * POINTS
    x = ca.MX.sym("x", 6 + n * elements + 1)
    Z = ca.reshape(x[6:-1], n, elements)
    left = ca.horzcat(x[:6], Z[n - 9 : n - 3, : elements - 1])
    g, f = element.map(elements)(left, Z, ca.repmat(x[-1], 1, elements))
    solver = ca.nlpsol("mx", "ipopt", {"x": x, "f": x[-1] + ca.sum2(f), "g": ca.vec(g)}, of_size(x.numel()))
    at = ((np.arange(elements)[:, None] + radau.points) / elements).ravel()
    guess = np.hstack([motion.guessed(name, at) for name in ("T", "der(T)", "tau")]) / np.repeat([1.0, FORCE], [6, 3])
    free = np.full((len(at), 6), np.inf)
    high = np.hstack([free, np.ones((len(at), 3))])
    low = -high
    low[-1, :6] = high[-1, :6] = [*GOAL, 0.0, 0.0, 0.0]
    begin = [*START, 0.0, 0.0, 0.0]
    start = tuple(np.concatenate([begin, a.ravel(), [b]]) for a, b in ((guess, 1.0), (low, SHORTEST), (high, np.inf)))
    setup = clock.lap()
    return _run(solver, start, clock, setup)


def _run(solver: ca.Function, start: tuple[np.ndarray, ...], clock: Clock, setup: float) -> Result:
    x0, low, high = start
    found = solver(x0=x0, lbx=low, ubx=high, lbg=0.0, ubg=0.0)
    stats = solver.stats()
    return Result(float(found["f"]), int(stats["iter_count"]), setup, clock.lap(), bool(stats["success"]))
