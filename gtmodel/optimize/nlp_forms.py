"""Alternative forms of an NLP: `Merged`, with one unknown per continuous state at an edge, and `Staged`, for fatrop."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeVar

import casadi as ca
import numpy as np

from ..compiler.matrices import SparseMatrix
from ..lang.source import ModelError
from .ipopt import SolverRun
from .nlp import Nlp, functions_of, scatter
from .watch import Iterate, Multipliers, Program

Run = TypeVar("Run", SolverRun, Iterate)
ALONE, MERGED = 1.0, np.sqrt(0.5)  # weight of an unknown in its z


@dataclass(frozen=True, eq=False)
class Pairs:
    """Pairs of equal unknowns: the rows `rows` state X[kept] - X[gone] == 0; the rows `others` stay.

    X = weight[place] * z[place], with the index `place` of the z of each unknown.
    """

    rows: np.ndarray
    kept: np.ndarray
    gone: np.ndarray
    others: np.ndarray
    place: np.ndarray
    weight: np.ndarray

    @classmethod
    def of(cls, nlp: Nlp) -> Pairs:
        """Pair states at element ends, and continuous controls, with the next element's left values.

        There are no pairs if the end is not a collocation point, and none of controls that may step.
        """
        layout, mesh, m = nlp.element.layout, nlp.mesh, nlp.element.rows.numel()
        last = layout.x[-1].tolist() if mesh.table.points[-1] == 1.0 else []
        if len(last) == layout.nx and layout.carried.size and mesh.blocks is None:
            last += layout.u[-1].tolist()
        k, i = (a.ravel() for a in np.meshgrid(np.arange(mesh.elements), np.arange(len(last)), indexing="ij"))
        rows, kept, gone = k * m + i, k * layout.size + np.array(last, int)[i], (k + 1) * layout.size + i
        stays = np.ones(nlp.size, bool)
        stays[gone] = False
        place = np.cumsum(stays) - 1
        place[gone] = place[kept]
        weight = np.full(int(stays.sum()), ALONE)
        weight[place[gone]] = MERGED
        return cls(rows, kept, gone, np.setdiff1d(np.arange(len(nlp.lbg)), rows), place, weight)

    @property
    def spread(self) -> SparseMatrix:
        """The matrix E of X = E z."""
        n = len(self.place)
        return SparseMatrix.of(np.arange(n), self.place, self.weight[self.place], (n, len(self.weight)))

    def taken(self, x: np.ndarray) -> np.ndarray:
        """Return E' x."""
        return np.bincount(self.place, self.weight[self.place] * x, len(self.weight))


class Merged(Program):
    """An NLP in which equal unknowns are merged and their rows removed; solutions are mapped back to the full NLP."""

    def __init__(self, full: Nlp, pairs: Pairs, nlp: ca.Function, functions: dict[str, ca.Function]) -> None:
        """nlp, functions: in terms of z, see `merged`."""
        self.full, self.pairs, self.nlp, self.functions = full, pairs, nlp, functions
        size = len(pairs.weight)
        self.lbx, self.ubx = np.full(size, -np.inf), np.full(size, np.inf)
        np.maximum.at(self.lbx, pairs.place, full.lbx)
        np.minimum.at(self.ubx, pairs.place, full.ubx)
        self.lbx, self.ubx = self.lbx / pairs.weight, self.ubx / pairs.weight
        self.lbg, self.ubg = full.lbg[pairs.others], full.ubg[pairs.others]

    def start(self, x: np.ndarray, warm: Multipliers | None) -> tuple[np.ndarray, Multipliers | None]:
        """Map a guess of the full NLP, and multipliers for a warm start, to z and the remaining rows."""
        p = self.pairs
        return p.taken(x), None if warm is None else Multipliers(warm.rows[p.others], p.taken(warm.bounds))

    def turned(self, run: SolverRun) -> SolverRun:
        """Map the run back to the unknowns and rows of the full NLP."""
        return replace(self._lifted(run), best=None if run.best is None else self._lifted(run.best))

    def _lifted(self, run: Run) -> Run:
        full, p = self.full, self.pairs
        x = np.clip((p.weight * run.x)[p.place], full.lbx, full.ubx)  # rounding only
        g, rows = np.zeros(len(full.lbg)), np.zeros(len(full.lbg))
        g[p.others], rows[p.others] = run.g, run.multipliers.rows
        bounds = (run.multipliers.bounds / p.weight)[p.place]
        # two equal bounds share the multiplier; if they differ (at the end of the horizon) the narrower one takes it
        same = (full.lbx[p.kept] == full.lbx[p.gone]) & (full.ubx[p.kept] == full.ubx[p.gone])
        bounds[p.gone] *= np.where(same, 0.5, 1.0)
        bounds[p.kept] -= bounds[p.gone]
        gradient = np.asarray(full.functions["grad_f"](x, [])[1]).reshape(-1)
        jacobian = full.functions["jac_g"](x, [])[1]
        slope = gradient + np.asarray((jacobian.T @ ca.DM(rows)).full()).reshape(-1) + bounds
        rows[p.rows] = -slope[p.kept]  # the element's end has the coefficient +1 in its row
        return replace(run, x=x, g=g, multipliers=Multipliers(rows, bounds))


