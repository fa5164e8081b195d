"""Kind "compliance": the shipped problems, and what is refused, with its key."""

from __future__ import annotations

import numpy as np
import pytest

from gtmodel.compliance import arm_poses, softest_and_stiffest, translational_compliance
from gtmodel.kinds import Context, InputError, compliance
from gtmodel.kinds.load import load
from gtmodel.results import SolveStatus

COARSE = "section.step_m=0.2"


def solved(name: str, *changes: str):
    return compliance.solve(load(f"problems/compliance_{name}.toml", [COARSE, *changes]).problem, Context())  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def l1():
    return solved("l1")


def test_the_l1_over_its_section(l1) -> None:
    v = l1.values
    assert l1.status is SolveStatus.SOLVED and list(v) == list(compliance.VALUES)
    assert all(check.passed for check in l1.checks.values())
    C = np.asarray(v["compliance"])
    np.testing.assert_allclose(C @ [300.0, 200.0, -300.0], v["deflection_m"], rtol=1e-9)
    np.testing.assert_allclose(1 / np.linalg.eigvalsh(C)[::-1], v["stiffness_N_m"], rtol=1e-9)
    assert v["work_J"] == pytest.approx(np.dot([300.0, 200.0, -300.0], v["deflection_m"]) / 2)
    assert sum(v["shares"].values()) == pytest.approx(1.0) and v["rotation_rad"] is None
    assert np.all(np.diff(v["frequencies_Hz"]) > 0)
    # the size of printed ones: 2 to 4 N/um and above 45 Hz of other prototypes (Dressler 2012, sections 2.1, 2.2)
    assert 1e6 < v["stiffness_N_m"][0] < 4e6 and 30 < v["frequencies_Hz"][0] < 60
    for name in ("softest_N_m", "deflection_m", "frequency_Hz"):
        assert v["map"][name]["least"] < v["map"][name]["greatest"]
    rows = l1.files["map.csv"].splitlines()
    assert rows[0] == "u_m,v_m,x_m,y_m,z_m,softest_N_m,deflection_m,frequency_Hz"
    assert len(rows) == 1 + v["map"]["points"] and "nan" not in l1.files["map.csv"]
    assert {*l1.figures} == {"softest", "deflection", "frequency", "shares"}
    for draw in l1.figures.values():
        assert draw().axes


def test_nothing_changes_along_parallel_guideways(l1) -> None:
    moved = solved("l1", "section.along_m=3.0", "pose_m=[3.0, -0.43666666666666667, 0.9666666666666667]")
    np.testing.assert_allclose(moved.values["compliance"], l1.values["compliance"], rtol=1e-9)
    assert moved.values["map"]["softest_N_m"]["least"] == pytest.approx(l1.values["map"]["softest_N_m"]["least"])


def test_drives_alone_take_all_the_work() -> None:
    found = solved("l1", "links={stiffness_N_m=1e15}", "carts={drive_N_m=1e7}", "frame={}")
    assert found.values["shares"]["drives"] == pytest.approx(1.0, abs=1e-6)


def test_the_arm_is_as_soft_as_its_joints_say() -> None:
    found = solved("kr500")
    v, problem = found.values, load("problems/compliance_kr500.toml").problem
    arm = problem.arm  # type: ignore[attr-defined]
    poses = arm_poses(problem.model(Context()), np.deg2rad(arm.pose_deg), arm.tool_m)  # type: ignore[attr-defined]
    C = translational_compliance(poses.J, 1 / np.array(arm.joint_Nm_rad))
    np.testing.assert_allclose(v["stiffness_N_m"], softest_and_stiffest(C)[0][0], rtol=1e-9)
    assert v["frequencies_Hz"] is None and v["sag_m"] is None and v["shares"] is None
    assert "beyond the joints' limits" in v["reasons"] and {*found.figures} == {"softest", "deflection"}
    assert all(check.passed for check in found.checks.values())


@pytest.mark.parametrize(
    ("name", "change", "sentence"),
    [
        ("l1", "links={joint_N_m=1e8}", r"^links: expected either stiffness_N_m, or modulus_Pa with outer_diameter_m"),
        ("l1", "links={stiffness_N_m=1e7, modulus_Pa=7e10}", r"^links: expected either stiffness_N_m, or modulus_Pa"),
        ("l1", "links={stiffness_N_m=1e7, inner_diameter_m=0.1}", r"^links: expected either stiffness_N_m, or modulus"),
        ("kr500", "carts={drive_N_m=1e7}", r"^carts: is for parallel robots; an \[arm\] gives way in its joints alone"),
        ("kr500", "section.cone_deg=30.0", r"^section.cone_deg: is for parallel robots"),
        ("l1", "links={stiffness_N_m=[1e7, 1e7]}", r"^links: link has 2 numbers; expected one, or 3"),
        ("l1", "load.moment_Nm=[1.0, 0.0, 0.0]", r"^load.moment_Nm: the plate of this robot is a point"),
        ("l1", "pose_m=[0.0, 0.0, 9.0]", r"^pose_m: cannot be reached: "),
        ("l1", "section.low_m=[5.0, 0.0]", r"^section.high_m: every lower limit must be less than its upper one"),
        ("l1", "section.step_m=1e-5", r"^section.step_m: the grid would have more than a million points"),
        ("l1", 'robot="kr500"', r"^payload_kg: |^robot: "),
        ("kr500", "links={stiffness_N_m=1e7}", r"^arm: expected one of \[links\], for a parallel robot, and \[arm\]"),
        ("kr500", "arm.joint_Nm_rad=[1e6]", r"^arm.joint_Nm_rad: has 1 numbers; expected 6, one per joint"),
        ("kr500", "pose_m=[9.0, 0.0, 0.0]", r"^pose_m: cannot be reported: "),
        ("l1", "carts.axis_Nm_rad=1e3", r"^carts.axis_Nm_rad: this robot has no rotary axes on its carts"),
        ("kr500", 'robot="l1_tape"', r"^robot: expected a serial arm such as kr500"),
    ],
)
def test_wrong_inputs_name_their_key(name, change, sentence) -> None:
    with pytest.raises(InputError, match=sentence):
        solved(name, change)


def test_a_section_out_of_reach_says_why() -> None:
    found = solved("l1", "section.low_m=[4.0, 4.0]", "section.high_m=[5.0, 5.0]")
    assert found.status is SolveStatus.INFEASIBLE and "no point of the section is reached" in found.message
    assert found.files == {} and found.values["map"] == {"points": 0}


def test_explain_names_the_springs() -> None:
    text = compliance.explain(load("problems/compliance_l1.toml").problem, Context())  # type: ignore[arg-type]
    assert "C = U^-1 (diag(1/k) + G diag(1/k_s) G') U^-T" in text and "ball joints: 57.5 to 172.5 MN/m" in text


def test_a_stiffness_about_an_axis_is_refused_in_its_own_unit() -> None:
    with pytest.raises(InputError, match=r"must be greater than 0 N\.m/rad; found 0"):
        load("problems/compliance_kr500.toml", ["arm.joint_Nm_rad=[0.0, 1e6, 1e6, 1e6, 1e6, 1e6]"])
    with pytest.raises(InputError, match=r"must be greater than 0 MN\.m/rad; found 0"):
        load("problems/stiffness_kr500.toml", ["joint_stiffness.synthetic.stiffness_MNm_rad=[0, 1, 1, 1, 1, 1]"])
