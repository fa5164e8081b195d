"""Operations whose discontinuities and corners no derivative shows: sign, absolute value, minimum, comparisons."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from ..flat import FlatModel
from ..rewriting import of_expression

# CasADi takes the first or second derivative of these as zero wherever it exists
NONSMOOTH = frozenset(
    getattr(ca, f"OP_{name}")
    for name in (
        "SIGN", "FABS", "FLOOR", "CEIL", "FMIN", "FMAX", "FMOD", "REMAINDER", "COPYSIGN",
        "LT", "LE", "EQ", "NE", "NOT", "AND", "OR", "IF_ELSE_ZERO",
    )
)  # fmt: skip


def is_nonsmooth(flat: FlatModel) -> bool:
    """True if some equation holds such an operation; most models have none, and all else here is then skipped."""
    if "nonsmooth" not in flat.cache:
        column = ca.vertcat(*[e.residual for e in flat.equations]) if flat.equations else ca.SX(0, 1)
        flat.cache["nonsmooth"] = any(i.op in NONSMOOTH for i in of_expression(column)[0])
    return flat.cache["nonsmooth"]


def kinked_in(rows: Sequence[ca.SX], symbols: Sequence[ca.SX], only: frozenset[int] = NONSMOOTH) -> list[set[int]]:
    """For each row the places of the symbols that stand inside such an operation."""
    given = {s.element_hash(): n for n, s in enumerate(symbols)}
    column = ca.vertcat(*rows)
    read, free = of_expression(column)
    inside: list[frozenset[int]] = []  # symbols that an instruction depends on
    within: list[frozenset[int]] = []  # those of them that went through a nonsmooth operation
    by_row: list[set[int]] = [set() for _ in rows]
    nothing: frozenset[int] = frozenset()
    for op, reads, place, _ in read:
        depends, kinked = (nothing.union(*[of[i] for i in reads]) for of in (inside, within))
        if op == ca.OP_INPUT and (n := given.get(free[place].element_hash())) is not None:
            depends = frozenset([n])
        kinked = depends if op in only else kinked
        inside.append(depends)
        within.append(kinked)
        if op == ca.OP_OUTPUT:
            by_row[place] |= kinked
    return by_row
