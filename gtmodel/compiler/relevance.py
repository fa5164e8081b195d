"""What a causality needs of a flat model: conditions on known values set apart, undetermined rest left out."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from .blocks import Margin, SolvedBlock
from .flat import FlatEquation, FlatModel
from .structure import overdetermined_and_underdetermined

# a unit quaternion printed with six digits is one, anything coarser is refused
CONDITION_TOLERANCE = 1e-6


def set_apart(
    flat: FlatModel, equations: Sequence[FlatEquation], known: set[int]
) -> tuple[list[FlatEquation], list[FlatEquation]]:
    """(equations to solve, conditions): a condition holds among the elements of one known variable, e'e = 1.

    An equation among several known variables stays: there are too many knowns then.
    """
    group_of = {i: n for n, (_, indices) in enumerate(flat.groups.values()) for i in indices}
    left: list[FlatEquation] = []
    conditions: list[FlatEquation] = []
    for e in equations:
        inside = flat.scope.symbols_in(e.residual)
        one = len({group_of.get(i, -1 - i) for i, _ in inside}) == 1
        alone = one and len(inside) > 1 and all(i in known and order == 0 for i, order in inside)
        (conditions if alone else left).append(e)
    return left, conditions


def needed(
    flat: FlatModel, equations: list[FlatEquation], unknowns: list[int], targets: set[int]
) -> tuple[list[FlatEquation], list[int], list[int]]:
    """(equations, unknowns, undetermined): without the underdetermined part, where no target lies in it.

    The forces of a mechanism whose loads nobody gave do not stand in the way of its kinematics: by Dulmage and
    Mendelsohn the well-determined part does not contain them. A system with surplus equations stays whole.
    """
    column = {j: n for n, j in enumerate(unknowns)}
    entries = {
        (i, column[index]): 0
        for i, e in enumerate(equations)
        for index, _ in flat.scope.symbols_in(e.residual)
        if index in column
    }
    over, under = overdetermined_and_underdetermined(len(equations), len(unknowns), entries)
    dropped = {unknowns[j] for j in under}
    if over or not under or not targets or dropped & targets:
        return equations, unknowns, []
    kept = [e for e in equations if not any(i in dropped for i, _ in flat.scope.symbols_in(e.residual))]
    return kept, [j for j in unknowns if j not in dropped], sorted(dropped)


def condition_block(conditions: Sequence[FlatEquation], residuals: Sequence[ca.SX]) -> SolvedBlock:
    """A block that computes nothing; its margins turn negative where the known values break a condition."""
    labels = [f"{e.label} ({e.where})" for e in conditions]
    margins = [
        Margin("condition", CONDITION_TOLERANCE**2 - r**2, label) for r, label in zip(residuals, labels, strict=True)
    ]
    return SolvedBlock("condition", [], labels, [], margins, detail="holds among the known values")
