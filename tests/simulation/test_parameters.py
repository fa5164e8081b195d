"""Runs with other values of parameters: the motion of a model made with them, and nothing is worked out anew."""

from __future__ import annotations

from unittest import mock

import casadi as ca
import numpy as np
import pytest

import gtmodel as gt
from gtmodel.compiler.causal import flat_of
from gtmodel.compiler.flat_cache import values_by_place, with_values
from gtmodel.results import ArgumentError
from tests.simulation.models import DriveTrain, FourBarInAngles, SwingingPendulum, TwoMasses
from tests.simulation.robot import T0, l1

# symbols in place of numbers round differently, and the integrator's steps with them
SAME = 1e-8
ENERGY = 1e-6  # sums of terms up to 100 J


def difference(a, b):
    """The largest, of anything recorded, in parts of its size or of one SI unit."""
    assert a.trajectory.names == b.trajectory.names
    np.testing.assert_array_equal(a.trajectory.time, b.trajectory.time)
    largest = 0.0
    for name in a.trajectory.names:
        x, y = np.asarray(a.trajectory[name]), np.asarray(b.trajectory[name])
        largest = max(largest, float(np.max(np.abs(x - y)) / max(1.0, float(np.max(np.abs(y))))))
    return largest


def both(model, given, final_time, **more):
    """The run with parameters of a model, and that of the model made with them."""
    swept = gt.simulate(model, final_time, parameters=given, throw=False, **more)
    return swept, gt.simulate(model.with_(**given), final_time, throw=False, **more)


def drop(model, **more):
    return gt.simulate(model, 0.2, step=0.01, inputs={"tau": 0.0}, start={"T": T0, "der(T)": 0.0}, **more)


