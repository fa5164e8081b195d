"""What simulate() and linearize() refuse in one sentence, and models with nothing left but aliases."""

from __future__ import annotations

import numpy as np
import pytest

import gtmodel as gt
from gtmodel import ModelError, der
from gtmodel.simulation import linearize, simulate


class Sum(gt.Model):
    """x' = u: nothing but an alias and a state."""

    x = gt.variable(start=0.0, fixed=True)
    u = gt.input()

    def equations(self):
        yield der(self.x) == self.u


class Same(gt.Model):
    """Two names for one quantity."""

    x = gt.input()
    y = gt.variable()

    def equations(self):
        yield self.x == self.y


class Empty(gt.Model):
    """Nothing."""

    def equations(self):
        yield from ()


class TestAliases:
    def test_a_state_that_is_given(self):
        t = simulate(Sum(), 1.0, inputs={"x": lambda t: t**2}).trajectory
        assert t["u"] == pytest.approx(2 * t.time, abs=1e-12) and np.ptp(t["u"]) == 2.0

    def test_a_state_that_sums_up(self):
        t = simulate(Sum(), 1.0, inputs={"u": lambda t: 2 * t}).trajectory
        assert t["x"] == pytest.approx(t.time**2, abs=1e-6)  # 1e-9 per step

    def test_another_name(self):
        run = simulate(Same(), 1.0, inputs={"x": lambda t: 2 * t})
        assert run.residual == 0.0 and np.array_equal(run.trajectory["y"], 2 * run.trajectory.time)

    def test_no_variable(self):
        with pytest.raises(ModelError, match="Empty declares no variable; there is nothing to simulate"):
            simulate(Empty(), 1.0)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (dict(final_time="1"), "final_time takes a number; found '1'"),
        (dict(start_time="a"), "start_time takes a number; found 'a'"),
        (dict(step="0.1"), "step takes a number; found '0.1'"),
        (dict(step=1e-9), "interval of 1e-09 s gives 1e.09 rows, more than 1000000; give at least 1e-06 s"),
        (dict(tolerance="a"), "tolerance takes a number; found 'a'"),
        (dict(start=[1.0]), r"start takes a dictionary by name, .*; found \[1.0\]"),
        (dict(inputs=[1.0]), r"inputs takes a dictionary by name, .*; found \[1.0\]"),
        (dict(start={1: 2.0}), "start takes names such as 'T'; found 1"),
        (dict(prefer=3), "prefer takes names such as 'T'; found 3"),
        (dict(outputs=[None]), "outputs takes names such as 'T'; found None"),
        (dict(keep=[None]), "keep takes names such as 'T'; found None"),
        (dict(keep=["x", "v"]), "Sum has no variable 'v'"),
        (dict(keep=[]), "it is empty; leave it out"),
        (dict(inputs={"u": gt.log}), "input 'u' has no finite value at the start, 0 s"),
        (dict(inputs={"u": lambda t: None}), "function of input 'u' returns nothing"),
        (dict(inputs={"u": lambda t: np.nan}), "function of input 'u' returns nan, which is not finite"),
    ],
)
def test_refused_by_simulate(arguments, sentence):
    arguments = {"final_time": 1.0, "inputs": {"u": 1.0}} | arguments
    with pytest.raises(ModelError, match=sentence):
        simulate(Sum(), **arguments)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ((["u", "u"], "x"), "input 'u' is named twice"),
        (("u", ["x", "x"]), "output 'x' is named twice"),
        (("der(u)", "x"), r"input 'der\(u\)' is a derivative; name the variable itself"),
        ((3, "x"), "inputs takes names such as 'T'; found 3"),
    ],
)
def test_refused_by_linearize(arguments, sentence):
    with pytest.raises(ModelError, match=sentence):
        linearize(Sum(), *arguments)


def test_input_values_that_are_no_numbers():
    with pytest.raises(ModelError, match="input_values: 'u' takes numbers; found 'a'"):
        linearize(Sum(), "u", "x", input_values={"u": "a"})


def test_initial_equations_without_yield():
    class Forgotten(Sum):
        def initial_equations(self):
            self.x == 1.0  # type: ignore[expression-value]  # noqa: B015

    class Kept(Sum):
        def initial_equations(self):
            _ = self.x == 1.0

    line = Forgotten.initial_equations.__code__.co_firstlineno + 1
    with pytest.raises(ModelError, match=rf"the result of this '==' is discarded; write yield .*py:{line}\)"):
        simulate(Forgotten(), 1.0, inputs={"u": 1.0})
    line = Kept.initial_equations.__code__.co_firstlineno
    with pytest.raises(ModelError, match=rf"initial_equations\(\) of Kept returned nothing; .*py:{line}\)"):
        simulate(Kept(), 1.0, inputs={"u": 1.0})


def test_an_infinite_derivative_at_the_start(recwarn):
    class Steep(gt.Model):
        x = gt.variable(start=0.0, fixed=True)

        def equations(self):
            yield der(self.x) == 3 * gt.absolute(self.x) ** (2 / 3)

    line = Steep.equations.__code__.co_firstlineno + 1
    with pytest.raises(ModelError, match=rf"at the start values Steep equation 1 \(.*py:{line}\) has a derivative"):
        simulate(Steep(), 1.0)
    assert not recwarn.list
