"""Linear blocks: any pivot order must give the answer of a dense solver with pivoting."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import assume, given, strategies as st

import gtmodel as gt
from tests.support.compare import relative_error
from tests.support.examples import examples

# Sparse elimination with threshold 1e-4 per pivot may lose some digits more than partial pivoting does.
SPARSE = 1e-9
ROUND_OFF = 1e-12
MAX_CONDITION = 1e4
# of the condition number, in units of the last place: a stable solver's factor for at most five unknowns
STABLE = 10 * np.finfo(float).eps


def linear(A: np.ndarray, b: np.ndarray) -> gt.Model:
    """A x = b with numbers as constants; zeros are left out."""
    n = len(b)

    def equations(self):
        for i in range(n):
            yield sum(float(A[i, j]) * self.x[j] for j in np.flatnonzero(A[i])) == self.u * float(b[i])

    return type("Linear", (gt.Model,), {"x": gt.variable(n), "u": gt.input(), "equations": equations})()


def solution(model: gt.Model, *arguments: Any) -> Any:
    x, status = model.causal("u", "x")(1.0, *arguments)
    assert status == gt.Status.OK
    return x


class TestConstantPivots:
    def test_cancellation_is_no_pivot(self):
        # 0.9 - 0.3 * 0.3 / 0.1 is 1e-16 in floating point: dividing by it gave 1.5 instead of 1.97
        A = np.array([[0.1, 0.3, 1.0], [0.3, 0.9, -1.0], [0.7, 0.2, 5.0]])
        b = np.array([1.0, 2.0, 3.0])
        assert 0.9 - 0.3 * 0.3 / 0.1 != 0.0
        model = linear(A, b)
        assert relative_error(solution(model), np.linalg.solve(A, b)) < ROUND_OFF
        f = model.causal("u", "x").casadi
        constants = [f.instruction_constant(k) for k in range(f.n_instructions()) if f.instruction_id(k) == ca.OP_CONST]
        assert min(map(abs, constants), default=1.0) > 1e-3  # and no round-off is carried along as a coefficient

    @pytest.mark.parametrize("tiny", [1e-10, 1e-14, -1e-17])
    def test_tiny_entries_are_no_pivots(self, tiny):
        A = np.array([[tiny, 1.0], [1.0, 1.0]])
        assert relative_error(solution(linear(A, np.array([1.0, 2.0]))), [1.0, 1.0]) < 1e-9

    @examples(25)
    @given(st.data())
    def test_like_a_dense_solver(self, data):
        n = data.draw(st.integers(2, 6))
        short = st.integers(-9, 9).map(lambda k: k / 10)
        A = np.array(data.draw(st.lists(st.lists(short, min_size=n, max_size=n), min_size=n, max_size=n)))
        assume(np.linalg.matrix_rank(A) == n and np.linalg.cond(A) < MAX_CONDITION)
        b = np.arange(1.0, n + 1)
        assert relative_error(solution(linear(A, b)), np.linalg.solve(A, b)) < SPARSE


class TestOtherPivots:
    def make(self, n: int, size: float) -> type[gt.Model]:
        """A tridiagonal system whose coefficients are declared positive parameters, plus one state-dependent row."""

        class Chain(gt.Model):
            k = gt.parameter(size * np.arange(1.0, n + 1), positive=True)
            c = gt.parameter(np.ones(n), unit=None)
            x = gt.variable(n)
            u = gt.input()
            w = gt.input()

            def equations(self):
                for i in range(n):
                    left = self.k[i] * self.x[i]
                    if i:
                        left = left + self.c[i] * self.x[i - 1]
                    if i < n - 1:
                        left = left - self.w * self.x[i + 1]
                    yield left == self.u

        return Chain

    @pytest.mark.parametrize("size, w", [(1.0, 0.0), (1.0, 0.7), (1e-6, 0.7), (1e-6, -1.3), (1e6, 0.0), (1e6, -1.3)])
    def test_parameters_and_states(self, size, w):
        n = 5
        f = self.make(n, size)().causal(["u", "w"], "x")
        x, status = f(2.0, w)
        A = np.diag(size * np.arange(1.0, n + 1)) + np.diag(np.ones(n - 1), -1) - w * np.diag(np.ones(n - 1), 1)
        assert status == gt.Status.OK
        assert relative_error(x, np.linalg.solve(A, np.full(n, 2.0)), floor=0.0) < ROUND_OFF * np.linalg.cond(A)

    def test_parameters_stay_symbols_in_the_parametric_function(self):
        n = 4
        f = self.make(n, 1.0)().causal(["u", "w"], "x")
        rng = np.random.default_rng(1)
        k, c = rng.uniform(0.5, 2.0, n), rng.uniform(-1, 1, n)
        found = f.casadi_parametric(2.0, 0.7, np.concatenate([k, c]))[0].full().reshape(-1)
        A = np.diag(k) + np.diag(c[1:], -1) - 0.7 * np.diag(np.ones(n - 1), 1)
        assert relative_error(found, np.linalg.solve(A, np.full(n, 2.0))) < ROUND_OFF

    def test_a_state_dependent_pivot_that_vanishes_is_a_status(self):
        class Division(gt.Model):
            x = gt.variable()
            w = gt.variable()
            u = gt.input()

            def equations(self):
                yield self.w * self.x == self.u

        f = Division().causal(["w", "u"], "x")
        assert f(2.0, 3.0) == (1.5, gt.Status.OK)
        x, status = f(0.0, 3.0)
        assert np.isnan(x)
        assert status == gt.Status.SINGULAR
        assert "pivot for x is 0" in f.diagnose(0.0, 3.0)

    def test_a_zero_on_the_diagonal_of_the_dense_core_is_no_obstacle(self):
        class Turned(gt.Model):
            x = gt.variable(3)
            w = gt.variable(3)
            u = gt.input()

            def equations(self):
                w = self.w
                yield w[0] * self.x[1] + w[1] * self.x[2] == self.u
                yield w[1] * self.x[0] + w[2] * self.x[1] == 2 * self.u
                yield w[2] * self.x[0] - w[0] * self.x[2] == 3 * self.u

        f = Turned().causal(["w", "u"], "x")
        for w in ([1.0, 2.0, 3.0], [1.0, 2.0, 0.0], [-0.5, 0.3, 2.0]):
            A = np.array([[0, w[0], w[1]], [w[1], w[2], 0], [w[2], 0, -w[0]]])
            assert relative_error(f(w, 1.0)[0], np.linalg.solve(A, [1.0, 2.0, 3.0])) < ROUND_OFF


def core(n: int) -> gt.Model:
    """M x = b with all entries given from outside: no pivot is allowed, all is the dense core."""

    def equations(self):
        for i in range(n):
            yield sum(self.M[n * i + j] * self.x[j] for j in range(n)) == self.b[i]

    members = {"x": gt.variable(n), "M": gt.input(n * n, start=np.eye(n).ravel().tolist()), "b": gt.input(n)}
    return type("Core", (gt.Model,), {**members, "equations": equations})()


def nearly_singular(n: int, condition: float, count: int) -> np.ndarray:
    """Matrices (count, n, n) with one small singular value; multiples of 2^-30, which makes small sums exact."""
    rng = np.random.default_rng(n)
    left, right = (np.linalg.qr(rng.normal(size=(count, n, n)))[0] for _ in range(2))
    sizes = np.ones(n)
    sizes[-1] = 1 / condition
    return np.round(left * sizes @ right * 2**30) / 2**30


@pytest.mark.parametrize("n", [2, 3, 4, 5])
class TestDenseCore:
    @pytest.mark.parametrize("condition", [1e1, 1e3, 1e6])
    def test_the_error_is_the_condition_number_not_its_square(self, n, condition):
        M = nearly_singular(n, condition, 100)
        expected = np.random.default_rng(0).integers(-9, 10, (len(M), n)).astype(float)
        expected[:, 0] = 9.0
        x, status = core(n).causal(["M", "b"], "x")(M.reshape(-1, n * n), np.einsum("kij,kj->ki", M, expected))
        assert np.all(status == gt.Status.OK)
        for m, found, exact in zip(M, x, expected, strict=True):
            assert relative_error(found, exact, floor=0.0) < STABLE * np.linalg.cond(m)

    @pytest.mark.parametrize("noise", [0.0, 1e-12])
    def test_any_loss_of_rank_is_a_status(self, n, noise):
        rng = np.random.default_rng(n)
        M = rng.integers(-9, 10, (200, n, n)).astype(float)
        for k, m in enumerate(M):  # one column depends on some others; every fourth time it is zero
            dependent, *others = rng.permutation(n)
            m[:, dependent] = m[:, others] @ rng.integers(-2, 3, n - 1) * (k % 4 > 0)
        M[0], M[1] = 0.0, np.outer(np.arange(1, n + 1), np.ones(n))  # rank 0 and rank 1
        f = core(n).causal(["M", "b"], "x")
        x, status = f((M + noise * rng.uniform(-1, 1, M.shape)).reshape(-1, n * n), np.ones((200, n)))
        assert set(status.tolist()) == {gt.Status.SINGULAR}
        assert np.all(np.isnan(x))

    def test_each_column_has_its_pivot(self, n):
        f = core(n).causal(["M", "b"], "x")
        M = np.random.default_rng(n).normal(size=(n, n))
        *_, pivots = f.casadi(M.ravel(), np.ones(n))
        assert np.prod(np.abs(pivots.full())) == pytest.approx(abs(np.linalg.det(M)), rel=ROUND_OFF)
        assert sorted(m.label.split("(")[1] for m in f.margins) == [f"x[{k}])" for k in range(n)]


def test_a_matrix_symmetric_at_the_start_only_keeps_its_qr():
    assert "dense core of 4" in core(4).causal(["M", "b"], "x").explain()
