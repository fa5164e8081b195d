"""Postures along paths, and the study: jumps against an exhaustive search, distances out of reach by hand, limits."""

from __future__ import annotations

from itertools import pairwise, product
from pathlib import Path

import numpy as np
import pytest

import gtmodel as gt
from gtmodel.geometry.chains import Chain, along_path, postures
from gtmodel.geometry.chains.numerical import shortfall
from gtmodel.geometry.rotations import rotation_about
from gtmodel.kinematics import ToolColumns, ToolPose, ToolPoses, postures_study, read_tool_poses
from gtmodel.results import ArgumentError, SolveStatus
from tests.support import chains as arms

ARM = Path(__file__).parents[2] / "problems" / "models" / "arm.urdf"
ROUND_OFF = 1e-9
X, Y, Z = np.eye(3)
DOWN = np.diag([1.0, -1.0, -1.0])
STEP = 0.5


@pytest.fixture(scope="module")
def arm() -> gt.Model:
    return gt.robots.from_urdf(ARM)


def fewest_jumps(chain: Chain, T: np.ndarray, limits: np.ndarray) -> int:
    """By all pairs of postures in all turns: the least number of steps that no pair of a way allows."""
    turns = np.array(list(product((-2 * np.pi, 0.0, 2 * np.pi), repeat=len(chain))))
    rows = []
    for q in postures(chain, T).q:
        turned = (q[:, None] + turns).reshape(-1, len(chain))
        rows.append(turned[((turned >= limits[:, 0]) & (turned <= limits[:, 1])).all(axis=1)])
    jumps = np.zeros(len(rows[0]))
    for before, after in pairwise(rows):
        goes_on = (np.abs(after[:, None] - before[None]) <= STEP).all(axis=2)
        jumps = np.where(goes_on, jumps, jumps + 1).min(axis=1)
    return int(jumps.min())


@pytest.mark.parametrize("seed", range(4))
def test_no_way_has_fewer_jumps(seed: int) -> None:
    chain, rng = arms.planar(0.4, 0.3), np.random.default_rng(seed)
    angle = np.cumsum(rng.uniform(-0.4, 0.5, 60))
    radius = 0.42 + 0.13 * np.sin(np.cumsum(rng.uniform(-0.5, 0.5, 60)))
    T = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), 0 * angle])
    limits = np.array([[-3.0, 3.3], [-2.4, 2.0]])
    way = along_path(chain, postures(chain, T), T, None, limits=limits, largest_step=STEP)
    assert sum(j.kind != "gap" for j in way.jumps) == fewest_jumps(chain, T, limits)
    rows = np.isfinite(way.q).all(axis=1)
    assert rows.all() and ((way.q >= limits[:, 0] - ROUND_OFF) & (way.q <= limits[:, 1] + ROUND_OFF)).all()
    np.testing.assert_allclose(chain.pose(way.q)[0], T, atol=ROUND_OFF)
    jumped = np.abs(np.diff(way.q, axis=0)).max(axis=1) > STEP
    assert set(np.flatnonzero(jumped) + 1) <= {j.row for j in way.jumps}


def test_a_full_circle_needs_the_turns_of_its_joint() -> None:
    chain = arms.planar(0.4, 0.3)
    angle = np.radians(np.linspace(0, 400, 81))
    T = 0.5 * np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    wide = along_path(chain, postures(chain, T), T, None, limits=np.radians([[-200, 370], [-170, 170]]))
    assert wide.jumps == () and np.ptp(wide.q[:, 0]) == pytest.approx(np.radians(400), abs=ROUND_OFF)
    narrow = along_path(chain, postures(chain, T), T, None, limits=np.radians([[-170, 170], [-170, 170]]))
    # the elbow is at 90 degrees: q[0] is the angle of the target and 36.87 degrees less, so that 210 is beyond 170
    assert [(j.row, j.kind, j.joint) for j in narrow.jumps] == [(42, "limit", 0)]
    assert narrow.jumps[0].amount == pytest.approx(np.radians(40) - np.arctan2(3, 4), abs=ROUND_OFF)


def test_a_path_through_a_singular_wrist_keeps_its_axes_still() -> None:
    chain = arms.kr500()
    s = np.linspace(-1, 1, 21)[:, None]
    q = np.array([0.2, -1.0, 1.4, 0.7, 0.0, -0.4]) + s * np.array([0.3, 0.1, -0.2, 0.2, 0.5, 0.3])
    T, R = chain.pose(q)  # joint 5 is exactly zero in the middle row
    found = postures(chain, T, R)
    assert (found.status[10] == gt.Status.SINGULAR).any()
    way = along_path(chain, found, T, R, near=q[0])
    assert way.jumps == ()
    for got, wanted in zip(chain.pose(way.q), (T, R), strict=True):
        np.testing.assert_allclose(got, wanted, atol=ROUND_OFF)
    np.testing.assert_allclose(np.delete(way.q, 10, axis=0), np.delete(q, 10, axis=0), atol=1e-6)
    assert np.abs(np.diff(way.q, axis=0)).max() < 0.2  # also next to the singular row


