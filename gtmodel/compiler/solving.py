"""Solution of one block of equations: linear, in closed form, or with Newton's method."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import casadi as ca
import numpy as np

from .analysis.body_axes import Own
from .blocks import NewtonBlock, SignAnalysis, SolvedBlock
from .closed_form.linear_block import solve_linear
from .closed_form.quadric import NoClosedForm, eliminate_explicit, solve_angle, solve_nonlinear
from .flat import FlatModel
from .matrices import stacked
from .rewriting import is_nonsmooth, kinked_in
from .structure import EquationStructure
from .tearing import torn

Assignments = list[tuple[ca.SX, ca.SX]]
Pair = tuple[int, int]


def solve_block(
    flat: FlatModel,
    structure: EquationStructure,
    derivatives: list[list[ca.SX]],
    nodes: list[Pair],
    unknown_of: dict[Pair, Pair],
    signs: SignAnalysis,
    uses: tuple[tuple[str, ...], ...],
    pose: bool = False,
    turns: bool = False,
    states: Collection[Pair] = (),
    own: Mapping[Pair, Own] | None = None,
) -> SolvedBlock:
    """Solve the block of these nodes (equation, derivative) for their unknowns.

    uses: see `SolvedBlock`. pose: a rotation is known, and the block may contain a chain of joints. turns: an angle may
    be limited to one turn about its start. states: the chain symbols that are states. own: for equations in the axes of
    bodies, see `BodyAxes`.
    """
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
        held = [k for k, (i, m) in enumerate(unknown_of[n] for n in order) if (i, m - 1) in states]
        ranks, shared = None, False
        if own is not None:
            place = {unknown_of[n]: k for k, n in enumerate(order)}
            mine = ((k, own[n]) for k, n in enumerate(rows) if n in own)
            ranks = {k: (-1 if o.pair is None else place.get(o.pair, -1), o.rank) for k, o in mine}
            solved = set(unknown_of.values())
            shared = solved.isdisjoint(flat.scope.symbols_in(jacobian))
        assignments, margins, detail, core = solve_linear(
            residuals, unknowns, jacobian, signs, label, held, ranks, shared
        )
        kind = "explicit" if len(nodes) == 1 and not margins else "linear"
        return SolvedBlock(kind, names, equations, assignments, margins, [], detail, None, uses, (), core)
    if pose:
        preference = [flat.variables[unknown_of[n][0]].prefer for n in order]
        cut = torn(residuals, unknowns, preference)
        if cut is not None:
            return _newton(flat, names, equations, residuals, cut.residuals, cut.unknowns, cut.assignments, uses)
    try:
        assignments, margins, roots, detail = solve_nonlinear(residuals, unknowns, signs, kinked)
    except NoClosedForm:
        reduced, implicit, explicit = eliminate_explicit(residuals, unknowns, signs, True, kinked)
        assigned = list(reversed(explicit))
        if turns and len(implicit) == 1 and not kinked and (middle := _middle(flat, implicit[0], signs)) is not None:
            label = implicit[0].name()
            try:
                core, margins, root = solve_angle(reduced[0], implicit[0], middle, signs, label)
            except NoClosedForm:
                pass
            else:
                detail = f"angle in {label}" + (f", {len(explicit)} explicit" if explicit else "")
                given = core + assigned
                return SolvedBlock(
                    "angle", names, equations, given, margins, [root], detail, None, uses, tuple(residuals)
                )
        return _newton(flat, names, equations, residuals, reduced, implicit, assigned, uses)
    kind = detail.split(" in ")[0]
    return SolvedBlock(kind, names, equations, assignments, margins, roots, detail, None, uses, tuple(residuals))


def _middle(flat: FlatModel, u: ca.SX, signs: SignAnalysis) -> float | None:
    """Return the middle of the limits of an angle, else its value at home; None if the unknown is not an angle."""
    owner = flat.scope.owner(u)
    v = None if owner is None or owner[1] else flat.variables[owner[0]]
    if v is None or v.unit != "rad":
        return None
    return (v.min + v.max) / 2 if np.isfinite(v.min) and np.isfinite(v.max) else round(signs.at_home(u), 2)


def _newton(
    flat: FlatModel,
    names: list[str],
    equations: list[str],
    residuals: list[ca.SX],
    reduced: list[ca.SX],
    implicit: list[ca.SX],
    assigned: Assignments,
    uses: tuple[tuple[str, ...], ...],
) -> SolvedBlock:
    """Return a block for Newton's method: reduced residuals of the implicit unknowns, which determine the others."""
    scale = np.array([flat.variables[p[0]].nominal for p in map(flat.scope.owner, implicit) if p is not None])
    labels = [u.name() for u in implicit]
    detail = f"Newton in {', '.join(labels)}" + (f", {len(assigned)} explicit" if assigned else "")
    newton = NewtonBlock(implicit, reduced, labels, scale)
    return SolvedBlock("Newton", names, equations, assigned, [], [], detail, newton, uses, tuple(residuals))
