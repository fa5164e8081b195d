"""Quantities along a path as sums of few terms, whose coefficients depend on the place alone.

Inverse dynamics along x(s) are linear in s'' and quadratic in s', but for friction; written out they are thousands of
operations on poses, speeds and accelerations. Multiplied out in s', s'^2 and s'' they are a few products at each node
with coefficients that are computed once.
"""

from __future__ import annotations

import casadi as ca

from ..compiler.rewriting import applied, instructions, walked

Terms = dict[tuple[int, ...], ca.SX]  # product of variables, by their numbers in increasing order -> its coefficient
MOST_FACTORS, MOST_TERMS = 4, 12  # of a product that is multiplied out


class _Collected:
    """Writes instructions as sums of terms: see `compiler.rewriting.walked`."""

    def __init__(self, variables: ca.SX) -> None:
        self.variables = ca.vertsplit(variables)
        self.numbers = {v.element_hash(): n for n, v in enumerate(self.variables)}
        self.symbols: list[ca.SX] = []
        self.coefficients: list[ca.SX] = []
        self.known: dict[int, ca.SX] = {}

    def leaf(self, x: ca.SX) -> Terms:
        number = self.numbers.get(x.element_hash()) if x.is_symbolic() else None
        return {(): x} if number is None else {(number,): ca.SX(1)}

    def operation(self, k: int, op: int, given: list[Terms]) -> Terms:
        if all(_fixed(form) for form in given):
            return {(): applied(op, [form.get((), ca.SX(0)) for form in given])}
        first, last = given[0], given[-1]
        if op in (ca.OP_ADD, ca.OP_SUB):
            return _sum(first, last if op == ca.OP_ADD else _scaled(last, -1.0))
        if op in (ca.OP_NEG, ca.OP_TWICE):
            return _scaled(first, -1.0 if op == ca.OP_NEG else 2.0)
        if op == ca.OP_DIV and _fixed(last):
            return {factors: value / last.get((), ca.SX(0)) for factors, value in first.items()}
        if op in (ca.OP_MUL, ca.OP_SQ) and (product := _product(first, last)) is not None:
            return product
        self.variables.append(applied(op, [self.whole(form) for form in given]))
        return {(len(self.variables) - 1,): ca.SX(1)}

    def whole(self, form: Terms) -> ca.SX:
        """The sum, its coefficients as symbols."""
        total = ca.SX(0)
        for factors, value in form.items():
            term = self._symbol(value)
            for n in factors:
                term = term * self.variables[n]
            total = total + term
        return total

    def _symbol(self, value: ca.SX) -> ca.SX:
        if value.is_constant():
            return value
        if value.element_hash() not in self.known:
            self.known[value.element_hash()] = symbol = ca.SX.sym(f"c{len(self.symbols)}")
            self.symbols.append(symbol)
            self.coefficients.append(value)
        return self.known[value.element_hash()]


def collected(expression: ca.SX, variables: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """A column of expressions in the variables and in symbols, the symbols, and what these are: functions of all that
    the expressions hold besides the variables."""
    symbols = ca.symvar(expression)
    read = instructions(ca.Function("f", [ca.vertcat(*symbols)], [ca.densify(expression)], {"cse": True}))
    forms = _Collected(variables)
    rows = ca.vertcat(ca.SX(0, 1), *walked(read, symbols, forms))
    return rows, ca.vertcat(ca.SX(0, 1), *forms.symbols), ca.vertcat(ca.SX(0, 1), *forms.coefficients)


def _fixed(form: Terms) -> bool:
    return not any(form)


def _scaled(form: Terms, factor: float) -> Terms:
    return {factors: factor * value for factors, value in form.items()}


def _sum(first: Terms, last: Terms) -> Terms:
    total = dict(first)
    for factors, value in last.items():
        total[factors] = total[factors] + value if factors in total else value
    return {factors: value for factors, value in total.items() if not value.is_zero()}


def _product(first: Terms, last: Terms) -> Terms | None:
    """None where it would be long."""
    if len(first) * len(last) > MOST_TERMS:
        return None
    product: Terms = {}
    for a, x in first.items():
        for b, y in last.items():
            factors = tuple(sorted(a + b))
            if len(factors) > MOST_FACTORS:
                return None
            product = _sum(product, {factors: x * y})
    return product
