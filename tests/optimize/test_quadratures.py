"""A cost that is written as a state takes the iterations of the integral, and its values are still there."""

from __future__ import annotations

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import der
from gtmodel.optimize import Mesh, SolverOptions, resimulate, solve, solve_phases, transcribe
from gtmodel.optimize.formulation.problem import build
from tests.optimize import problems

ROUNDING = 1e-10


def running(tank: gt.Optimization) -> object:
    return (338.775766 - tank.c) ** 2 + (280.099198 - tank.T) ** 2 + (280.0 - tank.Tc) ** 2


class Integral(problems.StirredTank):
    weight = gt.parameter(1.0)

    def objective(self):
        return 1.0 + 2 * self.weight + self.weight * gt.integral(running(self))


class AsState(Integral):
    """The same from 1 on, in units of 2."""

    cost = gt.variable(start=1.0, fixed=True)

    def equations(self):
        yield from super().equations()
        yield 2 * der(self.cost) == running(self)

    def objective(self):
        return 1.0 + 2 * self.weight * self.cost.at(self.final_time)


def make(extra: str) -> gt.Optimization:
    """AsState with something that makes the cost more than an integral."""

    class Other(AsState):
        aim = gt.variable()
        u = gt.input()

        def equations(self):
            yield from super().equations()
            yield self.aim == (self.cost + self.c if extra == "read" else self.c)

        def objective(self):
            if extra == "inside":
                return self.cost.at(75.0)
            cost = self.cost.at(self.final_time)
            return cost**2 if extra == "squared" else cost + gt.integral(self.u**2)

        def constraints(self):
            if extra == "held":
                yield self.cost.at(self.final_time) <= 1e12
            if extra == "bounded":
                yield self.cost <= 1e12

    return Other()


@pytest.mark.parametrize("elements", [20, 50])
@pytest.mark.parametrize("weight", [1e-4, 1.0])
def test_it_takes_the_iterations_of_the_integral(elements, weight):
    """As a state it took 51 to 150 of them where the integral takes 30 to 41."""
    as_state, integral = (solve(c(weight=weight), Mesh(elements)) for c in (AsState, Integral))
    assert as_state.iterations == integral.iterations
    assert as_state.objective == pytest.approx(integral.objective, rel=ROUNDING)


@pytest.mark.parametrize("scheme", ["radau", "gauss"])
def test_its_values_are_the_integrals_up_to_each_instant(scheme):
    s = solve(AsState(), Mesh(20, 3, scheme))
    run, fine = s.trajectory, s.sample(np.linspace(0.0, 1.0, 2001))
    rate = np.array([running(_At(fine, k)) for k in range(len(fine.time))]) / 2
    summed = 1 + np.concatenate([[0.0], np.cumsum(np.diff(fine.time) * (rate[1:] + rate[:-1]) / 2)])
    # trapezoids, and polynomials of the integrand instead of the integrand between the points
    assert fine["cost"] == pytest.approx(summed, rel=1e-3)
    assert run["cost"][0] == 1.0 and s.objective == pytest.approx(1 + 2 * run["cost"][-1], rel=ROUNDING)
    assert run["der(cost)"][1:4] == pytest.approx([running(_At(run, k)) / 2 for k in (1, 2, 3)], rel=ROUNDING)


class _At:
    def __init__(self, run: gt.Trajectory, k: int) -> None:
        self.c, self.T, self.Tc = (float(run[n][k]) for n in ("c", "T", "Tc"))


