"""The optimisation study, called on objects: forms and controls, re-simulation, stops, and what is refused."""

from __future__ import annotations

import pytest

import gtmodel as gt
from gtmodel import der
from gtmodel.optimize import Mesh, SolverOptions, optimization_study
from gtmodel.results import ArgumentError, SolveStatus

# Two forms of one discrete problem, each stopped by IPOPT at 1e-8 of its scaled conditions.
SOLVER = 1e-6


class Implicit(gt.Optimization):
    x = gt.variable(start=1.0, fixed=True)
    y = gt.variable(start=1.0)
    u = gt.input(min=-1.0, max=1.0)
    final_time = 1.0

    def equations(self):
        yield der(self.x) == self.y
        yield self.y + 0.3 * gt.sin(self.y) + self.y**3 == self.u - self.x

    def objective(self):
        return gt.integral(self.x**2 + 0.1 * self.u**2)


def solved(control: str = "polynomial", formulation: str = "auto", **options):
    solver = SolverOptions(formulation=formulation, **options.pop("solver", {}))
    return optimization_study(Implicit(), Mesh(elements=8, control=control), solver=solver, **options)


def test_forms_and_controls() -> None:
    found = {}
    for control, formulation in (("bernstein", "torn"), ("bernstein", "dae"), ("linear", "auto"), ("constant", "auto")):
        s = solved(control, formulation)
        assert s.status.ok and s.message.endswith("and re-simulated") and s.violation_between_nodes < SOLVER
        found[control, formulation] = s.objective
    assert found["bernstein", "torn"] == pytest.approx(found["bernstein", "dae"], rel=SOLVER)
    assert found["bernstein", "torn"] < found["linear", "auto"] < found["constant", "auto"]


def test_values_and_table() -> None:
    s = solved(title="implicit")
    assert s.final_time == 1.0 and s.free == {} and s.objective == s.solution.objective
    assert [row.label for row in s.rows] == [
        "objective", "final time", "defect", "violation between nodes", "cost error",
    ]  # fmt: skip
    assert {*s.checks} == {*s.solution.checks} and s.trajectory is s.solution.trajectory


def test_states_and_controls_are_drawn_without_their_rates() -> None:
    figure = solved(title="implicit").figure("states")
    labels = {t.get_text() for axes in figure.axes for legend in [axes.get_legend()] if legend for t in legend.texts}
    assert labels == {"x", "y", "u", "bound"} and figure.get_suptitle() == "implicit"


def test_what_the_mesh_does_not_resolve_is_not_said_to_be_solved_and_re_simulated() -> None:
    s = optimization_study(Implicit(), Mesh(elements=1, points=1))
    assert s.status is SolveStatus.CHECK_FAILED and not s.message.endswith("and re-simulated")


def test_stopped_it_keeps_the_iterate_and_is_not_tried() -> None:
    told: list[object] = []
    s = solved(
        progress=lambda stage=None, fraction=None, numbers=None: told.append(numbers), stop=lambda: len(told) > 1
    )
    assert s.status is SolveStatus.INTERRUPTED and s.trajectory is not None and s.defect is None
    assert {"iteration", "objective", "violation"} == {*told[0]}  # type: ignore[misc]
    assert [row.label for row in s.rows] == ["objective", "final time"]


def test_no_compiler_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.raises(ArgumentError) as caught:
        solved(solver={"compile": True})
    assert caught.value.argument == "solver.compile"
