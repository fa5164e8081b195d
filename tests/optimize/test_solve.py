"""What solve() says: statuses, sentences of wrong problems, stops on the way; and problems with inner constraints."""

from __future__ import annotations

import re
import time

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import ModelError, SolveStatus, Trajectory, der
from gtmodel.optimize import Mesh, NotSolved, SolverOptions, solve
from gtmodel.optimize.judgement.resimulate import resimulate
from tests.optimize.features import Tank
from tests.optimize.problems import DoubleIntegrator, StirredTank, VanDerPol, VanDerPolTime
from tests.support.models import Pendulum, SliderCrank

COARSE = Mesh(5, 2)
# Two ways of writing one mechanism have the same motion; each is collocated with an error of some 1e-9 on 40 x 3.
TWO_MODELS = 1e-7


def case(base=Tank, **changes):
    """A variant of a problem: methods given as functions of self."""
    return type("Case", (base,), changes)()


class Doubled(Tank):
    """With a variable that is no state."""

    y = gt.variable()

    def equations(self):
        yield from super().equations()
        yield self.y == 2 * self.x


def attempt(model, mesh=COARSE, **options):
    return solve(model, mesh, throw=False, solver=SolverOptions(**options))


WRONG = {
    "no objective": (
        lambda: type("Bare", (gt.Optimization,), {"x": gt.variable(), "equations": lambda self: [der(self.x) == 1]})(),
        "Bare has no objective; define objective",
    ),
    "vector objective": (
        lambda: case(objective=lambda self: gt.vector([self.x, self.u])),
        r"Case.objective\(\) must return a scalar expression; found .*shape=\(2,\)",
    ),
    "objective is a number": (
        lambda: case(objective=lambda self: 3.0),
        r"Case.objective\(\) must return a scalar expression; found 3.0",
    ),
    "objective returns nothing": (
        lambda: case(objective=lambda self: None),
        r"Case.objective\(\) must return a scalar expression; found None",
    ),
    "objective along the path": (
        lambda: case(objective=lambda self: self.x**2),
        r"objective\(\) contains x along the whole path; use a value .at\(...\) or gt.integral\(...\)",
    ),
    "integral of an instant": (
        lambda: case(objective=lambda self: gt.integral(self.x - self.x.at(0.0))),
        r"the argument of gt.integral\(\) contains a value at an instant",
    ),
    "constraints return nothing": (
        lambda: case(constraints=lambda self: None),
        r"constraints\(\) of Case returned nothing; expected 'yield' in front of each relation",
    ),
    "constraints yield a bool": (
        lambda: case(constraints=lambda self: [True]),
        r"Case.constraints\(\) yielded bool; expected a relation",
    ),
    "chained comparison": (
        lambda: case(constraints=lambda self: [-1 <= self.u <= 1]),
        r"has no truth value .* write gt.between\(a, x, b\).*optimize/test_solve.py",
    ),
    "path and instant in one constraint": (
        lambda: case(constraints=lambda self: [self.x <= self.x.at(0.0)]),
        r"constraint 1 \(optimize/test_solve.py:\d+\) contains x along the whole path, together with a value",
    ),
    "constraint on nothing": (
        lambda: case(rate=gt.parameter(2.0), constraints=lambda self: [self.rate <= 1]),
        r"constraint 1 .* contains no variable or free constant",
    ),
    "bounds cross": (
        lambda: case(constraints=lambda self: [self.x <= 0.5, self.x >= 0.7]),
        "the bounds of 'x' contradict each other: at least 0.7 and at most 0.5",
    ),
    "start out of bounds": (
        lambda: case(constraints=lambda self: [self.x <= 0.5]),
        "the bounds of 'x' contradict each other at the start: at least 1 and at most 0.5",
    ),
    "end out of bounds": (
        lambda: case(constraints=lambda self: [self.x <= 2.0, self.x.at(self.final_time) == 3.0]),
        "the bounds of 'x' contradict each other at the end: at least 3 and at most 2",
    ),
    "bounds of a free constant cross": (
        lambda: case(k=gt.free(1.0, min=2.0, max=1.5)),
        "the bounds of 'k' contradict each other: at least 2 and at most 1.5",
    ),
    "free final time that begins with none": (
        lambda: case(final_time=gt.free(0.0)),
        "the free horizon is 0 s long at its guess; guess an end after the start, or bound it",
    ),
    "both ends free and turned round": (
        lambda: case(start_time=gt.free(1.0), final_time=gt.free(0.5)),
        r"free horizon is -0.5 s long at its guess; .*gt.free\(guess=..., min=0.1\) \(optimize/test_solve.py:\d+\)",
    ),
    "horizon reversed": (lambda: case(start_time=3.0), "the horizon ends at 2 s, but starts at 3 s"),
    "horizon empty": (lambda: case(start_time=2.0), "the horizon ends at 2 s, but starts at 2 s"),
    "final time is a text": (
        lambda: case(final_time="2"),
        r"final_time must be a number \[s\], a gt.parameter or gt.free\(...\); found '2'",
    ),
    "instant outside": (
        lambda: case(constraints=lambda self: [self.x.at(2.5) <= 1]),
        r"the instant 2.5 s of .at\(\) lies outside the horizon",
    ),
    "instant that moves": (
        lambda: case(final_time=gt.free(2.0, min=1.0), constraints=lambda self: [self.x.at(0.5) <= 1]),
        r"an instant of .at\(\) is not fixed in the horizon; use its ends",
    ),
    "fixed start of no state": (
        lambda: case(Doubled, y=gt.variable(start=2.0, fixed=True)),
        "'y' has a fixed start but is not a state; states are x .optimize/test_solve.py",
    ),
    "derivative of a control": (
        lambda: case(constraints=lambda self: [der(self.u) <= 1]),
        r"Case needs der\(u\), but a control may jump; declare the control as a state",
    ),
    "no optimisation": (
        lambda: type("Plain", (gt.Model,), {"x": gt.variable(), "equations": lambda self: [der(self.x) == -self.x]})(),
        "Plain is not a gt.Optimization",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_wrong_problem(name):
    make, sentence = WRONG[name]
    with pytest.raises(ModelError, match=sentence):
        solve(make(), COARSE)


def test_inverse_form_where_there_is_none():
    class Cart(gt.Optimization):
        x = gt.variable(start=0.0, fixed=True)
        u = gt.input(2)

        def equations(self):
            yield der(self.x) == self.u[0] + self.u[1] ** 3

        def objective(self):
            return gt.integral(gt.dot(self.u, self.u))

    with pytest.raises(ModelError, match=r"2 controls for 1 coordinates.*use formulation 'explicit'"):
        attempt(Cart(), formulation="inverse")
    assert attempt(Cart()).problem.formulation == "explicit"


@pytest.mark.parametrize(
    "options, sentence",
    [
        (dict(tolerance=0.0), "tolerance must lie between 0 and 1; found 0"),
        (dict(tolerance="small"), "tolerance and max_seconds must be numbers .* found 'small'"),
        (dict(max_iterations=2.5), "max_iterations an integer; found .* 2.5"),
        (dict(prefer="tau"), "prefer takes a list of names; found 'tau'"),
        (dict(max_iterations=-1), "must be >= 0; found -1 and None"),
        (dict(max_seconds=-2.0), "must be >= 0; found 1000 and -2.0"),
        (dict(max_seconds=float("nan")), "must be >= 0; found 1000 and nan"),
        (dict(formulation="implicit"), "formulation is one of auto, inverse, explicit, torn, dae; found 'implicit'"),
        (dict(hessian="bfgs"), "hessian is one of exact, lbfgs; found 'bfgs'"),
    ],
)
def test_wrong_options(options, sentence):
    with pytest.raises(ValueError, match=sentence):
        SolverOptions(**options)


def test_misspelt_keywords():
    with pytest.raises(TypeError, match="has no argument 'guss'; did you mean 'guess'"):
        solve(Tank(), COARSE, guss=None)
    for call in (lambda: SolverOptions(tol=1e-6), lambda: Mesh(element=5)):
        with pytest.raises(TypeError, match="unexpected keyword argument"):
            call()


class TestGuess:
    def test_none_of_the_states(self):
        with pytest.raises(ModelError, match="the guess contains none of the states x"):
            solve(Tank(), COARSE, guess=Trajectory([0.0, 1.0], {"level": [1.0, 2.0]}))

    def test_one_row_is_a_constant(self):
        guess = Trajectory([0.0], {"x": [0.5]})
        assert attempt(Tank(), max_iterations=0).trajectory["x"][-1] == pytest.approx(1.0)
        first = solve(Tank(), COARSE, guess=guess, throw=False, solver=SolverOptions(max_iterations=0))
        assert first.trajectory["x"][1:] == pytest.approx([0.5] * 10)

    def test_time_span_is_the_guess_of_a_free_horizon(self):
        guess = Trajectory([0.0, 3.5], {"x1": [0.0, 0.0], "x2": [1.0, 0.0]})
        first = solve(VanDerPolTime(), COARSE, guess=guess, throw=False, solver=SolverOptions(max_iterations=0))
        assert first.final_time == pytest.approx(3.5)

    def test_other_names_and_signs(self):
        """A state is found under the name of any variable that equals it, up to the sign."""

        class Named(DoubleIntegrator):
            back = gt.variable()

            def equations(self):
                yield from super().equations()
                yield self.back == -self.v

        guess = Trajectory([0.0, 2.0], {"x": [1.0, 0.0], "back": [0.0, 3.0]})
        first = solve(Named(), COARSE, guess=guess, throw=False, solver=SolverOptions(max_iterations=0))
        assert first.problem.state_names == ["x", "der(x)"]
        assert first.trajectory["v"][5] == pytest.approx(-3.0 * first.trajectory.time[5] / 2.0)

    def test_start_value_of_another_name(self):
        class Named(DoubleIntegrator):
            v = gt.variable()
            back = gt.variable(start=0.25)

            def equations(self):
                yield from super().equations()
                yield self.back == -self.v

        assert attempt(Named(), max_iterations=0).trajectory["v"] == pytest.approx(-0.25)


class TestStops:
    def test_callback_keeps_the_best_iterate(self):
        seen = []

        def progress(iteration, objective, violation):
            seen.append((iteration, objective, violation))
            return iteration == 7

        solution = solve(StirredTank(), Mesh(20, 3), progress=progress, throw=False)
        assert solution.status is SolveStatus.INTERRUPTED and not solution.status.ok
        assert [s[0] for s in seen] == list(range(8)) and solution.iterations == 7
        # what came nearest to its constraints is kept, but for the bounds that it is brought back to; never the guess
        number, objective, violation = min(seen[1:], key=lambda s: s[2])
        assert violation < 0.5 * seen[-1][2]
        assert solution.objective == pytest.approx(objective, rel=1e-6)
        assert solution.checks["constraint_violation"].value == pytest.approx(violation, rel=1e-6)
        assert f"returned iterate {number}, which has the smallest violation" in solution.message
        assert "stopped by the caller" in solution.message
        again = solve(StirredTank(), Mesh(20, 3), guess=solution)
        assert again.status.converged

    def test_progress_numbers(self):
        seen = []
        solution = solve(VanDerPol(), COARSE, progress=lambda *numbers: seen.append(numbers))
        assert [s[0] for s in seen] == list(range(solution.iterations + 1))
        assert seen[-1][1] == pytest.approx(solution.objective, rel=1e-6)
        assert seen[0][2] > 1e-3 and 0 <= seen[-1][2] < 1e-6

    def test_max_seconds(self):
        def slow(*_):
            time.sleep(0.02)
            return False

        solution = solve(StirredTank(), Mesh(20, 3), progress=slow, throw=False, solver=SolverOptions(max_seconds=0.1))
        assert solution.status is SolveStatus.INTERRUPTED
        assert 1 <= solution.iterations <= 6
        assert np.all(np.isfinite(solution.x))

    def test_max_iterations(self):
        solution = attempt(StirredTank(), Mesh(20, 3), max_iterations=3)
        assert solution.status is SolveStatus.ITERATION_LIMIT and solution.iterations == 3
        assert solution.message.startswith("the iteration limit was reached before the tolerance was")

    def test_not_solved_is_raised_with_the_iterate(self):
        with pytest.raises(NotSolved, match="the iteration limit was reached") as caught:
            solve(StirredTank(), Mesh(20, 3), solver=SolverOptions(max_iterations=3))
        assert caught.value.solution.iterations == 3
        assert caught.value.solution.trajectory.duration == pytest.approx(150.0)

    def test_not_finite(self):
        solution = attempt(case(objective=lambda self: gt.integral(gt.log(self.x - 3))))
        assert solution.status is SolveStatus.NOT_FINITE
        assert "was not a finite number" in solution.message


class TestInfeasible:
    def test_names_the_worst_rows(self):
        """x moves at most 1 per second: 5 is out of reach in 2 s."""

        class Far(DoubleIntegrator):
            final_time = 2.0

            def objective(self):
                return gt.integral(self.u**2)

            def constraints(self):
                yield self.x.at(self.final_time) == 5

        solution = attempt(Far())
        assert solution.status is SolveStatus.INFEASIBLE
        assert solution.message.startswith("no point was found that satisfies all constraints (IPOPT: Infeasible_Probl")
        worst = solution.message.split("worst rows: ")[1]
        assert re.match(r"continuity of (x|der\(x\)) in element \d \([\d.]+ s\) by \d", worst)
        assert not solution.checks["constraint_violation"].passed

    def test_names_a_point_constraint_with_its_line(self):
        solution = attempt(case(constraints=lambda self: [self.x.at(2.0) * self.x.at(1.0) >= 5]), max_iterations=0)
        worst = (
            r"worst rows: constraint 1 \(optimize/test_solve.py:\d+\) by 4; "
            r"rate of x in element \d, point \d \([\d.]+ s\) by 0"
        )
        assert re.search(worst, solution.message)

    def test_names_a_path_constraint_with_its_place(self):
        solution = attempt(case(constraints=lambda self: [self.x**2 + self.u**2 <= 0.1]))
        assert solution.status is SolveStatus.INFEASIBLE
        assert "in element 1, point 1 (0.1333 s) by " in solution.message


def test_fixed_start_and_initial_equations_are_held():
    class Begun(Tank):
        x = gt.variable(start=0.8)  # a guess only
        y = gt.variable()

        def equations(self):
            yield from super().equations()
            yield der(self.y) == self.x

        def initial_equations(self):
            yield self.x == 0.5
            yield self.y**2 + self.y == 2  # 1, from the guess 0

    solution = solve(Begun(), COARSE)
    assert solution.trajectory["x"][0] == pytest.approx(0.5, abs=1e-9)
    assert solution.trajectory["y"][0] == pytest.approx(1.0, abs=1e-7)


def test_the_same_solve_twice_gives_the_same_numbers():
    first, second = (solve(VanDerPolTime(), Mesh(20, 3)) for _ in range(2))
    assert np.array_equal(first.x, second.x) and np.array_equal(first.multipliers, second.multipliers)
    model = VanDerPolTime()
    third, fourth = (solve(model, Mesh(20, 3)) for _ in range(2))
    assert np.array_equal(first.x, third.x) and np.array_equal(third.x, fourth.x)
    assert first.trajectory == fourth.trajectory


def test_one_model_in_two_formulations_one_after_the_other():
    """Nothing that was kept of the first disturbs the second."""
    model = VanDerPol()
    found = {f: attempt(model, Mesh(20, 3), formulation=f) for f in ("explicit", "inverse", "explicit")}
    assert {s.problem.formulation for s in found.values()} == {"explicit", "inverse"}
    for solution in found.values():
        assert solution.trajectory["u"].shape == (61,)
        assert solution.objective == pytest.approx(found["explicit"].objective, rel=1e-7)


def test_nothing_to_choose_but_a_constant():
    from tests.optimize.features import NoControl

    solution = solve(NoControl(), Mesh(20, 3))
    assert solution.free["k"] == pytest.approx(0.7, rel=1e-7)


class SwingUp(gt.Optimization):
    """A pendulum whose motor lifts no more than half of its weight, from hanging to standing in least time."""

    g = gt.parameter(9.81, unit="m/s2")
    L = gt.parameter(1.0, unit="m", positive=True)
    theta = gt.variable(unit="1", start=0.0, fixed=True)
    omega = gt.variable(unit="1/s", start=0.0, fixed=True)
    torque = gt.input(unit="1/s2", min=-5.0, max=5.0)
    final_time = gt.free(3.0, min=0.5, unit="s")

    def equations(self):
        yield der(self.theta) == self.omega
        yield der(self.omega) == -self.g / self.L * gt.sin(self.theta) + self.torque

    def objective(self):
        return self.final_time

    def constraints(self):
        yield self.theta.at(self.final_time) == np.pi
        yield self.omega.at(self.final_time) == 0


def test_pendulum_swings_up():
    solution = solve(SwingUp(), Mesh(40, 3, control="constant"))
    run = resimulate(solution)
    # work of the motor, exact for torque constant per element, lifts the pendulum by 2 g L
    at_edges = slice(0, None, 8)
    work = np.sum(run.trajectory["torque"][8::8] * np.diff(run.trajectory["theta"][at_edges]))
    assert work == pytest.approx(2 * 9.81, abs=0.05)  # what the collocation misses of the goal
    assert run.trajectory["theta"].min() < -0.5  # it must swing back first
    assert solution.final_time == pytest.approx(2.3857, abs=0.02)


class CartesianSwing(Pendulum, gt.Optimization):
    """The Cartesian pendulum (index 3) pushed sideways from -0.2 to 0.3 m in 1 s with least effort."""

    push = gt.input(unit="N")

    def equations(self):
        yield self.m * der(self.x, 2) == -self.tension * self.x + self.push
        yield self.m * der(self.y, 2) == -self.tension * self.y - self.m * self.g
        yield self.x**2 + self.y**2 == self.L**2

    def objective(self):
        return gt.integral(self.push**2)

    def constraints(self):
        yield self.x.at(0.0) == -0.2
        yield self.x.at(1.0) == 0.3
        yield der(self.x).at(0.0) == 0
        yield der(self.x).at(1.0) == 0


class AngleSwing(gt.Optimization):
    """The same in the angle."""

    phi = gt.variable()
    push = gt.input()

    def equations(self):
        yield der(self.phi, 2) == -9.81 * gt.sin(self.phi) + gt.cos(self.phi) * self.push

    def objective(self):
        return gt.integral(self.push**2)

    def constraints(self):
        yield self.phi.at(0.0) == -np.arcsin(0.2)
        yield self.phi.at(1.0) == np.arcsin(0.3)
        yield der(self.phi).at(0.0) == 0
        yield der(self.phi).at(1.0) == 0


@pytest.mark.parametrize("formulation", ["explicit", "inverse"])
def test_cartesian_pendulum_is_the_angle_pendulum(formulation):
    a = attempt(CartesianSwing(), Mesh(40, 3), formulation=formulation)
    b = solve(AngleSwing(), Mesh(40, 3))
    assert a.status.ok and a.problem.formulation == formulation
    assert a.objective == pytest.approx(b.objective, rel=TWO_MODELS)
    assert a.trajectory["x"] == pytest.approx(np.sin(b.trajectory["phi"]), abs=TWO_MODELS)
    assert a.trajectory["y"] == pytest.approx(-np.cos(b.trajectory["phi"]), abs=TWO_MODELS)
    # the rod's pull, a multiplier of the model: m v^2 / L + m g cos phi + push sin phi, per length
    phi, rate = b.trajectory["phi"], b.trajectory["der(phi)"]
    pull = rate**2 + 9.81 * np.cos(phi) + b.trajectory["push"] * np.sin(phi)
    assert a.trajectory["tension"] == pytest.approx(pull, rel=1e-4)


class CrankMotion(SliderCrank, gt.Optimization):
    """The slider goes from 0.97 to 0.80 m at rest in least time; both drives bounded, one would do."""

    torque = gt.input(unit="N.m", min=-3.0, max=3.0)
    force = gt.input(unit="N", min=-1.0, max=1.0)
    final_time = gt.free(1.0, min=0.1)

    def objective(self):
        return self.final_time

    def constraints(self):
        yield self.s.at(0.0) == 0.97
        yield der(self.s).at(0.0) == 0
        yield self.s.at(self.final_time) == 0.80
        yield der(self.s).at(self.final_time) == 0


def test_slider_crank():
    solution = solve(CrankMotion(), Mesh(30, 3, control="constant"))
    run = resimulate(solution)
    assert run.defect < 1e-5 and max(map(abs, run.end_error.values())) < 1e-5
    P, s = run.trajectory["P"], run.trajectory["s"]
    # closure at every instant
    assert np.linalg.norm(P, axis=1) == pytest.approx(0.3, abs=1e-12)
    assert np.hypot(s - P[:, 0], P[:, 1]) == pytest.approx(0.8, abs=1e-12)
    assert P[:, 1].min() > 0 and (s - P[:, 0]).min() > 0  # the declared branches
    # power balance: what the drives put in, exact for constant drives, is the kinetic energy, zero at both ends
    angle = np.arctan2(P[:, 1], P[:, 0])[::8]
    torque, force = run.trajectory["torque"][8::8], run.trajectory["force"][8::8]
    moved = np.sum(np.abs(torque * np.diff(angle)) + np.abs(force * np.diff(s[::8])))
    assert abs(np.sum(torque * np.diff(angle) + force * np.diff(s[::8]))) < 1e-4 * moved
    assert np.max(np.abs(torque)) == pytest.approx(3.0, abs=1e-6)
