"""A function mapped on columns gives the numbers of CasADi's virtual machine, bit for bit."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from gtmodel.compiler.columns import kernel
from gtmodel.compiler.columns.kernel import MANY, Batch, mapped
from gtmodel.compiler.tape.machine import AT_ONCE, Interpreted, interpreter
from gtmodel.compiler.toolchain import find


def operations() -> ca.Function:
    """Most operations, results that are inputs, constants and twice the same, and an argument and a result of none."""
    x, y, none = ca.SX.sym("x", 3), ca.SX.sym("y"), ca.SX.sym("none", 0)
    a = ca.tanh(x[0]) / x[1] + ca.exp(-y) * ca.sqrt(x[2]) - 2 * x[0]
    b = ca.if_else(x[0] < x[1], ca.atan2(x[0], y), 1 / a) ** 2
    return ca.Function("f", [x, none, y], [ca.vertcat(a, x[1], 3.0, a, -0.0), ca.SX(0, 1), b * a])


@pytest.fixture(params=["interpreter", "NumPy"])
def way(request, monkeypatch):
    """What computes the points."""
    if request.param == "interpreter":
        assert not isinstance(find(), str), find()
        assert interpreter(True) is not None
        monkeypatch.setattr(kernel, "USED", 0.0)
    else:
        monkeypatch.setattr(kernel, "interpreter", lambda build: None)
    return request.param


@pytest.mark.parametrize("points", [MANY, 300, 513])
def test_columns_give_the_numbers_of_the_virtual_machine(points, way):
    f = operations()
    rng = np.random.default_rng(points)
    x, y = rng.uniform(-1.0, 2.0, (3, points)), rng.uniform(-1.0, 1.0, (1, points))
    x[:, 0] = np.nan  # and roots of what is negative
    fast = mapped(f, points)
    assert isinstance(fast, Batch)
    assert isinstance(fast._program, Interpreted) == (way == "interpreter")
    for _ in range(2):  # its memory is used again
        x = -x
        for a, b in zip(fast(x, ca.DM(0, points), y), f.map(points)(x, ca.DM(0, points), y), strict=True):
            assert a.shape == b.shape
            assert np.array_equal(a.full(), b.full(), equal_nan=True)
            assert np.array_equal(np.signbit(a.full()[:, 1:]), np.signbit(b.full()[:, 1:]))


def test_what_is_not_given_is_zero_and_what_is_not_asked_for_is_not_written(way):
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


@pytest.mark.parametrize("way", ["interpreter"], indirect=True)
def test_what_the_interpreter_does_not_take(way):
    x, library = ca.SX.sym("x"), interpreter(False)
    assert not isinstance(mapped(operations(), AT_ONCE - 1), Batch)
    assert Interpreted.of_function(library, ca.Function("erf", [x], [ca.erf(x)])) is None
    assert Interpreted.of_function(library, ca.Function("matrix", [ca.SX.sym("m", 2, 2)], [ca.SX(1)])) is None
    assert Interpreted.of_function(library, ca.Function("sparse", [x], [ca.diag(ca.vertcat(x, x))])) is None
    none = mapped(ca.Function("none", [x], [ca.SX(0, 1)]), AT_ONCE)
    assert isinstance(none, Batch) and none(ca.DM.zeros(1, AT_ONCE)).shape == (0, AT_ONCE)


def long_function(seed: int, operations: int = 400) -> ca.Function:
    """Random operations, whose work vector is used again and again, with constants and entries that are always zero."""
    rng = np.random.default_rng(seed)
    x, y = ca.SX.sym("x", 4), ca.SX.sym("y", 2)
    made = [*ca.vertsplit(x), *ca.vertsplit(y), ca.SX(0.7)]
    pairs = (lambda a, b: a + b, lambda a, b: a - b, lambda a, b: a * b, lambda a, b: a / (2 + b**2), ca.atan2, ca.fmax)
    for _ in range(operations):
        a, b = (made[int(rng.integers(max(0, len(made) - 40), len(made)))] for _ in range(2))
        made.append(ca.tanh(rng.normal() * pairs[int(rng.integers(len(pairs)))](a, b)) + 0.1)
    return ca.Function("long", [x, y], [ca.vertcat(*made[-9:]), ca.densify(ca.vertcat(0, made[-10], y[1]))])


@pytest.mark.parametrize("points", [AT_ONCE, AT_ONCE + 1, 150, 257])
@pytest.mark.parametrize("seed", range(3))
def test_the_interpreter_reads_a_function_to_the_last_bit(seed, points, way):
    f = long_function(seed)
    fast, rng = mapped(f, points), np.random.default_rng(seed)
    assert isinstance(fast, Batch) is (way == "interpreter" or points >= MANY)
    at = rng.normal(size=(4, points)), rng.normal(size=(2, points))
    for a, b in zip(fast(*at), f.map(points)(*at), strict=True):
        assert np.array_equal(a.full(), b.full())


def test_the_interpreter_is_built_when_all_that_was_asked_for_would_have_taken_seconds(monkeypatch):
    asked: list[bool] = []
    monkeypatch.setattr(kernel, "interpreter", lambda build: asked.append(build))
    monkeypatch.setattr(kernel, "_asked", kernel._Asked())
    f, points = long_function(0), 250
    calls = 1 + int(kernel.BUILT / (f.n_instructions() * points * kernel.OPERATION * kernel.CALLS))
    for _ in range(calls):
        assert not isinstance(mapped(f, points), Batch)  # it is not there yet
    assert asked == [False] * (calls - 1) + [True]
