"""What events must not disturb: orders, starts, other causalities, models without events, odd instants."""

from __future__ import annotations

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.compiler.causal import flat_of

TOLERANCE = 1e-9


class Switched(gt.Model):
    """x' = -x until x <= 1/2, then x' = -3 x: exact."""

    x = gt.variable(start=1.0, fixed=True)

    def equations(self):
        yield gt.der(self.x) == gt.If(self.x >= 0.5, -1.0, -3.0) * self.x


def test_the_error_follows_the_tolerance_through_a_switch() -> None:
    exact = 0.5 * np.exp(-3 * (2.0 - np.log(2)))
    errors = [abs(gt.simulate(Switched(), 2.0, tolerance=t).trajectory["x"][-1] - exact) for t in (1e-5, 1e-8, 1e-11)]
    assert errors[0] < 1e-5
    assert errors[1] < 1e-8
    assert errors[2] < 1e-11


def test_a_short_visit_between_two_rows_is_not_missed() -> None:
    class Touch(gt.Model):
        x = gt.variable(start=0.0, fixed=True)
        w = gt.parameter(1.0, unit="rad/s")
        n = gt.discrete(0.0)

        def equations(self):
            yield gt.der(self.x) == gt.cos(self.w * self.time)
            yield gt.when(self.x >= 0.99999, self.n == gt.pre(self.n) + 1.0)

    # sin(t) is above it for 9 ms; rows are 0.1 s apart
    run = gt.simulate(Touch(), 20.0, step=0.1)
    assert run.trajectory["n"][-1] == 3.0
    assert [e.time for e in run.events] == pytest.approx(np.arcsin(0.99999) + 2 * np.pi * np.arange(3), abs=1e-6)


def test_an_event_at_the_start_a_row_and_the_end() -> None:
    class Clock(gt.Model):
        x = gt.variable(start=0.0, fixed=True)
        n = gt.discrete(0.0)
        one = gt.parameter(0.25, unit="s")

        def equations(self):
            yield gt.der(self.x) == 1.0 + self.n
            yield gt.when(gt.sample(self.one), self.n == gt.pre(self.n) + 1.0)

    run = gt.simulate(Clock(), 1.0, step=0.25)
    assert [e.time for e in run.events] == [0.0, 0.25, 0.5, 0.75, 1.0]
    assert run.trajectory["n"][[0, -1]].tolist() == [0.0, 5.0]
    assert np.all(np.diff(run.trajectory.time) > 0)
    assert run.trajectory["x"][-1] == pytest.approx(0.25 * (2 + 3 + 4 + 5), abs=1e-12)


def test_where_the_condition_holds_at_the_start_nothing_happens() -> None:
    class Below(gt.Model):
        x = gt.variable(start=-1.0, fixed=True)
        n = gt.discrete(0.0)

        def equations(self):
            yield gt.der(self.x) == 1.0
            yield gt.when(self.x <= 0.0, self.n == 1.0)

    run = gt.simulate(Below(), 2.0)
    assert not run.events
    assert run.trajectory["n"][-1] == 0.0


def test_a_discrete_variable_begins_as_it_is_told() -> None:
    class Counting(gt.Model):
        x = gt.variable(2, start=[0.0, 0.0], fixed=True)
        n = gt.discrete([1.0, 2.0], unit="1")

        def equations(self):
            yield gt.der(self.x) == self.n
            yield gt.when(self.x[0] >= 3.0, self.n == [0.0, gt.pre(self.n[1])])

    assert gt.simulate(Counting(), 1.0).trajectory["x"][-1] == pytest.approx([1.0, 2.0])
    run = gt.simulate(Counting(), 1.0, start={"n": [4.0, 5.0]})
    assert run.trajectory["x"][-1] == pytest.approx([3.0, 5.0])
    with pytest.raises(gt.ModelError, match=r"'n' .* takes finite numbers"):
        gt.simulate(Counting(), 1.0, start={"n": [1.0, 2.0, 3.0]})


def test_a_side_that_is_not_there_may_be_undefined() -> None:
    class Root(gt.Model):
        x = gt.variable(start=1.0, fixed=True)

        def equations(self):
            yield gt.der(self.x) == -1.0 - gt.If(self.x >= 0.0, gt.sqrt(self.x), 0.0 * self.x)

    run = gt.simulate(Root(), 3.0)
    (event,) = run.events
    assert event.time == pytest.approx(2 - 2 * np.log(2), abs=1e-9)
    assert run.trajectory["x"][-1] == pytest.approx(-(3.0 - event.time), abs=1e-9)


