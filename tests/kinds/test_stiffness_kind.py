"""Kind "stiffness": the shipped synthetic tests, planted tilt, measured tables, and what is refused, with its key."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from gtmodel.kinds import Context, InputError, stiffness
from gtmodel.kinds.load import load
from gtmodel.kinds.robot_keys import RobotProblem
from gtmodel.results import SolveStatus

TRUTH = [3.93, 3.46, 2.77, 1.57, 0.24, 0.17]


def solved(*changes: str):
    return stiffness.solve(load("problems/stiffness_kr500.toml", list(changes)).problem, Context())  # type: ignore[arg-type]


@pytest.fixture(scope="module", autouse=True)
def one_robot():
    """The same robot in every test: compiled once."""
    made, found = RobotProblem.model, {}

    def model(self, context):
        if self.robot not in found:
            found[self.robot] = made(self, context)
        return found[self.robot]

    RobotProblem.model = model
    yield
    RobotProblem.model = made


@pytest.fixture(scope="module")
def shipped(one_robot):
    return solved()


def test_the_shipped_tests_are_recovered_and_say_that_they_are_synthetic(shipped) -> None:
    v = shipped.values
    assert shipped.status is SolveStatus.SOLVED and list(v) == list(stiffness.VALUES)
    # six intervals of 95 % for the seed of the file, and the printed values inside
    assert all(low < k < high for k, (low, high) in zip(TRUTH, v["stiffness_interval_MNm_rad"], strict=True))
    assert all(v["agree"]) and all(check.passed for check in shipped.checks.values())
    assert v["synthetic"] == "seed 9, noise 2e-05 m and 0.0001 rad"
    assert shipped.files["parameters.toml"].startswith("# synthetic: seed 9")
    assert "synthetic: seed 9" in shipped.figures["stiffness"]().axes[0].get_title()
    assert np.all(v["softest_N_m"] < v["stiffest_N_m"]) and len(v["best_tests"]) == 10


@pytest.mark.parametrize("method", ["complete_pose", "decoupled"])
def test_planted_tilt_fails_the_check(method) -> None:
    found = solved("synthetic.tilt=3.0", f'method="{method}"')
    assert not found.checks["chi_squared_p"].passed
    assert "the model lacks an effect" in found.values["adequacy"] and "bearings tilt" in found.values["synthetic"]


def test_measured_displacements_and_complementary_stiffness(shipped) -> None:
    changes = ["complementary=true"]
    data = load("problems/stiffness_kr500.toml", changes).problem
    assert isinstance(data, stiffness.Schema)
    planned = stiffness._tests(data, stiffness._poses(data, Context()))
    rows: dict[str, Any] = {
        "displacement_m": planned.displacement[:, :3].tolist(),
        "rotation_rad": planned.displacement[:, 3:].tolist(),
    }
    measured = data.model_copy(update={"synthetic": None, "measured": stiffness.Measured(**rows)})
    found = stiffness.solve(measured, Context())
    assert found.values["synthetic"] is None and found.values["other_method_MNm_rad"] is None
    np.testing.assert_allclose(found.values["stiffness_MNm_rad"], solved(*changes).values["stiffness_MNm_rad"])
    # without a target at the wrist centre it follows from the pose
    plain = stiffness.solve(measured.model_copy(update={"complementary": False}), Context())
    assert plain.values["other_method_MNm_rad"] is not None
    short = measured.model_copy(update={"measured": stiffness.Measured(**{**rows, "rotation_rad": [[0.0] * 3]})})
    with pytest.raises(InputError, match=r"^measured.rotation_rad: expected 30 rows of 3 numbers, one per pose"):
        stiffness.solve(short, Context())


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ('robot="l1_tape"', r"^robot: expected a serial arm such as kr500; "),
        ("poses_deg=[[1.0, 2.0]]", r"^poses_deg\[0\]: has 2 numbers; expected 6 joint angles in degrees"),
        ("load=[{force_N=[0.0,0.0,-4000.0]}]", r"^load: the data do not determine c\[0\]"),
        ("synthetic.stiffness_MNm_rad=[1.0]", r"^synthetic.stiffness_MNm_rad: has 1 numbers; expected 6"),
        ("measured={displacement_m=[], rotation_rad=[]}", r"^synthetic: expected one of \[measured\] and \[synthetic"),
    ],
)
def test_wrong_inputs_name_their_key(change, sentence) -> None:
    with pytest.raises(InputError, match=sentence):
        solved(change)


def test_decoupled_refuses_complementary_stiffness() -> None:
    with pytest.raises(InputError, match=r"^method: takes no complementary stiffness; use complete_pose"):
        solved("complementary=true", 'method="decoupled"')


def test_explain() -> None:
    text = stiffness.explain(load("problems/stiffness_kr500.toml").problem, Context())  # type: ignore[arg-type]
    assert "10 poses under 3 loads, 30 tests" in text and "complete pose: 180 rows" in text
