"""Validation in closed loop, against a loop integrated by hand."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gtmodel.identify import ClosedLoop
from gtmodel.identify.closed_loop import ClosedLoopRun, follow, rows_of, within_bound
from gtmodel.measurements import Session
from gtmodel.plot.signals import closed_loop_figure
from gtmodel.problem_files import Context
from gtmodel.problem_files.python_models import resolve
from gtmodel.results import ArgumentError, Trajectory, Work

PROBLEMS = Path(__file__).parents[2] / "problems"
TRUE = {"M": 95.0, "F_v": 203.0, "F_c": 20.0, "offset": -3.0}
GAIN, KP, KV, SCALE = 35.15065188, 160.18, 243.45, 1e-3
DT = 0.001
# m; the start velocity is a parabola's, DT^2 q''' / 3 off, some 1e-6 m/s, which the loop takes up within 5 ms
HAND = 2e-8


@pytest.fixture(scope="module")
def emps() -> Any:
    return resolve("models/emps.py:ControlledEmps", Context(folder=PROBLEMS), "robot")


def followed(made: Session, loop: ClosedLoop, numbers: dict[str, float] = TRUE) -> ClosedLoopRun:
    (run,) = follow(loop, numbers, (made,), "q", "tau", Work())
    return run


def drive(q: float, v: float, qg: float) -> float:
    return GAIN * KV * (KP * (qg - q) - v)


def acceleration(q: float, v: float, qg: float) -> float:
    return (drive(q, v, qg) - TRUE["F_v"] * v - TRUE["F_c"] * np.tanh(v / SCALE) - TRUE["offset"]) / TRUE["M"]


def reference(t: float) -> float:
    return 0.02 * (1 - np.cos(3 * t))


@pytest.fixture(scope="module")
def made() -> Session:
    """Synthetic, no noise: the loop by Runge and Kutta's fourth-order rule on four steps per sample."""
    rows, q, v = 400, 0.0, 0.0
    out, force, h = [], [], DT / 4
    for k in range(rows):
        out.append(q)
        force.append(drive(q, v, reference(k * DT)))
        for j in range(4):
            t = k * DT + j * h
            g = [reference(t), reference(t + h / 2), reference(t + h)]
            a1 = acceleration(q, v, g[0])
            a2 = acceleration(q + h / 2 * v, v + h / 2 * a1, g[1])
            v2 = v + h / 2 * a1
            a3 = acceleration(q + h / 2 * v2, v + h / 2 * a2, g[1])
            v3 = v + h / 2 * a2
            a4 = acceleration(q + h * v3, v + h * a3, g[2])
            v4 = v + h * a3
            q, v = q + h / 6 * (v + 2 * v2 + 2 * v3 + v4), v + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
    time = DT * np.arange(rows)
    values = {"q": np.array(out), "qg": np.array([reference(t) for t in time]), "tau": np.array(force)}
    return Session("made here", Trajectory(time, values, {"q": "m", "qg": "m", "tau": "N"}, synthetic="no noise"), DT)


def test_the_loop_is_that_of_the_equations(made: Session, emps: Any) -> None:
    run = followed(made, ClosedLoop(emps, ["qg"], tolerance=1e-11))
    assert run.maximum < HAND and run.effort < 1e-4 and len(run.trajectory) == 400
    assert run.relative == pytest.approx(run.rms / np.std(made.trajectory["q"]))


def test_a_wrong_mass_shows(made: Session, emps: Any) -> None:
    loop = ClosedLoop(emps, ["qg"], bound=1e-8)
    run = followed(made, loop, {**TRUE, "M": 105.0})
    assert run.rms > 10 * HAND and run.effort > 0.01
    assert not within_bound(loop, [run])["closed_loop_error"].passed
    assert within_bound(ClosedLoop(emps, ["qg"]), [run]) == {}
    assert [row.label for row in rows_of([run])][1:] == ["largest", "of the motion", "error of its effort"]


def test_fewer_samples_of_the_reference_change_little(made: Session, emps: Any) -> None:
    run = followed(made, ClosedLoop(emps, ["qg"], every=4))
    # cubic spline of a 0.5 Hz cosine at 4 ms: 1e-12 of it inside, its ends somewhat more
    assert run.maximum < 1e-6 and len(run.trajectory) == 100


def test_the_picture(made: Session, emps: Any) -> None:
    run = followed(made, ClosedLoop(lambda **found: emps.with_(**found), ["qg"]))  # a function that makes the model
    figure = closed_loop_figure([(run.name, run.trajectory)], title="loop")
    assert [axes.get_ylabel() for axes in figure.axes] == ["position [m]", "error [µm]"]


@pytest.mark.parametrize(("inputs", "numbers", "argument"), [(["qg"], {"mass": 1.0}, "model"), ([], TRUE, "")])
def test_a_model_that_does_not_take_what_is_given(made: Session, emps: Any, inputs, numbers, argument) -> None:
    with pytest.raises(ArgumentError) as caught:
        followed(made, ClosedLoop(emps, inputs), numbers)
    assert caught.value.argument == f"closed_loop.{argument}".rstrip(".")
