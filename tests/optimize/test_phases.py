"""Linked phases: against the same problem in one piece, against closed forms; and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import ModelError, SolveStatus, der
from gtmodel.optimize import Mesh, NotSolved, Phases, SolverOptions, solve, solve_phases
from gtmodel.optimize.formulation.problem import build
from gtmodel.optimize.guess import initial_guess
from gtmodel.optimize.linking import join
from gtmodel.optimize.nlp import make_nlp
from tests.optimize import problems
from tests.optimize.test_derivatives import wrong

SOLVER = 1e-6  # two roads to one discrete optimum


class Early(problems.VanDerPol):
    final_time = 8.0


class Late(problems.VanDerPol):
    x1 = gt.variable()
    x2 = gt.variable()
    start_time = 8.0
    final_time = 20.0


class Fall(gt.Optimization):
    """A ball falls from 2 m."""

    g = gt.parameter(9.81, unit="m/s2")
    q = gt.variable(unit="m", start=2.0, fixed=True, min=0.0)
    v = gt.variable(unit="m/s", start=0.0, fixed=True)
    final_time = gt.free(0.5, min=0.1, unit="s")

    def equations(self):
        yield der(self.q) == self.v
        yield der(self.v) == -self.g

    def objective(self):
        return self.final_time - self.start_time

    def constraints(self):
        yield self.q.at(self.final_time) == 0


class Rise(Fall):
    """And rises again until it rests."""

    q = gt.variable(unit="m", min=0.0)
    v = gt.variable(unit="m/s")
    start_time = gt.free(0.5, unit="s")
    final_time = gt.free(1.0, unit="s")

    def constraints(self):
        yield self.final_time - self.start_time >= 0.1
        yield self.v.at(self.final_time) == 0


def bounce(restitution: float) -> Phases:
    return Phases(
        {"fall": Fall(), "rise": Rise()},
        free={"rise": ["v"]},
        links={"rise": lambda before, after: [after.v == -restitution * before["v"]]},
    )


@pytest.mark.parametrize("scheme, control", [("radau", "polynomial"), ("gauss", "constant"), ("radau", "linear")])
def test_a_problem_cut_in_two_is_the_same(scheme, control):
    whole = solve(problems.VanDerPol(), Mesh(40, 3, scheme, control))
    # a continuous control may jump where phases meet: it is tied by hand
    links = {"late": lambda before, after: [after.u == before.u]} if control == "linear" else {}
    cut = Phases({"early": Early(), "late": Late()}, links=links)
    meshes = {"early": Mesh(16, 3, scheme, control), "late": Mesh(24, 3, scheme, control)}
    s = solve_phases(cut, meshes)
    assert s.objective == pytest.approx(whole.objective, rel=SOLVER)
    assert s.objective == pytest.approx(s["early"].objective + s["late"].objective, rel=1e-7)
    for name in ("early", "late"):
        t = s[name].trajectory.time[1:]
        x = whole.sample((t - 1e-12) / 20.0)["x1"]
        assert s[name].trajectory["x1"][1:] == pytest.approx(x, abs=1e-5)
    again = solve_phases(cut, meshes, guess=s)
    assert again.objective == pytest.approx(s.objective, rel=SOLVER)


@pytest.mark.parametrize("restitution", [0.5, 0.9])
def test_a_jump(restitution):
    s = solve_phases(bounce(restitution), Mesh(4, 3))
    down = np.sqrt(2 * 2.0 / 9.81)
    assert s.objective == pytest.approx(down * (1 + restitution), rel=SOLVER)
    before, after = s["fall"].trajectory, s["rise"].trajectory
    assert after["v"][0] == pytest.approx(-restitution * before["v"][-1], rel=1e-7)
    assert after.time[0] == pytest.approx(before.time[-1], rel=1e-9)
    assert after["q"][-1] == pytest.approx(2.0 * restitution**2, rel=1e-6)


def test_derivatives_of_the_whole():
    for model, mesh in ((bounce(0.5), Mesh(2, 2)), (problems.two_phases(), Mesh(2, 3, "gauss"))):
        nlps = {n: make_nlp(build(p), mesh) for n, p in model.phases.items()}
        joined = join(model, nlps)
        x = np.concatenate([initial_guess(n, None) for n in nlps.values()])
        joined.size = len(x)  # type: ignore[attr-defined]
        assert wrong(joined, x + 0.1 * np.random.default_rng(0).standard_normal(len(x))) == {}  # type: ignore[arg-type]


def test_three_phases_and_a_shared_constant():
    """x' = k in three phases of one clock each; one k for all brings x to 3 in 1 + 1 + 1 s at least cost."""

    class Leg(gt.Optimization):
        k = gt.free(0.5)
        x = gt.variable()

        def equations(self):
            yield der(self.x) == self.k

        def objective(self):
            return gt.integral(self.k**2 + 0 * self.x)

    class First(Leg):
        x = gt.variable(start=0.0, fixed=True)

        def objective(self):
            return gt.integral(10 * self.k**2 + 0 * self.x)

    class Last(Leg):
        def constraints(self):
            yield self.x.at(self.final_time) == 3

    legs = {"a": First(), "b": Leg(), "c": Last()}
    one = solve_phases(Phases(legs, shared=["k"]), Mesh(2, 2))
    assert [one[n].free["k"] for n in legs] == pytest.approx([1.0, 1.0, 1.0], rel=1e-7)
    own = solve_phases(Phases(legs), Mesh(2, 2))
    # least 10 a^2 + b^2 + c^2 with a + b + c = 3
    assert [own[n].free["k"] for n in legs] == pytest.approx([1 / 7, 10 / 7, 10 / 7], rel=1e-6)


