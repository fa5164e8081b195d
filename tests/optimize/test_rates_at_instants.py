"""A derivative at an instant is what the model's equations give there, in every form and at every place of the mesh."""

from __future__ import annotations

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import der
from gtmodel.optimize import Mesh, SolverOptions, solve, solve_phases
from tests.optimize import problems

EQUATIONS = 1e-7  # IPOPT's tolerance on rows; polynomials miss the model by 1e-3 to 1e-1 here
FORMS = ("inverse", "explicit", "torn", "dae")
START, INSIDE, END = 0.7, -0.1, 0.2


class Swing(gt.Optimization):
    """x'' = u - sin 3x - v^3, its acceleration given at three instants; none but the end can be a Radau point."""

    x = gt.variable(start=0.3, fixed=True)
    v = gt.variable(start=0.0)
    u = gt.input()
    final_time = 2.0

    def equations(self):
        yield der(self.x) == self.v
        yield der(self.v) == self.u - gt.sin(3 * self.x) - self.v**3

    def initial_equations(self):
        yield der(self.v) == START

    def objective(self):
        aim = 50 * (self.x.at(self.final_time) - 1) ** 2 + (self.v.at(self.final_time) - 0.5) ** 2
        return gt.integral(self.u**2) + aim

    def constraints(self):
        yield der(self.v).at(self.final_time) == END
        yield der(self.v).at(0.77) == INSIDE


@pytest.mark.parametrize("scheme", ["radau", "gauss"])
@pytest.mark.parametrize("form", FORMS)
def test_a_rate_is_that_of_the_equations(form, scheme):
    s = solve(Swing(), Mesh(8, 3, scheme), solver=SolverOptions(formulation=form))
    run = s.sample(np.array([0.0, 0.77 / 2, 1.0]))
    wanted = [START, INSIDE, END]
    assert run["u"] - np.sin(3 * run["x"]) - run["v"] ** 3 == pytest.approx(wanted, abs=EQUATIONS)
    assert run["der(v)"] == pytest.approx(wanted, abs=EQUATIONS)
    assert s.trajectory["der(v)"][[0, -1]] == pytest.approx([START, END], abs=EQUATIONS)


@pytest.mark.parametrize("scheme", ["radau", "gauss"])
def test_all_forms_have_one_optimum(scheme):
    costs = [solve(Swing(), Mesh(6, 3, scheme), solver=SolverOptions(formulation=f)).objective for f in FORMS]
    assert costs == pytest.approx([costs[0]] * len(FORMS), rel=1e-8)


class Implicit(gt.Optimization):
    """An unknown without a closed form: z + 0.3 sin z = x + u; what it is at the start is asked for."""

    x = gt.variable(start=0.5, fixed=True)
    z = gt.variable()
    u = gt.input()
    final_time = 1.0

    def equations(self):
        yield self.z + 0.3 * gt.sin(self.z) == self.x + self.u
        yield der(self.x) == -self.z

    def objective(self):
        return gt.integral(self.u**2 + self.x**2)

    def constraints(self):
        yield self.z.at(self.start_time) == 1.1
        yield der(self.x).at(self.final_time) == -0.4


@pytest.mark.parametrize("scheme", ["radau", "gauss"])
@pytest.mark.parametrize("form", ["torn", "dae"])
def test_an_unknown_without_a_closed_form_keeps_its_equation(form, scheme):
    s = solve(Implicit(), Mesh(3, 2, scheme), solver=SolverOptions(formulation=form))
    run = s.trajectory
    left = run["z"] + 0.3 * np.sin(run["z"]) - run["x"] - run["u"]
    assert left[[0, -1]] == pytest.approx([0.0, 0.0], abs=EQUATIONS)
    assert [run["z"][0], run["z"][-1]] == pytest.approx([1.1, 0.4], abs=EQUATIONS)
    assert run["der(x)"][[0, -1]] == pytest.approx([-1.1, -0.4], abs=EQUATIONS)


@pytest.mark.parametrize("scheme", ["radau", "gauss"])
@pytest.mark.parametrize("form", ["inverse", "explicit"])
def test_a_link_of_phases_takes_the_models_rate(form, scheme):
    """The acceleration continues: before it ends and after it begins, by the equations."""

    def leg(start: bool) -> gt.Optimization:
        class Leg(gt.Optimization):
            x = gt.variable(start=0.0, fixed=start)
            v = gt.variable(start=0.0, fixed=start)
            u = gt.input(min=-3.0, max=3.0)
            start_time = 0.0 if start else 1.0
            final_time = 1.0 if start else 2.0

            def equations(self):
                yield der(self.x) == self.v
                yield der(self.v) == self.u * (1.0 if start else 2.0) - gt.sin(3 * self.x)

            def objective(self):
                return gt.integral(self.u**2)

            def constraints(self):
                if not start:
                    yield self.x.at(self.final_time) == 1.0

        return Leg()

    links = {"b": lambda before, after: [after["der(v)"] == before["der(v)"]]}
    whole = gt.Phases({"a": leg(True), "b": leg(False)}, links=links)
    s = solve_phases(whole, Mesh(4, 2, scheme), solver=SolverOptions(formulation=form))
    a, b = s["a"].trajectory, s["b"].trajectory
    before = a["u"][-1] - np.sin(3 * a["x"][-1])
    assert 2 * b["u"][0] - np.sin(3 * b["x"][0]) == pytest.approx(before, abs=EQUATIONS)


def test_at_collocation_points_nothing_changes():
    """There the polynomials keep the equations: the same rates by the model and by the slope."""
    s = solve(problems.VanDerPol(), Mesh(10, 3, "gauss"))
    run = s.trajectory
    slope = (1 - run["x2"] ** 2) * run["der(x2)"] - run["x2"] + run["u"] if "der(x2)" in run else None
    assert slope is not None and run["der(x2,2)"] == pytest.approx(slope, abs=1e-6)
