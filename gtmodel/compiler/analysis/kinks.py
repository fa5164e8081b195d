"""Operations whose jumps and kinks a derivative does not show: sign, absolute value, minimum, comparisons."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from ..flat import FlatModel

# CasADi takes the first or second derivative of these as zero wherever it exists
KINKED = frozenset(
    getattr(ca, f"OP_{name}")
    for name in (
        "SIGN", "FABS", "FLOOR", "CEIL", "FMIN", "FMAX", "FMOD", "REMAINDER", "COPYSIGN",
        "LT", "LE", "EQ", "NE", "NOT", "AND", "OR", "IF_ELSE_ZERO",
    )
)  # fmt: skip


def has_kinks(flat: FlatModel) -> bool:
    """True if some equation holds such an operation; most models have none, and all else here is then skipped."""
    if "kinks" not in flat.cache:
        column = ca.vertcat(*[e.residual for e in flat.equations]) if flat.equations else ca.SX(0, 1)
        f = ca.Function("equations", [ca.vertcat(*ca.symvar(column))], [column])
        flat.cache["kinks"] = any(f.instruction_id(k) in KINKED for k in range(f.n_instructions()))
    return flat.cache["kinks"]


def kinked_in(rows: Sequence[ca.SX], symbols: Sequence[ca.SX], only: frozenset[int] = KINKED) -> list[set[int]]:
    """For each row the places of the symbols that stand inside such an operation."""
    given = {s.element_hash(): n for n, s in enumerate(symbols)}
    column = ca.vertcat(*rows)
    free = ca.symvar(column)
    f = ca.Function("rows", [ca.vertcat(*free)], [column])
    inside: dict[int, frozenset[int]] = {}  # symbols that a place of the function's memory depends on
    within: dict[int, frozenset[int]] = {}  # those of them that went through a kink
    found: list[set[int]] = [set() for _ in rows]
    nothing: frozenset[int] = frozenset()
    nonzeros = column.sparsity().row()
    for k in range(f.n_instructions()):
        operation, into, out = f.instruction_id(k), f.instruction_output(k), f.instruction_input(k)
        if operation == ca.OP_OUTPUT:
            found[nonzeros[into[1]]] |= within.get(out[0], nothing)
            continue
        if operation == ca.OP_INPUT:
            n = given.get(free[out[1]].element_hash())
            depends, kinked = (frozenset() if n is None else frozenset([n])), nothing
        elif operation == ca.OP_CONST:
            depends = kinked = nothing
        else:
            depends = nothing.union(*[inside.get(i, nothing) for i in out])
            kinked = depends if operation in only else nothing.union(*[within.get(i, nothing) for i in out])
        inside[into[0]], within[into[0]] = depends, kinked
    return found
