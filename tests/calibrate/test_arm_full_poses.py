"""A serial arm by full poses of a tracker, by TOML: orientation as a quaternion or as angles, joints of both kinds."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import gtmodel as gt
from gtmodel.problem_files import Context
from gtmodel.problem_files.load import load
from gtmodel.problem_files.robots import resolve
from gtmodel.problem_files.run import answer
from tests.support import arm_poses

SEED, POSES, NOISE, TURN_NOISE = 5, 60, 3e-5, 1e-4  # m and rad, of each coordinate and axis
PROBLEM = f"""kind = "calibration"
robot = "{arm_poses.PROBLEMS}/models/six_axis_arm.toml"
variant = "serial"
sensitivity_step = 0
[measurements]
file = "poses.csv"
frame = "device"
orientation = "e"
[measurements.signals]
q = {{ column = "q", unit = "deg" }}
T = {{ column = "T", unit = "mm", deviation = {1e3 * NOISE} }}
e = {{ column = ["e[0]", "e[1]", "e[2]", "e[3]"], unit = "1", noise = {TURN_NOISE} }}
[held_out]
every = 3
"""


def measured(arm: gt.robots.SerialArm, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions (n, 3) and quaternions (n, 4) in the frame of a tracker, synthetic with noise."""
    rng = np.random.default_rng([SEED, 1])
    T, R = arm_poses.forward(arm, q)
    frame = Rotation.from_euler("xyz", arm_poses.DEVICE_RPY)
    T = frame.inv().apply(T - arm_poses.DEVICE_T) + NOISE * rng.standard_normal(T.shape)
    turn = Rotation.from_rotvec(TURN_NOISE * rng.standard_normal(T.shape)) * frame.inv() * Rotation.from_matrix(R)
    return T, turn.as_quat(scalar_first=True)


def write(path: Path, q: np.ndarray, T: np.ndarray, e: np.ndarray) -> None:
    angles = Rotation.from_quat(e, scalar_first=True).as_euler("ZYX", degrees=True)
    names = [*(f"q[{k}]" for k in range(q.shape[1])), *(f"T[{k}]" for k in range(3)), *(f"e[{k}]" for k in range(4))]
    rows = np.column_stack([q, 1e3 * T, e, angles])
    header = f"# synthetic: seed {SEED}\n" + ",".join([*names, "A", "B", "C"])
    path.write_text("\n".join([header, *(",".join(f"{x:.9g}" for x in row) for row in rows)]) + "\n")


def solved(folder: Path, problem: str, *settings: str) -> Any:
    (folder / "p.toml").write_text(problem)
    return answer(load(folder / "p.toml", list(settings)), Context(folder=folder))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("arm")
    low, high = np.radians([[-100, 100], [-50, 60], [-60, 45], [-150, 150], [-100, 100], [-170, 170]]).T
    q = np.random.default_rng(SEED).uniform(low, high, (POSES, 6))
    write(path / "poses.csv", np.degrees(q), *measured(arm_poses.true_arm(), q))
    return path


@pytest.fixture(scope="module")
def study(folder: Path) -> Any:
    return solved(folder, PROBLEM)


def check_true(study: Any, true: gt.robots.SerialArm) -> None:
    deviations = []
    for name in study.estimate.names:
        array, _, index = name[:-1].partition("[")
        if hasattr(true, array):
            off = study.estimate.value(name) - np.asarray(getattr(true, array), float).ravel()[int(index)]
            deviations.append(off / study.estimate.std[study.estimate.names.index(name)])
    assert np.max(np.abs(deviations)) < 4.0 and 0.5 < np.sqrt(np.mean(np.square(deviations))) < 1.6


