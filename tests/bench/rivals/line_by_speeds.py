"""The fastest motion along the straight line in squared speeds b(s), as a user writes it in CasADi, and with toppra.

CasADi: b at the ends of N equal intervals, s'' = b' / 2 constant on each, forces in the middle. toppra bounds them at
both ends of each interval and takes forces that are affine in s'' and s'^2, so it needs a robot without friction.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from .l1_by_hand import FORCE, GOAL, START
from .timing import NLPSOL, Clock, Result

LEAST = 1e-12  # of b at rest: forces depend on s' = sqrt(b)


def solve_by_hand(quantities: ca.Function, intervals: int) -> Result:
    """From START to GOAL along the line, rest to rest, forces within FORCE, least time.

    quantities: (T, T', T'') -> tau.
    """
    clock = Clock()
    way, ds = ca.DM(GOAL - START), 1.0 / intervals
    b, a = ca.SX.sym("b"), ca.SX.sym("a")
    s = ca.SX.sym("s")
    row = ca.Function("row", [s, b, a], [quantities(ca.DM(START) + s * way, ca.sqrt(b) * way, a * way) / FORCE])
    B = ca.MX.sym("B", 1, intervals + 1)
    A = (B[1:] - B[:-1]) / (2 * ds)
    at = ca.DM((np.arange(intervals) + 0.5) * ds).T
    g = row.map(intervals)(at, (B[1:] + B[:-1]) / 2, A)
    root = ca.sqrt(B)
    f = ca.sum2(2 * ds / (root[1:] + root[:-1]))
    solver = ca.nlpsol("speeds", "ipopt", {"x": ca.vec(B), "f": f, "g": ca.vec(g)}, NLPSOL)
    setup = clock.lap()
    high = np.full(intervals + 1, np.inf)
    high[[0, -1]] = LEAST
    # a trapezoid of 1 s, as for the other methods
    points = np.linspace(0.0, 1.0, intervals + 1)
    start = np.clip((16 / 3) * np.minimum(points, 1 - points), LEAST, 16 / 9)
    result = solver(x0=start, lbx=LEAST, ubx=high, lbg=-1.0, ubg=1.0)
    stats = solver.stats()
    return Result(float(result["f"]), int(stats["iter_count"]), setup, clock.lap(), bool(stats["success"]))


def solve_toppra(quantities: ca.Function, intervals: int) -> Result:
    """The same with toppra; the forces of a robot without friction. Raises ImportError if toppra is not installed."""
    import toppra

    toppra.setup_logging("ERROR")
    clock = Clock()

    def forces(T: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        return np.asarray(quantities(T, v, a)).reshape(-1)

    path = toppra.SplineInterpolator([0.0, 1.0], np.array([START, GOAL]))
    limits = np.column_stack([np.full(3, -FORCE), np.full(3, FORCE)])
    within = toppra.constraint.JointTorqueConstraint(
        forces, limits, np.zeros(3), toppra.constraint.DiscretizationType.Interpolation
    )
    method = toppra.algorithm.TOPPRA([within], path, gridpoints=np.linspace(0.0, 1.0, intervals + 1))
    setup = clock.lap()
    speeds = method.compute_parameterization(0.0, 0.0)[1]
    if speeds is None:
        return Result(np.inf, 0, setup, clock.lap(), False)
    time = float(np.sum(2 / intervals / (speeds[1:] + speeds[:-1])))
    return Result(time, 0, setup, clock.lap())
