"""Every solution tells by how much its mesh misses the model: against re-simulation, exact motions and other forms."""

from __future__ import annotations

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import der
from gtmodel.optimize import Mesh, SolverOptions, multi_start, refine, resimulate, solve, solve_phases, transcribe
from gtmodel.optimize.judgement.discretisation import COST, NAME, discretisation
from gtmodel.results import SolveStatus
from tests.optimize import features, problems

# the estimate is of first order in the error, and the re-simulation is at the edges only
FIRST_ORDER = 0.25


class Oscillator(gt.Optimization):
    """x'' = -w2 x + u with a bounded input, from rest; as far as it gets."""

    w2 = gt.parameter(100.0)
    size = gt.parameter(1e-3)
    x = gt.variable(start=0.0, fixed=True)
    v = gt.variable(start=0.0, fixed=True)
    u = gt.input()
    final_time = 10.0

    def equations(self):
        yield der(self.x) == self.v
        yield der(self.v) == self.u - self.w2 * self.x

    def objective(self):
        return -self.x.at(self.final_time) / self.size

    def constraints(self):
        yield self.u <= self.size
        yield self.u >= -self.size


@pytest.mark.parametrize(("elements", "status"), [(5, "check_failed"), (20, "check_failed"), (200, "solved")])
def test_a_mesh_that_cannot_resolve_the_model_is_told(elements, status):
    s = solve(Oscillator(), Mesh(elements))  # does not raise
    assert s.status.value == status and s.checks[NAME].passed == s.status.ok
    assert s.status.converged and "x" in s.trajectory and "check" in s.seconds
    assert ("does not resolve" in s.message) != s.status.ok


@pytest.mark.parametrize("elements", [60, 100])
@pytest.mark.parametrize("size", [1e-4, 1e-3, 1e3])
def test_it_is_what_a_resimulation_shows_in_any_unit(elements, size):
    s = solve(Oscillator(size=size), Mesh(elements))
    run = resimulate(s)
    ranges = [np.ptp(s.trajectory[n]) for n in ("x", "v")]
    edges = np.searchsorted(s.trajectory.time, np.linspace(0.0, 10.0, elements + 1) - 1e-9)
    every = slice(None, None, 8)
    shown = max(
        np.max(np.abs(run.trajectory[n][every] - s.trajectory[n][edges])) / r
        for n, r in zip(("x", "v"), ranges, strict=True)
    )
    assert s.checks[NAME].value == pytest.approx(shown, rel=FIRST_ORDER)


@pytest.mark.parametrize(("points", "scheme"), [(1, "radau"), (2, "radau"), (3, "radau"), (2, "gauss"), (3, "gauss")])
def test_order_at_the_edges_and_points(points, scheme):
    """The states at collocation points converge with h^(points + 1), those at the edges faster."""

    class Decay(gt.Optimization):
        x = gt.variable(start=1.0, fixed=True)
        final_time = 1.0

        def equations(self):
            yield der(self.x) == -2 * self.x * self.x

        def objective(self):
            return gt.integral(self.x)

        def constraints(self):
            return ()

    values, true = [], []
    for elements in (4, 8, 16):
        s = solve(Decay(), Mesh(elements, points, scheme), solver=SolverOptions(tolerance=1e-12))
        values.append(s.checks[NAME].value)
        exact = 1 / (1 + 2 * s.trajectory.time)
        true.append(np.max(np.abs(s.trajectory["x"] - exact)) / np.ptp(s.trajectory["x"]))
    assert values == pytest.approx(true, rel=FIRST_ORDER)
    assert np.log2(values[-2] / values[-1]) > min(points + 1, 2 * points - 1) - 0.5


class Upright(gt.Optimization):
    """x'' = 25 x + u: no input brings it anywhere open loop, over e^50."""

    x = gt.variable(start=1.0, fixed=True)
    v = gt.variable(start=0.0, fixed=True)
    u = gt.input()
    final_time = 10.0

    def equations(self):
        yield der(self.x) == self.v
        yield der(self.v) == 25 * self.x + self.u

    def objective(self):
        return gt.integral(self.x**2 + self.u**2 / 100)

    def constraints(self):
        yield self.x.at(self.final_time) == 0.5


