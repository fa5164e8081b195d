"""What failures name, multipliers by name, and fatrop as another solver of the same NLP."""

from __future__ import annotations

import re

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import ModelError, SolveStatus, Trajectory, der
from gtmodel.optimize import Mesh, SolverOptions, resimulate, solve
from tests.optimize import features, problems
from tests.optimize.test_order import Regulator

COARSE = Mesh(4, 2)
SOLVER = 1e-6  # two roads to one discrete optimum
HERE = r"\(optimize/test_diagnosis.py:\d+\)"


class Rooted(gt.Optimization):
    """y = sqrt(x - limit) and z = 1 / y stand in equations of their own."""

    limit = gt.parameter(2.0)
    x = gt.variable(start=1.0, fixed=True)
    y = gt.variable(nominal=1.0)
    z = gt.variable()
    u = gt.input()
    final_time = 2.0

    def equations(self):
        yield der(self.x) == self.u + 0 * self.z
        yield self.y == gt.sqrt(self.x - self.limit)
        yield self.z == gt.exp(self.y) * self.u

    def objective(self):
        return gt.integral(self.y**2 + self.u**2 + self.z**2)


def failed(cls, mesh=COARSE, guess=None, **options):
    s = solve(cls(), mesh, guess=guess, throw=False, solver=SolverOptions(**options))
    assert not s.status.ok
    return s.message


class TestNotFinite:
    def test_value_operation_equation_and_time(self):
        class Shift(Rooted):
            x = gt.variable(start=3.0, fixed=True)  # the model has a consistent point; the guess leaves it

        guess = Trajectory([0.0, 2.0], {"x": [3.0, 1.0]})
        message = failed(Shift, guess=guess)
        assert re.search(
            rf"sqrt\(-0.[\d]+\) in 'Shift equation 2 {HERE}' at 1\.\d+ s \(element 3\) is not finite", message
        )

    def test_in_a_constraint_and_in_the_objective(self):
        class Path(features.Tank):
            def constraints(self):
                yield gt.log(self.x - 5) <= 1

        assert re.search(rf"log\(-4\) in 'constraint 1 {HERE}' at 0.1667 s \(element 1\)", failed(Path))

        class Cost(features.Tank):
            def objective(self):
                return gt.integral(1 / (self.x - 1) ** 2)

        assert re.search(r"(\(1\) / \(0\)|1 / \(0\)) in an integral of the objective at 0.1667 s", failed(Cost))

    def test_an_infinite_slope(self):
        class Edge(features.Tank):
            def objective(self):
                return gt.integral(gt.sqrt(self.u) + self.x**2)

        assert re.search(r"the derivative of sqrt\(0\) in an integral of the objective at 0.1667 s", failed(Edge))

    def test_nothing_eliminated(self):
        class Whole(problems.ImplicitBlock):
            y1 = gt.variable(start=1.0)

        guess = Trajectory([0.0, 4.0], {"x1": [1.0, -1.0], "x2": [1.0, 1.0]})
        message = failed(Whole, guess=guess, formulation="dae")
        assert re.search(r"sqrt\(-[\d.e-]+\) in 'Whole equation \d \(optimize/problems.py:\d+\)' at \d", message)

    def test_a_finite_failure_says_nothing_of_it(self):
        assert "not finite" not in failed(problems.StirredTank, max_iterations=2)


def test_more_conditions_than_unknowns():
    class Both(gt.Optimization):
        """Nothing to choose, but both ends are fixed."""

        x = gt.variable(start=1.0, fixed=True)
        y = gt.variable(start=0.0, fixed=True)

        def equations(self):
            yield der(self.x) == -self.x
            yield der(self.y) == self.x

        def objective(self):
            return gt.integral(self.x**2)

        def constraints(self):
            yield self.x.at(self.final_time) == 0.3
            yield self.x.at(0.5) * self.y.at(0.5) == 0.2

    message = failed(Both)
    ends = "y is fixed at the start, der(y) is fixed at the start, der(y) is fixed at the end, constraint 2 "
    assert re.search(r"equations for \d+ unknowns on 4 elements: " + re.escape(ends) + HERE, message), message
    assert "is an equation; remove one; worst rows: " in message


def test_worst_rows_have_equation_line_element_and_time():
    class Far(problems.ImplicitBlock):
        def constraints(self):
            yield self.x1.at(self.final_time) == 500.0

    message = failed(Far, formulation="dae", max_iterations=3)
    row = r"[\w' ]+(\(optimize/problems.py:\d+\) )?in element \d(, point \d)? \([\d.]+ s\) by [\d.e+]+"
    assert re.search(f"worst rows: {row}", message), message