def test_a_gap_is_said_and_the_path_goes_on_after_it() -> None:
    chain = arms.planar(0.4, 0.3)
    T = np.column_stack([np.linspace(0.5, 0.9, 9), np.full(9, 0.1), np.zeros(9)])
    T = np.concatenate([T, T[::-1]])
    way = along_path(chain, postures(chain, T), T, None)
    beyond = np.linalg.norm(T, axis=1) > 0.7
    np.testing.assert_array_equal(np.isnan(way.q).any(axis=1), beyond)
    assert [(j.row, j.kind) for j in way.jumps] == [(int(np.argmax(beyond)), "gap")]


def test_distance_out_of_reach_is_that_of_geometry(arm: gt.Model) -> None:
    planar = arms.planar(0.4, 0.3)
    T = np.array([[0.9, 0.0, 0.0], [0.05, 0.02, 0.0], [0.0, 0.8, 0.1]])
    by_hand = [0.2, 0.1 - np.hypot(0.05, 0.02), np.hypot(0.1, 0.1)]
    np.testing.assert_allclose(shortfall(planar, T, None)[0], by_hand, atol=1e-6)
    # a wrist point on a sphere of 0.4 + 0.35 m about the shoulder, the tool 0.18 m ahead of it
    rng = np.random.default_rng(2)
    R = np.array([rotation_about(Z, a) @ rotation_about(Y, b) for a, b in rng.uniform(-2, 2, (8, 2))])
    T = rng.uniform(-1, 1, (8, 3)) + 0.9 * R[:, :, 2]
    reach = np.linalg.norm(T - 0.18 * R[:, :, 2] - [0, 0, 0.3], axis=1) - 0.75
    study = postures_study(arm, ToolPoses(T, R))
    assert (reach > 0).sum() >= 4
    lost = np.array([not np.isfinite(q).any() for q in study.q])
    np.testing.assert_array_equal(lost, reach > 0)
    np.testing.assert_allclose(study.shortfall[lost], reach[lost], rtol=2e-3)  # the weight of the rotation is finite


def test_an_orientation_that_the_arm_does_not_have() -> None:
    scara = gt.robots.serial_arm(a=[0.3, 0.25, 0.0, 0.0], alpha=[0.0, np.pi, 0.0, 0.0], joints="rrpr")
    study = postures_study(scara, ToolPoses([[0.4, 0.1, -0.1]], DOWN @ rotation_about(X, 0.2)))
    assert study.status is SolveStatus.INFEASIBLE and np.isnan(study.shortfall[0])
    assert "cannot turn its tool that way" in study.message
    assert postures_study(scara, ToolPoses([[0.4, 0.1, -0.1]], DOWN)).status.ok


def test_forms_of_a_pose_are_one(arm: gt.Model) -> None:
    q = np.array([0.3, 0.4, 1.0, 0.2, 0.8, 0.3])
    T, R, _ = arm.causal("q", ["T", "R"])(q)
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_matrix(R)
    forms = {
        "matrix": R.tolist(), "quaternion w x y z": turn.as_quat(scalar_first=True).tolist(),
        "rotation vector": np.degrees(turn.as_rotvec()).tolist(), "RPY": turn.as_euler("xyz", degrees=True).tolist(),
        "KUKA A B C": turn.as_euler("ZYX", degrees=True).tolist(),
    }  # fmt: skip
    for form, numbers in forms.items():
        study = postures_study(arm, ToolPose(T.tolist(), numbers, form), near=q)
        np.testing.assert_allclose(study.chosen[0], q, atol=ROUND_OFF)
    assert study.names[study.branches[0, 0]] == "front, up, no flip"


def test_postures_beyond_limits_name_joint_and_limit() -> None:
    two = gt.robots.serial_arm(a=[0.4, 0.3], alpha=0.0, names=["base", "elbow"], limits=[[-3.0, 3.0], [0.0, 1.0]])
    study = postures_study(two, ToolPose([0.45, 0.2, 0.0]))
    bend = np.arccos((0.45**2 + 0.2**2 - 0.4**2 - 0.3**2) / (2 * 0.4 * 0.3))
    assert study.status is SolveStatus.INFEASIBLE and study.statuses == {"beyond_limits": 1}
    texts = sorted(p["limits_exceeded"] for p in study.each)
    assert texts == [
        f"elbow at {np.degrees(-bend):.4g} deg, beyond its lower limit 0 deg",
        f"elbow at {np.degrees(bend):.4g} deg, beyond its upper limit 57.3 deg",
    ]
    np.testing.assert_allclose(sorted(study.excess[0, :, 1]), [-bend, bend - 1.0], atol=ROUND_OFF)
    assert "elbow" in study.message and "limit" in study.message


