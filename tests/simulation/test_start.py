"""Consistent initialisation: what is prescribed holds, what is free is chosen and told, what contradicts is named."""

from __future__ import annotations

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import ModelError, der
from gtmodel.simulation import simulate
from tests.simulation.models import FourBarInAngles
from tests.support.models import Pendulum, SeriesRLC

ROUND_OFF = 1e-12


def first(model, *names, **options):
    trajectory = simulate(model, 1e-3, step=1e-3, **options).trajectory
    return [trajectory[name][0] for name in names]


class TestChoice:
    def test_everything_prescribed_leaves_nothing_to_choose(self):
        run = simulate(Pendulum(), 0.01, start={"x": 0.6, "der(x)": 0.3})
        assert run.chosen == {}
        t = run.trajectory
        # the start value of y says on which side
        assert [t[n][0] for n in ("x", "y", "der(x)", "der(y)")] == pytest.approx(
            [0.6, -0.8, 0.3, 0.225], abs=ROUND_OFF
        )

    def test_velocities_nobody_prescribes_are_zero_and_it_is_told(self):
        run = simulate(Pendulum(), 0.01, start={"x": 0.6})
        assert run.chosen == {"der(x)": 0.0}
        assert simulate(Pendulum(), 0.01).chosen == {"x": pytest.approx(0.6), "der(x)": 0.0}

    def test_a_dependent_quantity_may_be_prescribed_instead(self):
        run = simulate(Pendulum(), 0.01, start={"y": -0.8, "der(y)": 0.225})
        assert run.chosen == {}
        assert run.trajectory["der(x)"][0] == pytest.approx(0.3, abs=ROUND_OFF)

    def test_a_circuit_starts_at_rest(self):
        run = simulate(SeriesRLC(), 0.01, inputs={"u": 5.0})
        assert sorted(run.chosen.values()) == [0.0, 0.0]
        assert run.trajectory["capacitor.v"][0] == pytest.approx(0.0, abs=ROUND_OFF)

    def test_at_x_equals_L_with_only_x_given(self):
        run = simulate(Pendulum(), 0.01, start={"x": 1.0})
        # x = L leaves y no choice but 0, to first order though it is free
        assert run.chosen == {"y": pytest.approx(0.0, abs=1e-7), "der(y)": pytest.approx(0.0, abs=1e-7)}
        assert run.trajectory["der(y)"][-1] == pytest.approx(-9.81 * 0.01, rel=1e-3)

    def test_zero_is_a_choice_of_the_states_that_will_be(self):
        class Train(gt.Model):
            """A pendulum on a train of constant speed; released level with its pivot, where x is no state."""

            x = gt.variable(unit="m", start=0.6)
            y = gt.variable(unit="m", start=-0.8)
            pull = gt.variable(unit="1/s2")
            L = gt.parameter(1.0, unit="m")
            g = gt.parameter(9.81, unit="m/s2")
            v = gt.parameter(5.0, unit="m/s")

            def equations(self):
                from_pivot = self.x - self.v * self.time
                yield der(self.x, 2) == -self.pull * from_pivot
                yield der(self.y, 2) == -self.pull * self.y - self.g
                yield from_pivot**2 + self.y**2 == self.L**2

        run = simulate(Train(), 5.0, start={"x": 1.0, "y": 0.0, "der(x)": 5.0}, tolerance=1e-11)
        assert run.chosen == {"der(y)": 0.0}
        still = simulate(Pendulum(), 5.0, start={"x": 1.0, "y": 0.0, "der(y)": 0.0}, tolerance=1e-11)
        along = run.trajectory["x"] - 5.0 * run.trajectory.time
        assert along == pytest.approx(still.trajectory["x"], abs=1e-6)
        assert run.trajectory["y"] == pytest.approx(still.trajectory["y"], abs=1e-6)

    def test_values_far_from_the_nominal_are_reached(self):
        class Tank(gt.Model):
            T = gt.variable(unit="K", start=300.0, fixed=True)
            loss = gt.variable(unit="W")
            a = gt.parameter(1e4, unit="W/K")
            C = gt.parameter(5e6, unit="J/K")

            def equations(self):
                yield self.loss == self.a * self.T
                yield self.C * der(self.T) == -self.loss

        run = simulate(Tank(), 100.0, tolerance=1e-11)
        assert run.chosen == {} and run.trajectory["loss"][0] == pytest.approx(3e6, rel=ROUND_OFF)
        assert run.trajectory["T"][-1] == pytest.approx(300.0 * np.exp(-0.2), rel=1e-9)

    def test_a_robot_follows_its_assembly_mode_to_a_far_start(self):
        robot = gt.robots.gantry_tau("l1_tape")
        for x in (-3.0, 0.0, 6.0):
            T = np.array([x, -0.9, 0.3])
            (q,) = first(robot, "q", inputs={"tau": 0.0}, start={"T": T})
            expected, status = robot.causal(known="T", targets="q")(T)
            assert status is gt.Status.OK and q == pytest.approx(expected, abs=1e-10)

    @pytest.mark.parametrize("side", [-1.0, 1.0])
    def test_a_root_that_nothing_declared_tells_apart(self, side):
        class Sheet(gt.Model):
            """x' = -y on the hyperbola y^2 = x^2 + 1."""

            x = gt.variable(unit="1", start=1.0, fixed=True)
            y = gt.variable(unit="1", start=0.0)
            tau = gt.parameter(1.0, unit="s")

            def equations(self):
                yield self.tau * der(self.x) == -self.y
                yield self.y**2 == self.x**2 + 1

        run = simulate(Sheet(), 1.0, start={"y": side * np.sqrt(2)}, tolerance=1e-11)
        assert run.trajectory["x"][-1] == pytest.approx(np.sinh(np.arcsinh(1.0) - side), abs=1e-8)


