"""Objectives in small units: the same optimum as in large ones; and what estimates say of them. Data are synthetic."""

from __future__ import annotations

import io
import sys
from contextlib import redirect_stderr

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import ModelError, SolveStatus, der
from gtmodel.optimize import Mesh, Phases, SolverOptions, estimate, multi_start, refine, solve, solve_phases, transcribe

SEED, NOISE = 3, 0.02
TIMES = np.linspace(0.0, 2.0, 21)
DATA = 0.3 + 1.2 * TIMES + NOISE * np.random.default_rng(SEED).standard_normal(21)
COLUMNS = np.column_stack([TIMES, np.ones_like(TIMES)])
BEST, REST, *_ = np.linalg.lstsq(COLUMNS, DATA, rcond=None)


def line(unit: float, nominal: float = 1.0, **changes):
    class Line(gt.Optimization):
        b = gt.free(0.0)
        x = gt.variable(start=0.0, nominal=nominal)
        final_time = 2.0

        def equations(self):
            yield der(self.x) == self.b

        def objective(self):
            return gt.misfit(self.x, TIMES, unit * DATA)

    return type("Line", (Line,), changes)()


@pytest.mark.parametrize("nominal", ["of the data", "none"])
@pytest.mark.parametrize("unit", [1.0, 1e-3, 1e-6])
def test_a_misfit_in_any_unit(unit, nominal):
    s = solve(line(unit, unit if nominal == "of the data" else 1.0), Mesh(4, 2))
    e = estimate(s)
    assert s.iterations > 0
    assert e.values == pytest.approx(unit * BEST, rel=1e-5)
    deviation = np.sqrt(np.diag(REST[0] / 19 * np.linalg.inv(COLUMNS.T @ COLUMNS)))
    assert e.std == pytest.approx(unit * deviation, rel=1e-5)


@pytest.mark.parametrize("solver", ["ipopt", "fatrop"])
@pytest.mark.parametrize("size", [1e-3, 1e-5])
def test_a_small_distance(size, solver):
    """Least (x(1) - r)^2 + u^2-cost: x = r / 2 at slope multiplier r; in SI units whatever the scale."""

    class Reach(gt.Optimization):
        x = gt.variable(start=0.0, fixed=True, nominal=size)
        u = gt.input(nominal=size)
        final_time = 1.0

        def equations(self):
            yield der(self.x) == self.u

        def objective(self):
            return (self.x.at(1.0) - size) ** 2 + gt.integral(self.u**2)

    s = solve(Reach(), Mesh(4), solver=SolverOptions(solver=solver))
    assert s.trajectory["x"][-1] == pytest.approx(size / 2, rel=1e-6)
    assert s.objective == pytest.approx(size**2 / 2, rel=1e-6)
    assert np.abs(s.multiplier("continuity of x")) == pytest.approx(size, rel=1e-5)


PRIORS = {
    "at the optimum": lambda self: gt.misfit(self.x, TIMES, 0.3 + 1.2 * TIMES, sigma=NOISE) + 1e8 * (self.b - 1.2) ** 2,
    "flat there": lambda self: gt.misfit(self.x, TIMES, 0.3 + 1.2 * TIMES, sigma=NOISE) + (self.b - 1.2) ** 4,
    "of an integral": lambda self: gt.misfit(self.x, TIMES, 0.0 * TIMES, sigma=NOISE) + gt.integral(self.x**2),
    "of micrometres": lambda self: gt.misfit(self.x, TIMES, 1e-6 * DATA) + 1e-3 * (self.b - 1.2e-6) ** 2,
    "weight": lambda self: 2 * gt.misfit(self.x, TIMES, 1e-6 * DATA),
}


@pytest.mark.parametrize("name", PRIORS)
def test_a_prior_is_noticed_also_where_it_vanishes(name):
    s = solve(line(1.0, objective=PRIORS[name]), Mesh(4, 2))
    with pytest.raises(ModelError, match="the objective contains terms other than misfits"):
        estimate(s)


@pytest.mark.parametrize(
    "sigma, sentence",
    [
        (np.inf, "positive and finite; found inf"),
        ([0.1, 0.2, 0.3], r"one number, or one for each of 1 columns; found \(3,"),
    ],
)
def test_wrong_sigma(sigma, sentence):
    with pytest.raises(ModelError, match=sentence):
        solve(line(1.0, objective=lambda self: gt.misfit(self.x, TIMES, DATA, sigma=sigma)), Mesh(2))


