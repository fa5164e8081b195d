"""What drives a simulation: constants, functions, tables, trajectories; and what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad

import gtmodel as gt
from gtmodel import ModelError, Trajectory, der
from gtmodel.simulation import simulate
from tests.simulation.robot import T0, l1
from tests.support.models import SeriesRLC


class Driven(gt.Model):
    """x' = u - x, y = u: the answer to any input is an integral."""

    x = gt.variable(start=0.0, fixed=True)
    y = gt.variable()
    u = gt.input(unit="V")
    k = gt.parameter(1.0, unit="V")

    def equations(self):
        yield der(self.x) == self.u / self.k - self.x
        yield self.y == self.u


class Slow(Driven):
    """As before, with time in seconds."""

    def equations(self):
        yield self.tau * der(self.x) == self.u / self.k - self.x
        yield self.y == self.u

    tau = gt.parameter(1.0, unit="s")
    x = gt.variable(unit="1", start=0.0, fixed=True)
    y = gt.variable(unit="V")


def answer(u, t):
    return quad(lambda s: u(s) * np.exp(s - t), 0.0, t, epsabs=1e-13, epsrel=1e-13, limit=200)[0]


def end(value, **options):
    run = simulate(Slow(), 2.0, inputs={"u": value}, tolerance=1e-12, **options)
    return run.trajectory["x"][-1]


TIMES = np.linspace(0.0, 2.0, 11)