def test_the_values_are_those_of_the_state():
    """One of linked phases keeps it as a state: two roads to the same numbers, in a re-simulation too."""
    road = solve(problems.VanDerPolMayer(), Mesh(20))
    assert build(problems.VanDerPolMayer()).quadrature_names == ["cost"]
    kept = build(problems.VanDerPolMayer(), linked=True)
    assert "cost" in kept.state_names and not kept.quadratures
    state = solve(problems.VanDerPolMayer(), Mesh(20), solver=SolverOptions(prefer=("cost",)))
    assert "cost" in state.problem.state_names
    for name in ("cost", "der(cost)"):
        assert road.trajectory[name] == pytest.approx(state.trajectory[name], rel=1e-5, abs=1e-5)
    runs = [resimulate(s) for s in (road, state)]
    assert runs[0].trajectory["cost"] == pytest.approx(runs[1].trajectory["cost"], rel=1e-3, abs=1e-3)
    assert runs[0].end_error["cost"] == pytest.approx(runs[1].end_error["cost"], rel=1e-2, abs=1e-3)


@pytest.mark.parametrize("extra", ["read", "inside", "squared", "held", "bounded"])
def test_what_is_more_than_an_integral_stays_a_state(extra):
    assert "cost" in build(make(extra)).state_names
    assert "cost" not in build(make("")).state_names


@pytest.mark.parametrize("form", ["explicit", "torn", "dae"])
def test_in_all_forms(form):
    values = [solve(c(), Mesh(20), solver=SolverOptions(formulation=form)).objective for c in (AsState, Integral)]
    assert values[0] == pytest.approx(values[1], rel=1e-8)


def test_parameters_and_their_slopes():
    roads = [transcribe(c(), Mesh(20), parameters=["weight"]) for c in (AsState, Integral)]
    found = [r.solve({"weight": 2.0}) for r in roads]
    assert found[0].objective == pytest.approx(found[1].objective, rel=ROUNDING)
    assert found[0].sensitivity["weight"] == pytest.approx(found[1].sensitivity["weight"], rel=1e-9)


def test_a_cost_that_equals_another_variable():
    """der(cost) == power, where power stands in other equations."""

    class Power(gt.Optimization):
        x = gt.variable(start=1.0, fixed=True)
        power = gt.variable()
        cost = gt.variable(fixed=True)
        u = gt.input(max=1.0)
        final_time = 1.0

        def equations(self):
            yield self.power == self.u**2 + self.x**2
            yield der(self.cost) == self.power
            yield der(self.x) == self.u

        def objective(self):
            return self.cost.at(self.final_time)

        def constraints(self):
            yield self.power <= 5.0

    s = solve(Power(), Mesh(10))
    assert s.problem.quadrature_names == ["cost"]
    assert s.objective == pytest.approx(np.tanh(1.0), rel=1e-6)  # of the Riccati equation
    assert s.trajectory["cost"][-1] == pytest.approx(s.objective) and "power" in s.trajectory


def test_one_model_with_it_as_a_state_and_without():
    """Causalities without the equation of the cost leave those with it alone."""

    class Move(gt.Optimization):
        final_time = gt.parameter(1.0)
        cost = gt.variable(start=0.0, fixed=True)
        x = gt.variable(start=1.0, fixed=True)
        y = gt.variable()
        u = gt.input()

        def equations(self):
            yield der(self.cost) == self.x**2 + self.u**2
            yield der(self.x) == self.u
            yield self.y == self.x

        def objective(self):
            return self.cost.at(self.final_time)

    model = Move()
    assert build(model).quadrature_names == ["cost"]
    for formulation in ("dae", "explicit"):
        assert len(build(model, formulation, linked=True).state_names) == 2
    assert build(model, "explicit").quadrature_names == ["cost"]


def test_in_phases_it_continues():
    assert solve_phases(problems.two_phases(), Mesh(10)).status.ok


def test_an_only_state_stays_one():
    class Gain(gt.Optimization):
        x = gt.variable(start=0.0, fixed=True)
        u = gt.input(min=-1.0, max=1.0)
        final_time = 1.0

        def equations(self):
            yield der(self.x) == self.u

        def objective(self):
            return -self.x.at(self.final_time)

        def constraints(self):
            return ()

    assert build(Gain()).state_names == ["x"]
