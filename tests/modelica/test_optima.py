"""Optima of known problems, written in Optimica: the same numbers on the same mesh."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import der
from tests.modelica import texts

pytest.importorskip("lark")
MODELS = Path(__file__).parents[2] / "problems" / "models"
SAME_MESH = 1e-6  # relative: IPOPT stops at 1e-8 of the scaled conditions, and relaxes bounds by as much
MESH = gt.Mesh(50, points=3)


def optimum(tmp_path: Path, text: str, name: str = "", mesh: gt.Mesh = MESH) -> gt.Solution:
    file = tmp_path / "statement.mop"
    file.write_text(text)
    problem = gt.modelica.load(f"{file}:{name}" if name else str(file))()
    return gt.solve(problem, mesh, guess=gt.modelica.first_guess(problem))


@pytest.mark.parametrize(
    ("text", "name", "value"),
    [
        (texts.WEIGHTED, "", 23.4690886),
        (texts.AS_STATE, "", 23.4690886),
        (texts.DOUBLE, "", 1.3606309),
        (texts.FINAL_FREE, "", 2.0),
        (texts.START_FREE, "", 1.0),  # the start at -1, the objective its negative
        (texts.STATE_BOUND, "", 0.1698207),
        (texts.FREE_START, "", 19.1797673),
        (texts.TANK, "Hold", 1857.6873858),
    ],
    ids=["weighted", "as a state", "double", "final free", "start free", "state bound", "free start", "tank"],
)
def test_the_known_optimum(tmp_path: Path, text: str, name: str, value: float) -> None:
    assert optimum(tmp_path, text, name).objective == pytest.approx(value, rel=SAME_MESH)


def test_least_time_of_the_shipped_file() -> None:
    fast = gt.modelica.load(f"{MODELS / 'van_der_pol.mop'}:Fast")()
    assert gt.solve(fast, MESH).final_time == pytest.approx(2.2811587, rel=SAME_MESH)


def test_the_start_of_free_start_time(tmp_path: Path) -> None:
    solution = optimum(tmp_path, texts.START_FREE)
    assert solution.free["start_time"] == pytest.approx(-1.0, rel=SAME_MESH)


def test_catalytic_cracking(tmp_path: Path) -> None:
    """COPS 3.0: measured instants in a sum over a loop."""
    solution = optimum(tmp_path, texts.CRACKING, mesh=gt.Mesh(190, points=3))  # all instants at edges
    assert solution.objective == pytest.approx(5.23659583e-3, rel=SAME_MESH)  # by scipy's integrator and least squares
    assert [solution.free[n] for n in "abc"] == pytest.approx([11.84674, 8.34452, 1.00144], abs=6e-6)  # printed digits


def test_marine_population(tmp_path: Path) -> None:
    """COPS 3.0: vectors with cat, slices and .*, and 168 counts; the optimum by matrix exponentials."""
    solution = optimum(tmp_path, texts.MARINE, mesh=gt.Mesh(60, points=3))  # all instants at edges
    assert solution.objective == pytest.approx(2.0368686e7, rel=SAME_MESH)


def test_quadratic_forms(tmp_path: Path) -> None:
    forms = optimum(tmp_path, texts.LINEAR, "Forms").objective
    assert forms == pytest.approx(optimum(tmp_path, texts.LINEAR, "Written").objective, rel=1e-10)


def test_a_discontinuity_is_rejected_with_its_line(tmp_path: Path) -> None:
    with pytest.raises(gt.modelica.ModelicaError, match=r"solve_phases.*if w > 0.*\(.*statement\.mop:10\)"):
        optimum(tmp_path, texts.FRICTION)


def test_a_pendulum_in_cartesian_coordinates_keeps_its_length(tmp_path: Path) -> None:
    file = tmp_path / "pendulum.mo"
    file.write_text(texts.PENDULUM)
    run = gt.modelica.load(file)().simulate(2.0)
    x, y = run.trajectory["x"], run.trajectory["y"]
    assert np.max(np.abs(np.hypot(x, y) - 1.0)) < 1e-6


# a file and a class of one's own: the same bits


class Reactor(gt.Optimization):
    """problems/models/penicillin.mop by hand."""

    mu_m = gt.parameter(0.02)
    K_m = gt.parameter(0.05)
    K_i = gt.parameter(5.0)
    Y_xs = gt.parameter(0.5)
    Y_ps = gt.parameter(1.2)
    nu = gt.parameter(0.004)
    S_in = gt.parameter(200.0)
    X = gt.variable(start=1.0, fixed=True, max=3.7)
    S = gt.variable(start=0.5, fixed=True, min=0.0, max=100.0)
    P = gt.variable(start=0.0, fixed=True, max=5.0)
    V = gt.variable(start=150.0, fixed=True, min=1.0)
    u = gt.variable(start=0.03, fixed=True, min=0.0, max=1.0)
    du = gt.input(min=-0.1, max=0.1)
    mu = gt.variable()
    final_time = 75.0

    def equations(self):
        X, S, P, V, u = self.X, self.S, self.P, self.V, self.u
        yield self.mu == self.mu_m * S / (self.K_m + S + S**2 / self.K_i)
        yield der(X) == self.mu * X - u / V * X
        yield der(S) == -(self.mu * X) / self.Y_xs - self.nu * X / self.Y_ps + u / V * (self.S_in - S)
        yield der(P) == self.nu * X - u / V * P
        yield der(V) == u
        yield der(u) == self.du

    def objective(self):
        return -self.P.at(self.final_time)


class Quiet(gt.Optimization):
    """VanDerPol.Quiet by hand."""

    x1 = gt.variable(start=0.0, fixed=True)
    x2 = gt.variable(start=1.0, fixed=True)
    u = gt.input(max=0.75)
    final_time = 20.0

    def equations(self):
        yield der(self.x1) == (1 - self.x2**2) * self.x1 - self.x2 + self.u
        yield der(self.x2) == self.x1

    def objective(self):
        return gt.integral(self.x1**2 + self.x2**2 + self.u**2)


@pytest.mark.parametrize(
    ("reference", "by_hand"), [("van_der_pol.mop:Quiet", Quiet), ("penicillin.mop:MostProduct", Reactor)]
)
def test_a_file_and_a_class_by_hand_give_the_same_bits(reference: str, by_hand: type) -> None:
    mesh = gt.Mesh(20, points=3)
    text = gt.solve(gt.modelica.load(str(MODELS / reference))(), mesh, throw=False)
    hand = gt.solve(by_hand(), mesh, throw=False)
    assert text.objective == hand.objective and text.iterations == hand.iterations


def test_four_formulations_are_one_problem() -> None:
    """As one class, by extends and modification, as a component: bit for bit; the cost as a state: to the mesh."""
    file = MODELS / "van_der_pol.mop"
    names = ("Quiet", "QuietExtended", "QuietComponent", "QuietState")
    one, extended, component, state = (gt.solve(gt.modelica.load(f"{file}:{n}")(), MESH) for n in names)
    assert one.objective == extended.objective == component.objective
    assert state.objective == pytest.approx(one.objective, rel=SAME_MESH)
    assert "sys.x1" in component.trajectory.names and np.array_equal(
        component.trajectory["sys.x1"], one.trajectory["x1"]
    )


@pytest.mark.parametrize("reference", ["van_der_pol.mop:QuietComponent", "van_der_pol.mop:Fast"])
def test_the_printed_class_has_the_same_optimum(reference: str) -> None:
    printed = gt.modelica.python_of(str(MODELS / reference))
    world: dict[str, object] = {"__name__": "printed"}
    exec(printed, world)
    by_hand = next(c for c in world.values() if isinstance(c, type) and issubclass(c, gt.Optimization))
    text = gt.solve(gt.modelica.load(str(MODELS / reference))(), MESH)
    assert gt.solve(by_hand(), MESH).objective == text.objective