def test_an_unstable_model_is_measured_by_its_nearest_motion():
    """Against the optimum on a far finer mesh, where a re-simulation says nothing any more."""
    fine = solve(Upright(), Mesh(400)).trajectory
    found = []
    for elements in (8, 60):
        s = solve(Upright(), Mesh(elements))
        assert discretisation(s.nlp, s.x).shadow
        off = np.max(np.abs(s.trajectory["x"] - np.interp(s.trajectory.time, fine.time, fine["x"])))
        found.append((s.status.ok, off < 1e-2 * np.ptp(fine["x"])))
    assert resimulate(solve(Upright(), Mesh(60))).defect > 10
    assert found == [(False, False), (True, True)]


@pytest.mark.parametrize("make", [problems.VanDerPol, problems.ImplicitBlock, problems.LinearAlgebraic])
def test_all_forms_say_the_same(make):
    values = []
    for form in ("auto", "torn", "dae"):
        s = solve(make(), Mesh(10, 3), solver=SolverOptions(formulation=form, tolerance=1e-10), throw=False)
        values.append(s.checks[NAME].value)
    assert values == pytest.approx([values[0]] * 3, rel=1e-3, abs=1e-9)


@pytest.mark.parametrize("control", ["polynomial", "bernstein", "linear", "constant"])
def test_a_jump_of_the_input_is_no_error(control):
    """Bang-bang: the input is what it is. A quadratic one makes a quartic of x, where the states are cubics."""

    class Bang(gt.Optimization):
        x = gt.variable(start=0.0, fixed=True)
        v = gt.variable(start=0.0, fixed=True)
        u = gt.input(min=-1.0, max=0.6)
        final_time = gt.free(guess=2.0, min=0.1)

        def equations(self):
            yield der(self.x) == self.v
            yield der(self.v) == self.u

        def objective(self):
            return self.final_time

        def constraints(self):
            yield self.x.at(self.final_time) == 1.0
            yield self.v.at(self.final_time) == 0.0

    s = solve(Bang(), Mesh(7, control=control))
    assert s.status.ok and s.checks[NAME].value < (2e-3 if control in ("polynomial", "bernstein") else 1e-6)


def test_what_stands_still_is_no_error():
    """What the symmetry keeps at 0 is judged beside the vector's other entries, a scalar by the solver's noise."""

    class Still(gt.Optimization):
        r = gt.variable(shape=(2,), start=[1.0, 0.0], fixed=True)
        w = gt.variable(start=0.0, fixed=True)
        f = gt.input(shape=(2,), min=-1.0, max=1.0)
        final_time = 3.0

        def equations(self):
            yield der(self.r) == self.f - gt.sin(self.r) * gt.dot(self.r, self.r)
            yield der(self.w) == gt.sin(self.r[1]) - self.w**3

        def objective(self):
            return gt.integral(gt.dot(self.r, self.r) + gt.dot(self.f, self.f) + self.w**2)

        def constraints(self):
            return ()

    s = solve(Still(), Mesh(20))
    assert s.status.ok and np.ptp(s.trajectory["w"]) < 1e-6


