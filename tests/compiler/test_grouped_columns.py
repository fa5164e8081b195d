"""Functions on many columns, several of them in one call: the same numbers to the bit."""

import casadi as ca
import numpy as np
import pytest

from gtmodel.compiler import rows
from gtmodel.compiler.columns.kernel import FEWEST
from gtmodel.compiler.rows import BLOCK, GROUP, SMALL, map_columns


def length_and_derivatives(operations: int) -> ca.Function:
    d, x = ca.SX.sym("d", 2), ca.SX.sym("x", 3)
    r = ca.sqrt(ca.dot(d, d) + x[0] ** 2) - x[1] * ca.sin(x[2])
    for _ in range(operations):
        r = ca.cos(r) + x[0]
    return ca.Function("f", [d, x], [r, ca.densify(ca.jacobian(r, x))])


@pytest.mark.parametrize("operations", [0, SMALL])
@pytest.mark.parametrize("n", [1, GROUP - 1, GROUP, GROUP + 1, BLOCK, 2 * BLOCK + 3 * GROUP + 5])
def test_kept_functions_give_the_same_numbers(n, operations, monkeypatch):
    monkeypatch.setattr(rows, "kernel_of", lambda f, n: None)  # tests/compiler/test_column_kernels.py has those
    f = length_and_derivatives(operations)
    rng = np.random.default_rng(n)
    columns = [rng.standard_normal((2, n)), rng.standard_normal((3, n))]
    made: dict[int, ca.Function] = {}
    once, again, plain = map_columns(f, columns, made), map_columns(f, columns, made), map_columns(f, columns)
    assert all(np.array_equal(a, b) and np.array_equal(a, c) for a, b, c in zip(once, again, plain, strict=True))
    alone = [np.array(f(*[c[:, -1] for c in columns])[k]).reshape(-1, order="F") for k in range(2)]
    assert np.array_equal(alone[0], once[0][:, -1]) and np.array_equal(alone[1], once[1][0, -3:])
    whole = {BLOCK, 3 * GROUP, 5} if n > BLOCK else {n}
    assert set(made) == (whole if n >= FEWEST else set())  # fewer rows have memory of their own