def test_a_model_with_events_keeps_its_causal_functions() -> None:
    class Ball(gt.Model):
        h = gt.variable(start=1.0, fixed=True)
        v = gt.variable(start=0.0, fixed=True)

        def equations(self):
            yield gt.der(self.h) == self.v
            yield gt.der(self.v) == -9.81
            yield gt.when(self.h <= 0.0, gt.reinit(self.v, -self.v))

    f = Ball().causal(targets="der(v)", prefer=["h", "v"])
    assert f()[0] == -9.81


def test_an_optimisation_refuses_events() -> None:
    class Fastest(gt.Optimization):
        final_time = gt.free(1.0, min=0.1, unit="s")
        x = gt.variable(start=1.0, fixed=True)
        v = gt.variable(start=0.0, fixed=True)
        u = gt.input(min=-1.0, max=1.0)

        def equations(self):
            yield gt.der(self.x) == self.v
            yield gt.der(self.v) == self.u
            yield gt.when(self.x <= 0.5, gt.reinit(self.v, 0.0))

        def objective(self):
            return self.final_time

    with pytest.raises(gt.ModelError, match=r"Fastest has events, and an optimisation .*gt.phases_of_events"):
        gt.solve(Fastest())


def test_sign_is_a_switch_in_simulation() -> None:
    class Dry(gt.Model):
        x = gt.variable(start=0.5, fixed=True)
        v = gt.variable(start=0.0, fixed=True)

        def equations(self):
            yield gt.der(self.x) == self.v
            yield gt.der(self.v) == -100.0 * self.x - 2.0 * gt.sign(self.v)

    run = gt.simulate(Dry(), 3.0)
    # half periods about +-0.02: each loses 0.04 of the amplitude
    times = np.array([e.time for e in run.events])
    assert np.max(np.abs(times - np.pi / 10 * np.arange(1, len(times) + 1))) < 1e-9
    assert len(times) == 9
    end = run.trajectory["x"][int(np.searchsorted(run.trajectory.time, times[-1]))]
    assert abs(end) == pytest.approx(0.5 - 9 * 0.04, abs=1e-9)


def test_models_without_events_have_none() -> None:
    class Plain(gt.Model):
        x = gt.variable(start=1.0, fixed=True)

        def equations(self):
            yield gt.der(self.x) == -self.x

    assert flat_of(Plain()).events is None
    run = gt.simulate(Plain(), 1.0)
    assert run.events == []
    assert run.samples == {}


def test_a_stiff_system_between_events() -> None:
    class Stiff(gt.Model):
        x = gt.variable(2, start=[1.0, 0.0], fixed=True)
        u = gt.discrete(1.0)

        def equations(self):
            yield gt.der(self.x[0]) == -self.x[0] + self.u
            yield gt.der(self.x[1]) == -1e5 * (self.x[1] - self.x[0])
            yield gt.when(gt.sample(1.0, offset=1.0), self.u == -gt.pre(self.u))

    run = gt.simulate(Stiff(), 3.5)
    x = 1.0
    for k, u in enumerate((1.0, -1.0, 1.0, -1.0)):
        x = u + (x - u) * np.exp(-(1.0 if k < 3 else 0.5))
    assert run.trajectory["x[0]"][-1] == pytest.approx(x, abs=1e-8)
    assert run.trajectory["x[1]"][-1] == pytest.approx(x, abs=1e-4)


def test_what_is_decided_at_the_start_is_an_event_where_it_changes_something() -> None:
    class Inner(gt.Model):
        x = gt.input()
        side = gt.discrete(0.0)

        def equations(self):
            yield gt.when(gt.initial() & (self.x >= 1.0), self.side == 1.0)

    class Middle(gt.Model):
        inner = gt.part(Inner)

    class Outer(gt.Model):
        x = gt.variable(start=0.0, fixed=True)
        middle = gt.part(Middle)

        def equations(self):
            yield gt.der(self.x) == 1.0
            yield self.middle.inner.x == self.x

    for begin in (0.0, 3.0):
        # a discrete variable of a part of a part is recorded where outputs name it
        runs = [
            gt.simulate(Outer(), begin + 2.0, start_time=begin, start={"x": x}, outputs=["middle.inner.side"])
            for x in (0.0, 1.5)
        ]
        assert [[e.time for e in run.events] for run in runs] == [[], [begin]]
        assert [run.trajectory["middle.inner.side"][-1] for run in runs] == [0.0, 1.0]
    kept = gt.simulate(Outer(), 5.0, start_time=3.0, start={"x": 1.5}, keep="middle.inner.side")
    assert kept.trajectory.names == ("middle.inner.side",) and [e.time for e in kept.events] == [3.0]
    with pytest.raises(gt.ModelError, match=r"initial\(\) is true only at single instants"):
        gt.If(gt.initial(), 1.0, 2.0)