class TestRoads:
    def test_phases(self):
        def phase(w2: float, start: bool) -> gt.Optimization:
            class Leg(gt.Optimization):
                x = gt.variable(start=1.0, fixed=start)
                v = gt.variable(start=0.0, fixed=start)
                u = gt.input(min=-1.0, max=1.0)
                start_time = 0.0 if start else 5.0
                final_time = 5.0 if start else 10.0

                def equations(self):
                    yield der(self.x) == self.v
                    yield der(self.v) == self.u - w2 * self.x

                def objective(self):
                    return gt.integral(self.u**2 + self.x**2)

                def constraints(self):
                    return ()

            return Leg()

        whole = gt.Phases({"slow": phase(1.0, True), "fast": phase(900.0, False)})
        coarse = solve_phases(whole, Mesh(10))
        assert coarse.status is SolveStatus.CHECK_FAILED and "phase 'fast'" in coarse.message
        assert [s.checks[NAME].passed for s in coarse.phases.values()] == [True, False]
        assert all(s.status is SolveStatus.CHECK_FAILED for s in coarse.phases.values())
        assert solve_phases(whole, {"slow": Mesh(10), "fast": Mesh(200)}).status.ok

    def test_again_with_other_parameters(self):
        road = transcribe(Oscillator(), Mesh(20), parameters=["w2"])
        assert [road.solve({"w2": w2}).status.ok for w2 in (1.0, 100.0, 1.0)] == [True, False, True]
        steps = road.continuation([{"w2": 1.0}, {"w2": 100.0}]).steps
        assert [s.status.ok for _, s in steps] == [True, False]

    def test_many_starts(self):
        found = multi_start(transcribe(Oscillator(), Mesh(20)), 2)
        assert not found.failures and found.best.status is SolveStatus.CHECK_FAILED

    def test_shooting_has_none(self):
        s = solve(features.Tank(), Mesh(8, 3, control="constant"), method="shooting")
        assert s.status.ok and s.checks[NAME].passed

    def test_refinement_goes_on_until_it_holds(self):
        """In nominals, which are 1 here, the first mesh is fine."""
        r = refine(Oscillator(), Mesh(20), tolerance=1e-2)
        assert r.reached and len(r.passes) > 1 and r.solution.checks[NAME].passed

    def test_free_lengths_and_delays(self):
        s = solve(problems.VanDerPol(), Mesh(20, length_ratio=(0.5, 2.0), control="linear"))
        assert s.status.ok and 0 < s.checks[NAME].value < 1e-2


def test_the_bound_is_the_callers():
    strict = SolverOptions(error_bound=1e-9)
    assert solve(problems.VanDerPol(), Mesh(20), solver=strict).status is SolveStatus.CHECK_FAILED
    open_ended = solve(Oscillator(), Mesh(5), solver=SolverOptions(error_bound=None))
    assert open_ended.status.ok and open_ended.checks[NAME].value > 0.1
    for wrong in (0.0, -1.0, "1"):
        with pytest.raises(gt.ModelError, match="error_bound"):
            SolverOptions(error_bound=wrong)


class Hum(gt.Optimization):
    """A cost that swings: the optimum is u = sign(sin 100 t), and the cost the mean of |sin|."""

    w = gt.parameter(100.0, unit="1/s")
    x = gt.variable(start=0.0, fixed=True)
    u = gt.input(min=-1.0, max=1.0)
    final_time = 1.0

    def equations(self):
        yield der(self.x) == self.u

    def objective(self):
        return -gt.integral(gt.sin(self.w * self.time) * self.u)

    def constraints(self):
        return ()


class TestIntegrals:
    """The states are right on any mesh here; the cost is not."""

    EXACT = -float(np.trapezoid(np.abs(np.sin(100 * np.linspace(0, 1, 200001))), dx=5e-6))

    @pytest.mark.parametrize(("mesh", "ok"), [((5, 3), False), ((50, 1), False), ((60, 3), True)])
    def test_a_cost_that_the_mesh_does_not_resolve_is_told(self, mesh, ok):
        s = solve(Hum(), Mesh(*mesh))
        assert s.status.ok == ok == s.checks[COST].passed and s.checks[NAME].passed
        assert ok or "integral in the objective" in s.message
        assert not ok or s.objective == pytest.approx(self.EXACT, rel=1e-2)

    def test_refinement_goes_on_until_it_is_resolved(self):
        r = refine(Hum(), Mesh(5), tolerance=1.0)
        assert r.reached and len(r.passes) > 1 and r.solution.objective == pytest.approx(self.EXACT, rel=1e-2)

    def test_a_cost_of_nothing_is_resolved(self):
        """Perfect tracking: what is left is the solver's tolerance."""

        class Track(Hum):
            w = gt.parameter(1.0, unit="1/s")

            def objective(self):
                return gt.integral((self.x - gt.sin(self.w * self.time)) ** 2)

        assert all(solve(Track(), Mesh(n)).status.ok for n in (5, 20, 80))

    def test_without_a_state(self):
        class Wave(gt.Optimization):
            w = gt.parameter(60.0, unit="1/s")
            u = gt.input()
            final_time = 1.0

            def objective(self):
                return gt.integral((self.u - gt.sin(self.w * self.time)) ** 2 + 0.1 * self.u**2)

            def equations(self):
                return []

            def constraints(self):
                return ()

        assert [solve(Wave(), Mesh(n)).status.ok for n in (4, 60)] == [False, True]
