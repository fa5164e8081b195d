"""One block of equations solved for its unknowns: linear, in closed form, or by Newton."""

from __future__ import annotations

import casadi as ca
import numpy as np

from .analysis.nonsmooth import is_nonsmooth, kinked_in
from .blocks import NewtonBlock, SolvedBlock
from .flat import FlatModel
from .linear import solve_linear
from .matrices import stacked
from .pivots import SignAnalysis
from .quadric import NoClosedForm, eliminate_explicit, solve_nonlinear
from .structure import EquationStructure

Pair = tuple[int, int]


def solve_block(
    flat: FlatModel,
    structure: EquationStructure,
    derivatives: list[list[ca.SX]],
    nodes: list[Pair],
    unknown_of: dict[Pair, Pair],
    signs: SignAnalysis,
    uses: tuple[tuple[str, ...], ...],
) -> SolvedBlock:
    """The block of these nodes (equation, derivative), each solved for its unknown. uses: see `SolvedBlock`."""
    order = sorted(nodes, key=lambda n: unknown_of[n])  # canonical: by declaration of the unknowns
    rows = sorted(nodes)
    residuals = [derivatives[i][m] for i, m in rows]
    unknowns = [flat.scope.symbol(*unknown_of[n]) for n in order]
    names = [flat.symbol_name(*unknown_of[n]) for n in order]
    equations = [f"{structure.equations[i].label}{chr(39) * m} ({structure.equations[i].where})" for i, m in rows]
    label = names[0] if len(names) == 1 else f"{names[0]}..{names[-1]}"
    jacobian = ca.jacobian(stacked(residuals), stacked(unknowns))
    kinked = is_nonsmooth(flat) and any(kinked_in(residuals, unknowns))
    keys = {s.element_hash() for s in unknowns}
    linear = jacobian.is_constant() or not any(s.element_hash() in keys for s in ca.symvar(jacobian))
    if not kinked and linear:
        assignments, margins, how, core = solve_linear(residuals, unknowns, jacobian, signs, label)
        kind = "explicit" if len(nodes) == 1 and not margins else "linear"
        return SolvedBlock(kind, names, equations, assignments, margins, [], how, None, uses, (), core)
    try:
        assignments, margins, roots, how = solve_nonlinear(residuals, unknowns, signs, kinked)
    except NoClosedForm:
        left, unknown, explicit = eliminate_explicit(residuals, unknowns, signs, True, kinked)
        scale = np.array([flat.variables[p[0]].nominal for p in map(flat.scope.owner, unknown) if p is not None])
        labels = [u.name() for u in unknown]
        how = f"Newton in {', '.join(labels)}" + (f", {len(explicit)} explicit" if explicit else "")
        newton = NewtonBlock(unknown, left, labels, scale)
        assigned = list(reversed(explicit))
        return SolvedBlock("Newton", names, equations, assigned, [], [], how, newton, uses, tuple(residuals))
    kind = how.split(" in ")[0]
    return SolvedBlock(kind, names, equations, assignments, margins, roots, how, None, uses, tuple(residuals))
