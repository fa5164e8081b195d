"""Kind "calibration" with [joint_stiffness]: made-up tests, planted tilt, measured files, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gtmodel.kinds.calibration.kind import RESULT
from gtmodel.problem_files import Context, InputError
from gtmodel.problem_files.load import load
from gtmodel.problem_files.run import answer, explain
from gtmodel.results import SolveStatus
from gtmodel.results.quantity import described

TRUTH = [3.93, 3.46, 2.77, 1.57, 0.24, 0.17]
COLUMNS = ('q={column="q", unit="deg"}, force={column="force", unit="N"}, moment={column="moment", unit="N.m"}, '
           'displacement={column="displacement", unit="mm"}, rotation={column="rotation", unit="rad"}')  # fmt: skip
SPRING = "joint_stiffness.compensator={base_m=0.3, lever_m=0.25, rate_N_m=8e5, rest_m=0.2"


def solved(*changes: str, folder: Path = Path()):
    return answer(load("problems/stiffness_kr500.toml", list(changes)), Context(folder=folder))


@pytest.fixture(scope="module")
def shipped():
    return solved()


def test_the_shipped_tests_are_recovered_and_say_that_they_are_synthetic(shipped) -> None:
    v = shipped.values["joint_stiffness"]
    assert shipped.status is SolveStatus.SOLVED and list(shipped.values) == list(described(RESULT))
    # six intervals of 95 % for the seed of the file, and the printed values inside
    assert all(low < k < high for k, (low, high) in zip(TRUTH, v["interval_MNm_rad"], strict=True))
    assert all(v["agree"]) and v["adequate"] and all(check.passed for check in shipped.checks.values())
    assert shipped.values["synthetic"] == "seed 9, noise 2e-05 m and 0.0001 rad"
    assert shipped.files["parameters.toml"].startswith("# synthetic: seed 9")
    assert "synthetic: seed 9" in shipped.figures["stiffness"]().axes[0].get_title()
    assert np.all(np.array(v["softest_N_m"]) < v["stiffest_N_m"]) and len(v["best_tests"]) == 10
    page = shipped.files["report.html"]
    assert "Synthetic load tests: seed 9" in page and 'src="data:image/png' in page and "do not follow from it" in page


@pytest.mark.parametrize("method", ["complete_pose", "decoupled"])
def test_planted_tilt_fails_the_check_and_is_said(method) -> None:
    found = solved("joint_stiffness.synthetic.tilt=3.0", f'joint_stiffness.method="{method}"')
    v = found.values["joint_stiffness"]
    assert not found.checks["chi_squared_p"].passed and not v["adequate"]
    assert "the model lacks an effect" in v["adequacy"] and v["said"][0].startswith("the residuals are larger")
    assert "bearings tilt" in found.values["synthetic"]


@pytest.mark.parametrize("method", ["complete_pose", "decoupled"])
def test_a_measured_file_gives_what_its_tests_gave(tmp_path, method) -> None:
    changes = ["joint_stiffness.complementary=true", f'joint_stiffness.method="{method}"']
    made = solved(*changes)
    (tmp_path / "tests.csv").write_text(made.files["load_tests.csv"])
    tool = "tool_m=[0.1, 0.05, 0.4], complementary=true"
    wrist = 'wrist={column="wrist", unit="mm"}'
    keys = f'joint_stiffness={{{tool}, method="{method}", measurements={{file="tests.csv", {COLUMNS}, {wrist}}}}}'
    found = solved(keys, folder=tmp_path)
    a, b = made.values["joint_stiffness"], found.values["joint_stiffness"]
    np.testing.assert_allclose(b["stiffness_MNm_rad"], a["stiffness_MNm_rad"], rtol=1e-8)
    assert b["best_tests"] == a["best_tests"] and found.values["synthetic"] == made.values["synthetic"]
    # without a target at the wrist centre, that follows from the pose
    plain = solved(keys.replace(f", {wrist}", ""), folder=tmp_path).values["joint_stiffness"]
    np.testing.assert_allclose(plain["stiffness_MNm_rad"], a["stiffness_MNm_rad"], rtol=0.05)
    with pytest.raises(
        InputError, match=r"^joint_stiffness.measurements.\S+: tests.csv line 2: .* is in mm here and declared in m"
    ):
        solved(keys.replace('"displacement", unit="mm"', '"displacement", unit="m"'), folder=tmp_path)
    with pytest.raises(InputError, match=r"^joint_stiffness.measurements.file: there is no file 'other.csv'"):
        solved(keys.replace("tests.csv", "other.csv"), folder=tmp_path)


def test_a_compensator_given_or_estimated() -> None:
    given = solved(f"{SPRING}}}").values["joint_stiffness"]
    assert given["compensator_rate_N_m"] is None
    np.testing.assert_allclose(given["stiffness_MNm_rad"], TRUTH, rtol=0.1)
    v = solved(f"{SPRING}, estimate_rate=true}}").values["joint_stiffness"]
    rate, std = v["compensator_rate_N_m"]
    assert abs(rate - 8e5) < 3 * std and std < 8e5 and v["other_method_MNm_rad"] is None and v["adequate"]


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ('robot="l1_tape"', r"^robot: expected a serial arm such as kr500; "),
        ("joint_stiffness.poses_deg=[[1.0, 2.0]]", r"^joint_stiffness.poses_deg\[0\]: has 2 numbers; expected 6 joint"),
        ("joint_stiffness.load=[{force_N=[0.0,0.0,-4000.0]}]", r"^joint_stiffness.load: the data do not determine c\["),
        ("joint_stiffness.synthetic.stiffness_MNm_rad=[1.0]", r"^joint_stiffness.synthetic.stiffness_MNm_rad: has 1 n"),
        ("joint_stiffness={}", r"^joint_stiffness: expected one of \[measurements\] and \[synthetic\]; found none of"),
        ('cost="inverse"', r"^cost: is of a geometric calibration; leave it out beside \[joint_stiffness\]"),
        (
            f'joint_stiffness.measurements={{file="a.csv", {COLUMNS}}}',
            r"^joint_stiffness: expected one of .* found both",
        ),
    ],
)
def test_wrong_inputs_name_their_key(change, sentence) -> None:
    with pytest.raises(InputError, match=sentence):
        solved(change)


def test_the_rate_of_a_compensator_is_for_complete_poses() -> None:
    with pytest.raises(InputError, match=r"^joint_stiffness.method: estimates no compensator; use complete_pose"):
        solved('joint_stiffness.method="decoupled"', f"{SPRING}, estimate_rate=true}}")


def test_explain() -> None:
    text = explain(load("problems/stiffness_kr500.toml"), Context())
    assert "30 static load tests" in text and "complete pose: 180 rows" in text


def measured(folder: Path, shipped, change):
    """The shipped tests as a measured file, its numbers changed."""
    _, head, *lines = shipped.files["load_tests.csv"].splitlines()
    rows = change([[float(x) for x in line.split(",")] for line in lines])
    text = "\n".join([head, *(",".join(f"{x:.12g}" for x in row) for row in rows)])
    (folder / "tests.csv").write_text(text + "\n")
    problem = load("problems/stiffness_kr500.toml", ["joint_stiffness={tool_m=[0.1, 0.05, 0.4], "
                   f'measurements={{file="tests.csv", {COLUMNS}}}}}'])  # fmt: skip
    return answer(problem, Context(folder=folder))


def test_displacements_with_the_sign_turned_are_told_in_a_sentence(shipped, tmp_path) -> None:
    found = measured(tmp_path, shipped, lambda rows: [[*r[:12], *(-x for x in r[12:])] for r in rows])
    v = found.values["joint_stiffness"]
    assert v["adequate"], "residuals alone do not show it"
    assert "joints 1, 2, 3, 4, 5, 6 is negative beyond noise" in v["said"][0] and "sign turned" in v["said"][0]
    assert v["softest_N_m"] is None and not found.checks["negative_compliances"].passed
    shown = {row.label: str(row.value) for row in found.rows}
    assert shown["joint 1"].endswith("(negative, no interval)")
    assert 'class="box bad"' in str(found.files["report.html"])
    assert "no upper end" not in str(found.files["report.html"])


def test_copied_tests_and_too_few_are_told(shipped, tmp_path) -> None:
    copied = measured(tmp_path, shipped, lambda rows: rows + rows)
    said = copied.values["joint_stiffness"]["said"]
    assert not copied.checks["copied_tests"].passed and "copied_tests" not in shipped.checks
    assert said[0].startswith("30 of 60 tests repeat an earlier one to the last digit, as line 32 does line 2")
    assert "negative_compliances" not in shipped.checks and "repeat" not in "".join(
        shipped.values["joint_stiffness"]["said"])  # fmt: skip
    with pytest.raises(InputError, match="found 1 test; expected at least 2"):
        measured(tmp_path, shipped, lambda rows: rows[:1])


def test_displacements_of_zero_are_named_not_the_poses(shipped, tmp_path) -> None:
    with pytest.raises(InputError, match="every displacement is zero"):
        measured(tmp_path, shipped, lambda rows: [[*r[:12], *[0.0] * 9] for r in rows])
