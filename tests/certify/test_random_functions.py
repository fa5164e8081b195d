"""Random functions of all operations over random boxes: exact values inside, round-off of double and float bounded."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest
from mpmath import mpf

from gtmodel.certify.rounding import DOUBLE, FLOAT
from gtmodel.certify.tape import IntervalTape, MeanValue
from gtmodel.cgen.newton_steps import run
from tests.certify.exact import Exact

BOXES = 12
ONE: list[Callable[[Any], Any]] = [
    ca.sin, ca.cos, ca.tan, ca.atan, ca.tanh, ca.fabs, ca.sqrt, ca.exp, ca.log, ca.asin, ca.acos, ca.floor, ca.sign,
    ca.sinh, ca.cosh, lambda x: -x, lambda x: 2 * x, lambda x: 1 / x, lambda x: x * x, lambda x: x**3,
    lambda x: x**-1.5,
]  # fmt: skip
TWO: list[Callable[[Any, Any], Any]] = [
    ca.atan2, ca.fmin, ca.fmax, lambda x, y: x + y, lambda x, y: x - y, lambda x, y: x * y, lambda x, y: x / y,
    lambda x, y: ca.if_else(x < y, x, y * y), lambda x, y: ca.if_else(ca.logic_and(x <= 1, y > 0), x, 0),
    lambda x, y: ca.if_else(x >= y, ca.sqrt(x - y), x),
]  # fmt: skip


def drawn(rng: np.random.Generator) -> ca.Function:
    """A random function of three inputs and four outputs."""
    x = ca.SX.sym("x", 3)
    pool = [x[0], x[1], x[2], *(ca.SX(float(c)) for c in np.round(rng.normal(size=2), 3))]
    for _ in range(rng.integers(3, 14)):
        a, b = (pool[i] for i in rng.integers(len(pool), size=2))
        pool.append(ONE[rng.integers(len(ONE))](a) if rng.random() < 0.45 else TWO[rng.integers(len(TWO))](a, b))
    return ca.Function("f", [x], [ca.vertcat(*pool[-4:])])


@pytest.mark.parametrize("count", [40, pytest.param(2000, marks=pytest.mark.proof)])
def test_no_enclosure_and_no_error_bound_is_violated(count):
    rng = np.random.default_rng(0)
    checked = 0
    for _ in range(count):
        f = drawn(rng)
        tape, at = IntervalTape(f), Exact(f)
        middle, width = rng.normal(0, 2, (3, BOXES)), 10.0 ** rng.uniform(-9, 0.3, (3, BOXES))
        width[rng.random((3, BOXES)) < 0.2] = 0.0
        lo, hi = (x.astype(np.float32).astype(float) for x in (middle - width, middle + width))
        x = np.clip((lo + rng.random(lo.shape) * (hi - lo)).astype(np.float32).astype(float), lo, hi)
        with np.errstate(all="ignore"):
            computed = [np.array([f(p).full().ravel() for p in x.T]).T, run(f, [x.astype(np.float32)])[0].astype(float)]
        enclosed = [tape.over(lo, hi, arithmetic) for arithmetic in (DOUBLE, FLOAT)]
        centred, _ = MeanValue(tape, range(4)).over(lo, hi)
        for n, point in enumerate(x.T):
            try:
                exact = at(point)
            except (ArithmeticError, ValueError, TypeError, AttributeError):
                continue  # some output is undefined there
            for e, values in zip(enclosed, computed, strict=True):
                assert e.error is not None
                for k in np.flatnonzero(np.isfinite(e.lo[:, n]) & np.isfinite(e.hi[:, n])):
                    assert e.lo[k, n] <= exact[k] <= e.hi[k, n]
                    assert not e.error[k, n] < abs(mpf(values[k, n]) - exact[k])
                    checked += 1
                    if e.continuous[n] and not np.isnan(centred.lo[k, n]):
                        assert centred.lo[k, n] <= exact[k] <= centred.hi[k, n]
    assert checked > 20 * count
