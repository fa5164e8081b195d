"""The optimisation study, called on objects: forms and controls, re-simulation, stops, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

import gtmodel as gt
from gtmodel import der
from gtmodel.optimize import Mesh, SolverOptions, optimization_study, study
from gtmodel.results import ArgumentError, Row, SolveStatus

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
        "objective", "final time", "defect", "violation between nodes", "cost error", "violated",
    ]  # fmt: skip
    assert {*s.checks} == {*s.solution.checks, "excess_between_nodes", "relative_cost_error"}
    assert s.trajectory is s.solution.trajectory


class Fastest(gt.Optimization):
    """To rest in least time: the force jumps from one bound to the other."""

    x = gt.variable(unit="m", start=1.0, fixed=True)
    v = gt.variable(unit="m/s", start=0.0, fixed=True)
    m = gt.parameter(1.0, unit="kg")
    F = gt.input(unit="N", min=-1.0, max=1.0)
    final_time = gt.free(1.5, min=0.1)

    def equations(self):
        yield der(self.x) == self.v
        yield self.m * der(self.v) == self.F

    def objective(self):
        return self.final_time

    def constraints(self):
        yield self.x.at(self.final_time) == 0
        yield self.v.at(self.final_time) == 0


def test_a_gross_excess_between_nodes_fails_a_check_that_names_row_unit_and_instant() -> None:
    s = optimization_study(Fastest(), Mesh(elements=9))
    assert s.status is SolveStatus.CHECK_FAILED and not s.checks["excess_between_nodes"].passed
    assert (s.violated, s.violation_unit) == ("F", "N") and 0 < s.violated_at < s.final_time
    for word in ("'F' exceeds its bound by", " N at ", 'mesh.control = "linear"'):
        assert word in s.message, word
    assert Row("violated", f"F at {s.violated_at:.4g} s") in s.rows
    linear = optimization_study(Fastest(), Mesh(elements=9, control="linear"))
    assert linear.status.ok and linear.checks["excess_between_nodes"].value < SOLVER


class Unstable(gt.Optimization):
    """Held far from rest by the input alone: small differences grow by e^40."""

    rate = gt.parameter(7.0, unit="1/s")
    x = gt.variable(start=1.0, fixed=True)
    u = gt.input()
    final_time = 4.0

    def equations(self):
        yield der(self.x) == 10 * self.x + self.u

    def objective(self):
        return gt.integral((self.x - 1 - gt.sin(self.rate * self.time)) ** 2 + 0.01 * self.u**2)


def test_the_cost_of_an_unstable_model_is_told_and_not_checked() -> None:
    s = optimization_study(Unstable(), Mesh(elements=30))
    assert s.status.ok and "relative_cost_error" not in s.checks
    (note,) = s.notes
    assert "the re-simulated cost differs by" in note and "unstable" in note and "mesh.elements is 30" in note


def test_a_cost_that_the_input_does_not_reproduce_fails_a_check(monkeypatch: pytest.MonkeyPatch) -> None:
    run = study.resimulate
    monkeypatch.setattr(
        study, "resimulate", lambda solution: replace(run(solution), cost_error=0.2 * solution.objective)
    )
    s = optimization_study(Implicit(), Mesh(elements=8, control="linear"))
    assert s.status is SolveStatus.CHECK_FAILED
    assert "re-simulated cost differs by 20 %" in s.message and "more elements (mesh.elements is 8)" in s.message


class Thrown(Fastest):
    v = gt.variable(unit="m/s", min=-3.0)
    F = gt.input(unit="N", min=-1.0, max=1.0)


def test_a_free_initial_value_is_told() -> None:
    s = optimization_study(Thrown(), Mesh(elements=9, control="linear"))
    (note,) = s.notes
    assert note.startswith("the initial value of 'v' is free; the optimiser chose -1.") and " m/s (" in note
    assert not optimization_study(Fastest(), Mesh(elements=9, control="linear")).notes


def test_infeasible_with_a_free_end_says_what_to_try() -> None:
    class Short(Fastest):
        final_time = gt.free(1.0, min=0.1, max=1.5)

    s = optimization_study(Short(), Mesh(elements=9))
    assert s.status is SolveStatus.INFEASIBLE and "final_time is at its max, 1.5 s" in s.message


def test_sample_takes_fractions() -> None:
    s = gt.solve(Fastest(), Mesh(elements=9, control="linear"))
    assert s.sample([0.0, 1.0]).time[-1] == s.final_time
    with pytest.raises(ArgumentError, match=rf"0 to 1; found {s.final_time:.6g}.*trajectory\.resample"):
        s.sample([0.0, s.final_time])


def test_notes_of_text_are_those_of_the_class(tmp_path: Path) -> None:
    pytest.importorskip("lark")
    (tmp_path / "m.mop").write_text("""
optimization P(objectiveIntegrand = u^2, finalTime(free = true, max = 3, initialGuess = 2))
  Real x(start = 1, fixed = true, unit = "m");
  input Real u(unit = "m/s");
equation
  der(x) = u + x;
constraint
  x(finalTime) = 0;
end P;
""")
    cls = gt.modelica.load(f"{tmp_path / 'm.mop'}:P")
    for notes in (optimization_study(cls(), Mesh(4)).notes, gt.solve(cls(), Mesh(4)).notes):
        assert len(notes) == 1 and "units differ" in notes[0] and "m.mop:6" in notes[0]
    said = gt.load(f"{tmp_path / 'm.mop'}:P", "mesh.elements=4")().notes
    assert len(said) == 2 and any("units differ" in n for n in said) and any("simulation" in n for n in said)


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
