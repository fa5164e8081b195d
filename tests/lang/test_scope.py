"""The symbols of many expressions, searched at once, are those of each one."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from gtmodel.lang.scope import Scope

UNARY = (ca.sin, ca.sqrt, ca.sign, ca.fabs, ca.floor, lambda x: x**2, lambda x: -x, lambda x: 0 * x)
BINARY = (
    lambda a, b: a + b,
    lambda a, b: a - b,
    lambda a, b: a * b,
    lambda a, b: a / b,
    lambda a, b: ca.if_else(a < b, a, 1.0),
    lambda a, b: ca.fmax(a, b),
    lambda a, b: ca.fmod(a, b),
)


def random_scalars(scope: Scope, rng: np.random.Generator, count: int) -> list[ca.SX]:
    """Expressions of variables, their derivatives, parameters, time and constants, which share parts."""
    variables = [scope.new_chain(f"x{n}") for n in range(5)]
    known = [*variables, *(scope.symbol(n, 2) for n in range(3)), scope.new_parameter("p"), scope.time, ca.SX(2.0)]
    for _ in range(count):
        a, b = (known[k] for k in rng.integers(len(known), size=2))
        known.append(
            UNARY[rng.integers(len(UNARY))](a) if rng.random() < 0.4 else BINARY[rng.integers(len(BINARY))](a, b)
        )
    return known


@pytest.mark.parametrize("seed", range(20))
def test_of_random_expressions(seed: int) -> None:
    scope = Scope()
    expressions = random_scalars(scope, np.random.default_rng(seed), 60)
    wanted = [scope._search(e) for e in expressions]
    assert any(wanted) and not all(wanted)
    assert scope.symbols_in_each(expressions) == wanted
    assert [scope.symbols_in(e) for e in expressions] == wanted  # as they were kept


def test_of_nothing_of_constants_of_columns_and_of_an_entry_that_is_always_zero() -> None:
    scope = Scope()
    x, v = scope.new_chain("x"), scope.new_chain("v")
    assert scope.symbols_in_each([]) == []
    assert scope.symbols_in_each([ca.SX(1.0), ca.SX(2.0)]) == [(), ()]
    column = ca.vertcat(x, v)
    assert scope.symbols_in_each([x, column, ca.SX(1, 1), x * v, x]) == [
        ((0, 0),),
        ((0, 0), (1, 0)),
        (),
        ((0, 0), (1, 0)),
        ((0, 0),),
    ]


@pytest.mark.parametrize("shape", ["scalar", "column", "twice", "with a parameter", "matrix"])
def test_the_derivative_of_symbols_is_what_the_chain_rule_gives(shape: str) -> None:
    scope = Scope()
    x, v, p = scope.new_chain("x"), scope.new_chain("v"), scope.new_parameter("p")
    entries = {"scalar": [x], "column": [x, v], "twice": [x, v, x], "with a parameter": [x, p], "matrix": [x, v]}[shape]
    column = ca.vertcat(*entries)
    if shape == "matrix":
        column = column.T
    symbols = ca.vertcat(x, v)
    rates = ca.vertcat(scope.symbol(0, 1), scope.symbol(1, 1))
    by_chain_rule, derivative = ca.jtimes(column, symbols, rates), scope.derivative(column)
    assert str(derivative) == str(by_chain_rule) and derivative.sparsity() == by_chain_rule.sparsity()
    keys = [[s.element_hash() for s in e.nonzeros()] for e in (derivative, by_chain_rule)]
    assert shape == "with a parameter" or keys[0] == keys[1]
    assert str(scope.derivative(scope.symbol(0, 1))) == "der(x,2)"