class TestPhases:
    """One decay cut in two: the estimate of both together is that of the whole."""

    def model(self, name: str, first: int, last: int, **changes):
        times = np.linspace(0.1, 3.0, 30)
        data = np.exp(-0.7 * times) + NOISE * np.random.default_rng(SEED).standard_normal(30)

        class Decay(gt.Optimization):
            k = gt.free(0.5, min=0.01)
            x = gt.variable(start=1.0)

            def equations(self):
                yield der(self.x) == -self.k * self.x

            def objective(self):
                return gt.misfit(self.x, times[first:last], data[first:last], sigma=NOISE)

        return type(name, (Decay,), changes)()

    def test_together(self):
        whole = estimate(solve(self.model("Whole", 0, 30, final_time=3.0), Mesh(10)))
        a, b = self.model("A", 0, 10, final_time=1.0), self.model("B", 10, 30, start_time=1.0, final_time=3.0)
        s = solve_phases(Phases({"a": a, "b": b}, shared=["k"]), Mesh(5))
        e = estimate(s)
        assert e.names == ("a: k", "a: x at the start") and e.degrees_of_freedom == whole.degrees_of_freedom == 28
        assert e.values == pytest.approx(whole.values, rel=1e-6)
        assert e.covariance == pytest.approx(whole.covariance, rel=1e-5)
        with pytest.raises(ModelError, match="A is one of several linked phases"):
            estimate(s["a"])
        own = estimate(solve_phases(Phases({"a": a, "b": b}, free={"b": ["x"]}), Mesh(5)))
        assert own.names == ("a: k", "a: x at the start", "b: k", "b: x at the start") and own.degrees_of_freedom == 26


class TestStarts:
    class Twins(gt.Optimization):
        """Two optima of one cost, 0, that differ in the constant alone: k = 1 and k = -1."""

        k = gt.free(0.0, min=-5, max=5)
        x = gt.variable(start=0.1)
        u = gt.input(min=-1, max=1)
        final_time = 1.0

        def equations(self):
            yield der(self.x) == 0.001 * self.u

        def objective(self):
            return (self.k**2 - 1) ** 2 + gt.integral(self.u**2) + (self.x.at(1.0) - 1) ** 2

    def test_a_constant_of_guess_zero_is_changed_and_tells_optima_apart(self):
        found = multi_start(transcribe(self.Twins(), Mesh(3)), 12, spread=1.0)
        low = [o for o in found.optima if o.objective < 0.5]
        assert sorted(round(o.solution.free["k"], 6) for o in low) == [-1.0, 1.0]
        assert len(found.optima) == len(low) + 1  # the guess itself is the maximum between them

    def test_costs_near_zero_are_one(self):
        class One(self.Twins):
            k = gt.free(0.5, min=0.1, max=5)

        found = multi_start(transcribe(One(), Mesh(3)), 10, spread=0.5)
        assert len(found.optima) == 1 and found.optima[0].count == 10

    def test_controls_tell_optima_apart(self):
        class Square(gt.Optimization):
            v = gt.variable(start=0.0, fixed=True)
            u = gt.input(min=-3, max=3, start=0.3)
            final_time = 1.0

            def equations(self):
                yield der(self.v) == self.u**2

            def objective(self):
                return gt.integral((self.u**2 - 1) ** 2) + 2

        explicit = SolverOptions(formulation="explicit")
        found = multi_start(transcribe(Square(), Mesh(1, 1), solver=explicit), 8, spread=1.0)
        assert len(found.optima) == 2 and found.optima[1].distance == pytest.approx(2.0, rel=1e-4)


class Simple(gt.Optimization):
    x = gt.variable(start=1.0, fixed=True)
    u = gt.input(min=-1.0, max=1.0)
    final_time = 1.0

    def equations(self):
        yield der(self.x) == self.u - self.x

    def objective(self):
        return gt.integral(self.x**2 + self.u**2)


def test_what_is_not_finite_at_instants_is_named():
    root = type("Root", (Simple,), {"objective": lambda self: gt.sqrt(self.x.at(1.0) - 5)})()
    assert "sqrt(-4) in the objective is not finite" in solve(root, Mesh(4), throw=False).message
    log = type("Log", (Simple,), {"constraints": lambda self: [gt.log(self.x.at(0.5) - 2) <= 0]})()
    message = solve(log, Mesh(4), throw=False).message
    assert "log(-1) in 'constraint 1 (" in message and "is not finite" in message