def test_multipliers_of_links_are_slopes_of_the_cost():
    """What a kink of the level by e would cost: x of the second phase is the first one's plus e."""

    def cut(e: float):
        links = {"late": lambda before, after: [after.x1 == before.x1 + e]}
        return solve_phases(
            Phases({"early": Early(), "late": Late()}, free={"late": ["x1"]}, links=links),
            Mesh(10, 3),
            solver=SolverOptions(tolerance=1e-10),
        )

    s, e = cut(0.0), 1e-3
    slope = (cut(e).objective - cut(-e).objective) / (2 * e)
    name = next(n for n in s.link_multipliers if n.startswith("link to 'late' 1 (optimize/test_phases.py:"))
    # a row after - before - e == 0
    assert s.link_multipliers[name] == pytest.approx(-slope, rel=1e-4)


def test_one_row_links_two_phases_and_its_multiplier_has_si_units():
    """x' = u to x(2) = 200 costs 2 (x(1)^2) at best: the costate where phases meet is 2 u = 200."""

    class First(gt.Optimization):
        x = gt.variable(start=0.0, fixed=True, nominal=100.0)
        u = gt.input(nominal=100.0)
        final_time = 1.0

        def equations(self):
            yield der(self.x) == self.u

        def objective(self):
            return gt.integral(self.u**2)

    class Second(First):
        x = gt.variable(start=0.0, nominal=100.0)
        start_time = 1.0
        final_time = 2.0

        def constraints(self):
            yield self.x.at(2.0) == 200.0

    s = solve_phases(Phases({"a": First(), "b": Second()}), Mesh(4))
    assert s.objective == pytest.approx(2e4, rel=SOLVER)
    assert s.link_multipliers["x continues into 'b'"] == pytest.approx(200.0, rel=SOLVER)
    jump = Phases({"a": First(), "b": Second()}, free={"b": ["x"]}, links={"b": lambda p, q: [p.x == q.x]})
    assert list(solve_phases(jump, Mesh(4)).link_multipliers.values()) == pytest.approx([-200.0], rel=SOLVER)


def test_failure_names_phase_element_and_time():
    class Far(Rise):
        def constraints(self):
            yield from super().constraints()
            yield self.q.at(self.final_time) == 5

    s = solve_phases(Phases({"fall": Fall(), "rise": Far()}, free={"rise": ["v"]}, links={
        "rise": lambda before, after: [after.v <= -0.5 * before.v]}), Mesh(3, 2), throw=False)  # fmt: skip
    assert s.status is SolveStatus.INFEASIBLE and "worst rows: " in s.message
    with pytest.raises(NotSolved, match="iteration limit"):
        solve_phases(bounce(0.5), Mesh(3, 2), solver=SolverOptions(max_iterations=1))


