"""Is a solution one that was asked for: on the wanted branches, and with a horizon that somebody bounds?

The sign of each declared branch at every point tells.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from ..compiler.flat import FlatBranch
from .formulation.dynamic import DynamicProblem
from .formulation.system import on_rows
from .judgement.places import Remark, final_time_place
from .nlp import Nlp, placed
from .solution import constants, horizon, mesh_fractions, states_and_controls

# a branch expression this small beside its largest value is zero: the solution touches the border of the branch
TOUCHES = 1e-6
AT_LIMIT = 1e-3  # relative: a horizon so near its shortest length stands at it; IPOPT stops before its bounds


def astray(nlp: Nlp, x: np.ndarray) -> Remark:
    """A remark on a branch that is not the wanted one, or a horizon that came down to nothing; or nothing."""
    return wrong_branch(nlp, x) or shrunk(nlp, x)


def shrunk(nlp: Nlp, x: np.ndarray) -> Remark:
    """A remark on a free horizon without bounds that ends as short as it may be, or nothing."""
    shortest, (t0, tf) = nlp.problem.shortest, horizon(nlp, x)
    if not shortest or tf - t0 > shortest * (1 + AT_LIMIT):
        return Remark("")
    return Remark(
        f"the horizon has shrunk to {tf - t0:.4g} s, a thousandth of its guess, and would shrink on: nothing keeps it "
        "longer; bound the free time, as gt.free(guess=..., min=0.1), or write what takes time as a constraint",
        final_time_place(nlp.problem),
    )


def wrong_branch(nlp: Nlp, x: np.ndarray) -> Remark:
    """A remark on the first declared branch whose sign is not the wanted one at some point, or nothing."""
    problem = nlp.problem
    if "branches" not in problem.cache:
        problem.cache["branches"] = _branches(problem)
    branches, f = problem.cache["branches"]
    if not branches:
        return Remark("")
    xs, rates, us, times = states_and_controls(nlp, x, mesh_fractions(placed(nlp, x))[1:])
    (values,) = on_rows(f, (xs, rates, us), constants(nlp, x), times)
    for b, row in zip(branches, values, strict=True):
        sign = problem.branches.get(b.name, 1)
        wrong = np.flatnonzero(~(sign * row > -TOUCHES * np.max(np.abs(row), initial=0.0)))
        if wrong.size:
            k = int(wrong[0])
            return Remark(
                f"the solution is on the wrong branch: '{b.name}' ({b.where}) is {row[k]:.4g} at {times[k]:.6g} s, but "
                f"{sign:+d} is wanted; give a guess on the wanted branch, or branches={{'{b.name}': {-sign:+d}}}",
                b.where,
            )
    return Remark("")


def _branches(problem: DynamicProblem) -> tuple[list[FlatBranch], ca.Function]:
    """The declared branches that the problem's unknowns tell, and the expressions of all."""
    flat, alias, builder = problem.flat, problem.plan.alias, problem.builder
    branches = [
        b
        for b in flat.branches
        if all(builder.expressible(p) for p in flat.scope.symbols_in(alias.rewrite(flat, b.expression)))
    ]
    expressions = builder.express([b.expression for b in branches]) if branches else []
    return branches, ca.Function("branches", problem.arguments, [ca.vertcat(ca.SX(0, 1), *expressions)])
