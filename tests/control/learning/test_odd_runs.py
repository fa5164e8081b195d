"""Runs that are not what they should be: each is refused, fails a check or is noted, and none gives a silent number."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.control import learning
from gtmodel.control.learning.options import Case
from gtmodel.results import SolveStatus
from gtmodel.results.refusal import ArgumentError

TS, N = 0.004, 525
ROBOT = learning.LearningRobot(frequency=(7.4,), damping=(0.2,))
R = learning.SquarePath(corrected=N - 200).samples(TS)[:, 0]
CLEAN = {name: T(R) for name, T in ROBOT.plant(0).maps(N).items()}
UNITS = {"reference": "m", "input": "m", "motor": "m", "tool": "m", "acceleration": "m/s2"}


def run(*, period: float = TS, rows: int = N, **signals: Any) -> gt.Trajectory:
    given = {"reference": R, "motor": CLEAN["motor"], **signals}
    made = {name: x[:rows] for name, x in given.items()}
    return gt.Trajectory(period * np.arange(len(made["motor"])), made, {name: UNITS[name] for name in made})


def repeats(count: int = 3, **more: Any) -> list[gt.Trajectory]:
    rng = np.random.default_rng(3)
    return [run(motor=CLEAN["motor"] + 1e-6 * rng.normal(size=N), **more) for _ in range(count)]


@pytest.mark.parametrize(
    ("motor", "reference"),
    [(-CLEAN["motor"], R), (1e3 * CLEAN["motor"], R), (CLEAN["motor"], R[::-1].copy()), (R, CLEAN["motor"])],
    ids=["sign", "unit", "another reference", "columns exchanged"],
)
def test_a_run_that_the_model_does_not_explain_fails_its_check(motor: np.ndarray, reference: np.ndarray) -> None:
    s = learning.next_input(ROBOT, run(motor=motor, reference=reference))
    assert s.status is SolveStatus.CHECK_FAILED and not s.checks["unexplained"].passed


def test_a_learned_run_without_its_input_fails_its_check() -> None:
    u = np.zeros(N)
    T = ROBOT.plant(0).maps(N)["motor"]
    for _ in range(4):
        s = learning.next_input(ROBOT, run(motor=T(R + u), input=u))
        assert s.status is SolveStatus.SOLVED and s.unexplained[0] < 1e-9 and s.trajectory is not None
        u = s.trajectory["next_input"][:, 0]
    forgotten = learning.next_input(ROBOT, run(motor=T(R + u)))
    assert forgotten.status is SolveStatus.CHECK_FAILED and not forgotten.checks["unexplained"].passed
    assert any("has no input" in note for note in forgotten.notes)


@pytest.mark.parametrize("design", [learning.LearningDesign(law="norm_optimal"), learning.LearningDesign(ramps=False)])
def test_a_run_shorter_than_its_ramps_is_refused_by_every_law(design: learning.LearningDesign) -> None:
    with warnings.catch_warnings(), pytest.raises(ArgumentError) as error:
        warnings.simplefilter("error")
        learning.next_input(ROBOT, run(rows=150), design)
    assert error.value.argument == "ramp"


def test_repeats_of_another_clock_motion_input_or_of_one_file_are_refused() -> None:
    good = repeats()
    assert learning.next_input(ROBOT, run(), repeats=good).status is SolveStatus.SOLVED
    slow = [run(period=0.005, motor=g["motor"]) for g in good]
    other = [*good[:2], run(reference=R[::-1].copy(), motor=good[2]["motor"])]
    with_input = [run(motor=g["motor"], input=1e-4 * k * R) for k, g in enumerate(good)]
    for bad, argument in ((slow, "repeats[0]"), (other, "repeats[2]"), (with_input, "repeats[1]"),
                          ([good[0], good[1], good[0]], "repeats[2]")):  # fmt: skip
        with pytest.raises(ArgumentError) as error:
            learning.next_input(ROBOT, run(), repeats=bad)
        assert error.value.argument == argument
    with pytest.raises(ArgumentError) as error:
        learning.next_input(ROBOT, run(), repeats=good[:2])
    assert error.value.argument == "repeats"


def test_repeats_that_differ_by_more_than_the_run_errs_do_not_end_learning() -> None:
    rng = np.random.default_rng(4)
    wild = [run(motor=(1 + rng.normal()) * CLEAN["motor"]) for _ in range(5)]
    s = learning.next_input(ROBOT, run(), repeats=wild)
    assert s.status is SolveStatus.CHECK_FAILED and not s.checks["scatter_over_error"].passed


def test_repeats_that_slide_are_noted_and_those_that_scatter_are_not() -> None:
    sliding = [run(motor=g["motor"] + 1e-4 * k) for k, g in enumerate(repeats(5))]
    assert any("drift" in note for note in learning.next_input(ROBOT, run(), repeats=sliding).notes)
    assert not any("drift" in note for note in learning.next_input(ROBOT, run(), repeats=repeats(5)).notes)


@pytest.mark.parametrize("case", ["1", "2A", "2B", "3"])
def test_the_origin_of_positions_and_the_bias_of_the_accelerometer_do_not_count(case: Case) -> None:
    felt = CLEAN["acceleration"] + 0.07 * np.random.default_rng(5).normal(size=N)
    design = learning.LearningDesign(case=case)
    here = learning.next_input(ROBOT, run(tool=CLEAN["tool"], acceleration=felt), design)
    there = learning.next_input(
        ROBOT, run(reference=R + 0.5, motor=CLEAN["motor"] + 0.5, tool=CLEAN["tool"] + 0.5, acceleration=felt + 9.81),
        design,
    )  # fmt: skip
    assert here.trajectory is not None and there.trajectory is not None
    apart = np.abs(here.trajectory["next_input"] - there.trajectory["next_input"]).max()
    assert apart < 1e-9 and here.floor == pytest.approx(there.floor, rel=1e-6)
    assert any("accelerometer" in note for note in there.notes) == (case in ("2A", "2B"))


@pytest.mark.parametrize(("case", "tool"), [("2A", True), ("2B", False)], ids=["tool in the log", "by the model"])
def test_an_accelerometer_that_reads_another_motion_fails_its_check(case: Case, tool: bool) -> None:
    design = learning.LearningDesign(case=case)
    measured: dict[str, Any] = {"tool": CLEAN["tool"]} if tool else {}
    felt = CLEAN["acceleration"] + 0.07 * np.random.default_rng(5).normal(size=N)
    for wrong in (-felt, felt / 9.81):
        s = learning.next_input(ROBOT, run(acceleration=wrong, **measured), design)
        assert s.status is SolveStatus.CHECK_FAILED and not s.checks["accelerometer"].passed
        assert any("accelerometer's reading of x is" in note for note in s.notes)
    clean = learning.next_input(ROBOT, run(acceleration=felt, **measured), design)
    assert clean.status is SolveStatus.SOLVED and clean.checks["accelerometer"].passed


def test_a_run_is_judged_by_enough_samples_and_by_most_of_its_motion() -> None:
    for ramp in (262, 238):
        with pytest.raises(ArgumentError, match="expected 50 or more") as error:
            learning.next_input(ROBOT, run(), ramp=ramp)
        assert error.value.argument == "ramp"
    s = learning.next_input(ROBOT, run(), ramp=237)
    assert s.status is SolveStatus.CHECK_FAILED and s.checks["moves_outside"].value > 0.8
    with pytest.raises(ArgumentError, match="expected 50 or more") as error:
        learning.mismatch({name: CLEAN[name] for name in ("motor", "tool", "acceleration")}, 7.4, 0.2, ramp=250)
    assert error.value.argument == "run"


def test_an_axis_that_stands_still_divides_nothing_by_nothing() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        s = learning.next_input(ROBOT, run(reference=0 * R, motor=0 * R))
        assert s.learned and s.error == [0.0] and s.unexplained == [0.0]
        quiet = learning.LearningNoise(motor=0.0, unrepeatable=0.0, gauge=0.0)
        still = learning.SquarePath(corrected=400, side_time=10.0)  # x does not move in it
        made = learning.study(learning.LearningRobot(), still, learning.LearningDesign(iterations=2), quiet)
    assert made.status is SolveStatus.SOLVED and made.error[0] == [0.0, 0.0, 0.0] and made.not_learned[0] == 0.0


def test_people_read_lengths_without_powers_of_ten() -> None:
    assert "e+" not in learning.next_input(ROBOT, run()).message
