"""Alias elimination: removes equations A^(i) = +-B^(j); a removed variable can still be a target."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import casadi as ca

from ..lang.source import ModelError
from .flat import FlatEquation, FlatModel
from .matrices import triplets
from .rewriting import is_nonsmooth, kinked_in

Terms = tuple[tuple[tuple[int, int], float], tuple[tuple[int, int], float]]  # (symbol, coefficient), twice


@dataclass(frozen=True)
class Alias:
    """removed^(k) = sign * kept^(order + k)."""

    sign: int
    kept: int
    order: int


@dataclass
class AliasResult:
    """The remaining equations, and the alias of every removed variable."""

    equations: list[FlatEquation]
    removed: dict[int, Alias]
    names: Any = None  # cache: names of all variables by the quantity that they stand for

    def resolve(self, index: int, order: int) -> tuple[int, int, int]:
        """Return (sign, kept index, derivative order) of derivative `order` of variable `index`."""
        sign = 1
        while index in self.removed:
            a = self.removed[index]
            sign, index, order = sign * a.sign, a.kept, order + a.order
        return sign, index, order

    def declared_names(self, flat: FlatModel) -> dict[tuple[int, int], str]:
        """Return the names of derivatives that are declared as variables, by (kept index, order).

        A variable inside a part does not name the derivative of a variable at a higher level.
        """
        names: dict[tuple[int, int], str] = {}
        for index in sorted(self.removed):
            sign, kept, order = self.resolve(index, 0)
            name = flat.variables[index].name
            if sign > 0 and order and name.count(".") <= flat.variables[kept].name.count("."):
                names.setdefault((kept, order), name)
        return names

    def rewrite(self, flat: FlatModel, expression: ca.SX) -> ca.SX:
        """Rewrite an expression of the original variables in terms of the kept ones."""
        return self.rewrite_all(flat, [expression])[0]

    def rewrite_all(self, flat: FlatModel, expressions: list[ca.SX]) -> list[ca.SX]:
        """Rewrite several expressions with one substitution."""
        old, new = [], []
        for index, order in flat.scope.symbols_in(ca.veccat(*expressions)) if expressions else ():
            if index in self.removed:
                sign, kept, k = self.resolve(index, order)
                symbol = flat.scope.symbol(kept, k)
                old.append(flat.scope.symbol(index, order))
                new.append(symbol if sign > 0 else -symbol)
        if not old:
            return expressions
        return ca.substitute(expressions, [ca.vertcat(*old)], [ca.vertcat(*new)])


def eliminate(flat: FlatModel, protected: frozenset[int], apart: frozenset[int] = frozenset()) -> AliasResult:
    """Remove aliases until none is left; the result is cached.

    protected: variables that are never removed. apart: variables whose equations are left out. Only a variable of order
    0 is removed (v == der(r) removes v); A' == B' removes nothing, because the integration constant is free. Raises
    ModelError if aliases of the same quantity have different fixed start values.
    """
    key = "aliases", protected, apart
    if key not in flat.cache:
        flat.cache[key] = _eliminated(flat, protected, apart)
    return flat.cache[key]


def _eliminated(flat: FlatModel, protected: frozenset[int], apart: frozenset[int]) -> AliasResult:
    if "sums" not in flat.cache:  # shared by all causalities
        flat.cache["sums"] = _sums(flat, flat.equations)
    rows = [
        n
        for n, e in enumerate(flat.equations)
        if not apart or apart.isdisjoint(i for i, _ in flat.scope.symbols_in(e.residual))
    ]
    result, sums = AliasResult([flat.equations[n] for n in rows], {}), [flat.cache["sums"][n] for n in rows]
    while _sweep(flat, protected, result, sums):
        pass
    _check_starts(flat, result)
    return result


def _sums(flat: FlatModel, equations: list[FlatEquation]) -> list[Terms | None]:
    """Return the terms of each equation that is a sum of two symbols with constant coefficients; None for others."""
    scope = flat.scope
    sums: list[Terms | None] = [None] * len(equations)
    inside = scope.symbols_in_each([e.residual for e in equations])
    of_two = [n for n, pairs in enumerate(inside) if len(pairs) == 2]
    if not of_two:
        return sums
    pairs = sorted({pair for n in of_two for pair in inside[n]})
    symbols = ca.vertcat(*[scope.symbol(*pair) for pair in pairs])
    residuals = ca.vertcat(*[equations[n].residual for n in of_two])
    remainder = ca.substitute([residuals], [symbols], [ca.DM.zeros(len(pairs), 1)])[0]
    rows: list[list[tuple[tuple[int, int], ca.SX]]] = [[] for _ in of_two]
    for row, col, value in triplets(ca.jacobian(residuals, symbols)):
        if not value.is_zero():
            rows[row].append((pairs[col], value))
    for row, (n, entries) in enumerate(zip(of_two, rows, strict=True)):
        if len(entries) == 2 and all(v.is_constant() for _, v in entries) and remainder[row].is_zero():
            (a, va), (b, vb) = entries
            sums[n] = (a, float(va)), (b, float(vb))
    candidates = [n for n in of_two if sums[n] is not None]
    # sign() vanishes at zero and has no derivative: an equation with sign() only looks like x == y
    if candidates and is_nonsmooth(flat):
        kinked = kinked_in([equations[n].residual for n in candidates], ca.vertsplit(symbols))
        for n, positions in zip(candidates, kinked, strict=True):
            if positions:
                sums[n] = None
    return sums


def _sweep(flat: FlatModel, protected: frozenset[int], result: AliasResult, sums: list[Terms | None]) -> bool:
    """Do one sweep of eliminations; `sums` holds the terms of each equation and is updated too."""
    removed: dict[int, Alias] = {}
    kept: set[int] = set()
    drop: set[int] = set()
    for row, terms in enumerate(sums):
        if terms is None:
            continue
        (a, va), (b, vb) = terms
        if a[0] == b[0] or abs(va) != abs(vb):
            continue
        sign = -1 if va == vb else 1
        choice = _choose(flat, protected, a, b)
        for old, new in choice:
            if old[0] in removed or old[0] in kept or new[0] in removed:
                continue
            removed[old[0]] = Alias(sign, new[0], new[1])
            kept.add(new[0])
            drop.add(row)
            break
    if not removed:
        return False
    result.removed.update(removed)
    rows_left = [i for i in range(len(result.equations)) if i not in drop]
    equations = [result.equations[i] for i in rows_left]
    sums[:] = [sums[i] for i in rows_left]
    changed = [n for n, e in enumerate(equations) if any(j in removed for j, _ in flat.scope.symbols_in(e.residual))]
    residuals = result.rewrite_all(flat, [equations[n].residual for n in changed])
    for n, residual, inside in zip(changed, residuals, flat.scope.symbols_in_each(residuals), strict=True):
        equations[n] = replace(equations[n], residual=residual)
        if not inside:
            raise ModelError(_empty_equation(flat, equations[n]), equations[n].where)
    for n, terms in zip(changed, _sums(flat, [equations[n] for n in changed]), strict=True):
        sums[n] = terms
    result.equations = equations
    return True


def _empty_equation(flat: FlatModel, equation: FlatEquation) -> str:
    """Return the message for an equation without any variable left: redundant, or a contradiction."""
    residual = ca.Function("residual", [flat.p, flat.scope.time], [equation.residual])
    values = [float(residual(flat.p0, time)) for time in (0.0, 1.0)]
    if any(abs(value) > 0.0 for value in values):
        relation = f"{values[0]:.6g} == 0" if values[0] == values[1] else "that a function of time is zero"
        return (
            f"'{equation.label}' contradicts the connections and other equations: together they require {relation}; "
            "remove one of them, or insert a part between the connected ports"
        )
    original = next(e for e in flat.equations if (e.label, e.where) == (equation.label, equation.where))
    if all(flat.variables[i].role == "flow" for i, _ in flat.scope.symbols_in(original.residual)):
        return (
            f"'{equation.label}' follows from the other connections: the connected ports have no reference; connect a "
            "ground, or another part that fixes the potential"
        )
    return f"'{equation.label}' is redundant: it follows from connections and other equations; remove it"


def _choose(
    flat: FlatModel, protected: frozenset[int], a: tuple[int, int], b: tuple[int, int]
) -> list[tuple[tuple[int, int], tuple[int, int]]]:
    """Return candidates (removed, kept), best first: a low state preference, deep path or long name is removed."""
    candidates = [(x, y) for x, y in ((a, b), (b, a)) if x[1] == 0 and x[0] not in protected]

    def rank(pair: tuple[tuple[int, int], tuple[int, int]]) -> tuple[int, int, int, str]:
        v = flat.variables[pair[0][0]]
        return (v.prefer, -v.name.count("."), -len(v.name), v.name)

    return sorted(candidates, key=rank)


def _check_starts(flat: FlatModel, result: AliasResult) -> None:
    starts: dict[tuple[int, int], tuple[float, int]] = {}
    for v in flat.variables:
        if v.start is None or not v.fixed:
            continue
        sign, kept, order = result.resolve(v.index, 0)
        value = sign * v.start
        if (kept, order) in starts and starts[(kept, order)][0] != value:
            other = flat.variables[starts[(kept, order)][1]]
            raise ModelError(
                f"'{v.name}' starts at {v.start:g} ({v.where}) and '{other.name}' at {other.start:g} "
                f"({other.where}), but they are the same quantity; set only one of them"
            )
        starts.setdefault((kept, order), (value, v.index))
