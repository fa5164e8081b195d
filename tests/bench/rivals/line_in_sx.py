"""The fastest motion along the straight line as a careful user writes it: plain SX Radau collocation.

States s and s', control s'' at each point, the three forces as bounded rows; everything in units of its limit.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from gtmodel.optimize.mesh import table

from .l1_by_hand import FORCE, GOAL, SHORTEST, START, Motion, data, inverse_dynamics
from .plain_casadi import POINTS
from .timing import NLPSOL, Clock, Result


def solve_line(motion: Motion, elements: int) -> Result:
    """From START to GOAL along the line, rest to rest, forces within FORCE, least time."""
    clock = Clock()
    radau = table("radau", POINTS)
    tau_of = inverse_dynamics(data(motion.robot))
    way = ca.DM(GOAL - START)
    T = ca.SX.sym("T")
    h = T / elements
    x, g, low, high, x0 = [T], [], [SHORTEST], [np.inf], [1.0]
    low_g, high_g = [], []

    def unknown(lower: float, upper: float, guess: float) -> ca.SX:
        x.append(ca.SX.sym("x"))
        low.append(lower)
        high.append(upper)
        x0.append(guess)
        return x[-1]

    s0, v0 = unknown(0.0, 0.0, 0.0), unknown(0.0, 0.0, 0.0)
    top = 4.0 / 3.0  # the trapezoid of 1 s that everyone starts from
    for k in range(elements):
        S, V, A = [s0], [v0], []
        for c in range(POINTS):
            r = (k + radau.points[c]) / elements
            way_of, speed_of, push_of = (
                (2 * top * r**2, 4 * top * r, 4 * top) if r < 0.25 else
                (top * (r - 0.125), top, 0.0) if r < 0.75 else
                (1 - 2 * top * (1 - r) ** 2, 4 * top * (1 - r), -4 * top)
            )  # fmt: skip
            last = k == elements - 1 and c == POINTS - 1
            S.append(unknown(1.0 if last else 0.0, 1.0, way_of))
            V.append(unknown(0.0, 0.0 if last else np.inf, speed_of))
            A.append(unknown(-np.inf, np.inf, push_of))
        for c in range(POINTS):
            slope_s = sum(float(radau.derivative[j, c]) * S[j] for j in range(POINTS + 1))
            slope_v = sum(float(radau.derivative[j, c]) * V[j] for j in range(POINTS + 1))
            tau = tau_of(ca.DM(START) + way * S[c + 1], way * V[c + 1], way * A[c])
            g += [slope_s - h * V[c + 1], slope_v - h * A[c], tau / FORCE]
            low_g += [0.0, 0.0, -1.0, -1.0, -1.0]
            high_g += [0.0, 0.0, 1.0, 1.0, 1.0]
        s0, v0 = S[-1], V[-1]
    solver = ca.nlpsol("line", "ipopt", {"x": ca.vertcat(*x), "f": T, "g": ca.vertcat(*g)}, NLPSOL)
    setup = clock.lap()
    found = solver(x0=x0, lbx=low, ubx=high, lbg=low_g, ubg=high_g)
    stats = solver.stats()
    return Result(float(found["f"]), int(stats["iter_count"]), setup, clock.lap(), bool(stats["success"]))