class TestAttributes:
    def test_fixed_starts_are_prescribed_and_others_are_guesses(self):
        class Fixed(Pendulum):
            x = gt.variable(unit="m", start=0.8, fixed=True)

        assert first(Fixed(), "x", "y") == pytest.approx([0.8, -0.6], abs=ROUND_OFF)
        # guesses that do not fit the rod give way to it, as little as they can
        x, y = first(Pendulum(x=dict(start=0.7), y=dict(start=-0.8)), "x", "y")
        assert [x, y] == pytest.approx(np.array([0.7, -0.8]) / np.hypot(0.7, 0.8), abs=0.01)
        assert np.hypot(x, y) == pytest.approx(1.0, abs=ROUND_OFF)

    def test_a_start_argument_overrules_the_attribute(self):
        class Fixed(Pendulum):
            x = gt.variable(unit="m", start=0.8, fixed=True)

        assert first(Fixed(), "x", start={"x": 0.6}) == pytest.approx([0.6], abs=ROUND_OFF)

    def test_the_start_of_a_removed_name_counts(self):
        robot = gt.robots.gantry_tau("l1_tape")
        (T,) = first(robot, "T", inputs={"tau": 0.0}, start={"plate.frame.r": [0.5, -0.9, 0.3]})
        assert T == pytest.approx([0.5, -0.9, 0.3], abs=ROUND_OFF)

    def test_starts_of_newton_unknowns(self):
        run = simulate(FourBarInAngles(), 0.01, inputs={"torque": 0.0}, start={"phi": 0.5, "der(phi)": 4.0})
        assert run.chosen == {} and run.residual < 1e-12


class Thrown(Pendulum):
    """Starts at x = 0.5 with 2 m/s, said by equations."""

    v0 = gt.parameter(2.0, unit="m/s")
    x0 = gt.parameter(0.5, unit="m")

    def initial_equations(self):
        yield der(self.x) ** 2 + der(self.y) ** 2 == self.v0**2
        yield self.x == self.x0


class TestInitialEquations:
    def test_they_hold_at_the_start_only(self):
        t = simulate(Thrown(), 0.2).trajectory
        assert t["x"][0] == pytest.approx(0.5, abs=ROUND_OFF)
        speed = np.hypot(t["der(x)"], t["der(y)"])
        assert speed[0] == pytest.approx(2.0, abs=1e-10) and np.ptp(speed) > 0.1

    def test_what_they_leave_open_may_be_prescribed(self):
        class Half(Pendulum):
            v0 = gt.parameter(2.0, unit="m/s")

            def initial_equations(self):
                yield der(self.x) == self.v0

        run = simulate(Half(), 0.1, start={"x": 0.28})
        assert run.chosen == {} and run.trajectory["der(y)"][0] == pytest.approx(2.0 * 0.28 / 0.96, abs=1e-10)

    def test_a_conflict_names_both(self):
        with pytest.raises(ModelError, match=r"prescribed y = -0\.1: .*Thrown equation 1 \(initial\) .*test_start\.py"):
            simulate(Thrown(), 0.2, start={"y": -0.1})

    def test_a_derivative_that_nothing_needs_is_refused(self):
        class High(Pendulum):
            j = gt.parameter(1.0, unit="m/s3")

            def initial_equations(self):
                yield der(self.x, 3) == self.j

        with pytest.raises(ModelError, match=r"an initial equation uses der\(x,3\)"):
            simulate(High(), 0.2)


