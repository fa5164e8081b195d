"""Multiple shooting with CVODES, a cross-check of collocation.

The unknowns are states at the element edges, controls and constants; the integrator computes the states at the
collocation points and their sensitivities. Bounds and path constraints are imposed at the same points as in
collocation.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from ..lang.source import ModelError
from .formulation.scaling import objective_scale
from .ipopt import SolverRun, run_ipopt
from .judgement.resimulate import make_integrator
from .nlp import Nlp
from .watch import Iterate, Multipliers, Program, Progress

if TYPE_CHECKING:
    from .solve import SolverOptions

TOLERANCE = 1e-10  # of the integrator: far below IPOPT's tolerance


@dataclass(eq=False)
class _Shooting(Program):
    """The NLP in the unknowns `kept` of the collocation NLP, with its rows `rows`."""

    kept: np.ndarray
    rows: np.ndarray
    full: ca.Function


def run_shooting(nlp: Nlp, x0: np.ndarray, options: SolverOptions, progress: Progress | None) -> SolverRun:
    """Optimise by multiple shooting; the result is in the unknowns and rows of collocation.

    Raises ModelError for Gauss points, algebraic unknowns and delays, which shooting does not support.
    """
    problem, mesh = nlp.problem, nlp.mesh
    title = problem.flat.title
    if mesh.scheme != "radau":
        raise ModelError(f"{title}: shooting needs scheme 'radau', whose last point is the element's end")
    if problem.formulation != "explicit" or nlp.element.layout.nz:
        raise ModelError(
            f"{title}: shooting needs an explicit formulation without algebraic unknowns or delays; found "
            f"'{problem.formulation}'"
        )
    shooting = _transcribe(nlp)
    scale = objective_scale(nlp, x0, problem.misfits)
    # second derivatives of an integrator are expensive
    run = run_ipopt(shooting, x0[shooting.kept], replace(options, hessian="lbfgs"), progress, scale=scale)

    def lifted(of: SolverRun | Iterate) -> dict[str, Any]:
        """Map a result to unknowns, rows and multipliers of collocation."""
        g, lam_g, lam_x = np.zeros(len(nlp.lbg)), np.zeros(len(nlp.lbg)), np.zeros(nlp.size)
        count = len(shooting.rows)
        g[shooting.rows], lam_g[shooting.rows] = of.g[:count], of.multipliers.rows[:count]
        lam_x[shooting.kept] = of.multipliers.bounds
        x = np.asarray(shooting.full(of.x)).reshape(-1)
        return {"x": x, "g": g, "multipliers": Multipliers(lam_g, lam_x)}

    best = None if run.best is None else replace(run.best, **lifted(run.best))
    return replace(run, best=best, **lifted(run))


def _transcribe(nlp: Nlp) -> _Shooting:
    problem, mesh, layout = nlp.problem, nlp.mesh, nlp.element.layout
    n, N, nx, K = layout.size, mesh.elements, layout.nx, mesh.points
    inside = layout.x.ravel()
    free = np.setdiff1d(np.arange(n), inside)
    kept = np.concatenate([*(k * n + free for k in range(N)), np.arange(nlp.end, nlp.size)]).astype(int)
    m = nlp.element.rows.numel()
    row_numbers = [r for r, (name, _) in enumerate(nlp.element.row_names) if not name.startswith("rate of ")]
    rows = np.concatenate(
        [*(k * m + np.array(row_numbers, int) for k in range(N)), np.arange(N * m, len(nlp.lbg))]
    ).astype(int)

    w, p = ca.MX.sym("w", len(kept)), ca.MX.sym("p", 0)
    W = ca.reshape(w[: N * len(free)], len(free), N)
    P = w[N * len(free) + layout.nl :]
    place = {int(j): i for i, j in enumerate(free)}
    physical = P * nlp.p_scale if len(nlp.p_scale) else P
    times = ca.Function("times", [problem.P], [problem.t0, problem.tf])
    t0, tf = times(physical)

    def entries(columns: np.ndarray) -> ca.MX:
        """Return rows of y, all elements side by side, in physical units."""
        picked = W[[place[int(j)] for j in columns], :] if columns.size else ca.MX(0, N)
        return picked * ca.repmat(ca.DM(layout.scale[columns]), 1, N)

    if layout.h >= 0:
        left, length = entries(np.array([layout.edge])), entries(np.array([layout.h]))
    else:
        left, length = ca.MX(ca.DM(mesh.edges[:-1]).T), ca.MX(ca.DM(mesh.h).T)
    horizon = tf - t0
    arguments = [t0 + left * horizon, length * horizon, entries(layout.u.ravel()), ca.repmat(physical, 1, N)]
    integrator = make_integrator(nlp, TOLERANCE, mesh.table.points.tolist()).map(N)
    start = entries(layout.left[:nx]) if nx else ca.MX.zeros(1, N)
    result = integrator(x0=start, p=ca.vertcat(*arguments))
    states = ca.reshape(result["xf"], max(nx, 1) * K, N)
    scaled = states / ca.repmat(ca.DM(layout.scale[inside]), 1, N) if nx else ca.MX(0, N)
    order = np.argsort(np.concatenate([free, inside]), kind="stable")
    Y = ca.vertcat(W, scaled)[order.tolist(), :]
    full = ca.vertcat(ca.vec(Y), w[N * len(free) :])
    f, g = nlp.nlp(full, p)
    # replace collocation's integral cost by the integrator's
    element = nlp.element
    scaled_P = ca.SX.sym("P", len(nlp.p_scale))
    cost = (
        ca.substitute([element.cost], [element.P], [scaled_P * ca.DM(nlp.p_scale)])[0]
        if len(nlp.p_scale)
        else element.cost
    )
    share = ca.Function("cost", [element.y, scaled_P, element.d], [cost]).map(N)
    D = ca.DM(np.vstack([mesh.h, mesh.edges[:-1]]))
    f = f - ca.sum2(share(Y, ca.repmat(P, 1, N), D)) + ca.sum2(result["qf"][:, K - 1 :: K])
    # bounds on states at the points between the edges become rows
    low = np.concatenate(
        [np.where(np.isfinite(nlp.lbx[k * n + inside]), nlp.lbx[k * n + inside], -np.inf) for k in range(N)]
    )
    high = np.concatenate([nlp.ubx[k * n + inside] for k in range(N)])
    bounded = np.flatnonzero(np.isfinite(low) | np.isfinite(high))
    between = ca.vec(scaled)[bounded.tolist()] if bounded.size else ca.MX(0, 1)
    rows_all = ca.vertcat(g[rows.tolist()], between)
    return _Shooting(
        {}, ca.Function("nlp", [w, p], [f, rows_all], ["x", "p"], ["f", "g"]), nlp.lbx[kept], nlp.ubx[kept],
        np.concatenate([nlp.lbg[rows], low[bounded]]), np.concatenate([nlp.ubg[rows], high[bounded]]), kept, rows,
        ca.Function("full", [w], [full]),
    )  # fmt: skip
