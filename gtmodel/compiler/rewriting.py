"""Rewriting of expressions instruction by instruction: what the passes over generated code share."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Protocol, TypeVar

import casadi as ca

LARGEST = 50_000  # operations; beyond, the time of a pass would be noticed

# the outputs of a function of these symbols, one by one; None to leave everything as it is
Rewrite = Callable[[ca.Function, list[ca.SX]], list[ca.SX] | None]

Form = TypeVar("Form")  # how a pass writes down what an instruction gives


class Forms(Protocol[Form]):
    """What a pass makes of instructions: leaves are inputs and constants."""

    def leaf(self, x: ca.SX) -> Form: ...

    def operation(self, k: int, op: int, given: list[Form]) -> Form:
        """Of instruction `k`, with operation code `op`."""
        ...

    def whole(self, form: Form) -> ca.SX: ...


def walked(f: ca.Function, symbols: Sequence[ca.SX], forms: Forms[Form]) -> list[ca.SX]:
    """The outputs of a function of these symbols, one by one, each instruction written as `forms` makes it."""
    work: dict[int, Form] = {}
    results = [ca.SX(0)] * f.numel_out(0)
    for k in range(f.n_instructions()):
        op, given, put = f.instruction_id(k), f.instruction_input(k), f.instruction_output(k)
        if op == ca.OP_OUTPUT:
            results[put[1]] = forms.whole(work[given[0]])
        elif op == ca.OP_INPUT:
            work[put[0]] = forms.leaf(symbols[given[1]])
        elif op == ca.OP_CONST:
            work[put[0]] = forms.leaf(ca.SX(f.instruction_constant(k)))
        else:
            work[put[0]] = forms.operation(k, op, [work[i] for i in given])
    return results


def applied(op: int, parts: Sequence[ca.SX]) -> ca.SX:
    """The operation of that code."""
    return ca.SX.unary(op, *parts) if len(parts) == 1 else ca.SX.binary(op, *parts)


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