class TestEqualToTheModelMadeSo:
    @pytest.mark.parametrize("given", [{"m": 0.3}, {"L": 1.3}, {"m": 5.0, "g": 1.6}])
    def test_pendulum(self, given):
        a, b = both(SwingingPendulum(), given, 3.0, start={"x": 0.6, "der(x)": 0.0})
        assert a.status is b.status and difference(a, b) < SAME

    def test_states_that_switch(self):
        a, b = both(SwingingPendulum(), {"g": 3.0}, 2.0, start={"x": 0.0, "der(x)": 7.0})
        assert len(a.switches) == len(b.switches) > 2 and difference(a, b) < 1e-6

    @pytest.mark.parametrize(
        "given", [{"m_p": 5.0}, {"m_p": 25.0, "m_a": [0.0, 1.0, 2.0]}, {"coulomb": [9.0, 8.0, 7.0]}]
    )
    def test_robot(self, given):
        robot = l1()
        a = drop(robot, parameters=given)
        assert difference(a, drop(robot.with_(**given))) < SAME
        assert difference(a, drop(robot)) > 1e-4

    def test_newton_unknowns(self):
        more = {"inputs": {"torque": 0.3}, "start": {"phi": 0.5, "der(phi)": 0.0}, "step": 0.05}
        for given in ({"J": 0.4}, {"b": 0.72, "c": 0.58}):
            a, b = both(FourBarInAngles(), given, 0.5, **more)
            assert a.status.ok and difference(a, b) < SAME

    def test_arrays_that_parts_are_bound_to(self):
        a, b = both(TwoMasses(), {"m": [1.0, 4.0], "k": [100.0, 50.0]}, 1.0, inputs={"F": 1.0}, start={"s": 0.0})
        assert difference(a, b) < SAME

    def test_signs_that_change(self):
        more = {"inputs": {"torque": 0.1}, "start": {"phi": 0.0, "der(phi)": 0.0}}
        for ratio in (20.0, -20.0, -40.0):
            a, b = both(DriveTrain(), {"ratio": ratio}, 0.1, **more)
            assert difference(a, b) < SAME

    def test_a_root_whose_side_depends_on_a_sign(self):
        class Slide(gt.Model):
            second = gt.parameter(1.0, unit="s")
            side = gt.parameter(1.0, nonzero=True)
            x = gt.variable(start=0.0, fixed=True)
            y = gt.variable(start=1.0)

            def equations(self):
                yield self.second * gt.der(self.x) == 0.5 * self.y
                yield self.side * self.y**2 == self.side * (2.0 - self.x)

        for side in (2.0, -1.0):
            a, b = both(Slide(), {"side": side}, 1.0)
            assert a.trajectory["y"][0] == pytest.approx(b.trajectory["y"][0]) and difference(a, b) < SAME

    @pytest.mark.parametrize("given", [{"a": 0.5}, {"a": 1.5, "b": 3.0}, {"b": 1.9}])
    def test_a_root_whose_side_depends_on_several_parameters(self, given):
        """None of them changes its sign, what the root is multiplied by does: y stays near its start value, 1."""

        class Slide(gt.Model):
            second = gt.parameter(1.0, unit="s")
            a = gt.parameter(2.0)
            b = gt.parameter(1.0)
            x = gt.variable(start=0.0, fixed=True)
            y = gt.variable(start=1.0)

            def equations(self):
                yield self.second * gt.der(self.x) == 0.5 * self.y
                yield (self.a - self.b) * self.y**2 == (self.a - self.b) * (2.0 - self.x)

        model = Slide()
        for values in ({"a": 2.0}, given, {"a": 2.5}):  # the model's own side before and after
            a, b = both(model, values, 1.0)
            assert a.trajectory["y"][0] == pytest.approx(np.sqrt(2.0)) and difference(a, b) < SAME

    def test_the_solution_near_the_start_value_of_each_run(self):
        """y = c + 1 or c - 1, whichever is nearer to 1."""

        class Beside(gt.Model):
            second = gt.parameter(1.0, unit="s")
            c = gt.parameter(2.0)
            x = gt.variable(start=0.0, fixed=True)
            y = gt.variable(start=1.0)

            def equations(self):
                yield self.second * gt.der(self.x) == 0.5 * self.y
                yield (self.y - self.c) ** 2 == 1.0 - 0.5 * self.x

        model = Beside()
        for c, first in ((2.0, 1.0), (0.5, 1.5), (1.8, 0.8), (0.3, 1.3)):
            a, b = both(model, {"c": c}, 0.5)
            assert a.trajectory["y"][0] == pytest.approx(first) and difference(a, b) < SAME

    def test_a_start_far_from_the_model_s_own(self):
        a, b = both(SwingingPendulum(), {"L": 1000.0}, 1.0)
        assert a.status is b.status and difference(a, b) < SAME

    def test_zero_and_not_zero(self):
        for d in ([0.0, 0.0], [2.0, 0.0]):
            a, b = both(TwoMasses(), {"d": d}, 1.0, inputs={"F": 1.0}, start={"s": 0.0, "der(s)": 0.0})
            assert difference(a, b) < SAME

    def test_attributes_that_follow_from_parameters(self):
        class Decay(gt.Model):
            T = gt.parameter(1.0, unit="s", positive=True)
            first = gt.parameter(2.0)
            size = gt.parameter(1.0, positive=True)
            x = gt.variable(start=first, fixed=True)

            def equations(self):
                yield self.T * gt.der(self.x) == -self.x

        for given in ({"first": 3.0}, {"size": 50.0}, {"T": 0.2, "first": -1.0, "size": 0.1}):
            a, b = both(Decay(x={"nominal": lambda decay: decay.size}), given, 1.0)
            assert a.trajectory["x"][0] == given.get("first", 2.0) and difference(a, b) < SAME

    def test_a_pulse_at_the_time_that_a_parameter_says(self):
        class Pulsed(gt.Model):
            second = gt.parameter(1.0, unit="s")
            when = gt.parameter(5.0, unit="s")
            x = gt.variable(start=0.0, fixed=True)

            def equations(self):
                yield self.second * gt.der(self.x) == 1e4 * gt.exp(
                    -((1e4 * (self.time - self.when) / self.second) ** 2)
                )

        model = Pulsed()
        for when in (0.5, 7.77, 3.1):
            x = gt.simulate(model, 10.0, parameters={"when": when}).trajectory["x"]
            assert x[-1] == pytest.approx(np.sqrt(np.pi), rel=1e-6)

    def test_its_own_values_change_nothing(self):
        a, b = both(SwingingPendulum(), {"m": SwingingPendulum().m}, 2.0, start={"x": 0.6, "der(x)": 0.0})
        assert difference(a, b) < SAME

    def test_none_named_is_the_model_itself(self):
        a = gt.simulate(SwingingPendulum(), 1.0, start={"x": 0.6, "der(x)": 0.0}, parameters={})
        b = gt.simulate(SwingingPendulum(), 1.0, start={"x": 0.6, "der(x)": 0.0})
        assert difference(a, b) == 0.0