WRONG = {
    "one phase": (lambda: Phases({"a": Fall()}), "at least two phases; found 1"),
    "unknown phase": (
        lambda: Phases({"a": Fall(), "b": Rise()}, free={"c": ["v"]}),
        "'c' is not among the phases after the first, b",
    ),
    "first phase": (lambda: Phases({"a": Fall(), "b": Rise()}, links={"a": lambda x, y: []}), "'a' is not among"),
    "no state": (
        lambda: solve_phases(Phases({"a": Fall(), "b": Rise()}, free={"b": ["der(v)"]})),
        r"'der\(v\)' may jump into phase 'b', but is not a state there; states are q, der\(q\)",
    ),
    "no variable": (
        lambda: solve_phases(Phases({"a": Fall(), "b": Rise()}, free={"b": ["w"]})),
        "Rise has no variable 'w'",
    ),
    "to the other function": (lambda: solve(bounce(0.5)), "found Phases. Use gt.solve_phases"),
    "one phase to this function": (lambda: solve_phases(Fall()), "takes gt.Phases; found Fall. Use gt.solve"),
    "no relation": (
        lambda: solve_phases(Phases({"a": Fall(), "b": Rise()}, links={"b": lambda x, y: [x.v]})),
        "the link to 'b' yielded Expr; expected a relation",
    ),
    "a link without relations": (
        lambda: solve_phases(Phases({"a": Fall(), "b": Rise()}, links={"b": lambda x, y: None})),
        "the link to 'b' returned nothing; expected a list of relations",
    ),
    "a link of one relation": (
        lambda: solve_phases(Phases({"a": Fall(), "b": Rise()}, links={"b": lambda x, y: x.v == y.v})),
        "the link to 'b' returned one Relation; expected a list",
    ),
    "another solver": (
        lambda: solve_phases(bounce(0.5), Mesh(3), solver=SolverOptions(solver="fatrop")),
        "linked phases need solver 'ipopt'; found 'fatrop'",
    ),
    "mesh of no phase": (lambda: solve_phases(bounce(0.5), {"up": Mesh()}), "no phase 'up' for a mesh; phases are"),
    "nothing shared": (
        lambda: solve_phases(Phases({"a": Fall(), "b": Rise()}, shared=["k"])),
        "'k' is shared, but only 0 of the phases",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_wrong_phases(name):
    make, sentence = WRONG[name]
    with pytest.raises(ModelError, match=sentence):
        make()


class Named(gt.Optimization):
    """States whose names are those of many a program's own variables."""

    y = gt.variable(start=0.0)
    values = gt.variable(start=0.0)
    P = gt.input(min=-1.0, max=1.0)

    def equations(self):
        yield der(self.y) == self.P
        yield der(self.values) == self.y

    def objective(self):
        return gt.integral(self.P**2)

    def constraints(self):
        yield self.y.at(self.start_time) >= 0.25


def test_links_take_any_name():
    links = {"second": lambda before, after: [after.y == 2 * before.y, after.values == before.values + before.P]}
    s = solve_phases(Phases({"first": Named(), "second": Named()}, free={"second": ["y", "values"]}, links=links))
    first, second = s["first"].trajectory, s["second"].trajectory
    assert second["y"][0] == pytest.approx(2 * first["y"][-1], abs=1e-6)
    assert second["values"][0] == pytest.approx(first["values"][-1] + first["P"][-1], abs=1e-6)


@pytest.mark.parametrize(
    "wrong, sentence",
    [
        ({"mesh": 7}, "the mesh must be a gt.Mesh"),
        ({"mesh": {"first": 7}}, "the mesh must be a gt.Mesh"),
        ({"guess": 7}, "the guess must be"),
        ({"guess": {"first": 7}}, "the guess must be"),
    ],
)
def test_wrong_arguments(wrong, sentence):
    with pytest.raises(ModelError, match=sentence):
        solve_phases(Phases({"first": Named(), "second": Named()}), **wrong)


def test_what_is_no_phase_and_no_list():
    with pytest.raises(ModelError, match="phase 'second' must be a configured Optimization; found 3"):
        Phases({"first": Named(), "second": 3})  # type: ignore[dict-item]
    with pytest.raises(ModelError, match="free takes a list of names; found 'values'"):
        Phases({"first": Named(), "second": Named()}, free={"second": "values"})
    with pytest.raises(ModelError, match="shared takes a list of names; found 'final_time'"):
        Phases({"first": Named(), "second": Named()}, shared="final_time")


class Free(Rise):
    """Whose rise costs nothing."""

    def objective(self):
        return 0.0 * self.g


def test_a_phase_of_constant_cost_has_a_gradient_in_full():
    """IPOPT read what was in memory where the gradient had no entry."""
    phases = Phases({"fall": Fall(), "rise": Free()}, free={"rise": ["v"]}, links={"rise": lambda b, a: [a.v == -b.v]})
    joined = solve_phases(phases, Mesh(4), throw=False).joined
    assert joined.functions["grad_f"].sparsity_out(1).is_dense()
