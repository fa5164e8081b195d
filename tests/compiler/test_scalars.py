"""Operations on scalars give what CasADi's operators give: the same element where it is kept, the same text."""

from __future__ import annotations

import operator
from itertools import product as pairs_of

import casadi as ca
import pytest

from gtmodel.compiler import matrices

X, Y = ca.SX.sym("x"), ca.SX.sym("y")
OPERANDS = [X, -X, 2 * X, X * Y, X**2, ca.SX(0), ca.SX(1), ca.SX(-1), ca.SX(2.5), ca.SX(1, 1)]


@pytest.mark.parametrize(
    ("ours", "casadis"),
    [
        (matrices.total, operator.add),
        (matrices.difference, operator.sub),
        (matrices.product, operator.mul),
        (matrices.quotient, operator.truediv),
    ],
)
def test_operations_are_casadis(ours, casadis) -> None:
    for a, b in pairs_of(OPERANDS, OPERANDS):
        expected, result = casadis(a, b), ours(a, b)
        assert str(result) == str(expected) and result.sparsity() == expected.sparsity()
        assert ca.is_equal(result, expected, 5)