def test_an_exception_in_progress_is_its_own_and_nothing_is_printed():
    def progress(*args):
        raise KeyboardInterrupt("here")

    with redirect_stderr(io.StringIO()) as printed, pytest.raises(KeyboardInterrupt, match="here"):
        solve(Simple(), Mesh(4), progress=progress)
    held = type("Held", (Simple,), {"constraints": lambda self: [self.x + 0 * self.u == 1.0, self.x * self.u == 1.0]})()
    with redirect_stderr(printed):
        solve(held, Mesh(4), throw=False)
    assert printed.getvalue() == ""


def test_shooting_has_one_solver():
    with pytest.raises(ModelError, match="shooting needs solver 'ipopt'; found 'fatrop'"):
        solve(Simple(), Mesh(3), method="shooting", solver=SolverOptions(solver="fatrop"))


def late(history):
    class Late(gt.Optimization):
        u = gt.input(min=-1, max=1)
        late = gt.delayed(u, 1.0, history=history)
        x = gt.variable(start=1.0, fixed=True)
        final_time = 4.0

        def equations(self):
            yield der(self.x) == self.late

        def objective(self):
            return gt.integral((self.x - 2) ** 2 + 0.01 * self.u**2)

    return Late()


@pytest.mark.parametrize("history", [np.nan, "abc", lambda t: np.inf], ids=["nan", "text", "infinite"])
def test_a_history_is_finite(history):
    with pytest.raises(ModelError, match="the history of 'late' must be a finite number at"):
        solve(late(history), Mesh(8))


def test_refine_says_what_it_cannot_and_ends_at_a_failure():
    with pytest.raises(ModelError, match=r"Late: refine\(\) moves mesh edges, but the delay of 'late' fixes them"):
        refine(late(0.0), Mesh(8), tolerance=1e-4)
    far = type("Far", (Simple,), {"constraints": lambda self: [self.x.at(1.0) == 100]})()
    r = refine(far, Mesh(4), tolerance=1e-4, throw=False)
    assert r.solution.status is SolveStatus.INFEASIBLE and len(r.passes) == 1 and not r.reached


def test_a_later_pass_that_fails_ends_it_too(monkeypatch):
    module = sys.modules["gtmodel.optimize.judgement.refine"]
    calls = []

    def second_fails(*args, **options):
        calls.append(options)
        limit = SolverOptions(max_iterations=0) if len(calls) == 2 else SolverOptions()
        return solve(*args, **{**options, "solver": limit, "guess": None})

    monkeypatch.setattr(module, "solve", second_fails)
    r = refine(Simple(), Mesh(2, 2), tolerance=1e-9, throw=False)
    assert r.solution.status is SolveStatus.ITERATION_LIMIT and r.solution.message.startswith("pass 2 of refine(): ")
    assert r.passes[0].elements == 2 and len(calls) == 2 and not r.reached


def test_entries_of_a_matrix_are_recorded_and_guess_themselves():
    class Matrix(gt.Optimization):
        X = gt.variable((2, 2), start=[[1.0, 2.0], [3.0, 4.0]], fixed=True)
        u = gt.input((2, 2))
        final_time = 1.0

        def equations(self):
            yield der(self.X) == self.u

        def objective(self):
            return gt.integral(sum(self.u[i, j] ** 2 for i in range(2) for j in range(2)))

        def constraints(self):
            yield self.X.at(1.0) == np.array([[0.0, 1.0], [5.0, 9.0]])

    s = solve(Matrix(), Mesh(3))
    assert s.objective == pytest.approx(1 + 1 + 4 + 25, rel=1e-6)
    assert s.trajectory["X[0,1]"][[0, -1]] == pytest.approx([2.0, 1.0], abs=1e-6)
    from gtmodel.optimize.guess import initial_guess

    assert initial_guess(s.nlp, s) == pytest.approx(s.x, abs=1e-9)
    assert initial_guess(s.nlp, s.trajectory) == pytest.approx(s.x, abs=1e-9)


def test_one_unknown_in_each_element_is_refused():
    class Bare(gt.Optimization):
        u = gt.input(min=-3, max=3, start=0.3)
        final_time = 1.0

        def objective(self):
            return gt.integral((self.u**2 - 1) ** 2)

    with pytest.raises(ModelError, match="Bare has no state and only one unknown per element"):
        solve(Bare(), Mesh(2, 1))
    assert solve(Bare(), Mesh(2, 2)).objective == pytest.approx(0.0, abs=1e-8)
