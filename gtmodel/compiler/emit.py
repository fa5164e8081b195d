"""Emission: expressions of solved unknowns written in what a plan reads."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from .analysis.constants import with_gathered_constants
from .analysis.differences import with_differences
from .analysis.factors import without_factors
from .plan import CausalPlan


def express(plan: CausalPlan, expressions: Sequence[ca.SX], extra: Sequence[tuple[ca.SX, ca.SX]] = ()) -> list[ca.SX]:
    """Rewrite expressions of kept symbols in terms of the plan's inputs, Newton unknowns, parameters and time.

    Parameters become what the plan has in their place; `extra` are further (symbol, value) pairs substituted
    first, in place of what the plan would compute.

    One common-subexpression pass over everything comes last: SX itself shares nothing.
    """
    results = substituted(plan, expressions, extra)
    if not results:
        return []
    shared = ca.cse(with_differences(ca.cse(without_factors(ca.cse(results)))))
    return ca.cse(with_gathered_constants(shared))


def substituted(plan: CausalPlan, expressions: Sequence[ca.SX], extra: Sequence[tuple[ca.SX, ca.SX]]) -> list[ca.SX]:
    """As `express`, as it comes: quick, for what is called a few times."""
    given = {s.element_hash() for s, _ in extra}  # what is given is not computed
    roots = [r for b in plan.blocks for r in b.roots]
    pairs = [*extra]
    if plan.flat.parameters:
        pairs.append((plan.flat.p, plan.parameters))
    pairs += [(r.sign, ca.SX(r.value)) for r in roots]
    pairs += [a for b in plan.blocks for a in b.assignments if a[0].element_hash() not in given]
    results = list(expressions)
    if pairs:
        _, results = ca.substitute_inplace([s for s, _ in pairs], [v for _, v in pairs], results)
    return results
