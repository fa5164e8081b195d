"""Fifty-digit arithmetic over the operations of a function, the independent road of these tests: mpmath, or decimal
numbers where all operations are algebraic, which are ten times as fast."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from decimal import Decimal, getcontext
from typing import Any

import casadi as ca
from mpmath import mp, mpf

mp.dps = 50
getcontext().prec = 50
ALGEBRAIC = {ca.OP_ASSIGN, ca.OP_ADD, ca.OP_SUB, ca.OP_MUL, ca.OP_DIV, ca.OP_NEG, ca.OP_SQ, ca.OP_TWICE, ca.OP_INV,
             ca.OP_SQRT, ca.OP_CONST, ca.OP_INPUT, ca.OP_OUTPUT}  # fmt: skip

OPERATIONS: dict[int, Callable[..., Any]] = {
    ca.OP_ASSIGN: lambda x: x,
    ca.OP_ADD: lambda x, y: x + y,
    ca.OP_SUB: lambda x, y: x - y,
    ca.OP_MUL: lambda x, y: x * y,
    ca.OP_DIV: lambda x, y: x / y,
    ca.OP_NEG: lambda x: -x,
    ca.OP_SQ: lambda x: x * x,
    ca.OP_TWICE: lambda x: 2 * x,
    ca.OP_INV: lambda x: 1 / x,
    ca.OP_SQRT: mp.sqrt,
    ca.OP_SIN: mp.sin,
    ca.OP_COS: mp.cos,
    ca.OP_TAN: mp.tan,
    ca.OP_ASIN: mp.asin,
    ca.OP_ACOS: mp.acos,
    ca.OP_ATAN: mp.atan,
    ca.OP_ATAN2: mp.atan2,
    ca.OP_SINH: mp.sinh,
    ca.OP_COSH: mp.cosh,
    ca.OP_TANH: mp.tanh,
    ca.OP_EXP: mp.exp,
    ca.OP_LOG: mp.log,
    ca.OP_POW: mp.power,
    ca.OP_CONSTPOW: mp.power,
    ca.OP_FABS: abs,
    ca.OP_FMIN: min,
    ca.OP_FMAX: max,
    ca.OP_SIGN: lambda x: mp.sign(x),
    ca.OP_FLOOR: mp.floor,
    ca.OP_CEIL: mp.ceil,
    ca.OP_LT: lambda x, y: mpf(x < y),
    ca.OP_LE: lambda x, y: mpf(x <= y),
    ca.OP_EQ: lambda x, y: mpf(x == y),
    ca.OP_NE: lambda x, y: mpf(x != y),
    ca.OP_NOT: lambda x: mpf(x == 0),
    ca.OP_AND: lambda x, y: mpf(bool(x) and bool(y)),
    ca.OP_OR: lambda x, y: mpf(bool(x) or bool(y)),
    ca.OP_IF_ELSE_ZERO: lambda x, y: y if x else mpf(0),
}


class Exact:
    """An SX function with fifty digits; called with one point (all inputs in one column), returns all outputs. `number`
    is the type of all numbers, mpf or Decimal."""

    def __init__(self, f: ca.Function, number: type = mpf) -> None:
        codes = {f.instruction_id(k) for k in range(f.n_instructions())}
        assert number is mpf or codes <= ALGEBRAIC
        self.number = number
        operations = {**OPERATIONS, ca.OP_SQRT: Decimal.sqrt} if number is Decimal else OPERATIONS
        firsts = [0]
        for k in range(f.n_in()):
            firsts.append(firsts[-1] + f.nnz_in(k))
        places = [0]
        for k in range(f.n_out()):
            places.append(places[-1] + f.nnz_out(k))
        self.outputs = places[-1]
        self.constants: dict[int, Any] = {}
        self.steps: list[tuple[Callable[..., Any] | str, list[int], int]] = []
        for k in range(f.n_instructions()):
            op, read, written = f.instruction_id(k), f.instruction_input(k), f.instruction_output(k)
            if op == ca.OP_CONST:
                value = number(f.instruction_constant(k))
                self.steps.append((lambda value=value: value, [], written[0]))
            elif op == ca.OP_INPUT:
                self.steps.append(("in", [firsts[read[0]] + read[1]], written[0]))
            elif op == ca.OP_OUTPUT:
                self.steps.append(("out", [read[0]], places[written[0]] + written[1]))
            else:
                self.steps.append((operations[op], read, written[0]))

    def __call__(self, point: Sequence[Any]) -> list[Any]:
        work: dict[int, Any] = {}
        results: list[Any] = [self.number(0)] * self.outputs
        for operation, read, target in self.steps:
            if operation == "in":
                work[target] = self.number(point[read[0]])
            elif operation == "out":
                results[target] = work[read[0]]
            else:
                work[target] = operation(*[work[i] for i in read])  # type: ignore[operator]
        return results
