"""Rewriting of expressions instruction by instruction: what the passes over generated code share."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import casadi as ca

LARGEST = 50_000  # operations; beyond, the time of a pass would be noticed

# the outputs of a function of these symbols, one by one; None to leave everything as it is
Rewrite = Callable[[ca.Function, list[ca.SX]], list[ca.SX] | None]


def rewritten(expressions: Sequence[ca.SX], rewrite: Rewrite) -> list[ca.SX]:
    """The expressions as `rewrite` makes them, each with the sparsity it had."""
    numbers: list[Any] = [x for e in expressions for x in e.nonzeros()]
    symbols = ca.symvar(ca.vertcat(*numbers)) if numbers else []
    if not symbols:
        return list(expressions)
    f = ca.Function("f", [ca.vertcat(*symbols)], [ca.vertcat(*numbers)])
    made = rewrite(f, symbols) if f.n_instructions() <= LARGEST else None
    if made is None:
        return list(expressions)
    results = iter(made)
    return [
        ca.SX(e.sparsity(), ca.vertcat(*[next(results) for _ in range(e.nnz())])) if e.nnz() else e for e in expressions
    ]