class TestRoads:
    def test_constant(self):
        assert end(3.0) == pytest.approx(3.0 * (1 - np.exp(-2.0)), abs=1e-10)

    @pytest.mark.parametrize("function", [lambda t: np.sin(3 * t), lambda t: gt.sin(3 * t), lambda t: [np.sin(3 * t)]])
    def test_function_of_time(self, function):
        assert end(function) == pytest.approx(answer(lambda t: np.sin(3 * t), 2.0), abs=1e-10)

    def test_function_that_is_constant(self):
        assert end(lambda t: 3.0) == end(3.0)

    @pytest.mark.parametrize(("interpolation", "order"), [("previous", 1), ("linear", 2), ("cubic", 4)])
    def test_tables_converge_to_the_function(self, interpolation, order):
        errors = []
        for n in (24, 48):
            t = np.linspace(0.0, 2.0, n + 1)
            run = simulate(Slow(), 2.0, inputs={"u": ((t, np.sin(3 * t) + 2 * t), interpolation)}, tolerance=1e-12)
            t = run.trajectory.time
            exact = 2 * (t - 1 + np.exp(-t)) + (np.sin(3 * t) - 3 * np.cos(3 * t) + 3 * np.exp(-t)) / 10
            errors.append(np.max(np.abs(run.trajectory["x"] - exact)))
        assert errors[0] / errors[1] == pytest.approx(2.0**order, rel=0.3)

    @pytest.mark.parametrize("interpolation", ["previous", "linear", "cubic"])
    def test_a_table_is_what_it_says_between_its_rows(self, interpolation):
        t, u = np.array([0.0, 0.3, 0.5, 1.1, 1.6]), np.array([1.0, -2.0, 0.5, 3.0, 1.0])
        run = simulate(Slow(), 2.0, step=0.001, inputs={"u": ((t, u), interpolation)}, tolerance=1e-11)
        found, times = run.trajectory["y"], run.trajectory.time
        inside = times <= 1.6
        if interpolation == "linear":
            expected = np.interp(times, t, u)
        elif interpolation == "previous":
            expected = u[np.searchsorted(t[1:], times, side="left")]  # on a discontinuity: what was before
        else:
            from scipy.interpolate import CubicSpline

            expected = np.where(inside, CubicSpline(t, u)(times), 1.0)
        assert found == pytest.approx(expected, abs=1e-12)
        # and the state is the integral of that
        middle, h = 0.5 * (found[1:] + found[:-1]), 0.001
        if interpolation != "previous":
            x = np.zeros(len(times))
            for k in range(len(h * middle)):
                x[k + 1] = x[k] * np.exp(-h) + middle[k] * (1 - np.exp(-h))
            assert run.trajectory["x"] == pytest.approx(x, abs=1e-5)

    def test_steps_are_met_exactly(self):
        # 1 V until 0.25 s, then -1 V: whatever the rows and whatever the tolerance would step over
        expected = -1 + (2 - np.exp(-0.25)) * np.exp(-1.75)
        for step in (0.01, 0.3, 2.0):
            assert end(((np.array([0.0, 0.25]), np.array([1.0, -1.0])), "previous"), step=step) == pytest.approx(
                expected, abs=1e-10
            )

    def test_tables_keep_their_end_values(self):
        table = (np.array([0.5, 1.0]), np.array([1.0, 2.0]))
        run = simulate(Slow(), 2.0, inputs={"u": table})
        assert run.trajectory["y"][0] == 1.0 and run.trajectory["y"][-1] == 2.0

    def test_a_table_ends_where_the_run_does_not(self):
        late = (np.array([-1.0, 5.0, 9.0]), np.array([-1.0, 5.0, -9.0]))
        assert end(late) == pytest.approx(answer(lambda t: t, 2.0), abs=1e-10)

    def test_trajectory_and_table_are_the_same(self):
        t = np.linspace(0.0, 2.0, 41)
        trajectory = Trajectory(t, {"u": np.cos(t), "other": t}, {"u": "V"})
        assert end(trajectory) == end((t, np.cos(t)))
        assert end((trajectory, "cubic")) == end(((t, np.cos(t)), "cubic"))

    def test_what_one_simulation_recorded_drives_another(self):
        first = simulate(SeriesRLC(), 1.0, inputs={"u": lambda t: np.sin(5 * t)}, tolerance=1e-11)
        again = simulate(SeriesRLC(), 1.0, inputs={"u": (first.trajectory, "cubic")}, tolerance=1e-11)
        # at each of 500 rows the integrator starts anew, at low order
        assert again.trajectory["capacitor.v"] == pytest.approx(first.trajectory["capacitor.v"], abs=5e-8)

    def test_single_entries_of_a_vector_by_different_roads(self):
        t = np.linspace(0.0, 0.2, 5)
        together = simulate(
            l1(), 0.1, step=0.05, start={"T": T0}, inputs={"tau": lambda t: [10.0, 30 * t, 50 * t]}, tolerance=1e-11
        )
        apart = simulate(
            l1(), 0.1, step=0.05, start={"T": T0}, tolerance=1e-11,
            inputs={"tau[0]": 10.0, "tau[1]": lambda t: 30 * t, "tau[2]": (t, 50 * t)},
        )  # fmt: skip
        assert apart.trajectory["T"] == pytest.approx(together.trajectory["T"], abs=1e-10)

    def test_prescribed_motion_by_a_table(self):
        t = np.linspace(0.0, 0.5, 101)
        path = np.column_stack([T0[0] + 0.1 * np.sin(3 * t), 0 * t + T0[1], T0[2] + 0 * t])
        by_table = simulate(l1(), 0.5, step=0.05, inputs={"T": ((t, path), "cubic")})
        by_function = simulate(
            l1(), 0.5, step=0.05, inputs={"T": lambda t: [T0[0] + 0.1 * np.sin(3 * t), T0[1], T0[2]]}
        )
        # the second derivative of a cubic spline errs by the square of its step
        middle = slice(1, -1)
        assert by_table.trajectory["tau"][middle] == pytest.approx(by_function.trajectory["tau"][middle], abs=0.02)

    def test_derivatives_of_an_input(self):
        class Differentiating(Slow):
            rate = gt.variable(unit="V/s")

            def equations(self):
                yield from super().equations()
                yield self.rate == der(self.u)

        run = simulate(Differentiating(), 1.0, inputs={"u": lambda t: np.sin(3 * t)})
        assert run.trajectory["rate"] == pytest.approx(3 * np.cos(3 * run.trajectory.time), abs=1e-12)
        run = simulate(Differentiating(), 1.0, inputs={"u": (TIMES, TIMES**2)}, step=0.1)
        assert run.trajectory["rate"][1] == pytest.approx(0.2)
        with pytest.raises(
            ModelError, match=r"needs der\(u\), which a table with 'previous' interpolation does not have"
        ):
            simulate(Differentiating(), 1.0, inputs={"u": ((TIMES, TIMES), "previous")})


