"""Factors of +-2^k leave sums and products without a trace in the numbers."""

import casadi as ca
import numpy as np
import pytest

from gtmodel.compiler.emission import without_factors

UNARY = (
    lambda x: -x,
    lambda x: 2 * x,
    lambda x: x * x,
    ca.fabs,
    lambda x: ca.sqrt(ca.fabs(x)),
    ca.sin,
    lambda x: x / 4,
)
BINARY = (
    lambda x, y: x + y,
    lambda x, y: x - y,
    lambda x, y: x * y,
    lambda x, y: x / y,
    ca.fmin,
    lambda x, y: x - 2 * y,
)
CONSTANTS = (2.0, -0.5, 1.0, 3.7, -4.0, 0.0)


def grown(rng: np.random.Generator, symbols: list[ca.SX], steps: int) -> list[ca.SX]:
    """Random expressions, each of earlier ones."""
    found = [*symbols, *map(ca.SX, CONSTANTS)]
    for _ in range(steps):
        a, b = (found[k] for k in rng.integers(len(found), size=2))
        if rng.random() < 0.4:
            found.append(UNARY[rng.integers(len(UNARY))](a))
        else:
            found.append(BINARY[rng.integers(len(BINARY))](a, b))
    return found[-8:]


@pytest.mark.parametrize("seed", range(30))
def test_the_same_numbers_to_the_last_bit(seed: int) -> None:
    rng = np.random.default_rng(seed)
    x = ca.SX.sym("x", 4)
    results = grown(rng, ca.vertsplit(x), 30)
    rewritten = without_factors(results)
    f, g = (ca.Function("f", [x], [ca.vertcat(*e)]) for e in (results, ca.cse(rewritten)))
    points = rng.uniform(-3.0, 3.0, (4, 50))
    a, b = (np.array(h(points).full()) for h in (f, g))
    # elsewhere a factor of two decides what overflows or turns denormal
    judged = ((np.abs(a) < 1e100) & (np.abs(a) > 1e-100)) | (a == 0)
    assert judged.sum() > 20 and np.array_equal(a[judged], b[judged])


def test_second_derivatives_and_half_coefficients() -> None:
    x, a, v, L, q = (ca.SX.sym(n, k) for n, k in (("x", 3), ("a", 3), ("v", 3), ("L", 1), ("q", 1)))
    d = x - a - q * v
    residual = ca.dot(d, d) - L**2
    slope = ca.gradient(residual, q)
    half, square = (ca.substitute(e, q, ca.SX(0)) for e in (slope / 2, ca.gradient(slope, q) / 2))
    given = [x, a, v, L]
    before, after = (
        ca.Function("f", given, e) for e in (ca.cse([half, square]), ca.cse(without_factors([half, square])))
    )
    assert (before.n_nodes(), after.n_nodes()) >= (20, 20) and after.n_nodes() <= before.n_nodes() - 6
    rng = np.random.default_rng(1)
    numbers = [rng.standard_normal(s.shape) for s in given]
    for old, new in zip(before.call(numbers), after.call(numbers), strict=True):
        assert float(old) == float(new)


def test_shapes_and_constants_stay() -> None:
    x = ca.SX.sym("x")
    matrix = ca.SX(ca.Sparsity.upper(2))
    matrix[0, 1] = -(2 * x)
    for e in (matrix, ca.SX(3), ca.SX(0, 1), ca.SX(2, 2)):
        (found,) = without_factors([e])
        assert found.sparsity() == e.sparsity()
    found = without_factors([matrix, ca.SX(5.0)])
    assert float(ca.substitute(found[0], x, ca.SX(3.0))[0, 1]) == -6.0 and float(found[1]) == 5.0
