"""Nothing eliminated, torn, or solved block by block: one optimum. And the branch that a solution must lie on."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

import gtmodel as gt
from gtmodel import ModelError, SolveStatus, der
from gtmodel.optimize import Mesh, SolverOptions, resimulate, solve
from gtmodel.optimize.formulation.problem import build
from gtmodel.optimize.nlp import make_nlp
from tests.optimize import features, problems
from tests.optimize.test_derivatives import point_near_guess, robot_motion, wrong
from tests.optimize.test_solve import CartesianSwing, CrankMotion

# Roads to one discrete optimum, each stopped by IPOPT at 1e-8 of its scaled conditions.
SOLVER = 1e-6
IMPLICIT = 1.06183273  # CONFORMANCE: as a full DAE, after block elimination and torn


def attempt(model, mesh, guess=None, branches=None, **options):
    return solve(model, mesh, guess=guess, branches=branches, solver=SolverOptions(**options), throw=False)


@pytest.mark.parametrize("formulation, unknowns", [("torn", ["y1", "y3"]), ("dae", ["y1", "y2", "y3", "y4", "y5"])])
def test_a_block_without_a_closed_form(formulation, unknowns):
    solution = attempt(problems.ImplicitBlock(), Mesh(50, 3), formulation=formulation)
    assert solution.problem.formulation == formulation and solution.problem.point_names == unknowns
    assert solution.objective == pytest.approx(IMPLICIT, rel=SOLVER)
    run = resimulate(solution)  # Newton's unknowns at every instant, not the polynomials
    assert run.status.ok and abs(run.cost_error) < 1e-6


def test_auto_tears_and_explicit_refuses():
    assert build(problems.ImplicitBlock(), "auto").formulation == "torn"
    with pytest.raises(
        ModelError, match=r"equations for y\d, y\d have no closed form, which formulation 'explicit' needs.*'dae'"
    ):
        build(problems.ImplicitBlock(), "explicit")


@pytest.mark.parametrize(
    "cls, mesh, guess",
    [
        (problems.VanDerPolMayer, Mesh(40, 2, "gauss"), None),
        (problems.LinearAlgebraic, Mesh(50, 3), None),
        (problems.Bilinear, Mesh(20, 3), None),
        (features.TwoCarts, Mesh(10, 3, control="constant"), None),
        (features.PathConstraints, Mesh(10, 3), None),
        (CrankMotion, Mesh(10, 3, control="constant"), None),
        (CartesianSwing, Mesh(20, 3), None),
    ],
)
def test_nothing_eliminated_is_the_same_optimum(cls, mesh, guess):
    model = cls()
    whole = attempt(model, mesh, guess, formulation="dae")
    other = attempt(model, mesh, guess, formulation="auto")
    assert whole.status.ok, whole.message
    assert whole.problem.formulation == "dae" != other.problem.formulation
    assert whole.objective == pytest.approx(other.objective, rel=10 * SOLVER)
    assert set(whole.trajectory.names) == set(other.trajectory.names)
    run = resimulate(whole)
    assert run.defect == pytest.approx(resimulate(other).defect, rel=1e-2, abs=1e-6)


def test_a_robots_motion_with_nothing_eliminated():
    """Index 3, 87 unknowns at each point besides states and forces; no root, but the links' branches hold."""
    model, guess = robot_motion()
    found = [attempt(model, Mesh(8, 3), guess, formulation=f) for f in ("inverse", "dae")]
    assert [s.problem.formulation for s in found] == ["inverse", "dae"] and len(found[1].problem.point_names) == 87
    assert found[1].objective == pytest.approx(found[0].objective, rel=SOLVER)


@pytest.mark.parametrize("mesh", [Mesh(3, 2), Mesh(2, 3, "gauss", "constant")])
@pytest.mark.parametrize(
    "cls", [features.TwoCarts, features.PathConstraints, features.FreeTimes, problems.ImplicitBlock]
)
@pytest.mark.parametrize("formulation", ["dae", "torn"])
def test_derivatives(cls, formulation, mesh):
    nlp = make_nlp(build(cls(), formulation), mesh)
    assert wrong(nlp, point_near_guess(nlp, spread=0.02)) == {}


def test_rows_have_names_with_file_and_line():
    nlp = make_nlp(build(CartesianSwing(), "dae"), Mesh(2, 1))
    names = [nlp.row_name(r) for r in range(len(nlp.lbg))]
    # the rod's length, and its two derivatives
    for dashes in ("", "'", "''"):
        assert any(n.startswith(f"CartesianSwing equation 3{dashes} (optimize/test_solve.py:") for n in names)
    assert any(n.endswith("in element 2, point 1") for n in names)


