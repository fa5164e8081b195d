"""Models 1 to 5 of D1 on the shipped synthetic robot, its cart points, and the sensitivity of model 3."""

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gtmodel.calibrate import CalibrationStudy
from gtmodel.calibrate.basin import basin
from gtmodel.calibrate.synthetic import Made, make
from gtmodel.calibrate.told.sensitivity_table import table, text
from gtmodel.kinds.calibration.keys import Synthetic
from gtmodel.problem_files import Context, InputError, robots
from gtmodel.robots.measured_guideways import D1_MODELS
from tests.calibrate.runs import ready
from tests.kinds.calibration_problems import PROBLEMS, keys, solved

PRINTED = np.array([0.140, 0.120, 0.110, 0.100, 0.090])  # mm, Table 5.3
STORY = 0.3  # of the printed means: our robot has errors of D1's sizes, but it is not D1
LAST_DIGIT = 1.01e-4  # mm: where another machine rounds otherwise


@cache
def model(number: int) -> CalibrationStudy:
    return solved(keys(f"calibrate_d1_model_{number}"))


def made(**changes: Any) -> Made:
    problem = keys("simulate_d1")
    return make(robots.resolve(problem["robot"], Context()), Synthetic(**{**problem["synthetic"], **changes}).options())


def mean_errors(folder: Path, numbers: tuple[int, ...] = (1, 2, 3, 4, 5)) -> np.ndarray:
    """Held-out means [mm] of models on files in folder/data."""
    problems = [keys(f"calibrate_d1_model_{n}", sensitivity_step=0.0) for n in numbers]
    return np.array([solved(p, folder).values["held_out_mm"]["mean"] for p in problems])


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
        problem = keys(f"calibrate_d1_model_{number}")
        assert [arm - 1 for arm in problem.get("cart_points", {}).get("arms", [])] == list(arms)
        assert problem["robot"] == ("d1_nominal" if number < 3 else "d1_six_link")


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
    assert "no robot file" in said.splitlines()[0] and "family" not in said
    assert 'family = "six_link"' in str(model(3).files["parameters.toml"])


@pytest.mark.parametrize(
    ("changes", "key", "said"),
    [
        ({"file": "none.csv"}, "cart_points.file", "there is no file 'none.csv'"),
        ({"quaternion": [1.0, 1.0, 0.0, 0.0]}, "cart_points.quaternion", "has the length 1.414"),
        ({"unit": "m"}, "cart_points.file", "'q' is in mm here and declared in m"),
    ],
)
def test_wrong_cart_points_are_said(changes: dict[str, Any], key: str, said: str) -> None:
    problem = keys("calibrate_d1_model_5")
    with pytest.raises(InputError, match=said.replace("(", r"\(")) as caught:
        solved({**problem, "cart_points": {**problem["cart_points"], **changes}})
    assert caught.value.key == key


def test_cart_points_need_a_gantry_tau_and_coordinates_that_grow(tmp_path: Path) -> None:
    carts = keys("calibrate_d1_model_5")["cart_points"]
    with pytest.raises(InputError, match="three or six links"):
        solved(keys("calibrate_f1", cart_points=carts))
    lines = (PROBLEMS / carts["file"]).read_text().splitlines()
    (tmp_path / "twice.csv").write_text("\n".join([*lines, lines[-1]]) + "\n")
    with pytest.raises(InputError, match="line 32 repeats a coordinate"):
        solved(keys("calibrate_d1_model_5", cart_points={**carts, "file": "twice.csv"}), tmp_path)


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
    (tmp_path / "data").mkdir()
    found = []
    for seed in range(11, 19):
        m = made(seed=seed)
        assert m.carts is not None
        (tmp_path / "data" / "d1_synthetic.csv").write_text(m.text)
        (tmp_path / "data" / "d1_carts_synthetic.csv").write_text(m.carts)
        found.append(mean_errors(tmp_path))
    means = np.mean(found, axis=0)
    assert means == pytest.approx(PRINTED, rel=STORY)
    assert np.all(np.diff(means) < 0)
