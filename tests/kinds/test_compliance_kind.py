"""Kind "compliance": keys of the file, and where refusals stand in it."""

from __future__ import annotations

import io

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.problem_files import Context, InputError
from gtmodel.problem_files.load import load
from gtmodel.problem_files.run import answer, context_of, explain
from gtmodel.results import SolveStatus

STEP = 0.2  # m
COARSE = f"section.step_m={STEP}"


def solved(name: str, *changes: str):
    loaded = load(f"problems/compliance_{name}.toml", [COARSE, *changes])
    return answer(loaded, context_of(loaded))


@pytest.mark.parametrize("name", ["l1", "kr500"])
def test_shipped_problems_are_solved(name) -> None:
    found = solved(name)
    assert found.status is SolveStatus.SOLVED and found.map["points"] > 0 and found.rows


@pytest.mark.parametrize(
    ("name", "change", "key"),
    [
        ("l1", "links={joint_N_m=1e8}", "links"),
        ("l1", "links={stiffness_N_m=[1e7, 1e7]}", "links"),
        ("kr500", "carts={drive_N_m=1e7}", "carts"),
        ("kr500", "section.cone_deg=30.0", "section.cone_deg"),
        ("l1", "load.moment_Nm=[1.0, 0.0, 0.0]", "load.moment_Nm"),
        ("l1", "pose_m=[0.0, 0.0, 9.0]", "pose_m"),
        ("l1", "section.low_m=[5.0, 0.0]", "section.high_m"),
        ("l1", "section.step_m=1e-5", "section.step_m"),
        ("kr500", "links={stiffness_N_m=1e7}", "arm"),
        ("kr500", "arm.joint_Nm_rad=[1e6]", "arm.joint_Nm_rad"),
        ("kr500", "pose_m=[9.0, 0.0, 0.0]", "pose_m"),
        ("l1", "carts.axis_Nm_rad=1e3", "carts.axis_Nm_rad"),
        ("kr500", 'robot="l1_tape"', "robot"),
    ],
)
def test_wrong_inputs_name_their_key(name, change, key) -> None:
    with pytest.raises(InputError) as caught:
        solved(name, change)
    assert caught.value.key == key and caught.value.message


@pytest.mark.parametrize("change", ['robot="kr500"'])
def test_keys_of_another_robot_are_refused(change) -> None:
    with pytest.raises(InputError) as caught:
        solved("l1", change)
    assert caught.value.key in ("payload_kg", "robot")


def test_explain_names_the_springs() -> None:
    text = explain(load("problems/compliance_l1.toml"), Context())
    assert "C = U^-1 (diag(1/k) + G diag(1/k_s) G') U^-T" in text and "ball joints: 57.5 to 172.5 MN/m" in text


@pytest.mark.parametrize(
    ("problem", "setting", "unit"),
    [
        ("compliance_kr500", "arm.joint_Nm_rad=[0.0, 1e6, 1e6, 1e6, 1e6, 1e6]", "N.m/rad"),
        ("stiffness_kr500", "joint_stiffness.synthetic.stiffness_MNm_rad=[0, 1, 1, 1, 1, 1]", "MN.m/rad"),
    ],
)
def test_a_stiffness_about_an_axis_is_refused_in_its_own_unit(problem, setting, unit) -> None:
    with pytest.raises(InputError) as caught:
        load(f"problems/{problem}.toml", [setting])
    assert f" {unit};" in caught.value.message


def test_an_arm_from_a_urdf_deflects_as_its_kinematics_by_differences() -> None:
    """The Jacobian comes from differences of forward kinematics here, from the joints' axes there."""
    s = solved("ur_like")
    assert s.status is SolveStatus.SOLVED, s.message
    arm = gt.robots.from_urdf("problems/models/ur_like.urdf", tool_xyz=[0.0, 0.0, 0.21])  # 0.09 to the flange
    q, h = np.radians([0.0, 80.0, -90.0, -80.0, -90.0, 0.0]), 1e-5
    rows = arm.causal(known="q", targets="T")(np.vstack([q, q + h * np.eye(6), q - h * np.eye(6)]))[0]
    J = (rows[1:7] - rows[7:]).T / (2 * h)
    c = 1 / np.array([2.0e4, 2.0e4, 2.0e4, 6.0e3, 6.0e3, 6.0e3])
    np.testing.assert_allclose(s.pose, rows[0], atol=1e-12)
    np.testing.assert_allclose(s.deflection, (J * c) @ J.T @ [0.0, 0.0, -50.0], rtol=0, atol=1e-9)  # h^2 of it
    # the section holds the reported pose: within half a diagonal of its grid it is as stiff
    rows = np.genfromtxt(io.StringIO(s.files["map.csv"]), delimiter=",", names=True)
    away = np.linalg.norm(np.column_stack([rows[f"{axis}_m"] for axis in "xyz"]) - s.pose, axis=1)
    assert away.min() < STEP / np.sqrt(2)
    assert rows["softest_N_m"][np.argmin(away)] == pytest.approx(s.stiffness[0], rel=0.1)
