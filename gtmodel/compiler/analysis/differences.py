"""What a quadratic left behind is used again: the difference that it was made of, and its root as its slope.

x - (y + z) is (x - y) - z where x - y is there already and z was computed from it: |T - A - q v| = L solved for q
leaves T - (A + q v) beside T - A. Elsewhere the two orders of summation would differ in accuracy: here z carries the
rounding of x - y already, so that nothing is lost. And with q = (d.v - s) / v.v the slope (d - q v).v, by which the
velocity is divided, is s.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from ..rewriting import rewritten

LONGEST = 16  # products in a sum

Instruction = tuple[int, list[int]]  # operation, and numbers of the instructions it reads


def with_differences(expressions: Sequence[ca.SX]) -> list[ca.SX]:
    """The expressions, each with the sparsity it had; common subexpressions must be shared before."""
    return rewritten(expressions, _rewritten)


def _rewritten(f: ca.Function, symbols: list[ca.SX]) -> list[ca.SX] | None:
    read = _read(f)
    better = _better(read)
    for k, instruction in better.items():
        read[k] = instruction
    slopes = _slopes(read)
    for k, instruction in slopes.items():
        read[k] = instruction
    return _rebuilt(f, symbols, read) if better or slopes else None


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


def _better(read: list[Instruction]) -> dict[int, Instruction]:
    """(x - y) - z in place of differences x - (y + z) that profit."""
    uses = [0] * len(read)
    for _, given in read:
        for k in given:
            uses[k] += 1
    differences = {tuple(given): k for k, (op, given) in enumerate(read) if op == ca.OP_SUB}
    better: dict[int, Instruction] = {}
    for (x, total), k in differences.items():
        op, terms = read[total]
        if op != ca.OP_ADD or uses[total] != 1:
            continue
        for y, z in (terms, terms[::-1]):
            difference = differences.get((x, y))
            if difference is not None and difference < z and _depends(read, z, difference):
                better[k] = (ca.OP_SUB, [difference, z])
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


def _slopes(read: list[Instruction]) -> dict[int, Instruction]:
    """s or -s in place of sums of (x - q y) y, where q is (sum of x y -+ s) over (sum of y y)."""
    found: dict[int, Instruction] = {}
    for k, (op, _) in enumerate(read):
        if op != ca.OP_ADD:
            continue
        terms = _products(read, k)
        split = [_off_line(read, a, b) or _off_line(read, b, a) for a, b in terms]
        first = split[0] if split else None
        if first is None or any(x is None or x[1] != first[1] for x in split):
            continue
        q_op, given = read[first[1]]
        if q_op != ca.OP_DIV or read[given[0]][0] not in (ca.OP_ADD, ca.OP_SUB):
            continue
        sign, (product, root) = read[given[0]]
        pairs = [(x[0], x[2]) for x in split if x is not None]
        if _sorted(_products(read, product)) == _sorted(pairs) and _sorted(_products(read, given[1])) == _sorted(
            [(y, y) for _, y in pairs]
        ):
            found[k] = (ca.OP_ASSIGN if sign == ca.OP_SUB else ca.OP_NEG, [root])
    return found


def _products(read: list[Instruction], k: int) -> list[tuple[int, int]]:
    """The factors of a sum of products; none if it is something else, or longer than vectors are."""
    found, left = list[tuple[int, int]](), [k]
    while left:
        op, given = read[left.pop()]
        if len(found) == LONGEST:
            return []
        if op == ca.OP_ADD:
            left += given
        elif op in (ca.OP_MUL, ca.OP_SQ):
            found.append((given[0], given[-1]))
        else:
            return []
    return found


def _off_line(read: list[Instruction], r: int, y: int) -> tuple[int, int, int] | None:
    """(x, q, y) if r is x - q y."""
    op, given = read[r]
    if op != ca.OP_SUB or read[given[1]][0] != ca.OP_MUL:
        return None
    a, b = read[given[1]][1]
    return None if y not in (a, b) else (given[0], b if a == y else a, y)


def _sorted(pairs: list[tuple[int, int]]) -> list[tuple[int, int]]:
    return sorted((min(p), max(p)) for p in pairs)


def _rebuilt(f: ca.Function, symbols: list[ca.SX], read: list[Instruction]) -> list[ca.SX]:
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
        elif op == ca.OP_ASSIGN:
            made.append(made[given[0]])
        else:
            parts = [made[i] for i in given]
            made.append(ca.SX.unary(op, *parts) if len(parts) == 1 else ca.SX.binary(op, *parts))
    return results
