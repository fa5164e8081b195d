"""x - (y + z) as (x - y) - z where x - y is there already and z was computed from it: one operation less.

A quadratic in q solved for |T - A - q v| = L leaves T - (A + q v) beside T - A. Elsewhere the two orders of summation
would differ in accuracy: here z carries the rounding of x - y already, so that nothing is lost.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

LARGEST = 50_000  # operations; beyond, the time of this pass would be noticed

Instruction = tuple[int, list[int]]  # operation, and numbers of the instructions it reads


def with_differences(expressions: Sequence[ca.SX]) -> list[ca.SX]:
    """The expressions, each with the sparsity it had; common subexpressions must be shared before."""
    numbers = [x for e in expressions for x in e.nonzeros()]
    symbols = ca.symvar(ca.vertcat(*numbers)) if numbers else []
    if not symbols:
        return list(expressions)
    f = ca.Function("f", [ca.vertcat(*symbols)], [ca.vertcat(*numbers)])
    if f.n_instructions() > LARGEST:
        return list(expressions)
    read = _read(f)
    better = _better(read)
    if not better:
        return list(expressions)
    results = iter(_rebuilt(f, symbols, read, better))
    return [
        ca.SX(e.sparsity(), ca.vertcat(*[next(results) for _ in range(e.nnz())])) if e.nnz() else e for e in expressions
    ]


def _read(f: ca.Function) -> list[Instruction]:
    """Instructions by what they read: places of the work vector are used again and again."""
    written: dict[int, int] = {}
    found: list[Instruction] = []
    for k in range(f.n_instructions()):
        op = f.instruction_id(k)
        given = [] if op in (ca.OP_INPUT, ca.OP_CONST) else [written[i] for i in f.instruction_input(k)]
        found.append((op, given))
        if op != ca.OP_OUTPUT:
            written[f.instruction_output(k)[0]] = k
    return found


def _better(read: list[Instruction]) -> dict[int, tuple[int, int]]:
    """Of differences x - (y + z) that profit: (x - y, z)."""
    uses = [0] * len(read)
    for _, given in read:
        for k in given:
            uses[k] += 1
    differences = {tuple(given): k for k, (op, given) in enumerate(read) if op == ca.OP_SUB}
    better: dict[int, tuple[int, int]] = {}
    for (x, total), k in differences.items():
        op, terms = read[total]
        if op != ca.OP_ADD or uses[total] != 1:
            continue
        for y, z in (terms, terms[::-1]):
            difference = differences.get((x, y))
            if difference is not None and difference < z and _depends(read, z, difference):
                better[k] = (difference, z)
                break
    return better


def _depends(read: list[Instruction], k: int, on: int) -> bool:
    """Whether instruction k is computed from the result of another one."""
    seen, left = set[int](), [k]
    while left:
        k = left.pop()
        if k == on:
            return True
        if k > on and k not in seen:
            seen.add(k)
            left += read[k][1]
    return False


def _rebuilt(
    f: ca.Function, symbols: list[ca.SX], read: list[Instruction], better: dict[int, tuple[int, int]]
) -> list[ca.SX]:
    made: list[ca.SX] = []
    results = [ca.SX(0)] * f.numel_out(0)
    for k, (op, given) in enumerate(read):
        if op == ca.OP_INPUT:
            made.append(symbols[f.instruction_input(k)[1]])
        elif op == ca.OP_CONST:
            made.append(ca.SX(f.instruction_constant(k)))
        elif op == ca.OP_OUTPUT:
            results[f.instruction_output(k)[1]] = made[given[0]]
            made.append(made[given[0]])
        elif k in better:
            difference, z = better[k]
            made.append(made[difference] - made[z])
        else:
            parts = [made[i] for i in given]
            made.append(ca.SX.unary(op, *parts) if len(parts) == 1 else ca.SX.binary(op, *parts))
    return results
