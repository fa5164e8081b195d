"""rockit at its own discretisation: Radau collocation, control constant on each element.

States p and v, explicit forward dynamics by an SX function, forces in units of their limit: of eight combinations
(form, units, `expand`) the fastest that converged at all weights. Guesses are expressions of time: arrays break its
collocation.
"""

from __future__ import annotations

import casadi as ca

from .l1_by_hand import FORCE, FORCE_UNIT, GOAL, SHORTEST, START, Motion, data, forward_dynamics, inverse_dynamics
from .plain_casadi import POINTS
from .timing import NLPSOL, Clock, Result


def solve_rockit(motion: Motion, elements: int, form: str = "explicit", expand: bool = False) -> Result:
    """form: "explicit", or "implicit" with the accelerations as algebraic variables."""
    import rockit

    clock = Clock()
    d = data(motion.robot)
    ocp = rockit.Ocp(T=rockit.FreeTime(1.0))
    p, v, share = ocp.state(3), ocp.state(3), ocp.control(3)  # forces in units of their limit
    tau = FORCE * share
    ocp.set_der(p, v)
    if form == "explicit":
        ocp.set_der(v, forward_dynamics(d)(p, v, tau))
    else:
        a = ocp.algebraic(3)
        ocp.set_der(v, a)
        ocp.add_alg(share - inverse_dynamics(d)(p, v, a) / FORCE)
    ocp.subject_to(-1 <= (share <= 1), include_last=False)
    for value, start, end in ((p, START, GOAL), (v, 0, 0)):
        ocp.subject_to(ocp.at_t0(value) == start)
        ocp.subject_to(ocp.at_tf(value) == end)
    ocp.subject_to(ocp.T >= SHORTEST)
    ocp.add_objective(ocp.T)
    if motion.weight:
        ocp.add_objective(motion.weight * ocp.integral(ca.sumsqr(tau / FORCE_UNIT)))
    # the trapezoid of 1 s as expressions of time
    top, t = 4.0 / 3.0, ocp.t
    s = ca.if_else(t < 0.25, 2 * top * t**2, ca.if_else(t < 0.75, top * (t - 0.125), 1 - 2 * top * (1 - t) ** 2))
    ds = ca.if_else(t < 0.25, 4 * top * t, ca.if_else(t < 0.75, top, 4 * top * (1 - t)))
    dds = ca.if_else(t < 0.25, 4 * top, ca.if_else(t < 0.75, 0.0, -4 * top))
    line = [ca.DM(START) + ca.DM(GOAL - START) * s, ca.DM(GOAL - START) * ds, ca.DM(GOAL - START) * dds]
    force = ca.fmax(ca.fmin(inverse_dynamics(d)(*line) / FORCE, 1), -1)
    guesses = [(p, line[0]), (v, line[1]), (share, force)]
    if form == "implicit":
        guesses.append((a, line[2]))
    for unknown, guess in guesses:
        ocp.set_initial(unknown, guess)
    ocp.solver("ipopt", {**NLPSOL, "expand": expand, "record_time": True})
    ocp.method(rockit.DirectCollocation(N=elements, M=1, degree=POINTS, scheme="radau"))
    try:
        solution = ocp.solve()
    except RuntimeError:  # Opti throws where IPOPT did not converge
        solution = ocp.non_converged_solution
    total = clock.lap()
    stats = solution.stats
    solve = float(stats.get("t_proc_total", 0.0))
    return Result(
        float(solution.value(ocp.objective)), int(stats["iter_count"]), total - solve, solve, bool(stats["success"])
    )
