"""The equations of a causality with the derivatives that they imply, stage by stage."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from .flat import FlatEquation, FlatModel
from .structure import EquationStructure

Pair = tuple[int, int]


def differentiate(flat: FlatModel, structure: EquationStructure) -> list[list[ca.SX]]:
    """derivatives[i][m] = m-th time derivative of equation i, m = 0..c_i, all equations of one order at once."""
    result = [[e.residual] for e in structure.equations]
    for m in range(int(structure.c.max(initial=0))):
        rows = [i for i in range(len(result)) if structure.c[i] > m]
        rates = flat.scope.derivative(ca.vertcat(*[result[i][m] for i in rows]))
        for n, i in enumerate(rows):
            half = _half(rates[n], {})
            result[i].append(rates[n] if half is None else half)
    return result


def _half(e: ca.SX, known: dict[int, ca.SX | None], depth: int = 50) -> ca.SX | None:
    """e/2 where every term has a factor two, as the derivatives of squares have; None otherwise.

    known: answers by element; depth: how far down it looks, against sums as long as Python's stack.
    """
    key = e.element_hash()
    if key not in known:
        known[key] = _halved(e, known, depth)
    return known[key]


def _halved(e: ca.SX, known: dict[int, ca.SX | None], depth: int) -> ca.SX | None:
    if e.is_zero():
        return e
    if depth == 0 or e.is_constant() or e.is_symbolic():
        return None
    op = e.op()
    if op == ca.OP_TWICE:
        return e.dep(0)
    if op == ca.OP_NEG:
        a = _half(e.dep(0), known, depth - 1)
        return None if a is None else -a
    if op in (ca.OP_ADD, ca.OP_SUB):
        a = _half(e.dep(0), known, depth - 1)
        b = None if a is None else _half(e.dep(1), known, depth - 1)
        return None if a is None or b is None else a + b if op == ca.OP_ADD else a - b
    if op == ca.OP_MUL:
        for one, other in ((e.dep(0), e.dep(1)), (e.dep(1), e.dep(0))):
            a = _half(one, known, depth - 1)
            if a is not None:
                return a * other
    return None


def folded(flat: FlatModel, derivatives: list[list[ca.SX]], fold: ca.SX) -> list[list[ca.SX]]:
    if not flat.parameters:
        return derivatives
    everything = ca.substitute([e for chain in derivatives for e in chain], [flat.p], [fold])
    flatten = iter(everything)
    return [[next(flatten) for _ in chain] for chain in derivatives]


def condition_order(flat: FlatModel, conditions: Sequence[FlatEquation], pairs: Sequence[Pair]) -> int:
    """How often conditions on known values are differentiated, as often as these occur; -1 without any."""
    highest = dict(sorted(pairs))
    return max((highest.get(i, 0) for e in conditions for i, _ in flat.scope.symbols_in(e.residual)), default=-1)


def _with_conditions(
    flat: FlatModel, stages: list[ca.SX], conditions: list[FlatEquation], pairs: list[Pair]
) -> list[ca.SX]:
    """Stage residuals with the conditions on known values, differentiated as often as these occur."""
    if not conditions:
        return stages
    residual = ca.vertcat(*[e.residual for e in conditions])
    top = condition_order(flat, conditions, pairs)
    stages = [*stages, *[ca.SX(0, 1)] * max(0, top + 1 - len(stages))]
    for m in range(top + 1):
        stages[m] = ca.vertcat(stages[m], residual)
        residual = flat.scope.derivative(residual)
    return stages


def stage_residuals(
    flat: FlatModel,
    structure: EquationStructure,
    derivatives: list[list[ca.SX]],
    conditions: list[FlatEquation],
    pairs: list[Pair],
) -> list[ca.SX]:
    """Residuals of each stage, positions first; with the conditions on known values."""
    c = structure.c
    stages = [
        ca.vertcat(*[derivatives[i][c[i] + k] for i in range(len(c)) if c[i] + k >= 0])
        for k in range(-int(structure.d.max(initial=0)), 1)
    ]
    return [r for r in _with_conditions(flat, stages, conditions, pairs) if r.numel()]


def pairs_of(
    flat: FlatModel,
    derivatives: list[list[ca.SX]],
    structure: EquationStructure,
    conditions: list[FlatEquation],
    wanted: Sequence[Pair],
) -> list[Pair]:
    inside = flat.scope.symbols_in_each([e for chain in derivatives for e in chain])
    pairs = {p for each in inside for p in each}
    pairs |= {(j, m) for n, j in enumerate(structure.unknowns) for m in range(int(structure.d[n]) + 1)}
    pairs |= {p for e in conditions for p in flat.scope.symbols_in(e.residual)}
    return sorted(pairs | set(wanted))


def system_of(flat: FlatModel, structure: EquationStructure, derivatives: list[list[ca.SX]]) -> ca.SX:
    """d f_i^(c_i) / d x_j^(d_j)."""
    # SX also where nothing is left but aliases
    top = ca.SX(ca.vertcat(*[derivatives[i][structure.c[i]] for i in range(len(structure.c))]))
    columns = ca.SX(ca.vertcat(*[flat.scope.symbol(j, int(structure.d[n])) for n, j in enumerate(structure.unknowns)]))
    return ca.jacobian(top, columns)
