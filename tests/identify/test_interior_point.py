"""Few unknowns under many rows: against IPOPT and closed forms, conditions for a minimum, and how runs end."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np
import pytest
import scipy

from gtmodel.identify.excitation.interior_point import KEPT, interior_point
from gtmodel.results import SolveStatus

Array = np.ndarray
TIGHT = 1e-6
HOLDS = 2e-2  # a row that is nearer than this may carry a multiplier
GAP = 5e-3  # of the cost: a barrier of 1e-5 over some hundred rows
TO_TOLERANCE = 2e-3  # of unknowns of order one, where the cost is curved by about one


@dataclass
class Symbolic:
    """A problem by CasADi: cost and rows of x, and how often they were asked for."""

    x: ca.SX
    f: ca.SX
    h: ca.SX
    asked: int = 0

    def __post_init__(self) -> None:
        self._value = ca.Function("value", [self.x], [self.f, ca.densify(self.h)])
        derivatives = [ca.gradient(self.f, self.x), ca.densify(ca.jacobian(self.h, self.x))]
        self._derivatives = ca.Function("derivatives", [self.x], derivatives)
        y = ca.SX.sym("y", self.h.shape[0])
        second = ca.hessian(self.f + ca.dot(y, self.h), self.x)[0]
        self._second = ca.Function("second", [self.x, y], [ca.densify(second)])

    def value(self, x: Array) -> tuple[float, Array]:
        self.asked += 1
        f, h = self._value(x)
        return float(f), h.full().reshape(-1)

    def derivatives(self, x: Array) -> tuple[Array, Array, Callable[[Array], Array]]:
        gradient, A = self._derivatives(x)
        return gradient.full().reshape(-1), A.full(), lambda y: self._second(x, y).full()

    def by_ipopt(self, x0: Array) -> tuple[Array, float]:
        options = {"ipopt": {"print_level": 0, "sb": "yes", "tol": 1e-9}, "print_time": False}
        solver = ca.nlpsol("oracle", "ipopt", {"x": self.x, "f": self.f, "g": self.h}, options)
        r = solver(x0=x0, lbg=-np.inf, ubg=0.0)
        assert solver.stats()["success"]
        return r["x"].full().reshape(-1), float(r["f"])


def polygon(corners: int = 300) -> Symbolic:
    """The point nearest to (2, 1) within a regular polygon about the unit circle: as good as (2, 1) / sqrt 5."""
    x = ca.SX.sym("x", 2)
    angle = 2 * np.pi * np.arange(corners) / corners
    normals = np.column_stack([np.cos(angle), np.sin(angle)])
    return Symbolic(x, ca.sumsqr(x - ca.DM([2.0, 1.0])) / 2, ca.mtimes(ca.DM(normals), x) - 1)


def random_problem(seed: int, n: int = 6, rows: int = 200) -> Symbolic:
    """A smooth convex cost under ellipsoids and half-spaces that hold the origin inside."""
    rng = np.random.default_rng(seed)
    x = ca.SX.sym("x", n)
    A, centre = rng.normal(size=(rows, n)), rng.normal(size=n) * 3
    half = ca.mtimes(ca.DM(A), x) - ca.DM(rng.uniform(0.5, 2.0, rows))
    return Symbolic(x, ca.log(1 + ca.sumsqr(x - ca.DM(centre))), ca.vertcat(half, ca.sumsqr(x) - 4))


def rosenbrock(rows: bool) -> Symbolic:
    x = ca.SX.sym("x", 2)
    disc = ca.sumsqr(x) - 1.0
    return Symbolic(x, (1 - x[0]) ** 2 + 100 * (x[1] - x[0] ** 2) ** 2, disc if rows else ca.SX(0, 1))


def hilly(seed: int, n: int = 5, rows: int = 60) -> Symbolic:
    """A cost of several hills and hollows, concave in places, under half-spaces and a ball."""
    rng = np.random.default_rng(seed)
    x = ca.SX.sym("x", n)
    A = rng.normal(size=(rows, n))
    half = ca.mtimes(ca.DM(A), x) - ca.DM(rng.uniform(0.5, 2.0, rows))
    waves = ca.sum1(ca.sin(ca.mtimes(ca.DM(rng.normal(size=(8, n)) * 2), x) + ca.DM(rng.uniform(0, 6, 8))))
    return Symbolic(x, waves, ca.vertcat(half, ca.sumsqr(x) - 4))


def residual(problem: Symbolic, x: Array) -> float:
    """Of Karush, Kuhn and Tucker: what no multipliers >= 0 of the rows that nearly hold balance of the gradient."""
    gradient, A, _ = problem.derivatives(x)
    return scipy.optimize.nnls(A[problem.value(x)[1] > -HOLDS].T, -gradient)[1]


@pytest.mark.parametrize("seed", range(12))
def test_minima_of_hilly_costs_have_multipliers_and_ipopt_finds_no_lower_point_from_them(seed: int) -> None:
    problem = hilly(seed)
    run = interior_point(problem, np.zeros(5), tolerance=1e-4, max_iterations=300)
    assert run.status is SolveStatus.SOLVED and run.violation <= KEPT
    assert residual(problem, run.x) < 5e-3
    f = problem.by_ipopt(run.x)[1]
    assert f <= run.objective + 1e-6  # it went down from there, not to another hollow
    assert run.objective - f < GAP


def test_hilly_costs_are_on_average_no_higher_than_by_ipopt() -> None:
    """Both end in some hollow, neither in the lower one by its nature."""
    ours, theirs = [], []
    for seed in range(100, 140):
        problem = hilly(seed)
        ours.append(interior_point(problem, np.zeros(5), tolerance=1e-4, max_iterations=300).objective)
        theirs.append(problem.by_ipopt(np.zeros(5))[1])
    difference = np.array(ours) - theirs
    assert np.mean(difference) < 3 * np.std(difference) / np.sqrt(len(difference))


@pytest.mark.parametrize("start", [(0.2, 0.1), (1e-3, 1e-9), (-0.5, -1e-4)])
def test_a_saddle_is_no_minimum(start) -> None:
    x = ca.SX.sym("x", 2)
    problem = Symbolic(x, x[0] ** 2 - x[1] ** 2, ca.sumsqr(x) - 1)
    run = interior_point(problem, np.array(start), tolerance=TIGHT, max_iterations=100)
    assert run.status is SolveStatus.SOLVED and run.objective == pytest.approx(-1, abs=1e-3)


def test_at_the_very_saddle_it_does_not_claim_a_solution() -> None:
    x = ca.SX.sym("x", 2)
    problem = Symbolic(x, x[0] ** 2 - x[1] ** 2, ca.sumsqr(x) - 1)
    assert not interior_point(problem, np.zeros(2), tolerance=TIGHT, max_iterations=20).status.ok


def test_units_of_unknowns_and_order_of_rows_do_not_matter() -> None:
    rng = np.random.default_rng(5)
    problem, size, order = hilly(3), 10 ** rng.uniform(-3, 3, 5), rng.permutation(61)
    run = interior_point(problem, np.zeros(5), tolerance=1e-4, max_iterations=300)
    z = ca.SX.sym("z", 5)
    f, h = ca.Function("of", [problem.x], [problem.f, problem.h])(z * ca.DM(size))
    other = interior_point(Symbolic(z, f, h[order.tolist()]), np.zeros(5), tolerance=1e-4, max_iterations=300)
    assert other.iterations == run.iterations
    np.testing.assert_allclose(other.x * size, run.x, atol=1e-6)


def test_the_nearest_point_of_a_disc_of_many_sides() -> None:
    run = interior_point(polygon(), np.zeros(2), tolerance=TIGHT, max_iterations=200)
    assert run.status is SolveStatus.SOLVED and run.message == "solved" and run.violation <= KEPT
    np.testing.assert_allclose(run.x, np.array([2.0, 1.0]) / np.sqrt(5), atol=TO_TOLERANCE)


@pytest.mark.parametrize("seed", range(8))
def test_random_problems_are_solved_as_by_ipopt(seed: int) -> None:
    problem = random_problem(seed)
    f = problem.by_ipopt(np.zeros(6))[1]
    run = interior_point(problem, np.zeros(6), tolerance=1e-4, max_iterations=300)
    assert run.status is SolveStatus.SOLVED
    assert run.objective == pytest.approx(f, abs=GAP) and run.objective >= f - GAP / 10
    assert np.max(problem.value(run.x)[1]) <= KEPT
    assert run.objective == problem.value(run.x)[0] and run.violation == max(0.0, np.max(problem.value(run.x)[1]))


def test_a_start_that_breaks_rows_is_led_back() -> None:
    problem = polygon()
    run = interior_point(problem, np.array([3.0, -2.0]), tolerance=TIGHT, max_iterations=200)
    assert run.status is SolveStatus.SOLVED and run.violation <= KEPT
    np.testing.assert_allclose(run.x, np.array([2.0, 1.0]) / np.sqrt(5), atol=TO_TOLERANCE)


@pytest.mark.parametrize("rows", [False, True])
def test_a_curved_valley_with_one_row_or_none(rows: bool) -> None:
    problem = rosenbrock(rows)
    run = interior_point(problem, np.array([-0.6, 0.4]), tolerance=TIGHT, max_iterations=300)
    x = problem.by_ipopt(np.array([-0.6, 0.4]))[0] if rows else np.ones(2)
    assert run.status is SolveStatus.SOLVED
    np.testing.assert_allclose(run.x, x, atol=TO_TOLERANCE)


def test_outside_the_domain_a_step_is_shortened() -> None:
    x = ca.SX.sym("x")
    problem = Symbolic(x, -ca.sqrt(1 - x) - x, -x - 5)  # stationary at 3/4, no number beyond 1
    run = interior_point(problem, np.array([-4.0]), tolerance=TIGHT, max_iterations=100)
    assert run.status is SolveStatus.SOLVED and run.x[0] == pytest.approx(0.75, abs=TO_TOLERANCE)


def test_same_input_same_result_and_a_warm_start_is_short() -> None:
    problem = random_problem(3)
    one, two = (interior_point(problem, np.zeros(6), tolerance=1e-4, max_iterations=300) for _ in range(2))
    np.testing.assert_array_equal(one.x, two.x)
    again = interior_point(problem, one.x, tolerance=1e-4, max_iterations=300, barrier=1e-3)
    assert again.status is SolveStatus.SOLVED and again.iterations < one.iterations
    assert again.objective == pytest.approx(one.objective, abs=GAP)


def test_how_runs_end() -> None:
    problem, start = random_problem(1), np.zeros(6)
    given = {"tolerance": 1e-4, "max_iterations": 300}
    few = interior_point(problem, start, **(given | {"max_iterations": 3}))
    assert few.status is SolveStatus.ITERATION_LIMIT and few.iterations == 3
    none = interior_point(problem, start, **(given | {"max_iterations": 0}))
    assert none.status is SolveStatus.ITERATION_LIMIT and none.iterations == 0
    np.testing.assert_array_equal(none.x, start)
    late = interior_point(problem, start, max_seconds=0.0, **given)
    assert late.status is SolveStatus.INTERRUPTED and late.message.count("time limit") == 1
    seen: list[tuple[int, float, float]] = []

    def stop(iteration: int, cost: float, violation: float) -> bool:
        seen.append((iteration, cost, violation))
        return iteration == 5

    asked = interior_point(problem, start, progress=stop, **given)
    assert asked.status is SolveStatus.INTERRUPTED and "stopped by the caller" in asked.message
    assert [k for k, *_ in seen] == list(range(6)) and asked.iterations == 5
    # what is kept is the best of what was seen, and it keeps all rows
    assert asked.objective == min(cost for _, cost, violation in seen if violation <= KEPT)
    assert np.max(problem.value(asked.x)[1]) <= KEPT
    nowhere = interior_point(problem, np.full(6, np.nan), **given)
    assert nowhere.status is SolveStatus.NOT_FINITE and not nowhere.status.ok


def test_rows_that_contradict_each_other_are_not_solved() -> None:
    x = ca.SX.sym("x", 2)
    problem = Symbolic(x, ca.sumsqr(x), ca.vertcat(x[0] + 1, 1 - x[0]))
    run = interior_point(problem, np.array([0.3, 0.3]), tolerance=TIGHT, max_iterations=60)
    assert not run.status.ok and run.violation >= 1 - 1e-6
    assert "violates a row by 1" in run.message
