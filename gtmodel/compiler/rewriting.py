"""Expressions instruction by instruction: reading them, writing them anew, and operations whose discontinuities no
derivative shows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol, TypeVar

import casadi as ca

from .flat import FlatModel
from .matrices import stacked

LARGEST = 50_000  # operations; beyond, the time of a pass would be noticed


class Instruction(NamedTuple):
    """An operation, the numbers of the instructions that it reads, the entry of an input or output, and the value of a
    constant."""

    op: int
    reads: Sequence[int] = ()
    place: int = -1
    constant: float = 0.0


# the outputs, in symbols of the inputs; None to leave everything as it is
Rewrite = Callable[[list[Instruction], list[ca.SX]], list[ca.SX] | None]

Form = TypeVar("Form")  # how a pass writes down what an instruction gives


class Forms(Protocol[Form]):
    """What a pass makes of instructions: leaves are inputs and constants."""

    def leaf(self, x: ca.SX) -> Form: ...

    def operation(self, k: int, op: int, given: list[Form]) -> Form:
        """Of instruction `k`, with operation code `op`."""
        ...

    def whole(self, form: Form) -> ca.SX: ...


def instructions(f: ca.Function) -> list[Instruction]:
    """Of a function of one column, by what they read: places of the work vector are used again and again."""
    written: dict[int, int] = {}
    read: list[Instruction] = []
    for k in range(f.n_instructions()):
        op, given, put = f.instruction_id(k), f.instruction_input(k), f.instruction_output(k)
        if op == ca.OP_INPUT:
            read.append(Instruction(op, place=given[1]))
        elif op == ca.OP_CONST:
            read.append(Instruction(op, constant=float(f.instruction_constant(k))))
        else:
            reads = [written[i] for i in given]
            read.append(Instruction(op, reads, put[1]) if op == ca.OP_OUTPUT else Instruction(op, reads))
        if op != ca.OP_OUTPUT:
            written[put[0]] = k
    return read


def of_expression(expression: ca.SX) -> tuple[list[Instruction], list[ca.SX]]:
    """Its instructions, and the symbols that they take in."""
    symbols = ca.symvar(expression)
    column = ca.vertcat(*symbols) if symbols else ca.SX(0, 1)
    return instructions(ca.Function("f", [column], [ca.densify(expression)])), symbols


def walked(read: Sequence[Instruction], symbols: Sequence[ca.SX], forms: Forms[Form]) -> list[ca.SX]:
    """The outputs, one by one, in these symbols, each instruction written as `forms` makes it."""
    made: list[Form] = []
    results: dict[int, ca.SX] = {}
    for k, (op, reads, place, constant) in enumerate(read):
        if op == ca.OP_OUTPUT:
            results[place] = forms.whole(made[reads[0]])
            made.append(made[reads[0]])
        elif op in (ca.OP_INPUT, ca.OP_CONST):
            made.append(forms.leaf(symbols[place] if op == ca.OP_INPUT else ca.SX(constant)))
        else:
            made.append(forms.operation(k, op, [made[i] for i in reads]))
    return [results[place] for place in sorted(results)]


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
    made = rewrite(instructions(f), symbols) if f.n_instructions() <= LARGEST else None
    if made is None:
        return list(expressions)
    results = iter(made)
    return [
        ca.SX(e.sparsity(), stacked([next(results) for _ in range(e.nnz())])) if e.nnz() else e for e in expressions
    ]


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
