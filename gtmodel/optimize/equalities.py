"""Equations that cannot all hold: more of them in one element than it has unknowns. Structure alone shows them."""

from __future__ import annotations

import casadi as ca
import numpy as np

from ..compiler.structure import overdetermined_and_underdetermined
from ..lang.source import ModelError
from .element import Element
from .formulation.dynamic import DynamicProblem

MOST_NAMED = 6


def check_equalities(problem: DynamicProblem, element: Element) -> None:
    """Match the equations of one element to its own unknowns. Raises ModelError naming those that are too many.

    What stands at the left end belongs to the element before; the right end is the element's own.
    """
    layout = element.layout
    equal = np.flatnonzero(element.low == element.high)
    own = np.arange(layout.nl, layout.size)
    column = {int(j): n for n, j in enumerate(own)}
    row = {int(i): n for n, i in enumerate(equal)}
    entries = {
        (row[i], column[j]): 0
        for i, j in zip(*ca.jacobian_sparsity(element.rows, element.y).get_triplet(), strict=True)
        if i in row and j in column
    }
    # a row that continues something is matched by the right end; a free constant may take up one row per element
    for n, i in enumerate(equal):
        if i < layout.nl:
            entries[(n, len(own) + int(i))] = 0
    columns = len(own) + layout.nl
    held = {s.element_hash() for s in ca.symvar(element.rows)} & {s.element_hash() for s in ca.vertsplit(element.P)}
    if held and layout.mesh.elements == 1:
        return  # constants could make up for it
    over, _ = overdetermined_and_underdetermined(len(equal), columns, entries)
    if not over:
        return
    names = list(dict.fromkeys(element.row_names[int(equal[n])][0] for n in over))
    shown = "; ".join(names[:MOST_NAMED]) + ("; ..." if len(names) > MOST_NAMED else "")
    raise ModelError(
        f"{problem.flat.title}: too many equations for what may be chosen along the path; these contradict or repeat "
        f"each other: {shown}; leave one out, or add a control"
    )
