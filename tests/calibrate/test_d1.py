"""Models 1 to 5 of D1 on the shipped synthetic robot, its cart points, and the sensitivity of model 3."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.calibrate import CalibrationStudy, MeasuredPoses, made_poses, read_cart_points, study
from gtmodel.calibrate.sensitivity import table, text
from gtmodel.calibrate.synthetic import SyntheticFile, make
from gtmodel.problem_files.load import load
from gtmodel.results import ArgumentError
from gtmodel.robots.three_link import D1_MODELS
from tests.calibrate.runs import ready
from tests.calibrate.shipped import PROBLEMS
from tests.support.basin import basin

PRINTED = np.array([0.140, 0.120, 0.110, 0.100, 0.090])  # mm, Table 5.3
STORY = 0.3  # of the printed means: our robot has errors of D1's sizes, but it is not D1
LAST_DIGIT = 1.01e-4  # mm: where another machine rounds otherwise


@cache
def call(number: int) -> Any:
    """The shipped problem; the sensitivity is looked at in model 3 alone."""
    return gt.load(PROBLEMS / f"calibrate_d1_model_{number}.toml", *([] if number == 3 else ["sensitivity_step=0"]))


@cache
def model(number: int) -> CalibrationStudy:
    return call(number)()


@cache
def six_link() -> Any:
    """d1_six_link, and what problems/simulate_d1.toml makes of it."""
    return load(PROBLEMS / "simulate_d1.toml").problem.synthetic.options()


def made(**changes: Any) -> SyntheticFile:
    return make(gt.robots.make("d1_six_link"), replace(six_link(), **changes))


def mean_errors(fresh: MeasuredPoses, cart_points: Path) -> np.ndarray:
    """Held-out means [mm] of the five models on other poses and cart points."""
    errors = []
    for number in D1_MODELS:
        robot, poses, fit = call(number).arguments
        carts = call(number).options["carts"]
        values = {name: fresh.measurements.values[name] for name in poses.measurements.values}
        measured = replace(poses, measurements=replace(poses.measurements, values=values))
        if carts is not None:
            at, points = read_cart_points(cart_points, list(carts.points))
            carts = replace(carts, at=at, points=points)
        s = study(robot, measured, replace(fit, sensitivity_step=0.0), carts=carts)
        errors.append(s.values["held_out_mm"]["mean"])
    return np.array(errors)


def numbers(csv: str) -> np.ndarray:
    return np.array([line.split(",") for line in csv.splitlines()[3:]], float)


def test_the_shipped_files_are_those_of_the_shipped_problem() -> None:
    fresh = made()
    for name, again in (("d1", fresh.text), ("d1_carts", fresh.carts)):
        shipped = (PROBLEMS / "data" / f"{name}_synthetic.csv").read_text()
        assert again is not None and shipped.splitlines()[:3] == again.splitlines()[:3]
        assert np.abs(numbers(shipped) - numbers(again)).max() <= LAST_DIGIT
        assert "# synthetic: seed 2, 176 poses" in shipped and "carts tilt by 0.005 deg" in shipped
    assert fresh.carts is not None and numbers(fresh.carts).shape == (28, 10)


def test_the_models_are_those_of_the_thesis() -> None:
    for number, arms in D1_MODELS.items():
        carts, origin = call(number).options["carts"], call(number).options["origin"]
        assert [arm - 1 for arm in ([] if carts is None else carts.points)] == list(arms)
        assert origin.name == ("d1_nominal" if number < 3 else "d1_six_link")


def test_means_fall_from_model_1_to_5_as_printed() -> None:
    means = np.array([model(n).values["held_out_mm"]["mean"] for n in D1_MODELS])
    assert means == pytest.approx(PRINTED, rel=STORY)
    assert np.all(np.diff(means) < 0)
    assert [len(model(n).values["unknowns"]) for n in D1_MODELS] == [21, 21, 60, 60, 60]
    assert model(5).values["prediction_proven"]


def test_per_link_lengths_then_x_then_the_rest() -> None:
    """Table 5.10 on model 3: L above B_x and offset_x, these above y and z; link 1 hardly turns the plate."""
    sums = model(3).values["sensitivity"]
    for of in ("position_mm", "cost_m4"):
        order, values = table(sums, of)
        at = dict(zip(order, values, strict=True))
        assert np.all(at["L"] > np.maximum(at["A_x"], at["B_x"]))
        yz = np.max([at[f"{n}_{axis}"] for n in "AB" for axis in "yz"], axis=0)
        assert np.all(np.minimum(at["A_x"], at["B_x"]) > yz)
    order, turns = table(sums, "orientation_deg")
    assert np.all(50 * turns[:, 0] < turns[:, 1:].min(axis=1))
    assert text(sums).splitlines()[0] == "position change, mm,link 0,link 1,link 2,link 3,link 4,link 5"


def test_parameters_on_measured_guideways_are_no_robot_file() -> None:
    said = str(model(5).files["parameters.toml"])
    assert "not a robot file" in said.splitlines()[0] and "family" not in said
    assert 'family = "six_link"' in str(model(3).files["parameters.toml"])


def test_wrong_cart_points_are_said(tmp_path: Path) -> None:
    path = PROBLEMS / "data" / "d1_carts_synthetic.csv"
    with pytest.raises(ArgumentError, match="'q' is in mm here and declared in m"):
        read_cart_points(path, [2], "m")
    lines = path.read_text().splitlines()
    (tmp_path / "twice.csv").write_text("\n".join([*lines, lines[-1]]) + "\n")
    with pytest.raises(ArgumentError, match="line 32 repeats a coordinate"):
        read_cart_points(tmp_path / "twice.csv", [2])


def test_cart_points_need_a_gantry_tau_and_a_turn_of_length_one() -> None:
    robot, poses, fit = call(5).arguments
    carts = call(5).options["carts"]
    for model_, changed, argument in (
        (gt.robots.make("f1"), carts, "carts"),
        (robot, replace(carts, quaternion=[1.0, 1.0, 0.0, 0.0]), "carts.quaternion"),
    ):
        with pytest.raises(ArgumentError) as caught:
            study(model_, poses, fit, carts=changed)
        assert caught.value.argument == argument


def test_near_starts_end_at_the_optimum_and_far_ones_need_not() -> None:
    p = ready("three_link")
    x = p.unknowns.start
    reached, rms = basin(p, x, {}, 10.0, 5, 1)  # noisy: the truth is not the optimum, but near it
    best = min(float(np.sum(p.residuals(x) ** 2)), 1.0)
    assert reached == 5 and 3e-3 < rms < 0.1 and best < 1e-5
    lost, _ = basin(p, x, {"L": 1.0, "A": 1.0, "v": 1.0}, 5.0, 5, 1)
    assert lost < 5


@pytest.mark.proof
def test_the_order_holds_in_the_mean_of_other_robots(tmp_path: Path) -> None:
    """Seeds 11 to 18, fixed before they were seen; sizes were set on seeds 1 to 4."""
    by_robot = []
    for seed in range(11, 19):
        fresh = made_poses(gt.robots.make("d1_six_link"), replace(six_link(), seed=seed))
        (tmp_path / "carts.csv").write_text(fresh.files["carts.csv"])
        by_robot.append(mean_errors(fresh, tmp_path / "carts.csv"))
    means = np.mean(by_robot, axis=0)
    assert means == pytest.approx(PRINTED, rel=STORY)
    assert np.all(np.diff(means) < 0)
