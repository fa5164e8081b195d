"""On which side of each root a consistent point lies, and the point on the other one."""

from __future__ import annotations

import casadi as ca
import numpy as np

from .branch import root_derivatives
from .emit import express
from .plan import Plan


def on_branch(plan: Plan, w: np.ndarray, time: float) -> bool:
    """Whether every root has the sign that declared branches or start values give it, as in a causal function."""
    roots = [r for b in plan.blocks for r in b.roots]
    if not roots:
        return True
    jacobian = root_derivatives(plan, plan.sampler)(w, plan.flat.p0, time)
    return bool(np.all(np.asarray(jacobian.full()).reshape(-1) * [r.value for r in roots] > 0))


def moved_to_branch(plan: Plan, w: np.ndarray, time: float) -> np.ndarray:
    """The point with what the plan computes put on its branches, all else as it is; w itself if no numbers come out."""
    flat = plan.flat
    values = express(plan, [flat.scope.symbol(*pair) for pair in plan.pairs])
    f = ca.Function("moved", [plan.sampler.w, flat.p, flat.scope.time], [ca.vertcat(*values)])
    moved = np.asarray(f(w, flat.p0, time).full()).reshape(-1)
    return moved if np.all(np.isfinite(moved)) else w
