"""Quantities along a path as sums of few terms, whose coefficients depend on the place alone.

Inverse dynamics along x(s) are linear in s'' and quadratic in s', but for friction; written out they are thousands of
operations on poses, speeds and accelerations. Multiplied out in s', s'^2 and s'' they are a few products at each node
with coefficients that are computed once.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from ..compiler.rewriting import of_expression
from ..compiler.tape.function import written
from ..compiler.tape.operations import Tape

Terms = dict[tuple[int, ...], int]  # product of variables, by their numbers in increasing order -> its coefficient
MOST_FACTORS, MOST_TERMS = 4, 12  # of a product that is multiplied out


class _Collected:
    """Operations as sums of terms. Coefficients stand on a tape of their own; on the tape `rows`, whose inputs are the
    variables and then symbols for these coefficients, stands what is no such sum."""

    def __init__(self, variables: int) -> None:
        self.rows, self.coefficients = Tape(), Tape()
        self._inputs = variables
        self.variables = [self.rows.input(n) for n in range(variables)]
        self.places: dict[int, int] = {}  # of the coefficients that have a symbol: among the inputs of `rows`

    def operation(self, op: int, given: Sequence[Terms]) -> Terms:
        own, first, last = self.coefficients, given[0], given[-1]
        if all(_fixed(form) for form in given):
            return {(): own.applied(op, *[self._constant(form) for form in given])}
        if op in (ca.OP_ADD, ca.OP_SUB):
            return self._sum(first, last if op == ca.OP_ADD else self._scaled(last, -1.0))
        if op in (ca.OP_NEG, ca.OP_TWICE):
            return self._scaled(first, -1.0 if op == ca.OP_NEG else 2.0)
        if op == ca.OP_DIV and _fixed(last):
            divisor = self._constant(last)
            return {factors: own.applied(op, value, divisor) for factors, value in first.items()}
        if op in (ca.OP_MUL, ca.OP_SQ) and (product := self._product(first, last)) is not None:
            return product
        self.variables.append(self.rows.applied(op, *[self.whole(form) for form in given]))
        return {(len(self.variables) - 1,): own.constant(1.0)}

    def whole(self, form: Terms) -> int:
        """The sum on the tape `rows`."""
        total = self.rows.constant(0.0)
        for factors, value in form.items():
            term = self._symbol(value)
            for n in factors:
                term = self.rows.product(term, self.variables[n])
            total = self.rows.total(total, term)
        return total

    def _symbol(self, value: int) -> int:
        if value in self.coefficients.constants:
            return self.rows.constant(self.coefficients.constants[value])
        return self.rows.input(self.places.setdefault(value, self._inputs + len(self.places)))

    def _constant(self, form: Terms) -> int:
        return form.get((), self.coefficients.constant(0.0))

    def _scaled(self, form: Terms, factor: float) -> Terms:
        own = self.coefficients
        return {factors: own.product(own.constant(factor), value) for factors, value in form.items()}

    def _sum(self, first: Terms, last: Terms) -> Terms:
        total, own = dict(first), self.coefficients
        for factors, value in last.items():
            total[factors] = own.total(total[factors], value) if factors in total else value
        return {factors: value for factors, value in total.items() if own.constants.get(value) != 0.0}

    def _product(self, first: Terms, last: Terms) -> Terms | None:
        """None where it would be long."""
        if len(first) * len(last) > MOST_TERMS:
            return None
        product: Terms = {}
        for a, x in first.items():
            for b, y in last.items():
                factors = tuple(sorted(a + b))
                if len(factors) > MOST_FACTORS:
                    return None
                product = self._sum(product, {factors: self.coefficients.product(x, y)})
        return product


def collected(expression: ca.SX, variables: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """A column of expressions in the variables and in symbols, the symbols, and what these are: functions of all that
    the expressions hold besides the variables."""
    read, symbols = of_expression(expression)
    numbers = {v.element_hash(): n for n, v in enumerate(ca.vertsplit(variables))}
    forms = _Collected(len(numbers))
    made: list[Terms] = []
    results: dict[int, int] = {}
    for op, reads, place, constant in read:
        if op == ca.OP_INPUT:
            number = numbers.get(symbols[place].element_hash())
            made.append(
                {(): forms.coefficients.input(place)}
                if number is None
                else {(number,): forms.coefficients.constant(1.0)}
            )
        elif op == ca.OP_CONST:
            made.append({(): forms.coefficients.constant(constant)})
        elif op == ca.OP_OUTPUT:
            results[place] = forms.whole(made[reads[0]])
            made.append(made[reads[0]])
        else:
            made.append(forms.operation(op, [made[i] for i in reads]))
    own = ca.SX.sym("c", len(forms.places))
    rows = written(forms.rows, [results[place] for place in sorted(results)], ca.vertcat(variables, own))
    return rows, own, written(forms.coefficients, list(forms.places), ca.vertcat(ca.SX(0, 1), *symbols))


def _fixed(form: Terms) -> bool:
    return not any(form)
