"""The hexapod of problems/models: its recordings and synthetic poses."""

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from gtmodel.calibrate import Measurements
from gtmodel.problem_files.base import Context
from gtmodel.problem_files.python_models import resolve

PROBLEMS = Path(__file__).parents[2] / "problems"
DATA = PROBLEMS / "data" / "hexapod"
FIRST, SECOND = "108_calibration_poses.csv", "rosbag_108_offset_origins.csv"
# revolutions, m, rad: assumed; with it 48 parameters leave residuals of 1.09 times their noise
NOISE = {"n": 2e-3, "T": 3e-4, "e": 1e-3}
EVEN, ODD = np.arange(0, 108, 2), np.arange(1, 108, 2)


@cache
def hexapod() -> Any:
    return resolve("models/hexapod.py:Hexapod", Context(folder=PROBLEMS), "robot")


@cache
def recording(name: str) -> dict[str, np.ndarray]:
    """Motor revolutions, position [m] and quaternion, scalar first, by motion capture."""
    table = np.genfromtxt(DATA / name, delimiter=",", skip_header=1)
    return {"n": table[:, :6], "T": 1e-3 * table[:, 6:9], "e": table[:, [12, 9, 10, 11]]}


def measured(name: str, **more: Any) -> Measurements:
    return Measurements(recording(name), NOISE, **more)


def legs(data: dict[str, np.ndarray], A: np.ndarray, B: np.ndarray, L0: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Errors (N, 6) [m] of the legs' lengths, written out by hand."""
    R = Rotation.from_quat(data["e"], scalar_first=True).as_matrix()
    joints = data["T"][:, None] + np.einsum("kij,mj->kmi", R, B)
    return np.linalg.norm(joints - A, axis=2) - L0 - data["n"] * c


def synthetic(robot: Any, poses: int, seed: int) -> dict[str, np.ndarray]:
    """Synthetic, without noise: platform poses within 0.2 m and 0.2 rad, revolutions by the leg equation."""
    rng = np.random.default_rng(seed)
    T = rng.uniform([-0.2, -0.2, 0.55], [0.2, 0.2, 0.95], (poses, 3))
    e = Rotation.from_rotvec(rng.uniform(-0.2, 0.2, (poses, 3))).as_quat(scalar_first=True)
    A, B, L0, c = (np.array(getattr(robot, n)) for n in ("A", "B", "L0", "c"))
    return {"n": legs({"T": T, "e": e, "n": np.zeros((poses, 6))}, A, B, L0, c) / c, "T": T, "e": e}


def rms_mm(residuals: np.ndarray) -> float:
    return float(1e3 * np.sqrt(np.mean(residuals**2)))
