"""Every interval operation against exact arithmetic: sampling a whole function sees no unit in the last place."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest
from mpmath import mpf

from gtmodel.certify.intervals import OPERATIONS, Interval, outward
from gtmodel.certify.regularity import upper_norm
from gtmodel.certify.rounding import DOUBLE, FLOAT, error
from tests.certify.exact import OPERATIONS as EXACT

POINTS = 120
NAMES = {getattr(ca, n): n for n in dir(ca) if n.startswith("OP_")}
ALGEBRAIC = [ca.OP_ADD, ca.OP_SUB, ca.OP_MUL, ca.OP_DIV, ca.OP_SQ, ca.OP_INV, ca.OP_SQRT]
TWO = {ca.OP_ADD, ca.OP_SUB, ca.OP_MUL, ca.OP_DIV, ca.OP_ATAN2, ca.OP_POW, ca.OP_CONSTPOW, ca.OP_FMIN, ca.OP_FMAX,
       ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE, ca.OP_AND, ca.OP_OR, ca.OP_IF_ELSE_ZERO}  # fmt: skip


def boxes(op: int, n: int, rng: np.random.Generator, points: bool = False) -> list[Interval]:
    """Random operands inside the domain of an operation; a third of them single numbers, or all."""
    made = []
    for k in range(2 if op in TWO else 1):
        if op in (ca.OP_ASIN, ca.OP_ACOS):
            x = rng.uniform(-1, 1, (2, n))
        elif op in (ca.OP_EXP, ca.OP_SINH, ca.OP_COSH, ca.OP_TANH):
            x = rng.uniform(-30, 30, (2, n))
        elif op in (ca.OP_FLOOR, ca.OP_CEIL, ca.OP_AND, ca.OP_OR, ca.OP_NOT, ca.OP_IF_ELSE_ZERO, ca.OP_EQ, ca.OP_LE):
            x = np.round(rng.uniform(-2, 2, (2, n)) * 2) / 2
        elif op in (ca.OP_POW, ca.OP_CONSTPOW) and k == 1:
            x = np.tile(np.round(rng.uniform(-3, 4, n)), (2, 1))
        else:
            x = rng.choice([-1.0, 1.0], (2, n)) * 10.0 ** rng.uniform(-6, 6, (2, n))
        if op in (ca.OP_SQRT, ca.OP_LOG):
            x = np.abs(x)
        single = rng.random(n) < (1.0 if points else 0.3)
        x[1] = np.where(single, x[0], x[1])
        made.append(Interval(x.min(axis=0), x.max(axis=0)))
    return made


def violations(
    op: int, operation: Callable[..., Interval], seed: int = 0, n: int = POINTS, points: bool = False
) -> int:
    """The number of random operands whose exact result lies outside the interval."""
    rng = np.random.default_rng(seed)
    given = boxes(op, n, rng, points)
    with np.errstate(all="ignore"):
        result = operation(*given)
    outside = 0
    for share in (0.0, 1.0, 0.37):
        for i in range(n):
            if np.isnan(np.broadcast_to(result.lo, n)[i]):
                continue
            lo, hi = (mpf(float(np.broadcast_to(x, n)[i])) for x in result)
            # a number of double inside: the ends, or one between
            ends = [[float(x.lo[i]), float(x.hi[i])] for x in given]
            operands = [mpf(min(max(a + share * (b - a), a), b)) for a, b in ends]
            outside += not lo <= EXACT[op](*operands) <= hi
    return outside


@pytest.mark.parametrize("op", sorted(OPERATIONS), ids=lambda op: NAMES[op])
def test_exact_results_lie_inside(op):
    assert violations(op, OPERATIONS[op]) == 0


@pytest.mark.parametrize("op", ALGEBRAIC, ids=lambda op: NAMES[op])
@pytest.mark.parametrize("end", [0, 1])
def test_an_interval_that_is_one_number_short_is_found(op, end):
    def short(*x: Interval) -> Interval:
        r = OPERATIONS[op](*x)
        return Interval(np.nextafter(r.lo, np.inf), r.hi) if end == 0 else Interval(r.lo, np.nextafter(r.hi, -np.inf))

    assert violations(op, short, points=True) > 0


@pytest.mark.parametrize("op", sorted(OPERATIONS), ids=lambda op: NAMES[op])
def test_results_of_operands_with_errors_stay_within_the_error_bound(op):
    rng = np.random.default_rng(1)
    given = boxes(op, POINTS, rng)
    x = [Interval(a.lo + 0.0, a.hi + 0.0) for a in given]
    moved = [3e-7 * np.abs(a.lo) for a in given]  # five round-offs of float
    with np.errstate(all="ignore"):
        wide = [a.widened(e) for a, e in zip(x, moved, strict=True)]
        # operands of a jump are widened before, as the tape does
        result = OPERATIONS[op](*(wide if NAMES[op].endswith(("SIGN", "FLOOR", "CEIL", "LT", "LE", "EQ", "NE", "NOT",
                                                               "AND", "OR", "ELSE_ZERO")) else x))  # fmt: skip
        bound = error(op, x if op != ca.OP_IF_ELSE_ZERO else [wide[0], x[1]], moved, result, FLOAT)
    for i in range(POINTS):
        e = float(np.broadcast_to(bound, POINTS)[i])
        if np.isnan(e) or np.isnan(np.broadcast_to(result.lo, POINTS)[i]):
            continue
        real = [mpf(float(a.lo[i])) for a in given]
        for sign in (-1.0, 1.0):
            operands = [mpf(float(np.float32(float(r) + 0.7 * sign * m[i]))) for r, m in zip(real, moved, strict=True)]
            exact, computed = EXACT[op](*real), EXACT[op](*operands)
            rounded = mpf(float(np.float32(float(computed))))
            assert abs(rounded - exact) <= e


def test_undefined_operations_prove_nothing():
    around = Interval(np.array([-1.0]), np.array([1.0]))
    for op in (ca.OP_INV, ca.OP_SQRT, ca.OP_LOG):
        with np.errstate(all="ignore"):
            assert np.isnan(OPERATIONS[op](around).lo).all()
    assert np.isnan(OPERATIONS[ca.OP_SIGN](Interval(*np.full((2, 1), np.nan))).lo).all()


def test_zero_over_a_divisor_that_may_be_computed_as_zero_has_no_error_bound():
    zero, small = Interval(np.zeros(1), np.zeros(1)), Interval(np.full(1, 1e-20), np.ones(1))
    errors = [np.zeros(1), np.full(1, 1e-15)]
    assert np.isnan(error(ca.OP_DIV, [zero, small], errors, OPERATIONS[ca.OP_DIV](zero, small), DOUBLE)).all()


def test_the_norm_of_tiny_numbers_does_not_vanish():
    assert upper_norm(np.full((1, 2, 2), 1e-60))[0] >= 2e-60


def test_rounding_is_to_nearest_with_denormal_numbers():
    assert float(np.float64(5e-324) * 1.0) == 5e-324
    assert outward(np.zeros(1), np.zeros(1)).hi[0] == DOUBLE.tiny
