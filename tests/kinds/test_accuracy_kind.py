"""Kind "accuracy": the windows printed for D1 (Dressler 2012, section 4.3); and where refusals stand in the file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.kinematics.accuracy import ErrorSection, LinkErrors, MonteCarloDraws
from gtmodel.problem_files import Context, InputError
from gtmodel.problem_files.load import load
from gtmodel.problem_files.run import answer, explain
from tests.support.commands import CLONE, Commands

FILE = CLONE / "problems" / "d1_accuracy.toml"


def test_the_declared_problem_and_the_printed_windows(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    done = Commands(capsys)(
        "solve", FILE, "--set", "section.step_m=0.1", "--json", "--plot", "--out", tmp_path / "out"
    )  # fmt: skip
    assert done.code == 0 and done.json["status"] == "solved"
    assert list(done.json["values"]) == ["cases", "window_m", "guideways_m", "section", "points"]
    one, two = done.json["values"]["cases"]
    assert 140 < one["min_um"] < one["max_um"] < 230 and one["centre_um"] == pytest.approx(200, abs=10)
    assert 75 < two["min_um"] < two["max_um"] < 180
    # case 1 largest beside a guideway, case 2 near guideway 2
    guideways = np.array(done.json["values"]["guideways_m"])
    assert np.linalg.norm(guideways - one["max_at_m"], axis=1).min() < 0.15
    assert two["nearest_guideway"] == 2 and np.linalg.norm(guideways[1] - two["max_at_m"]) < 0.15
    # least in the lower right corner
    window = np.array(done.json["values"]["window_m"])
    np.testing.assert_allclose(one["min_at_m"], [window[1, 0], window[0, 1]], atol=0.15)
    # most of it orthogonal to link 1, whose error is the smallest
    assert np.argmax(one["shape"]["faces_um2"]) == 0
    assert one["shape"]["longest_diagonal_um"] == pytest.approx(2 * one["centre_um"], rel=1e-9)
    assert one["reached_min_um"] <= one["min_um"] and one["max_um"] <= one["reached_max_um"]
    checks = done.json["checks"]
    assert len(checks) == 6 and all(check["passed"] for check in checks.values())
    files = {p.name for p in (tmp_path / "out").iterdir()}
    assert files == {
        "result.json", "errors.csv", "run.toml", "error_1.png", "error_2.png", "faces.png", "robot.png",
        "error_1.scene.json", "error_2.scene.json",
    }  # fmt: skip
    table = np.genfromtxt(tmp_path / "out" / "errors.csv", delimiter=",", names=True)
    assert table["error_1_um"].max() == pytest.approx(one["max_um"], rel=1e-5)
    assert table["error_2_um"].min() == pytest.approx(two["min_um"], rel=1e-5)


def test_the_call_on_objects_gives_the_values_of_the_file() -> None:
    by_file = answer(load(FILE, ["section.step_m=0.2", "monte_carlo.samples=500"]), Context())
    cases = [
        LinkErrors("case 1", along=[32e-6, 77e-6, 54e-6], across=[32e-6, 77e-6, 54e-6]),
        LinkErrors("case 2", along=[11e-6, 58e-6, 1e-6 * 19], across=[28e-6, 1e-6 * 38, 47e-6]),
    ]
    robot = gt.robots.gantry_tau("d1_nominal")
    by_call = gt.kinematics.accuracy_study(
        robot, cases, section=ErrorSection(step=0.2), monte_carlo=MonteCarloDraws(500)
    )
    assert str(by_call.values) == str(by_file.values) and by_call.checks == by_file.checks


@pytest.mark.parametrize(
    ("setting", "key"),
    [
        ("cases=[{name='none'}]", "cases[0]"),
        ("cases=[{name='x', length_um=[0, 0, 0]}]", "cases[0].length_um"),
        ("cases=[{name='x', length_um=[1, -1, 0]}]", "cases[0].length_um[1]"),
        ("cases=[{name='x', length_um=[1, 1, 1]}, {name='x', length_um=[1, 1, 1]}]", "cases[1].name"),
        ("cases=[]", "cases"),
        ("section.high_m=[-9.0, -9.0]", "section.high_m"),
        ("section.step_m=1e-5", "section.step_m"),
        ("robot='d1_nominl'", "robot"),
    ],
)
def test_what_is_refused(setting: str, key: str) -> None:
    with pytest.raises(InputError) as caught:
        answer(load(FILE, [setting]), Context())
    assert caught.value.key == key and "\n" not in str(caught.value)


def test_a_start_is_refused() -> None:
    with pytest.raises(InputError, match="leave it out"):
        answer(load(FILE), Context(start={}))


def test_explain_names_region_and_method() -> None:
    text = explain(load(FILE), Context())
    assert "rectangle from (u, v) = (-5.078, -0.6949)" in text and "corners from the support function" in text