def test_each_row_has_its_own_status(arm: gt.Model) -> None:
    q = np.array([0.3, 0.4, 1.0, 0.2, 0.8, 0.3])
    still = q * [1, 1, 1, 1, 0, 1]
    f = arm.causal("q", ["T", "R"])
    (T, T0), (R, R0) = (np.array(x) for x in f(np.array([q, still]))[:2])
    poses = ToolPoses([T, T0, [2.0, 0.0, 0.3], [np.nan, 0.0, 0.0]], [R, R0, R, R])
    study = postures_study(arm, poses)
    assert study.statuses == {"ok": 2, "out_of_range": 1, "not_finite": 1}  # elbow down is regular
    assert study.status is SolveStatus.CHECK_FAILED and "row 3 is out of reach by" in study.message
    assert any("row 2: next to a singular position" in n for n in study.notes)
    assert np.isnan(study.chosen[2:]).all() and np.isfinite(study.chosen[:2]).all()


def test_seven_joints_take_an_elbow_or_a_locked_joint() -> None:
    arm = gt.robots.serial_arm(a=np.zeros(7), alpha=np.array([1, -1, 1, -1, 1, -1, 0]) * np.pi / 2,
                               d=[0.3, 0.0, 0.4, 0.0, 0.4, 0.0, 0.1], limits=np.tile([-2.8, 2.8], (7, 1)))  # fmt: skip
    chain, q = gt.kinematics.chain_of(arm), np.array([0.2, 0.5, 0.4, 1.0, 0.3, 0.6, 0.1])
    T, R = chain.pose(q)
    angle = float(gt.kinematics.elbow_angle(chain, q)[0])
    for way in (gt.kinematics.ElbowAngle(angle), gt.kinematics.LockedJoint(2, 0.4)):
        study = postures_study(arm, ToolPoses(T, R), near=q, redundancy=way)
        np.testing.assert_allclose(study.chosen[0], q, atol=1e-8)


def test_a_table_names_line_and_column(tmp_path: Path) -> None:
    file = tmp_path / "poses.csv"
    file.write_text("x,y,z,A,B,C\n400,150,100,30,0,180\n400,150,10x,30,0,180\n")
    columns = ToolColumns(["x", "y", "z"], "mm", ["A", "B", "C"], "KUKA A B C")
    with pytest.raises(ArgumentError, match=r"poses\.csv line 3"):
        read_tool_poses(file, columns)
    file.write_text(file.read_text().replace("10x", "100"))
    poses = read_tool_poses(file, columns)
    assert poses.called(1) == "row 2 (line 3)"
    turn = rotation_about(Z, np.radians(30)) @ rotation_about(X, np.pi)
    np.testing.assert_allclose(poses.R, [turn, turn], atol=ROUND_OFF)
    for wrong, argument in (({"position": "q"}, "position"), ({"position_unit": "kg"}, "position_unit"),
                            ({"representation": "euler"}, "representation")):  # fmt: skip
        with pytest.raises(ArgumentError) as error:
            read_tool_poses(file, ToolColumns(**{"position": ["x", "y", "z"], "orientation": ["A", "B", "C"], **wrong}))
        assert error.value.argument == argument


def test_wrong_arguments_are_named(arm: gt.Model) -> None:
    pose = ToolPose([0.4, 0.1, 0.3], DOWN.tolist())
    with pytest.raises(ArgumentError, match="expected 6") as error:
        postures_study(arm, pose, near=[0.0, 0.0])
    assert error.value.argument == "near"
    with pytest.raises(ArgumentError, match="serial arm"):
        postures_study(gt.robots.gantry_tau("l1_tape"), pose)
    with pytest.raises(ArgumentError, match="rotation"):
        postures_study(arm, ToolPose([0.4, 0.1, 0.3], (2 * DOWN).tolist()).poses)


def test_a_stopped_study_says_so(arm: gt.Model) -> None:
    poses = ToolPoses(np.tile([0.4, 0.1, 0.3], (1200, 1)), np.tile(DOWN, (1200, 1, 1)))
    calls = iter([False, False, True, True, True, True])
    study = postures_study(arm, poses, stop=lambda: next(calls, True))
    assert study.status is SolveStatus.INTERRUPTED and np.isnan(study.chosen).all()