class TestMultipliers:
    def test_costates_are_slopes_of_the_cost_to_go(self):
        """x' = u, int x^2 + u^2: cost to go tanh(tf - t) x^2, whose slope is the costate."""
        s = solve(Regulator(), Mesh(10, 3), solver=SolverOptions(tolerance=1e-11))
        t = np.linspace(0.0, 2.0, 11)[1:]
        x = np.cosh(2 - t) / np.cosh(2)
        assert s.multiplier("continuity of x") == pytest.approx(2 * np.tanh(2 - t) * x, abs=1e-6)

    def test_point_constraint(self):
        class To(Regulator):
            goal = gt.parameter(0.3)

            def constraints(self):
                yield self.x.at(self.final_time) * self.x.at(1.0) == self.goal

        tight = SolverOptions(tolerance=1e-11)
        low, mid, high = (solve(To(goal=g), Mesh(10, 3), solver=tight) for g in (0.299, 0.3, 0.301))
        slope = (high.objective - low.objective) / 0.002
        assert mid.multiplier("constraint 1") == pytest.approx(-slope, rel=1e-4)

    def test_path_and_bounds(self):
        """One limit as a bound and as a constraint of two variables: the same multipliers."""

        class Bound(features.Tank):
            u = gt.input(min=-0.1, max=1.0, nominal=0.5)

        class Path(features.Tank):
            u = gt.input(min=-1.0, max=1.0, nominal=0.5)

            def constraints(self):
                yield self.u + 0 * self.x + 0 * self.x**2 >= -0.1 - 0.1 * (self.x - self.x) * self.u

        a, b = solve(Bound(), Mesh(5, 3)), solve(Path(), Mesh(5, 3))
        assert a.objective == pytest.approx(b.objective, rel=SOLVER)
        assert a.bound_multiplier("u").shape == (5, 3) and np.min(a.bound_multiplier("u")) < -1e-3
        held = a.trajectory["u"][1:].reshape(5, 3) < -0.1 + 1e-6
        assert np.all(np.abs(a.bound_multiplier("u")[~held]) < 1e-5)

    def test_unknown_names(self):
        s = solve(Regulator(), COARSE, solver=SolverOptions(formulation="explicit"))
        assert s.multiplier_names == ("continuity of x", "rate of x")
        with pytest.raises(KeyError, match="0 rows begin with 'x'; names are continuity of x, rate of x"):
            s.multiplier("x")
        with pytest.raises(KeyError, match="no bounds belong to 'w'; names are x, u"):
            s.bound_multiplier("w")


class TestFatrop:
    @pytest.mark.parametrize(
        "cls, mesh, guess",
        [
            (problems.VanDerPol, Mesh(50, 3), None),
            (problems.VanDerPolPath, Mesh(50, 3), None),
            (problems.VanDerPolMayer, Mesh(40, 2, "gauss"), None),
            (problems.StateConstraint, Mesh(20, 3, control="constant"), None),
            (problems.LinearAlgebraic, Mesh(20, 3, control="linear"), None),
        ],
    )
    def test_the_same_optimum(self, cls, mesh, guess):
        start = guess() if guess else None
        a = solve(cls(), mesh, guess=start)
        b = solve(cls(), mesh, guess=start, solver=SolverOptions(solver="fatrop"))
        assert b.objective == pytest.approx(a.objective, rel=SOLVER)
        assert b.checks["constraint_violation"].passed
        name = a.multiplier_names[0]
        assert b.multiplier(name) == pytest.approx(
            a.multiplier(name), rel=1e-3, abs=1e-3 * np.max(np.abs(a.multiplier(name)))
        )

    def test_badly_scaled_at_a_tolerance_that_it_reaches(self):
        """fatrop scales neither rows nor cost: 1e-8 is out of its reach here."""
        guess, options = problems.stirred_tank_guess(), {"solver": "fatrop", "tolerance": 1e-5}
        s = solve(problems.StirredTank(), Mesh(50, 3), guess=guess, solver=SolverOptions(**options))
        assert s.objective == pytest.approx(1857.6873858, rel=SOLVER)

    def test_what_couples_elements_is_refused(self):
        for cls, mesh, what in (
            (problems.DoubleIntegrator, COARSE, "the constants final_time"),
            (features.InteriorPoints, COARSE, r"a value at 0\.\d+ of the horizon"),
        ):
            with pytest.raises(ModelError, match=f"'fatrop' needs elements coupled by states only; found {what}"):
                solve(cls(), mesh, solver=SolverOptions(solver="fatrop"))

    def test_it_says_when_it_fails(self):
        s = solve(problems.VanDerPol(), throw=False, solver=SolverOptions(solver="fatrop", max_iterations=2))
        assert s.status is SolveStatus.ITERATION_LIMIT and "fatrop ended after" in s.message

    @pytest.mark.parametrize("options", [{"hessian": "lbfgs"}, {"max_seconds": 1.0}, {"compile": True}])
    def test_options(self, options):
        with pytest.raises(ValueError, match="fatrop supports neither lbfgs nor max_seconds nor compile"):
            SolverOptions(solver="fatrop", **options)


def test_what_happens_between_the_nodes():
    """Violation and cost by re-simulation, on a mesh where both are plain to see."""
    s = solve(problems.VanDerPolPath(), Mesh(8, 3))
    run = resimulate(s)
    assert run.violation > 1e-3 and run.violated.startswith("constraint 1 (optimize/problems.py:")
    assert abs(run.cost_error) > 1e-3


class TestRunsAway:
    """x' = u without a bound on u, and the least x: nothing stops it."""

    def failure(self, **changes) -> str:
        class Falls(gt.Optimization):
            x = gt.variable(start=1.0, fixed=True)
            u = gt.input()

            def equations(self):
                yield der(self.x) == self.u

            def objective(self):
                return self.x.at(1.0)

        made = type("Falls", (Falls,), changes)()
        solution = solve(made, Mesh(4), solver=SolverOptions(max_iterations=60), throw=False)
        assert not solution.status.ok
        return solution.message

    def test_names_what_grows(self):
        assert re.search(r"'[ux]' has grown to -\d\S* in element \d and has no bound there; bound it", self.failure())

    def test_names_a_constant(self):
        said = self.failure(
            k=gt.free(1.0), u=gt.input(min=-1.0, max=1.0), objective=lambda self: self.x.at(1.0) - self.k
        )
        assert re.search(r"'k' has grown to \d\S* and has no bound", said)


def test_a_model_without_variables():
    class Nothing(gt.Optimization):
        k = gt.free(1.0, min=0.0)

        def objective(self):
            return (self.k - 2) ** 2

    with pytest.raises(ModelError, match="Nothing has no variable"):
        solve(Nothing())