class TestShared:
    def test_nothing_is_made_anew(self):
        used = l1()
        drop(used, parameters={"m_p": 10.0})
        with (
            mock.patch.object(ca, "integrator") as integrator,
            mock.patch("gtmodel.simulation.systems.Reduced") as made,
            mock.patch("gtmodel.simulation.systems.make_plan") as planned,
            mock.patch("gtmodel.simulation.systems.OriginalEquations") as written,
            mock.patch("gtmodel.simulation.systems.StateSelection") as chosen,
            mock.patch("gtmodel.compiler.flat_cache.BoundParameters") as bounds,
            mock.patch.object(ca, "vertcat") as stacked,
            mock.patch.object(ca, "depends_on") as asked,
        ):
            for mass in (10.5, 12.0):
                drop(used, parameters={"m_p": mass})
        symbolic = stacked, asked
        assert not any(m.called for m in (integrator, made, planned, written, chosen, bounds, *symbolic))

    def test_models_that_differ_in_what_is_tunable(self):
        first, second = SwingingPendulum(m=2.0), SwingingPendulum(m=3.0)
        more = {"start": {"x": 0.6, "der(x)": 0.0}, "tunable": "m"}
        gt.simulate(first, 1.0, **more)
        with mock.patch("gtmodel.simulation.systems.make_plan") as planned:
            a = gt.simulate(second, 1.0, **more)
        assert not planned.called
        assert difference(a, gt.simulate(SwingingPendulum(m=2.0), 1.0, parameters={"m": 3.0}, start=more["start"])) == 0
        assert difference(gt.simulate(first, 1.0, **more, parameters={"m": 3.0}), a) == 0
        with pytest.raises(gt.ModelError, match="no parameter 'mm'"):
            gt.simulate(first, 1.0, tunable="mm")

    def test_what_came_before_makes_no_difference(self):
        def fresh():
            return type("Pendulum", (SwingingPendulum,), {})()

        used, start = fresh(), {"x": 0.6, "der(x)": 0.0}
        gt.simulate(used, 2.0, start=start, parameters={"m": 7.0})
        a = gt.simulate(used, 2.0, start=start, parameters={"m": 2.0})
        assert difference(a, gt.simulate(fresh(), 2.0, start=start, parameters={"m": 2.0})) < SAME
        assert difference(a, gt.simulate(used, 2.0, start=start, parameters={"m": 2.0})) == 0.0

    def test_the_model_keeps_its_values(self):
        model = SwingingPendulum()
        before = gt.simulate(model, 1.0, start={"x": 0.6, "der(x)": 0.0})
        gt.simulate(model, 1.0, start={"x": 0.6, "der(x)": 0.0}, parameters={"g": 1.0})
        assert difference(gt.simulate(model, 1.0, start={"x": 0.6, "der(x)": 0.0}), before) == 0.0

    def test_the_equations_are_looked_at_with_the_values_of_the_run(self):
        run = drop(l1(), parameters={"m_p": 50.0})
        assert run.residual < 1e-10 and run.energy_error < ENERGY