def test_a_full_pose_determines_four_numbers_a_joint_and_the_tool(study: Any) -> None:
    """4 R + 6: as many as there are for R revolute joints between two unknown frames."""
    assert study.status.ok and len(study.estimate.names) == 4 * 6 + 6 and not study.estimate.undetermined
    assert study.numerics_sound and study.prediction_proven
    check_true(study, arm_poses.true_arm())
    assert study.orientation["mean"] < 4 * TURN_NOISE
    # of a length's error a metre off, not of a model's name
    assert any(name.startswith("orientation_at_1_m") for name in study.link_errors)


def test_orientations_say_more_than_positions_alone(study: Any, folder: Path) -> None:
    lines = [line for line in PROBLEM.splitlines() if not line.startswith(("e =", "orientation"))]
    alone = solved(folder, "\n".join(lines))
    assert len(alone.estimate.names) == 27
    for name in ("alpha[3]", "d[2]", "theta[1]"):
        std, without = (s.estimate.std[s.estimate.names.index(name)] for s in (study, alone))
        assert std < without


def test_angles_of_a_kuka_are_the_same_poses(study: Any, folder: Path) -> None:
    column = 'e = { column = ["A", "B", "C"], unit = "deg", representation = "KUKA A B C", '
    quaternion = f'e = {{ column = ["e[0]", "e[1]", "e[2]", "e[3]"], unit = "1", noise = {TURN_NOISE}'
    by_angles = PROBLEM.replace(quaternion, f"{column}deviation = {np.rad2deg(TURN_NOISE)}")
    other = solved(folder, by_angles)
    assert other.estimate.values == pytest.approx(study.estimate.values, abs=1e-8)


SCARA = """family = "serial"
title = "SCARA"
source = "an example of ours"
note = "two parallel axes, a slide, a wrist that hangs"
convention = "standard"
joints = "rrpr"
a_m = [0.3, 0.25, 0.0, 0.0]
alpha_deg = [0.0, 180.0, 0.0, 0.0]
d_m = [0.4, 0.0, 0.0, 0.05]
theta_deg = [0.0, 0.0, 0.0, 0.0]
beta_deg = [0.0, 0.0, 0.0, 0.0]
tool_m = [0.05, 0.0, 0.02]
"""


def test_joints_of_both_kinds_have_units_of_their_own(tmp_path: Path) -> None:
    """A SCARA in degrees and millimetres; 4 R + 2 P + 6 numbers are determined."""
    (tmp_path / "scara.toml").write_text(SCARA)
    arm = resolve("scara.toml", Context(folder=tmp_path))
    assert isinstance(arm, gt.robots.SerialArm)
    a, alpha, theta = (np.array(getattr(arm, name), float) for name in ("a", "alpha", "theta"))
    changed = ((a, (0, 1), (4e-4, -3e-4)), (alpha, (0, 2), (1e-3, -5e-4)), (theta, (1,), (8e-4,)))
    for numbers, places, off in changed:
        numbers[list(places)] += off
    true = arm.with_(a=a, alpha=alpha, theta=theta)
    q = np.random.default_rng(7).uniform([-2, -2, 0.02, -3], [2, 2, 0.2, 3], (50, 4))
    columns = np.column_stack([np.degrees(q[:, :2]), 1e3 * q[:, 2], np.degrees(q[:, 3])])
    write(tmp_path / "poses.csv", columns, *measured(true, q))
    problem = PROBLEM.replace(f"{arm_poses.PROBLEMS}/models/six_axis_arm.toml", "scara.toml")
    mixed = problem.replace('column = "q", unit = "deg"', 'column = "q", unit = ["deg", "deg", "mm", "deg"]')
    study = solved(tmp_path, mixed)
    assert study.status.ok and study.prediction_proven and len(study.estimate.names) == 4 * 3 + 2 + 6
    check_true(study, true)


def test_a_model_without_a_rotation_is_refused() -> None:
    with pytest.raises(gt.ModelError, match="declares no rotation 'R'"):
        gt.calibrate.seen_with_quaternion(gt.robots.gantry_tau("l1_tape"))