def merged(nlp: Nlp) -> Merged | None:
    """Return the merged form of an NLP, built once; None if there is nothing to merge."""
    if "merged" not in nlp.cache:
        equal = Pairs.of(nlp)
        nlp.cache["merged"] = (equal, *_functions(nlp, equal)) if len(equal.rows) else None
    form: tuple[Pairs, ca.Function, dict[str, ca.Function]] | None = nlp.cache["merged"]
    if form is None:
        return None
    pairs, program, functions = form
    return Merged(nlp, pairs, program, functions)


def _functions(full: Nlp, pairs: Pairs) -> tuple[ca.Function, dict[str, ca.Function]]:
    """Return the program and its derivatives with respect to z: E'g, JE and E'HE."""
    size, others, weight, place = len(pairs.weight), pairs.others, pairs.weight, pairs.place
    z, p, sigma, lam = ca.MX.sym("z", size), ca.MX.sym("p", 0), ca.MX.sym("lam_f"), ca.MX.sym("lam_g", len(others))
    E = pairs.spread
    X = E.dm @ z
    row = np.full(len(full.lbg), -1)
    row[others] = np.arange(len(others))
    f, g = full.nlp.call([X, p], True, False)
    g_first, jacobian = full.functions["jac_g"].call([X, p], True, False)
    _, gradient = full.functions["grad_f"].call([X, p], True, False)
    (hessian,) = full.functions["hess_lag"].call([X, p, sigma, ca.vertcat(lam, 0)[row.tolist()]], True, False)

    i, j = (np.array(a, int) for a in jacobian.sparsity().get_triplet())
    entries = np.flatnonzero(row[i] >= 0)
    r, c = row[i[entries]], place[j[entries]]
    jac = _gathered(r, c, jacobian.nz[entries.tolist()], weight[c], (len(others), size))
    i, j = (np.array(a, int) for a in hessian.sparsity().get_triplet())
    r, c = place[i], place[j]
    twice = np.where((i != j) & (r == c), 2.0, 1.0)  # off-diagonal entry of two merged unknowns: in both triangles
    hess = _gathered(np.minimum(r, c), np.maximum(r, c), hessian.nz[:], twice * weight[r] * weight[c], (size, size))
    nlp = ca.Function("nlp", [z, p], [f, g[others.tolist()]], ["x", "p"], ["f", "g"])
    return nlp, functions_of(z, p, sigma, lam, f, g_first[others.tolist()], E.T.dm @ gradient, jac, hess)


def _gathered(r: np.ndarray, c: np.ndarray, values: ca.MX, weights: np.ndarray, shape: tuple[int, int]) -> ca.MX:
    """Return a sparse matrix from weighted triplets; duplicates are summed."""
    if not len(r):
        return ca.MX(*shape)
    entries, where = np.unique(r + shape[0] * c, return_inverse=True)
    summed = SparseMatrix.of(where, np.arange(len(r)), weights, (len(entries), len(r))).dm
    return scatter(entries % shape[0], entries // shape[0], summed @ values, shape)


class Staged(Program):
    """The NLP with the signs of its continuity rows reversed and rows at the start moved to the first element.

    fatrop detects the stages itself.
    """

    def __init__(self, nlp: Nlp, scale: float = 1.0) -> None:
        """scale: factor of the objective. Raises ModelError if anything but states couples the elements."""
        self.signs, self.order, self.scale = _signs(nlp), _order(nlp), scale
        order = self.order.tolist()
        X, p, sigma = ca.MX.sym("X", nlp.size), ca.MX.sym("p", 0), ca.MX.sym("lam_f")
        lam = ca.MX.sym("lam_g", len(nlp.lbg))
        s = ca.DM(self.signs)
        place = np.argsort(self.order).tolist()  # position of each row in fatrop's order
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
        """Map values or multipliers of the rows back to the NLP's signs and order."""
        result = np.empty_like(staged)
        result[self.order] = staged
        return result * self.signs

    def turned(self, run: SolverRun) -> SolverRun:
        """Map the run back to the signs, order and scale of the NLP."""
        rows, bounds = self.rows(run.multipliers.rows) / self.scale, run.multipliers.bounds / self.scale
        objective = run.objective / self.scale
        return replace(run, g=self.rows(run.g), objective=objective, multipliers=Multipliers(rows, bounds))


def _start_rows(nlp: Nlp) -> list[int]:
    """Return the point constraints that depend only on values at the start."""
    place = {i.symbol.element_hash(): i.s for i in nlp.problem.instants}
    instants = [[place.get(s.element_hash()) for s in ca.symvar(r.expression)] for r in nlp.problem.points]
    return [n for n, times in enumerate(instants) if times and all(s == 0.0 for s in times)]


def _order(nlp: Nlp) -> np.ndarray:
    """Return the NLP's rows in fatrop's order: rows at the start follow the first element's."""
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
        raise ModelError(f"{title}: solver 'fatrop' needs elements coupled by states only; found "
                         f"{' and '.join(couples)}; use solver 'ipopt'")  # fmt: skip
    m = nlp.element.rows.numel()
    signs = np.ones(len(nlp.lbg))
    signs[: m * mesh.elements].reshape(mesh.elements, m)[:, : layout.nl] = -1.0
    return signs