def test_guess_of_what_is_not_eliminated_solves_its_equations():
    from gtmodel.optimize.guess import initial_guess

    for formulation in ("torn", "dae"):
        nlp = make_nlp(build(problems.ImplicitBlock(), formulation), Mesh(4, 3))
        g = np.asarray(nlp.nlp(initial_guess(nlp, None), [])[1]).reshape(-1)
        held = [r for r in range(len(g)) if re_algebraic(nlp.row_name(r))]
        assert len(held) >= 4 * 3 * 2 and np.max(np.abs(g[held])) < 1e-9


def re_algebraic(name: str) -> bool:
    """A row of the model's own equations that holds no rate."""
    return "equation" in name and not name.startswith(("ImplicitBlock equation 1 ", "ImplicitBlock equation 2 "))


def test_a_bound_on_what_is_eliminated_holds_in_all_forms():
    found = []
    for formulation in ("explicit", "dae"):
        s = attempt(problems.LinearAlgebraic(y1={"min": -0.5}), Mesh(20, 3), formulation=formulation)
        assert s.status.ok and np.min(s.trajectory["y1"][1:]) == pytest.approx(-0.5, abs=1e-7)
        found.append(s.objective)
    assert found[0] == pytest.approx(found[1], rel=SOLVER)


def test_a_condition_on_the_controls_alone_is_held():
    class Unit(gt.Optimization):
        x = gt.variable(2, start=[0.0, 0.0], fixed=True)
        u = gt.input(2, start=[0.6, 0.8])
        final_time = gt.free(1.0, min=0.1)

        def equations(self):
            yield der(self.x) == self.u
            yield gt.dot(self.u, self.u) == 1

        def objective(self):
            return self.final_time

        def constraints(self):
            yield self.x.at(self.final_time) == [3.0, 4.0]

    assert solve(Unit(), Mesh(3, 2)).final_time == pytest.approx(5.0, rel=SOLVER)


class Dent(gt.Optimization):
    """y^3 - 3 y = x has three solutions for small x and no closed form here; branch `high`: the upper one, y > 1."""

    x = gt.variable(start=0.0, fixed=True)
    y = gt.variable(start=1.7)
    u = gt.input(min=-1.0, max=1.0)
    final_time = 1.0

    def equations(self):
        yield der(self.x) == self.u
        yield self.y**3 - 3 * gt.sin(self.y) == self.x
        yield gt.branch("high", self.y)

    def objective(self):
        return gt.integral((self.y - 1.9) ** 2 + 0.1 * self.u**2)


class TestBranch:
    @pytest.mark.parametrize("formulation", ["torn", "dae"])
    @pytest.mark.parametrize("sign", [1, -1])
    def test_the_wanted_one(self, sign, formulation):
        s = attempt(Dent(), Mesh(10, 3), branches={"high": sign}, formulation=formulation)
        assert s.status.ok, s.message
        y, x = s.trajectory["y"], s.trajectory["x"]
        assert np.all(sign * y > 0)
        root = brentq(lambda v: v**3 - 3 * np.sin(v) - x[-1], *sorted((sign * 1.0, sign * 3.0)))
        assert y[-1] == pytest.approx(root, rel=1e-7)

    def test_leaving_it_is_a_failure(self):
        """The guess leads to the other branch, where all equations hold too."""
        other = attempt(Dent(), Mesh(10, 3), branches={"high": -1})
        s = attempt(Dent(), Mesh(10, 3), guess=other)
        assert s.status is SolveStatus.FAILED
        assert s.message.startswith("the solution is on the wrong branch: 'high' (optimize/test_formulations.py:")
        assert "but its sign must be +1; give a guess on that branch, or branches={'high': -1}" in s.message

    def test_closed_form(self):
        """The crank below the slider's line: the same motion mirrored."""
        for sign in (1, -1):
            s = attempt(CrankMotion(), Mesh(6, 2, control="constant"), branches={"up": sign})
            assert s.status.ok and np.all(sign * s.trajectory["P"][:, 1] > 0)

    def test_unknown_name(self):
        with pytest.raises(ModelError, match="CrankMotion has no branch 'down'; it has right, up"):
            attempt(CrankMotion(), Mesh(6, 2), branches={"down": 1})


def test_no_state_at_all():
    class Static(gt.Optimization):
        u = gt.input()
        y = gt.variable()
        final_time = 2.0

        def equations(self):
            yield self.y == self.u + 1

        def objective(self):
            return gt.integral(self.y**2 + self.u**2)

    for formulation in ("explicit", "dae"):
        assert attempt(Static(), Mesh(3, 2), formulation=formulation).objective == pytest.approx(1.0, rel=SOLVER)


def test_too_many_equations_are_named():
    class Twice(features.Tank):
        def constraints(self):
            yield self.x + self.u == 1.0
            yield self.x * self.u == 0.2

    with pytest.raises(ModelError, match=r"Twice has more equations .*constraint 1 \(.*constraint 2 \(.*remove one"):
        solve(Twice(), Mesh(4, 2))