REFUSED = [
    ({"u": [1.0, 2.0]}, "input 'u' has 1 entries; found 2"),
    ({"u": np.nan}, "input 'u' must be finite"),
    ({"u": "full"}, "takes a number, an array, a function of time, .* found str"),
    ({"u": math.sin}, r"cannot be written as an expression of time .* use functions such as np\.sin"),
    ({"u": lambda t: 1.0 if t > 1 else 0.0}, "cannot be written as an expression of time"),
    ({"u": lambda t: "on"}, "cannot be written as an expression of time"),
    ({"u": lambda t: [t, t]}, "input 'u' has 1 entries; found 2"),
    ({"u": (TIMES, TIMES[:-1])}, r"takes times \(n,\) and values \(n,\); found \(11,\) and \(10,\)"),
    ({"u": (TIMES, "high")}, r"input 'u' takes \(\(times, values\), interpolation\)"),
    ({"u": (TIMES, ["a"] * 11)}, "takes numbers"),
    ({"u": (TIMES[::-1], TIMES)}, "the times of input 'u' must increase strictly"),
    ({"u": (TIMES, TIMES * np.nan)}, "contains numbers that are not finite"),
    ({"u": ((TIMES, TIMES), "quintic")}, "no interpolation 'quintic'; use one of previous, linear, cubic"),
    ({"u": (3.0, "linear")}, r"or \(Trajectory, interpolation\)"),
    ({"u": Trajectory(TIMES, {"v": TIMES})}, "input 'u': there is no signal 'u'"),
    ({"u": Trajectory(TIMES, {"u": TIMES}, {"u": "A"})}, "input 'u' is in V; found A"),
    ({"w": 1.0}, "has no variable 'w'"),
    ({"der(u)": 1.0}, r"input 'der\(u\)' is a derivative"),
    ({}, "inputs without a value: u"),
    ({"u": 1.0, "x": 2.0}, "too many equations or knowns"),
]


@pytest.mark.parametrize(("inputs", "sentence"), REFUSED, ids=range(len(REFUSED)))
def test_wrong_inputs_are_refused(inputs, sentence):
    with pytest.raises(ModelError, match=sentence):
        simulate(Slow(), 1.0, inputs=inputs)


def test_an_entry_given_twice_is_refused():
    with pytest.raises(ModelError, match=r"input 'tau\[0\]' is given twice"):
        simulate(l1(), 1.0, inputs={"tau[0]": 1.0, "tau": 2.0})


def test_prescribed_motion_by_a_table_without_acceleration_is_refused():
    table = (np.array([0.0, 1.0]), np.array([T0, T0]))
    with pytest.raises(ModelError, match=r"needs der\(T\[0\],2\), .*'linear' interpolation.*'cubic' interpolation"):
        simulate(l1(), 1.0, inputs={"T": table})


@pytest.mark.parametrize("interpolation", ["linear", "cubic"])
def test_a_wrapped_angle_of_a_trajectory_goes_on_across_pi(interpolation):
    class Angle(gt.Model):
        u = gt.input(unit="rad")
        x = gt.variable(start=0.0, fixed=True, unit="rad.s")

        def equations(self):
            yield der(self.x) == self.u

    t = np.linspace(0.0, 4.0, 81)
    log = Trajectory(t, {"u": (2.0 * t + np.pi) % (2 * np.pi) - np.pi}, {"u": "rad"})
    run = simulate(Angle(), 4.0, inputs={"u": (log, interpolation)}, tolerance=1e-10)
    assert run.trajectory["x"][-1] == pytest.approx(16.0, abs=1e-8)  # the integral of 2 t
    log = Trajectory(t, {"u": (40.0 * t + np.pi) % (2 * np.pi) - np.pi}, {"u": "rad"})  # 2 rad from row to row
    with pytest.raises(ModelError, match=r"input 'u': 'u' turns by 114\.6 deg"):
        simulate(Angle(), 4.0, inputs={"u": (log, interpolation)})
