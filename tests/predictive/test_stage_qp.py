"""Quadratic programs of a horizon: against PIQP and Riccati's equation, conditions of optimality judged apart, C."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
import scipy

import gtmodel as gt
from gtmodel import Status, cgen
from gtmodel.predictive import ControllerQP, HorizonStage, LimitedRow, StageQP, StageSolution
from gtmodel.results import ArgumentError

SX = ca.SX
OPTIMAL = 1e-7  # of the cost: the tolerance is 1e-8 of 1 + |cost|, and the gap bounds the cost above the optimum
FEASIBLE = 1e-7
FEW, MANY = 16, 300  # problems whose shape is drawn too; test_stage_qp_draws.py draws thousands
SOLVED = 0.9  # of the draws: the others have limits that exclude each other
LQR = 1e-9


def drawn(rng: np.random.Generator) -> tuple[StageQP, np.ndarray, np.ndarray, np.ndarray]:
    """A problem of random size, whose matrices change from stage to stage in part."""
    n, m, count = int(rng.integers(1, 5)), int(rng.integers(1, 4)), int(rng.integers(1, 9))
    x, u, p, q = SX.sym("x", n), SX.sym("u", m), SX.sym("p", m + n), SX.sym("q", n)
    A, B = np.eye(n) + 0.3 * rng.normal(size=(n, n)), rng.normal(size=(n, m))
    A[rng.random((n, n)) < 0.3] = 0.0
    half = rng.normal(size=(n + m, n + m))
    H = half.T @ half + 0.1 * np.eye(n + m)
    z = ca.vertcat(x, u)
    wide = 10 ** rng.uniform(-1, 1)
    rows = [LimitedRow(u[i] / wide, -1, 1) for i in range(m)]
    rows += [LimitedRow(ca.dot(p[:m], u) + 0.1 * x[0], None, 1 + wide)]
    rows += [LimitedRow(x[i], -1 - p[m + i], 2, (rng.uniform(0, 100), rng.uniform(0.1, 10))) for i in range(n)]
    if rng.random() < 0.3:
        rows.append(LimitedRow(x[0] + u[0], -3, 3))
    stage = HorizonStage(x, u, p, A @ x + B @ u + p[m:], ca.dot(z, H @ z) / 2 + ca.dot(p[m:], x), rows)
    end_rows = (
        [LimitedRow(x[0], -1, None, (20.0, 1.0)), LimitedRow(x[-1] - q[0], None, 5)] if rng.random() < 0.5 else []
    )
    last = HorizonStage(x, None, q, None, ca.sumsqr(x - q), end_rows)
    data = rng.normal(size=(count, n + m)) * 0.3
    return StageQP(stage, count, last), 2 * rng.normal(size=n), data, rng.normal(size=n)


def flat(qp: StageQP, x: np.ndarray, data: np.ndarray, end: np.ndarray) -> tuple[np.ndarray, ...]:
    """H, c, A, b, G, h and the constant of: least z'Hz/2 + c'z + constant with A z = b, G z <= h. z: states of all
    stages, inputs, excesses of soft limits; by evaluating the declared expressions, not their matrices."""
    stages = [qp.stage] * qp.count + [qp.last]
    numbers = [*data, end]
    n, m = qp.stage.states, qp.stage.inputs
    at_u = n * (qp.count + 1)
    soft = [sum(len(limits(r)) for s in stages[:k] for r in s.rows if r.price) for k in range(len(stages) + 1)]
    size = at_u + m * qp.count + soft[-1]
    H, c, constant, A, b = np.zeros((size, size)), np.zeros(size), 0.0, [np.eye(n, size)], [x]
    G: list[np.ndarray] = []
    h: list[float] = []
    for k, (s, p) in enumerate(zip(stages, numbers, strict=True)):
        z = ca.vertcat(s.x, SX(0, 1) if s.u is None else s.u)
        own = np.r_[n * k : n * (k + 1), at_u + m * k : at_u + m * k + (0 if s.u is None else m)]
        hessian, slope = ca.hessian(s.cost, z)
        zero = np.zeros(z.numel())
        value = ca.Function("f", [z, s.data], [s.cost, slope, hessian])
        at, by, by2 = (np.asarray(v.full()) for v in value(zero, p))
        H[np.ix_(own, own)] += by2
        c[own] += by[:, 0]
        constant += at[0, 0]
        if s.after is not None:
            step = ca.Function("f", [z, s.data], [s.after, ca.jacobian(s.after, z)])
            offset, jacobian = (v.full() for v in step(zero, p))
            row = np.zeros((n, size))
            row[:, own], row[:, n * (k + 1) : n * (k + 2)] = -jacobian, np.eye(n)
            A.append(row)
            b.append(offset[:, 0])
        excess = at_u + m * qp.count + soft[k]
        for r in s.rows:
            f = ca.Function("f", [z, s.data], [r.value, ca.jacobian(r.value, z)])
            offset, jacobian = (v.full() for v in f(zero, p))
            for sign, limit in limits(r):
                row = np.zeros(size)
                row[own] = sign * jacobian[0]
                if r.price:
                    row[excess] = -1.0
                    positive = np.zeros(size)
                    positive[excess] = -1.0
                    G.append(positive)
                    h.append(0.0)
                    c[excess], H[excess, excess] = r.price
                    excess += 1
                G.append(row)
                bound = float(ca.Function("f", [s.data], [SX(limit)])(p))
                h.append(sign * (bound - offset[0, 0]))
    return H, c, np.vstack(A), np.concatenate(b), np.array(G), np.array(h), np.array(constant)


def limits(row: LimitedRow) -> list[tuple[int, Any]]:
    return [(sign, limit) for sign, limit in ((-1, row.low), (1, row.high)) if limit is not None]


def best(problem: tuple[np.ndarray, ...]) -> float | None:
    """Least cost by PIQP, None if there is no solution."""
    piqp: Any = pytest.importorskip(
        "piqp", reason="PIQP, the oracle of quadratic programs, is not installed: pip install piqp"
    )
    H, c, A, b, G, h, constant = problem
    solver = piqp.DenseSolver()
    for name in ("eps_abs", "eps_rel", "eps_duality_gap_abs", "eps_duality_gap_rel"):
        setattr(solver.settings, name, 1e-10)
    solver.settings.check_duality_gap, solver.settings.max_iter = True, 500
    solver.setup(H, c, A, b, G, None, h)
    status = solver.solve()
    return float(solver.result.info.primal_obj + constant) if status == piqp.PIQP_SOLVED else None


def check(rng: np.random.Generator) -> bool:
    """One drawn problem. Returns whether there is a solution."""
    qp, x, data, end = drawn(rng)
    s = qp.solve(x, data, end)
    expected = best(flat(qp, x, data, end))
    if expected is None:
        assert s.status != Status.OK
        return False
    assert s.status == Status.OK, (s.status, s.gap, s.residual, s.gradient)
    assert abs(s.cost - expected) <= OPTIMAL * (1 + abs(expected))
    judge(qp, s, x, data, end)
    return True


def judge(qp: StageQP, s: StageSolution, x: np.ndarray, data: np.ndarray, end: np.ndarray) -> None:
    """What the solution says holds for the declared expressions: dynamics, exact limits, cost with prices."""
    cost, now = 0.0, x
    for k in range(qp.count + 1):
        g = qp.stage if k < qp.count else qp.last
        p = data[k] if k < qp.count else end
        u = s.u[k] if k < qp.count else np.zeros(0)
        assert np.abs(s.x[k] - now).max() <= 1e-9 * (1 + np.abs(now).max())
        symbols = [g.x, SX(0, 1) if g.u is None else g.u, g.data]
        cost += float(ca.Function("f", symbols, [g.cost])(s.x[k], u, p))
        for r in g.rows:
            value = float(ca.Function("f", symbols, [r.value])(s.x[k], u, p))
            for sign, limit in limits(r):
                beyond = sign * (value - float(ca.Function("f", [g.data], [SX(limit)])(p)))
                if r.price:
                    cost += r.price[0] * max(beyond, 0) + r.price[1] * max(beyond, 0) ** 2 / 2
                else:
                    assert beyond <= FEASIBLE
        if g.after is not None:
            now = ca.Function("f", symbols, [g.after])(s.x[k], u, p).full()[:, 0]
    assert abs(cost - s.cost) <= 10 * OPTIMAL * (1 + abs(cost))


def test_drawn_problems_have_the_cost_of_piqp() -> None:
    assert sum(check(np.random.default_rng([1, k])) for k in range(FEW)) >= SOLVED * FEW


@pytest.mark.proof
def test_many_drawn_problems_have_the_cost_of_piqp() -> None:
    assert sum(check(np.random.default_rng([2, k])) for k in range(MANY)) >= SOLVED * MANY


def cart(*rows: LimitedRow, weight: float = 0.01, count: int = 20, P: Any = None) -> StageQP:
    """A mass of 1 kg pushed by a force, 0.1 s a stage."""
    after = ca.vertcat(X[0] + 0.1 * X[1] + 0.005 * U, X[1] + 0.1 * U)
    last = HorizonStage(X, None, SX(0, 1), None, ca.sumsqr(X) if P is None else ca.dot(X, SX(P) @ X) / 2)
    return StageQP(HorizonStage(X, U, SX(0, 1), after, ca.sumsqr(X) + weight * U**2, rows), count, last)


X, U = SX.sym("x", 2), SX.sym("u")


def test_without_limits_it_is_the_linear_quadratic_regulator() -> None:
    A, B = np.array([[1, 0.1], [0, 1]]), np.array([[0.005], [0.1]])
    P = scipy.linalg.solve_discrete_are(A, B, 2 * np.eye(2), [[0.02]])
    gain = np.linalg.solve(0.02 + B.T @ P @ B, B.T @ P @ A)
    s = cart(P=P).solve([1.0, -0.5])
    assert s.status == Status.OK and s.iterations == 1
    assert np.abs(s.u[0] + gain @ [1.0, -0.5]).max() < LQR
    assert s.cost == pytest.approx(np.array([1.0, -0.5]) @ P @ [1.0, -0.5] / 2, rel=LQR)


def test_estimation_over_a_moving_horizon_is_the_kalman_filter() -> None:
    """The noise of the process is the input; the first stage moves the prior mean, at the price of its covariance."""
    F, H, Q, R, P = np.array([[1, 0.1], [0, 1]]), np.array([[1.0, 0.0]]), np.diag([1e-6, 1e-2]), 1e-2, np.diag([1, 0.5])
    w, (y, first), end = SX.sym("w", 2), ca.vertsplit(SX.sym("d", 2)), SX.sym("y")
    prior, process = (ca.dot(w, SX(np.linalg.inv(S)) @ w) / 2 for S in (P, Q))
    cost = first * prior + (1 - first) * (process + (y - X[0]) ** 2 / (2 * R))
    after = X + (1 - first) * (SX(F - np.eye(2)) @ X) + w
    readings, mean = np.random.default_rng(1).normal(size=9), np.array([0.3, -0.2])
    stage = HorizonStage(X, w, ca.vertcat(y, first), after, cost)
    qp = StageQP(stage, len(readings), HorizonStage(X, None, end, None, (end - X[0]) ** 2 / (2 * R)))
    s = qp.solve(mean, [[0.0, 1.0], *[[value, 0.0] for value in readings[:-1]]], readings[-1:])
    for k, value in enumerate(readings):
        if k:
            mean, P = F @ mean, F @ P @ F.T + Q
        gain = P @ H.T / (H @ P @ H.T + R)
        mean, P = mean + (gain * (value - H @ mean))[:, 0], P - gain @ H @ P
    assert s.status == Status.OK and s.x[-1] == pytest.approx(mean, abs=LQR)


def test_a_price_above_the_multiplier_keeps_the_limit_and_one_below_does_not() -> None:
    """Nesterov: a linear price is exact if it is larger than the multiplier of the exact limit."""
    exact = cart(LimitedRow(X[1], -0.3, None)).solve([1.0, 0.0])
    largest = exact.sides[:, 1].max()
    dear, cheap = (cart(LimitedRow(X[1], -0.3, None, (k * largest, 0.0))).solve([1.0, 0.0]) for k in (1.1, 0.5))
    assert np.abs(dear.x - exact.x).max() < 1e-5 and cheap.x[:, 1].min() < -0.3 - 1e-3


def test_a_solution_nearby_spares_iterations_and_changes_nothing() -> None:
    qp = cart(LimitedRow(U, -1, 1), LimitedRow(X[1], -0.4, 0.4, (50.0, 1.0)))
    x, start = np.array([1.0, 0.0]), None
    warm, cold = 0, 0
    for _ in range(8):
        s, alone = qp.solve(x, start=start), qp.solve(x)
        assert s.status == alone.status == Status.OK
        assert s.cost == pytest.approx(alone.cost, rel=OPTIMAL, abs=OPTIMAL)
        warm, cold = warm + s.iterations, cold + alone.iterations
        x, start = s.x[1], s.shifted()
    assert warm < 0.9 * cold


@pytest.mark.parametrize("x", [[np.nan, 0.0], [np.inf, 0.0], [1e200, 0.0]])
def test_what_is_not_finite_is_told(x: list[float]) -> None:
    assert cart(LimitedRow(U, -1, 1)).solve(x).status == Status.NOT_FINITE


def test_what_has_no_solution_is_never_ok() -> None:
    assert cart(LimitedRow(X[0] + U, None, -1), LimitedRow(X[0] + U, 1, None)).solve([0.1, 0.0]).status != Status.OK
    unbounded = StageQP(HorizonStage(X, U, SX(0, 1), X, ca.sumsqr(X) + U), 3, cart().last)
    assert unbounded.solve([1.0, 0.0]).status == Status.SINGULAR
    hasty = StageQP(cart(LimitedRow(U, -1, 1)).stage, 20, cart().last, max_iterations=2)
    assert hasty.solve([1.0, 0.0]).status == Status.NOT_CONVERGED


@pytest.mark.parametrize(
    ("argument", "wrong"),
    [
        ("after", lambda: HorizonStage(X, U, SX(0, 1), X * U, U**2)),
        ("cost", lambda: HorizonStage(X, U, SX(0, 1), X, U**4)),
        ("rows", lambda: HorizonStage(X, U, SX(0, 1), X, U**2, [LimitedRow(U**2, 0, 1)])),
        ("rows[0]", lambda: HorizonStage(X, U, SX(0, 1), X, U**2, [LimitedRow(U)])),
        ("rows[0].price", lambda: HorizonStage(X, U, SX(0, 1), X, U**2, [LimitedRow(U, 0, 1, (-1.0, 0.0))])),
        ("cost", lambda: HorizonStage(X, U, SX(0, 1), X, SX.sym("other") * U**2)),
        ("stage", lambda: StageQP(cart().last, 3, cart().last)),
        ("last", lambda: StageQP(cart().stage, 3, cart().stage)),
        ("count", lambda: cart(count=0)),
        ("x", lambda: cart().solve([1.0])),
        ("data", lambda: cart().solve([1.0, 0.0], np.zeros((20, 1)))),
        ("period", lambda: ControllerQP(cart(), 0.0, [1.0, 0.0])),
        ("x", lambda: ControllerQP(cart(), 0.1, [np.nan, 0.0])),
    ],
)
def test_wrong_arguments_are_named(argument: str, wrong: Any) -> None:
    with pytest.raises(ArgumentError) as caught:
        wrong()
    assert caught.value.argument == argument


def controlled() -> dict[str, Any]:
    p, q = SX.sym("p", 2), SX.sym("q", 2)
    rows = [
        LimitedRow(U, -1, 1),
        LimitedRow(X[1] + p[0], -0.4, 0.4, (100.0, 10.0)),
        LimitedRow(X[0], None, 2 + p[1], (5.0, 1.0)),
    ]
    after = ca.vertcat(X[0] + 0.1 * X[1] + 0.005 * U, X[1] + 0.1 * U)
    stage = HorizonStage(X, U, p, after, ca.sumsqr(X) + 0.01 * U**2, rows)
    last = HorizonStage(X, None, q, None, 10 * ca.sumsqr(X - q), [LimitedRow(X[1], -0.1, 0.1, (50.0, 1.0))])
    bare = cart(LimitedRow(U, -1, 1), count=1)
    qp = StageQP(stage, 10, last)
    return {
        "law": ControllerQP(qp, 0.1, [1.0, 0.0], [0.01, 0.1], [0.1, 0.0]),
        "bare": ControllerQP(bare, 0.1, [1.0, 0.0]),
    }


@pytest.mark.parametrize(("real", "points"), [("double", 20), pytest.param("float", 12, marks=pytest.mark.proof)])
def test_c_equals_python_bit_for_bit(real: str, points: int, tmp_path: Path) -> None:
    laws = controlled()
    cgen.generate(laws, tmp_path / "c", name="mpc", real=real)
    report = cgen.check(tmp_path / "c", laws, points=points)
    assert report.message.startswith("the C code equals Python bit for bit"), report.message
    assert report.rows_ok["law"] > points / 2 and report.rows_ok["bare"] > points / 2


@pytest.mark.proof
def test_c_equals_python_over_five_thousand_cycles(tmp_path: Path) -> None:
    laws = controlled()
    cgen.generate(laws, tmp_path / "c", name="mpc")
    report = cgen.check(tmp_path / "c", laws, points=5000)
    assert report.message.startswith("the C code equals Python bit for bit"), report.message


def test_a_controller_in_closed_loop_reaches_its_goal_within_the_limits() -> None:
    law = controlled()["law"]
    qp, x = law.qp, np.array([1.0, 0.0])
    start, inputs = None, []
    for _ in range(40):
        s = qp.solve(x, [0.0, 0.0], [0.0, 0.0], start)
        assert s.status == Status.OK
        inputs.append(s.u[0, 0])
        x, start = np.array([x[0] + 0.1 * x[1] + 0.005 * s.u[0, 0], x[1] + 0.1 * s.u[0, 0]]), s.shifted()
    assert np.abs(x).max() < 0.1 and np.abs(inputs).max() <= 1 + FEASIBLE
    assert gt.predictive.StageSolution is type(s)
