"""Nonsense given to the simulation study: one sentence each, under the argument that it stands in."""

from __future__ import annotations

import re

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.lang.source import ModelError
from gtmodel.results import ArgumentError
from gtmodel.simulation import linearize, simulate, simulation_study


class Swing(gt.Model):
    x = gt.variable(unit="m", start=1.0, fixed=True)
    v = gt.variable(unit="m/s", start=0.0, fixed=True)
    k = gt.parameter(1.0, unit="1/s2")
    u = gt.input(unit="m/s2")

    def equations(self):
        yield gt.der(self.x) == self.v
        yield gt.der(self.v) == -self.k * self.x + self.u


MODEL = Swing()
NO_FORCE = {"inputs": {"u": 0.0}}


@pytest.mark.parametrize(
    ("final_time", "options", "argument"),
    [
        (0, {}, "final_time"),
        (-1.0, {}, "final_time"),
        (1e300, {}, "final_time"),
        (np.nan, {}, "final_time"),
        (np.inf, {}, "final_time"),
        (10**400, {}, "final_time"),
        (1.0, {"step": 2.0}, "step"),
        (1.0, {"step": 10**400}, "step"),
        (1.0, {"step": 1e-300}, "step"),
        (1.0, {"max_step": 1e-320}, "max_step"),
        (1.0, {"start": {"y": 1.0}}, "start.y"),
        (1.0, {"start": {"x": 1e308}}, "start.x"),
        (1.0, {"start": {"x": -1e308, "v": 1e308}}, "start.x"),
        (1.0, {"start": {"x": np.nan}}, "start.x"),
        (1.0, {"start": {"x": None}}, "start.x"),
        (1.0, {"start": {"x": "a"}}, "start.x"),
        (1.0, {"start": {"x": [1.0, 2.0]}}, "start.x"),
        (1.0, {"start": {"x": 10**400}}, "start.x"),
        (1.0, {"start": {"u": 1.0}}, "start.u"),
        (1.0, {"inputs": {"u": np.nan}}, "inputs.u"),
        (1.0, {"inputs": {"u": "a"}}, "inputs.u"),
        (1.0, {"inputs": {"u": 10**400}}, "inputs.u"),
        (1.0, {"inputs": {"u": ([0.0, 0.0], [1.0, 2.0])}}, "inputs.u"),
        (1.0, {"inputs": {"w": 1.0}}, "inputs.w"),
        (1.0, {"outputs": ["\0"]}, "outputs[0]"),
    ],
    ids=lambda x: str(x)[:40],
)
def test_one_sentence_under_its_argument(final_time, options, argument) -> None:
    with pytest.raises(ArgumentError) as refused:
        simulation_study(MODEL, final_time, **{**NO_FORCE, **options})
    assert refused.value.argument == argument
    assert len(str(refused.value)) < 300 and "\n" not in str(refused.value)


@pytest.mark.parametrize("folder", ["a\0b", "a" * 300])
def test_a_folder_that_no_disk_takes(folder: str, tmp_path) -> None:
    study = simulation_study(MODEL, 0.01, step=0.01, **NO_FORCE)
    with pytest.raises(ArgumentError) as refused:
        study.write(f"{tmp_path}/{folder}")
    assert refused.value.argument == "folder" and not list(tmp_path.iterdir())


def test_sizes_whose_squares_overflow_are_refused_by_the_engine_too() -> None:
    with pytest.raises(ModelError, match=re.escape("the start of 'x' has size 1e+308")):
        simulate(MODEL, 1.0, start={"x": 1e308}, inputs={"u": 0.0})
    with pytest.raises(ModelError, match="1e\\+300 s"):
        simulate(MODEL, 1e300, inputs={"u": 0.0})


def test_what_is_a_declared_variable_stands_under_its_own_name() -> None:
    """speed is der(height): the state is shown as the model names it, in all that a run says of its states."""

    class Ball(gt.Model):
        height = gt.variable(unit="m", start=2.0, fixed=True)
        speed = gt.variable(unit="m/s")
        g = gt.parameter(9.81, unit="m/s2")

        def equations(self):
            yield gt.der(self.height) == self.speed
            yield gt.der(self.speed) == -self.g

    run = simulate(Ball(), 0.5)
    assert run.states == ("height", "speed") and run.chosen == {"speed": 0.0}
    linear = linearize(Ball(), [], ["height", "speed"])
    assert linear.state_labels == ["height", "speed"] and list(linear.params["rates"]) == ["height", "speed"]
