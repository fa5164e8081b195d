"""An NLP in the form that fatrop wants: stage by stage, each linked to the next by x_(k+1) - F(x_k, u_k) == 0."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np

from ..lang.source import ModelError
from .ipopt import SolverRun
from .nlp import Nlp
from .watch import Multipliers, Program


class Staged(Program):
    """The same NLP with the signs of its links turned round, and rows at the start moved to the first element.

    fatrop finds the stages by itself.
    """

    def __init__(self, nlp: Nlp, scale: float = 1.0) -> None:
        """scale: of the objective.

        Raises ModelError where something couples the elements otherwise than by their states.
        """
        self.signs, self.order, self.scale = _signs(nlp), _order(nlp), scale
        order = self.order.tolist()
        X, p, sigma = ca.MX.sym("X", nlp.size), ca.MX.sym("p", 0), ca.MX.sym("lam_f")
        lam = ca.MX.sym("lam_g", len(nlp.lbg))
        s = ca.DM(self.signs)
        place = np.argsort(self.order).tolist()  # where fatrop has each row
        f, g = nlp.nlp(X, p)
        g_j, jac = nlp.functions["jac_g"](X, p)
        turned = ca.mtimes(ca.diag(s), jac)[order, :]
        upper = nlp.functions["hess_lag"](X, p, scale * sigma, s * lam[place])
        f, grad = scale * f, scale * nlp.functions["grad_f"](X, p)[1]
        self.nlp = ca.Function("nlp", [X, p], [f, (s * g)[order]], ["x", "p"], ["f", "g"])
        self.functions = {
            "jac_g": ca.Function("nlp_jac_g", [X, p], [(s * g_j)[order], turned], ["x", "p"], ["g", "jac_g_x"]),
            "grad_f": ca.Function("nlp_grad_f", [X, p], [grad], ["x", "p"], ["grad_f_x"]),
            "hess_lag": ca.Function(
                "nlp_hess_l",
                [X, p, sigma, lam],
                [sigma * grad + ca.mtimes(turned.T, lam), ca.triu2symm(upper)],
                ["x", "p", "lam_f", "lam_g"],
                ["grad_gamma_x", "hess_gamma_x_x"],
            ),
        }
        self.lbx, self.ubx = nlp.lbx, nlp.ubx
        self.lbg = np.where(self.signs > 0, nlp.lbg, -nlp.ubg)[self.order]
        self.ubg = np.where(self.signs > 0, nlp.ubg, -nlp.lbg)[self.order]

    def rows(self, staged: np.ndarray) -> np.ndarray:
        """Values of the rows, or their multipliers, with the NLP's signs and in its order."""
        result = np.empty_like(staged)
        result[self.order] = staged
        return result * self.signs

    def turned(self, run: SolverRun) -> SolverRun:
        """The run in the signs, the order and the scale of the NLP itself."""
        rows, bounds = self.rows(run.multipliers.rows) / self.scale, run.multipliers.bounds / self.scale
        objective = run.objective / self.scale
        return replace(run, g=self.rows(run.g), objective=objective, multipliers=Multipliers(rows, bounds))


def _start_rows(nlp: Nlp) -> list[int]:
    """Point constraints that read values at the start alone."""
    place = {i.symbol.element_hash(): i.s for i in nlp.problem.instants}
    read = [[place.get(s.element_hash()) for s in ca.symvar(r.expression)] for r in nlp.problem.points]
    return [n for n, at in enumerate(read) if at and all(s == 0.0 for s in at)]


def _order(nlp: Nlp) -> np.ndarray:
    """The NLP's rows in the order of fatrop: those at the start behind the first element's."""
    first, N = nlp.element.rows.numel(), nlp.mesh.elements
    early = first * N + np.array(_start_rows(nlp), int)
    rest = np.setdiff1d(np.arange(len(nlp.lbg)), early)
    return np.concatenate([rest[:first], early, rest[first:]]).astype(int)


def _signs(nlp: Nlp) -> np.ndarray:
    problem, mesh, layout = nlp.problem, nlp.mesh, nlp.element.layout
    title = problem.flat.title
    couples = []
    if problem.P.numel():
        couples.append(f"the constants {', '.join((*problem.free_names, *problem.tunable))}")
    early = {s.element_hash() for n in _start_rows(nlp) for s in ca.symvar(problem.points[n].expression)}
    inner = [i.s for i in problem.instants if i.s != 1.0 and i.symbol.element_hash() not in early]
    if inner:
        couples.append(f"a value at {inner[0]:g} of the horizon")
    if problem.delayed:
        couples.append("a delayed input")
    if mesh.blocks is not None:
        couples.append("blocks of the control")
    if couples:
        raise ModelError(f"{title}: fatrop wants elements that only their states link; found {' and '.join(couples)}; "
                         "use solver 'ipopt'")  # fmt: skip
    m = nlp.element.rows.numel()
    signs = np.ones(len(nlp.lbg))
    signs[: m * mesh.elements].reshape(mesh.elements, m)[:, : layout.nl] = -1.0
    return signs