class TestRefused:
    @pytest.mark.parametrize(
        ("given", "sentence"),
        [
            ({"mass": 2.0}, "no parameter 'mass'"),
            ({"x": 2.0}, "no parameter 'x'"),
            ({"m": -1.0}, "'m' is declared positive; found -1"),
            ({"m": [1.0, 2.0]}, "has shape \\(\\)"),
            ({"m": "heavy"}, "'m' takes a number"),
            ({"m": np.nan}, "'m' must be finite"),
            ({3: 1.0}, "takes names"),
            ([1.0], "parameters takes a dictionary by name"),
        ],
    )
    def test_by_name_and_value(self, given, sentence):
        with pytest.raises(gt.ModelError, match=sentence):
            gt.simulate(SwingingPendulum(), 1.0, start={"x": 0.6, "der(x)": 0.0}, parameters=given)

    def test_what_follows_from_another_one(self):
        with pytest.raises(gt.ModelError, match=r"'mass\[1\].m' follows from m; change that"):
            gt.simulate(TwoMasses(), 1.0, inputs={"F": 0.0}, parameters={"mass[1].m": 2.0})

    def test_what_follows_is_checked_too(self):
        class Spring(gt.Model):
            k = gt.parameter(1.0, positive=True)

        class Pair(gt.Model):
            a = gt.parameter(2.0)
            least = gt.parameter(1.0)
            more = gt.parameter(3.0, min=least)
            x = gt.variable(start=1.0, fixed=True)
            spring = gt.part(Spring, k=lambda self: self.a - 1.0)

            def equations(self):
                yield gt.der(self.x) == -self.spring.k * self.more * self.x

        with pytest.raises(
            gt.ModelError, match=r"'spring.k' is declared positive; found -0.5, which follows from a = 0.5"
        ):
            gt.simulate(Pair(), 1.0, parameters={"a": 0.5})
        with pytest.raises(gt.ModelError, match="'more' must be at least 'least', 4"):
            gt.simulate(Pair(), 1.0, parameters={"least": 4.0})
        # a run that kept the bounds says nothing of the next one
        model = Pair()
        for least in (4.0, 5.0):
            assert gt.simulate(model, 0.1, parameters={"a": 3.0, "least": 2.0}).status.ok
            with pytest.raises(gt.ModelError, match=f"'more' must be at least 'least', {least:g}"):
                gt.simulate(model, 0.1, parameters={"a": 3.0, "least": least})
        for a in (0.5, 0.25):
            with pytest.raises(gt.ModelError, match=f"found {a - 1:g}, which follows from a = {a:g}"):
                gt.simulate(model, 0.1, parameters={"a": a, "least": 2.0})

    def test_the_study_says_which(self):
        from gtmodel.simulation import simulation_study

        with pytest.raises(ArgumentError) as caught:
            simulation_study(SwingingPendulum(), 1.0, start={"x": 0.6}, parameters={"m": 0.0})
        assert caught.value.argument == "parameters.m"

    def test_the_certificate_takes_them(self):
        text = gt.simulation.explain_simulation(
            SwingingPendulum(), start={"x": 0.6, "der(x)": 0.0}, parameters={"L": 2.0}
        )
        assert "x = 0.6" in text


def test_places_are_those_of_the_parameter_vector():
    flat = flat_of(TwoMasses())
    places = values_by_place(flat, {"m": [7.0, 8.0]})
    assert [flat.parameters[n].name for n in places] == ["m[0]", "m[1]"] and list(places.values()) == [7.0, 8.0]
    other = with_values(flat, places)
    np.testing.assert_array_equal(other.p0, flat_of(TwoMasses(m=[7.0, 8.0])).p0)
    assert with_values(flat, {}) is flat
