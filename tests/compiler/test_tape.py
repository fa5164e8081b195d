"""Tapes: derivatives are CasADi's, the interpreter gives what CasADi's virtual machine gives."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from gtmodel.compiler.tape import function
from gtmodel.compiler.tape.elimination import gradient, hessian, jacobian
from gtmodel.compiler.tape.function import TapeFunction, written
from gtmodel.compiler.tape.machine import AT_ONCE, interpreter, known
from gtmodel.compiler.tape.operations import Tape, read_in
from gtmodel.compiler.toolchain import find

ROUND_OFF = 1e-11  # relative: sums in another order
UNARY = (ca.sin, ca.cos, ca.tan, ca.tanh, ca.exp, ca.log, ca.sqrt, ca.fabs, ca.atan, ca.sign, ca.floor, lambda x: x**2,
         lambda x: -x, lambda x: 2 * x, lambda x: 1 / x)  # fmt: skip
BINARY = (lambda x, y: x + y, lambda x, y: x - y, lambda x, y: x * y, lambda x, y: x / y, ca.fmin, ca.fmax, ca.atan2,
          lambda x, y: ca.if_else(x < y, x, y), lambda x, y: x ** (0.5 + y**2))  # fmt: skip


def random_column(seed: int, inputs: int = 5, operations: int = 80, results: int = 4) -> tuple[ca.SX, ca.SX]:
    """Expressions of all operations, positive and of moderate size on the way."""
    rng = np.random.default_rng(seed)
    x = ca.SX.sym("x", inputs)
    made = [*ca.vertsplit(x), ca.SX(0.0), ca.SX(1.0), ca.SX(-2.5)]
    for _ in range(operations):
        a, b = (made[int(rng.integers(len(made)))] for _ in range(2))
        if rng.random() < 0.3:
            made.append(0.3 + ca.tanh(UNARY[int(rng.integers(len(UNARY)))](0.5 + ca.fabs(a))) ** 2)
        else:
            made.append(0.2 + ca.tanh(BINARY[int(rng.integers(len(BINARY)))](0.5 + ca.fabs(a), b + 3)))
    return x, ca.vertcat(*made[-results:], made[2], made[int(rng.integers(len(made)))] * 0)


def dense(entries: dict[tuple[int, int], int], tape: Tape, shape: tuple[int, int], x: ca.SX) -> ca.SX:
    matrix = ca.SX.zeros(*shape)
    for (r, c), value in zip(entries, ca.vertsplit(written(tape, list(entries.values()), x)), strict=True):
        matrix[r, c] = value
    return matrix


@pytest.mark.parametrize("seed", range(12))
def test_derivatives_are_those_of_casadi(seed):
    x, e = random_column(seed)
    weights = ca.SX.sym("weights", e.numel())
    both, tape = ca.vertcat(x, weights), Tape()
    results = read_in(tape, e, both)
    n, m = x.numel(), e.numel()
    v, own = [tape.input(k) for k in range(n)], [tape.input(n + k) for k in range(m)]
    J = dense(jacobian(tape, results, v), tape, (m, n), both)
    H = dense(hessian(tape, results, own, v), tape, (n, n), both)
    g = written(tape, gradient(tape, results, own, v), both)
    total = ca.dot(weights, e)
    expected = ca.Function("f", [both], [e, ca.jacobian(e, x), ca.gradient(total, x), ca.triu(ca.hessian(total, x)[0])])
    found = ca.Function("f", [both], [written(tape, results, both), J, g, H])
    rng = np.random.default_rng(seed)
    for _ in range(3):
        at = rng.uniform(0.2, 1.5, both.numel())
        for a, b in zip(expected(at), found(at), strict=True):
            assert np.allclose(a.full(), b.full(), rtol=ROUND_OFF, atol=ROUND_OFF)


def test_entries_that_are_always_zero_are_left_out():
    x, tape = ca.SX.sym("x", 3), Tape()
    results = read_in(tape, ca.vertcat(x[0] * x[1], 3 * x[2], 1.0), x)
    v, one = [tape.input(k) for k in range(3)], tape.constant(1.0)
    assert sorted(jacobian(tape, results, v)) == [(0, 0), (0, 1), (1, 2)]
    assert hessian(tape, results, [one] * 3, v) == {(0, 1): one}
    assert jacobian(tape, [], v) == hessian(tape, [], [], v) == {}
    assert written(tape, [], x).shape == (0, 1)


def test_operations_are_written_once():
    x, tape = ca.SX.sym("x", 2), Tape()
    a, b, c = read_in(tape, ca.vertcat(ca.sin(x[0] * x[1]), ca.sin(x[1] * x[0]), 0.0 - (0.0 - x[0]) * 1.0), x)
    assert a == b
    assert c == tape.input(0)
    # of a zero the sign is kept, and no number is another one
    assert tape.constant(0.0) != tape.constant(-0.0)
    assert tape.constant(np.nan) != tape.constant(0.0)


@pytest.fixture
def compiler():
    assert not isinstance(find(), str), find()
    assert interpreter(True) is not None


@pytest.mark.parametrize("points", [1, 2, AT_ONCE - 1, AT_ONCE, AT_ONCE + 1, 3 * AT_ONCE + 5])
@pytest.mark.parametrize("seed", range(4))
def test_interpreter_gives_the_numbers_of_the_virtual_machine(seed, points, compiler, monkeypatch):
    x, e = random_column(seed, operations=120)
    monkeypatch.setattr(function, "USED", 0.0)
    tape = Tape()
    results = read_in(tape, e, x)
    assert known(tape)
    split = [x[:2], x[2:]]
    f = TapeFunction("f", tape, split, [results[:1], [], results[1:]])
    rng = np.random.default_rng(seed)
    at = [rng.uniform(-1.0, 1.0, (part.numel(), points)) for part in split]
    at[0][:, 0] = np.nan
    fast, slow = f.map(points), f.casadi.map(points)
    assert fast.is_a("CallbackInternal") or not fast.is_a("Map")
    for a, b in zip(fast(*at), slow(*at), strict=True):
        assert a.shape == b.shape
        assert np.array_equal(a.full(), b.full(), equal_nan=True)


def test_without_a_compiler_the_virtual_machine_takes_it(monkeypatch):
    monkeypatch.setattr(function, "USED", 0.0)
    monkeypatch.setattr(function, "interpreter", lambda build: None)
    x, tape = ca.SX.sym("x"), Tape()
    f = TapeFunction("f", tape, [x], [read_in(tape, x**2, x)])
    assert f.map(3)(np.array([[1.0, 2.0, 3.0]])).full().tolist() == [[1.0, 4.0, 9.0]]


def test_an_operation_that_the_interpreter_lacks_stays_with_the_virtual_machine(monkeypatch):
    monkeypatch.setattr(function, "USED", 0.0)
    x, tape = ca.SX.sym("x"), Tape()
    f = TapeFunction("f", tape, [x], [read_in(tape, ca.erf(x), x)])
    assert not known(tape)
    assert f.map(1)(0.0).full().item() == 0.0
