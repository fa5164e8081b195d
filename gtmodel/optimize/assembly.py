"""Is a solution on the branches that were asked for? The sign of each declared branch at every point tells."""

from __future__ import annotations

import casadi as ca
import numpy as np

from .nlp import Nlp, placed
from .solution import constants, mesh_fractions, states_and_controls

# a branch expression this small beside its largest value is zero: the solution touches the border of the branch
TOUCHES = 1e-6


def wrong_branch(nlp: Nlp, x: np.ndarray) -> str:
    """A sentence on the first declared branch whose sign is not the wanted one at some point, or nothing."""
    problem = nlp.problem
    flat, alias = problem.flat, problem.plan.alias
    branches = []
    for b in flat.branches:
        pairs = flat.scope.symbols_in(alias.rewrite(flat, b.expression))
        if all(problem.builder.expressible(p) for p in pairs):
            branches.append(b)
    if not branches:
        return ""
    expressions = problem.builder.express([b.expression for b in branches])
    arguments = [problem.x, problem.xd, problem.u, problem.P, problem.t]
    xs, rates, us, times = states_and_controls(nlp, x, mesh_fractions(placed(nlp, x))[1:])
    f = ca.Function("branches", arguments, [ca.vertcat(*expressions)]).map(len(times))
    columns = [ca.DM(a.T) for a in (xs, rates, us)]
    values = f(*columns, ca.repmat(ca.DM(constants(nlp, x)), 1, len(times)), ca.DM(times).T).full()
    for b, row in zip(branches, values, strict=True):
        sign = problem.branches.get(b.name, 1)
        wrong = np.flatnonzero(~(sign * row > -TOUCHES * np.max(np.abs(row), initial=0.0)))
        if wrong.size:
            k = int(wrong[0])
            return (
                f"the solution is on the wrong branch: '{b.name}' ({b.where}) is {row[k]:.4g} at {times[k]:.6g} s, but "
                f"{sign:+d} is wanted; give a guess on the wanted branch, or branches={{'{b.name}': {-sign:+d}}}"
            )
    return ""
