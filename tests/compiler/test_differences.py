"""x - (y + z) becomes (x - y) - z where, and only where, nothing is lost."""

import casadi as ca
import numpy as np
import pytest

from gtmodel.compiler.emission import with_differences

# both orders of summation round differently, by some units in the last place of the largest term
ROUND_OFF = 1e-14

x, y, z, v, L = (ca.SX.sym(name) for name in "xyzvL")


def operations(*expressions: ca.SX) -> int:
    return ca.Function("f", ca.symvar(ca.vertcat(*expressions)), list(expressions)).n_nodes()


def test_a_root_leaves_its_difference_once() -> None:
    T, A, d, rate = (ca.SX.sym(name, 3) for name in ("T", "A", "d", "rate"))
    start = T - A
    half, square = ca.dot(start, d), ca.dot(d, d)
    q = (half - ca.sqrt(half**2 - square * (ca.dot(start, start) - L**2))) / square
    before = ca.cse([q, ca.dot(T - (A + q * d), rate)])
    after = ca.cse(with_differences(before))
    assert operations(*after) == operations(*before) - 3
    given = [T, A, d, rate, L]
    old, new = (ca.Function("f", given, e) for e in (before, after))
    rng = np.random.default_rng(0)
    for _ in range(50):
        numbers = [rng.standard_normal(3) for _ in range(4)]
        numbers.append(np.full(1, 1.5 * float(np.linalg.norm(numbers[0] - numbers[1]))))
        for a, b in zip(old.call(numbers), new.call(numbers), strict=True):
            assert abs(float(a) - float(b)) < ROUND_OFF * max(1.0, abs(float(a))) * 100


@pytest.mark.parametrize("sign", [1, -1])
def test_the_slope_of_a_quadratic_is_its_root(sign: int) -> None:
    d, v = ca.SX.sym("d", 3), ca.SX.sym("v", 3)
    root = ca.sqrt(L)
    square = ca.dot(v, v)
    q = (ca.dot(v, d) + sign * root) / square
    slope = ca.dot(d - q * v, v)
    (after,) = with_differences(ca.cse([slope]))
    assert ca.is_equal(after, -sign * root, 5)
    f = ca.Function("f", [d, v, L], [slope, after])
    a, b = f(np.array([1.0, 2.0, -3.0]), np.array([0.3, -0.2, 0.9]), 0.7)
    assert abs(float(a) - float(b)) < 10 * ROUND_OFF
    # another vector, another factor, another divisor, a part that is missing: no slope
    w = ca.SX.sym("w", 3)
    for other in (
        ca.dot(d - q * w, v),
        ca.dot(d - q * v, w),
        ca.dot(d - ca.sin(q) * v, v),
        ca.dot(d - (ca.dot(v, d) + sign * root) / ca.dot(w, w) * v, v),
        ca.dot(d - (ca.dot(v, w) + sign * root) / square * v, v),
        ca.dot((d - q * v)[:2], v[:2]),
    ):
        (kept,) = with_differences(ca.cse([other]))
        assert operations(kept) == operations(*ca.cse([other]))


def test_where_the_last_term_knows_nothing_of_the_difference_it_stays() -> None:
    # y = 1e10, z = -1e10: x - (y + z) is exact, (x - y) - z loses six digits
    for e in ([x - y, x - (y + z)], [x - (y + z)], [x - y, x - (y + v * ca.sin(z))]):
        assert all(ca.is_equal(a, b, 20) for a, b in zip(with_differences(ca.cse(e)), ca.cse(e), strict=True))


def test_a_sum_that_is_needed_stays() -> None:
    d = x - y
    total = y + ca.sin(d)
    before = ca.cse([total, x - total])
    assert all(ca.is_equal(a, b, 20) for a, b in zip(with_differences(before), before, strict=True))
    (after,) = with_differences(ca.cse([x - (ca.sin(d) + y)]))
    assert operations(after) == operations(d - ca.sin(d))


def test_shapes_constants_and_random_expressions() -> None:
    from tests.compiler.test_factors import grown

    matrix = ca.SX(ca.Sparsity.upper(2))
    matrix[0, 1] = x - (y + ca.sin(x - y))
    for e in (matrix, ca.SX(3), ca.SX(0, 1), ca.SX(2, 2)):
        (found,) = with_differences([e])
        assert found.sparsity() == e.sparsity()
    rewritten = 0
    for seed in range(60):
        rng = np.random.default_rng(seed)
        s = ca.SX.sym("s", 3)
        before = grown(rng, ca.vertsplit(s), 25)
        # what the pass is for, with an unknown that was computed from anything
        d = before[0] - before[1]
        before = ca.cse([*before, before[0] - (before[1] + ca.sin(d)), ca.sin(d) - (before[2] + d)])
        after = with_differences(before)
        rewritten += operations(*after) < operations(*before)
        f, g = (ca.Function("f", [s], [ca.vertcat(*e)]) for e in (before, after))
        points = rng.uniform(-3.0, 3.0, (3, 20))
        a, b = (np.array(h(points).full()) for h in (f, g))
        largest = max(1.0, *(abs(float(k)) for k in np.nan_to_num(a, posinf=0, neginf=0).ravel()))
        good = np.isfinite(a) & np.isfinite(b)
        assert np.all(np.abs(a[good] - b[good]) <= 1e4 * ROUND_OFF * largest)
    assert rewritten > 20
