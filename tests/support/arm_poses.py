"""Synthetic measurements of problems/data/arm_synthetic.csv and ur_like_poses_synthetic.csv: six-axis arms with known
errors, seen by a tracker.

Run as a module it writes the files.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import scipy

import gtmodel as gt
from gtmodel.problem_files import Context
from gtmodel.problem_files.robots import resolve

PROBLEMS = Path(__file__).resolve().parents[2] / "problems"
SEED, POSES, NOISE = 2026, 90, 30e-6  # m, of each coordinate
LENGTHS, ANGLES = 5e-4, 1e-3  # standard deviations of the errors, m and rad
# of the tracker in the robot's frame, and of the reflector from where the file of the arm has it
DEVICE_T, DEVICE_RPY, REFLECTOR = (
    np.array([2.6, -1.4, 0.3]),
    np.array([0.02, -0.01, 2.4]),
    np.array([4e-3, -3e-3, 2e-3]),
)


def nominal() -> gt.robots.SerialArm:
    """The arm as its file has it."""
    arm = resolve("models/six_axis_arm.toml", Context(folder=PROBLEMS))
    assert isinstance(arm, gt.robots.SerialArm)
    return arm


ROTATION = scipy.spatial.transform.Rotation
UR_SEED = 44
UR_TOOL = [0.08, 0.02, 0.14]  # m, of the reflector in the frame of the last link
RANGES = [[-100, 100], [-50, 60], [-60, 45], [-150, 150], [-100, 100], [-170, 170]]  # degrees
UR_RANGES = [[-100, 100], [10, 100], [-120, -20], [-150, 30], [-150, -30], [-170, 170]]


def ur_like() -> gt.robots.SerialArm:
    """The arm of problems/models/ur_like.urdf by its Denavit-Hartenberg numbers, with a reflector beside the flange."""
    arm = gt.robots.from_urdf(PROBLEMS / "models" / "ur_like.urdf", tool_xyz=UR_TOOL)
    return gt.robots.as_dh(arm)


def free(arm: gt.robots.SerialArm | None = None) -> list[str]:
    """What a calibration by positions alone determines."""
    return gt.robots.independent_geometry(arm or nominal())[0]


def true_arm(arm: gt.robots.SerialArm | None = None, seed: int = SEED) -> gt.robots.SerialArm:
    """The arm that is measured: each independent number off by a normal error."""
    arm, rng = arm or nominal(), np.random.default_rng([seed, 1])
    values = {name: np.array(getattr(arm, name), float) for name in ("theta", "d", "a", "alpha", "beta", "tool_xyz")}
    for entry in free(arm):
        name, index = entry[:-1].split("[")
        size = LENGTHS if name in ("d", "a") else ANGLES
        values[name][int(index)] += REFLECTOR[int(index)] if name == "tool_xyz" else size * rng.standard_normal()
    return arm.with_(**values)


def poses(
    arm: gt.robots.SerialArm | None = None, seed: int = SEED, ranges: list[list[int]] = RANGES
) -> tuple[np.ndarray, np.ndarray]:
    """Angles (n, 6) [rad] and measured positions (n, 3) [m] in the tracker's frame."""
    rng = np.random.default_rng([seed, 2])
    low, high = np.radians(ranges).T
    q = np.round(rng.uniform(low, high, (POSES, 6)), 6)
    T, _ = forward(true_arm(arm, seed), q)
    R = ROTATION.from_euler("xyz", DEVICE_RPY)
    return q, R.inv().apply(T - DEVICE_T) + NOISE * rng.standard_normal(T.shape)


def forward(arm: gt.robots.SerialArm, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions (n, 3) [m] and orientations (n, 3, 3) of the tool at joints (n, m) [rad, m], by standard
    Denavit-Hartenberg numbers: without the compiler, which needs a second for every other arm."""
    assert arm.structure.style == "standard"
    R = ROTATION.from_euler("xyz", np.tile(np.asarray(arm.base_rpy, float), (len(q), 1)))
    T = np.tile(np.asarray(arm.base_xyz, float), (len(q), 1))
    numbers = np.array([np.asarray(getattr(arm, name), float) for name in ("theta", "d", "a", "alpha", "beta")]).T
    for joint, (theta, d, a, alpha, beta), x in zip(arm.structure.joints, numbers, q.T, strict=True):
        slides = joint.kind == "prismatic"
        turn, along = (np.full(len(q), theta), d + x) if slides else (theta + x, np.full(len(q), d))
        T = T + R.apply(np.column_stack([a * np.cos(turn), a * np.sin(turn), along]))
        R = R * ROTATION.from_euler("ZXY", np.column_stack([turn, np.tile([alpha, beta], (len(q), 1))]))
    tool = ROTATION.from_euler("xyz", np.array(arm.tool_rpy, float))
    return T + R.apply(np.array(arm.tool_xyz, float)), (R * tool).as_matrix()


def text(arm: gt.robots.SerialArm | None = None, seed: int = SEED, ranges: list[list[int]] = RANGES) -> str:
    """The file: a comment, a header, angles in degrees and positions in mm."""
    q, T = poses(arm, seed, ranges)
    lines = [
        f"# synthetic: seed {seed}, noise {1e6 * NOISE:g} um of each coordinate; tests/support/arm_poses.py writes it",
        ",".join([*(f"q[{k}]" for k in range(6)), *(f"T[{k}]" for k in range(3))]),
    ]
    lines += [
        ",".join([*(f"{x:.7f}" for x in a), *(f"{x:.4f}" for x in b)])
        for a, b in zip(np.degrees(q), 1e3 * T, strict=True)
    ]
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    (PROBLEMS / "data" / "arm_synthetic.csv").write_text(text())
    (PROBLEMS / "data" / "ur_like_poses_synthetic.csv").write_text(text(ur_like(), UR_SEED, UR_RANGES))
