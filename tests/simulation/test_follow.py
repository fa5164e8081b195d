"""A run keeps to the solution that it is on, or ends with a sentence: bends, folds, roots at zero, discontinuities."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

import gtmodel as gt
from gtmodel import ModelError, SolveStatus, der
from gtmodel.simulation import simulate
from gtmodel.simulation.systems import NewtonContinuation
from tests.simulation.test_status import Implicit


class Bump(gt.Model):
    """y follows x up to a bump as narrow as w at y = 3, which holds it back; y = x beyond is another solution."""

    x = gt.input(unit="1")
    y = gt.variable(unit="1", start=0.0)
    z = gt.variable(unit="s", start=0.0, fixed=True)
    w = gt.parameter(0.2, unit="1", positive=True)

    def equations(self):
        yield self.y + 3 * gt.exp(-(((self.y - 3) / self.w) ** 2)) == self.x
        yield der(self.z) == self.y


class OnCircle(gt.Model):
    """A point on a circle, its height from x alone: the root touches zero where the point is at the right."""

    x = gt.variable(unit="1", start=0.6, fixed=True)
    v = gt.variable(unit="1/s", start=0.8, fixed=True)
    y = gt.variable(unit="1", start=-0.8)
    z = gt.variable(unit="s", start=0.0, fixed=True)
    w = gt.parameter(1.0, unit="1/s")

    def equations(self):
        yield der(self.x) == self.v
        yield der(self.v) == -(self.w**2) * self.x
        yield self.x**2 + self.y**2 == 1
        yield der(self.z) == self.y


class Parallelogram(gt.Model):
    """Four-bar whose coupler is as long as its frame: at 0 and pi its two assemblies meet."""

    a = gt.parameter(1.0, unit="m", positive=True)
    d = gt.parameter(2.0, unit="m", positive=True)
    theta = gt.input(unit="rad")
    p = gt.variable(2, unit="m", start=[2.0, 1.0])

    def equations(self):
        pin = self.a * gt.vector([gt.cos(self.theta), gt.sin(self.theta)])
        coupler, rocker = self.p - pin, self.p - gt.vector([self.d, 0.0])
        yield gt.dot(coupler, coupler) == self.d**2
        yield gt.dot(rocker, rocker) == self.a**2


class TestBends:
    @pytest.mark.parametrize("w", [0.2, 0.05])
    @pytest.mark.parametrize("road", ["function", "table"])
    def test_a_narrow_bend_is_not_stepped_over(self, w, road):
        inputs = {"x": (lambda t: 5.5 * t / 3) if road == "function" else (np.array([0, 3.0]), np.array([0, 5.5]))}
        run = simulate(Bump(w=w), 3.0, step=0.3, inputs=inputs)

        def height(x):
            return brentq(lambda y: y + 3 * np.exp(-(((y - 3) / w) ** 2)) - x, -1.0, 3.0, xtol=1e-14)

        assert run.trajectory["y"] == pytest.approx([height(x) for x in run.trajectory["x"]], abs=1e-10)
        assert run.trajectory["y"][-1] == pytest.approx({0.2: 2.922117, 0.05: 2.979143}[w], abs=1e-6)
        fine = np.linspace(0.0, 5.5, 4001)
        area = np.trapezoid([height(x) for x in fine], fine) * 3 / 5.5
        assert run.trajectory["z"][-1] == pytest.approx(area, abs=1e-5) and run.residual < 1e-12

    def test_a_fold_ends_the_run(self):
        run = simulate(Implicit(), 1.0, inputs={"x": lambda t: 4 * t}, throw=False)
        assert run.status is SolveStatus.FAILED and run.residual < 1e-12
        assert run.message.startswith("the motion ends at 0.5 s, where the equations of ")
        assert "become singular: the solution turns back or ends there" in run.message
        assert run.trajectory.time[-1] > 0.49 and np.all(run.trajectory["y"] >= -1.0)


class TestDiscontinuities:
    def test_followed_to_the_solution_that_the_old_one_leads_to(self):
        table = (np.array([0.0, 0.5]), np.array([0.0, 1.9]))
        run = simulate(Implicit(), 1.0, inputs={"x": (table, "previous")})
        low = brentq(lambda y: y**3 - 3 * y - 1.9, -1.0, 0.0, xtol=1e-14)  # the others: -1.17 and 1.98
        assert run.trajectory["y"][-1] == pytest.approx(low, abs=1e-12)
        assert run.trajectory["z"][-1] == pytest.approx(0.5 * low, abs=1e-8)

    @pytest.mark.parametrize("to", [4.0, 30.0])
    def test_beyond_a_fold_there_is_no_such_solution(self, to):
        table = (np.array([0.0, 0.5]), np.array([0.0, to]))
        run = simulate(Implicit(), 1.0, inputs={"x": (table, "previous")}, throw=False)
        assert run.status is SolveStatus.FAILED and run.trajectory.time[-1] == 0.5
        assert "ends at 0.5 s, where an input is discontinuous: " in run.message and "cannot be followed" in run.message

    @pytest.mark.parametrize(("to", "good"), [(2.0, True), (3.5, False)])
    def test_a_root_must_not_meet_its_other_one_on_the_way(self, to, good):
        table = (np.array([0.0, 0.5]), np.array([1.0, to]))
        run = simulate(Parallelogram(), 1.0, inputs={"theta": (table, "previous")}, throw=False)
        assert run.status.ok is good and ("where an input is discontinuous: p[0], p[1]" in run.message) is not good
        if good:
            assert run.trajectory["p"][-1] == pytest.approx([2 + np.cos(to), np.sin(to)], abs=1e-12)


class TestRoots:
    @pytest.mark.parametrize("step", [None, 1.0, 5.0])
    def test_no_reflection(self, step):
        run = simulate(OnCircle(), 10.0, step=step, throw=False)
        assert run.status is SolveStatus.FAILED
        assert run.message.startswith("the motion ends at 0.92729") and "in a singular pose: the two" in run.message
        t = run.trajectory
        assert t["y"] == pytest.approx(-t["v"], abs=1e-4)

    def test_a_root_that_turns_back_before_zero_goes_on(self):
        start = {"x": 0.6, "v": 0.797, "y": -0.8}  # as near as 0.067 of the radius
        run = simulate(OnCircle(), 5.0, start=start, tolerance=1e-11)
        x = 0.6 * np.cos(run.trajectory.time) + 0.797 * np.sin(run.trajectory.time)
        assert run.trajectory["y"] == pytest.approx(-np.sqrt(1 - x**2), abs=1e-6)
        assert np.max(run.trajectory["y"]) > -0.08

    @pytest.mark.parametrize("step", [0.5, None])
    def test_an_assembly_does_not_change_at_the_dead_point(self, step):
        run = simulate(Parallelogram(), 4.0, step=step, inputs={"theta": lambda t: 0.5 + t}, throw=False)
        assert run.status is SolveStatus.FAILED and run.message.startswith("the motion ends at 2.64159 s in a singular")
        t = run.trajectory
        assert t["p"] == pytest.approx(np.transpose([2 + np.cos(t["theta"]), np.sin(t["theta"])]), abs=1e-12)


@pytest.mark.parametrize("theta", [0.1, 0.5, 3.0, 4.0, 5.9])
def test_the_start_is_where_the_causal_function_is(theta):
    run = simulate(Parallelogram(), 0.1, step=0.1, inputs={"theta": theta})
    p, status = Parallelogram().causal("theta", "p")(theta)
    assert status == 0 and run.trajectory["p"][0] == pytest.approx(p, abs=1e-12)
    if theta == 0.5:
        assert p == pytest.approx([2 + np.cos(0.5), np.sin(0.5)], abs=1e-12)


class Driven(gt.Model):
    """The force that a prescribed motion takes."""

    q = gt.input(unit="m")
    f = gt.variable(unit="N")
    m = gt.parameter(2.0, unit="kg")

    def equations(self):
        yield self.f == self.m * der(self.q, 2)


class TestTables:
    rows = np.linspace(0.0, 1.0, 11)

    def test_one_that_ends_while_moving_is_an_impulse(self):
        table = ((self.rows, self.rows**2), "cubic")
        with pytest.raises(ModelError, match=r"ends at 1 s with der\(q\) = 2 .* der\(q,2\), .* has an impulse there"):
            simulate(Driven(), 2.0, inputs={"q": table})
        run = simulate(Driven(), 1.0, inputs={"q": table})
        assert run.trajectory["f"][:-1] == pytest.approx(4.0, abs=1e-9)

    def test_one_that_begins_while_moving_too(self):
        table = ((1.0 + self.rows, self.rows * (2 - self.rows)), "cubic")
        with pytest.raises(ModelError, match=r"begins at 1 s with der\(q\) = 2 .* or let it begin at rest"):
            simulate(Driven(), 1.5, inputs={"q": table})

    def test_one_at_rest_at_both_ends_may_end(self):
        rows = np.linspace(0.0, 1.0, 101)
        run = simulate(Driven(), 2.0, inputs={"q": ((rows, rows**3 * (10 - 15 * rows + 6 * rows**2)), "cubic")})
        assert run.trajectory["q"][-1] == 1.0 and run.trajectory["f"][-1] == 0.0


class Sum(gt.Model):
    x = gt.variable(unit="1", start=0.0, fixed=True)
    u = gt.input(unit="1/s")

    def equations(self):
        yield der(self.x) == self.u


class TestPulses:
    def test_a_narrow_one_after_a_long_rest(self):
        run = simulate(Sum(), 100.0, inputs={"u": lambda t: gt.exp(-(((t - 53.13) / 1e-3) ** 2))})
        assert run.trajectory["x"][-1] == pytest.approx(np.sqrt(np.pi) * 1e-3, rel=1e-4)

    def test_a_longest_step_between_far_rows(self):
        def pulse(t):
            return gt.exp(-(((t - 5.3137) / 2e-5) ** 2))

        area = np.sqrt(np.pi) * 2e-5
        run = simulate(Sum(), 10.0, step=5.0, inputs={"u": pulse}, max_step=8e-5, tolerance=1e-12)
        assert run.trajectory["x"][-1] == pytest.approx(area, rel=1e-4) and len(run.trajectory) == 3

    @pytest.mark.parametrize(
        ("max_step", "sentence"),
        [
            (0.0, "max_step must be positive; found 0 s"),
            ("a", "max_step takes a number; found 'a'"),
            (1e-9, r"a max_step of 1e-09 s means 1e\+09 steps, more than 10000000; give at least 1e-07 s"),
        ],
    )
    def test_a_longest_step_that_makes_no_sense(self, max_step, sentence):
        with pytest.raises(ModelError, match=sentence):
            simulate(Sum(), 1.0, inputs={"u": 1.0}, max_step=max_step)


class Sliding(gt.Model):
    """Dry friction that is discontinuous, or nearly: at rest after 10/7 s, and there it stays."""

    v = gt.variable(unit="1", start=1.0, fixed=True)
    u = gt.input(unit="1/s")
    tau = gt.parameter(1.0, unit="s")

    def equations(self):
        yield self.tau * der(self.v) == self.tau * self.u - self.v / gt.absolute(self.v)


class NearlyDiscontinuous(Sliding):
    def equations(self):
        yield self.tau * der(self.v) == self.tau * self.u - gt.tanh(self.v / 1e-12)


def test_a_discontinuity_ends_the_run_after_a_bounded_number_of_calls():
    calls = []
    run = simulate(Sliding(), 3.0, inputs={"u": 0.3}, throw=False, progress=calls.append)
    assert run.status is SolveStatus.FAILED and len(calls) < 200
    assert run.message.startswith("the motion ends at 1.42857 s: the integrator's steps became too small there")
    assert "look for a term that is discontinuous" in run.message


def test_what_is_nearly_discontinuous_is_followed_to_where_it_rests():
    calls = []
    run = simulate(NearlyDiscontinuous(), 3.0, inputs={"u": 0.3}, progress=calls.append)
    assert run.trajectory["v"][-1] == pytest.approx(1e-12 * np.arctanh(0.3), rel=1e-3) and len(calls) < 200


def test_equations_that_do_not_hold_are_no_solved_run(monkeypatch):
    follow = NewtonContinuation.follow
    monkeypatch.setattr(NewtonContinuation, "follow", lambda self, z, begin, end: follow(self, z, begin, end) + 5e-5)
    run = simulate(Implicit(), 0.1, inputs={"x": 1.0}, throw=False)
    assert run.status is SolveStatus.FAILED and run.residual > 1e-5
    assert "Implicit equation 1" in run.message and "does not hold at" in run.message