class TestConflicts:
    @pytest.mark.parametrize(
        ("start", "sentence"),
        [
            ({"x": 1.2}, r"with the prescribed x = 1\.2: .*Pendulum equation 3 \(support/models\.py:\d+\)"),
            ({"x": 0.6, "y": -0.9}, r"with the prescribed x = 0\.6, y = -0\.9: .*remains in Pendulum equation 3 "),
            ({"x": 0.6, "der(x)": 1.0, "der(y)": 0.0}, r"der\(x\) = 1, .*Pendulum equation 3' "),
            ({"x": [1.0, 2.0]}, "the start of 'x' has 1 entries; found 2"),
            ({"x": np.nan}, "the start of 'x' must be finite"),
            ({"x": "left"}, "the start of 'x' must be numbers; found 'left'"),
            ({"z": 1.0}, "Pendulum has no variable 'z'"),
        ],
    )
    def test_wrong_starts(self, start, sentence):
        with pytest.raises(ModelError, match=sentence):
            simulate(Pendulum(), 1.0, start=start)

    def test_of_many_values_only_those_at_fault_are_named(self):
        robot = gt.robots.gantry_tau("l1_tape")
        q, _ = robot.causal(known="T", targets="q")([0.5, -0.9, 0.3])
        with pytest.raises(ModelError) as error:
            simulate(robot, 1.0, inputs={"tau": 0.0}, start={"T": [0.5, -0.9, 0.3], "q[1]": q[1] + 0.1, "der(T)": 0.0})
        assert "arm[1].rod equation 1" in str(error.value) and "arm[0]" not in str(error.value)
        assert "q[1] = " in str(error.value) and "der(" not in str(error.value)

    def test_one_quantity_with_two_values(self):
        robot = gt.robots.gantry_tau("l1_tape")
        with pytest.raises(
            ModelError, match=r"'T' and 'plate\.frame\.r' are the same quantity, but their start values differ"
        ):
            simulate(robot, 1.0, inputs={"tau": 0.0}, start={"T": [0.5, -0.9, 0.3], "plate.frame.r": 0.0})

    def test_an_input_has_no_start_of_its_own(self):
        with pytest.raises(ModelError, match="'u' cannot have a start value"):
            simulate(SeriesRLC(), 1.0, inputs={"u": 5.0}, start={"u": 0.0})

    def test_a_singular_pose_is_no_start(self):
        class Folded(gt.Model):
            """A parallelogram of two equal cranks, stretched out: there it may go on in two ways."""

            p = gt.variable(2, unit="m", start=[1.0, 0.0])
            q = gt.variable(2, unit="m", start=[3.0, 0.0])
            r = gt.parameter(1.0, unit="m", positive=True)
            l = gt.parameter(2.0, unit="m", positive=True)
            pull = gt.variable(3, unit="N/m")
            m = gt.parameter(1.0, unit="kg", positive=True)

            def equations(self):
                rod = self.q - self.p
                lever = gt.vector([self.q[0] - self.l, self.q[1]])
                yield gt.dot(self.p, self.p) == self.r**2
                yield gt.dot(rod, rod) == self.l**2
                yield gt.dot(lever, lever) == self.r**2
                yield self.m * der(self.p, 2) == -self.pull[0] * self.p + self.pull[1] * rod
                yield self.m * der(self.q, 2) == -self.pull[2] * lever - self.pull[1] * rod

        fine = {"p": [0.6, 0.8], "q": [2.6, 0.8]}
        assert simulate(Folded(p=dict(start=fine["p"]), q=dict(start=fine["q"])), 0.1, start={"p[0]": 0.6}).status.ok
        with pytest.raises(ModelError, match="singular"):
            simulate(Folded(), 0.1, start={"p": [1.0, 0.0], "q": [3.0, 0.0]})
