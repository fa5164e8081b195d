"""A function mapped on columns gives the numbers of CasADi's virtual machine, bit for bit."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from gtmodel.compiler.columns.batch import MANY, Batch, mapped


def operations() -> ca.Function:
    """Most operations, results that are inputs, constants and twice the same, and an argument and a result of none."""
    x, y, none = ca.SX.sym("x", 3), ca.SX.sym("y"), ca.SX.sym("none", 0)
    a = ca.tanh(x[0]) / x[1] + ca.exp(-y) * ca.sqrt(x[2]) - 2 * x[0]
    b = ca.if_else(x[0] < x[1], ca.atan2(x[0], y), 1 / a) ** 2
    return ca.Function("f", [x, none, y], [ca.vertcat(a, x[1], 3.0, a, -0.0), ca.SX(0, 1), b * a])


@pytest.mark.parametrize("points", [MANY, 300, 513])
def test_columns_give_the_numbers_of_the_virtual_machine(points):
    f = operations()
    rng = np.random.default_rng(points)
    x, y = rng.uniform(-1.0, 2.0, (3, points)), rng.uniform(-1.0, 1.0, (1, points))
    x[:, 0] = np.nan  # and roots of what is negative
    fast = mapped(f, points)
    assert isinstance(fast, Batch)
    for _ in range(2):  # its memory is used again
        x = -x
        for a, b in zip(fast(x, ca.DM(0, points), y), f.map(points)(x, ca.DM(0, points), y), strict=True):
            assert a.shape == b.shape
            assert np.array_equal(a.full(), b.full(), equal_nan=True)
            assert np.array_equal(np.signbit(a.full()[:, 1:]), np.signbit(b.full()[:, 1:]))


def test_what_is_not_given_is_zero_and_what_is_not_asked_for_is_not_written():
    f = operations()
    fast, x = mapped(f, MANY), np.random.default_rng(0).uniform(0.1, 1.0, (3, MANY))
    assert isinstance(fast, Batch)
    outer = ca.Function("outer", [symbol := ca.MX.sym("x", 3, MANY)], [fast(symbol, ca.DM(0, MANY), 0)[2]])
    assert np.array_equal(outer(x).full(), f.map(MANY)(x, ca.DM(0, MANY), 0)[2].full(), equal_nan=True)


def test_few_points_and_operations_without_a_column_stay_with_the_virtual_machine():
    x = ca.SX.sym("x")
    assert not isinstance(mapped(operations(), MANY - 1), Batch)
    erf = mapped(ca.Function("erf", [x], [ca.erf(x)]), MANY)
    assert not isinstance(erf, Batch)
    assert float(erf(ca.DM.zeros(1, MANY))[0, -1]) == 0.0
