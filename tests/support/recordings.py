"""Recordings that may not be shipped: where the tests look for them."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import scipy

CLONE = Path(__file__).resolve().parents[2]


def recording(name: str) -> Path:
    """The first that is there: where its problem expects it, in $GTMODEL_RECORDINGS, in ../shared/realdata beside the
    clone; the first of these places where it is nowhere."""
    own = os.environ.get("GTMODEL_RECORDINGS", "").strip()
    folders = [CLONE / "problems" / "data", *([Path(own)] if own else []), CLONE.parent / "shared" / "realdata"]
    places = [folder / name for folder in folders]
    return next((p for p in places if p.is_file()), places[0])


EMPS = recording("emps/DATA_EMPS.mat")
EMPS_PULSES = recording("emps/DATA_EMPS_PULSES.mat")
NO_EMPS = "the EMPS recording is not there; problems/emps.toml says where to get it"


def write_synthetic_emps(file: Path, frequencies: tuple[float, float] = (0.5, 1.25), seed: int = 1) -> None:
    """A synthetic log like DATA_EMPS.mat, of the published parameters: 4 s at 1 kHz, noise of 2 N."""
    t = np.arange(4001) / 1000
    rates = 2 * np.pi * np.array(frequencies)
    q = 0.05 * np.sin(np.outer(t, rates)).sum(axis=1)
    v = 0.05 * (rates * np.cos(np.outer(t, rates))).sum(axis=1)
    a = -0.05 * (rates**2 * np.sin(np.outer(t, rates))).sum(axis=1)
    noise = 2.0 * np.random.default_rng(seed).standard_normal(len(t))
    force = 95.1089 * a + 203.5034 * v + 20.3935 * np.sign(v) - 3.1648 + noise
    scipy.io.savemat(file, {"t": t, "qm": q, "qg": q, "vir": force / 35.15065188248547})


ABB_IMU = recording("abb_imu/V1000_path3_MPU9150.mat")
NO_ABB_IMU = "the recording abb_imu is not there; problems/fusion_abb.toml says where to get it"
ABB_ROWS, ABB_LOST = 2139, 368  # rows of the file, on which the problem relies, and the one that was lost


def write_synthetic_abb(file: Path) -> None:
    """A synthetic log like V1000_path3_MPU9150.mat, seed 3: rows stamped on arrival, references in the robot's time,
    quaternions in every row of which only those of TokenPosition are true."""
    from gtmodel.filtering import SyntheticAttitude, synthetic_attitude

    made = synthetic_attitude(SyntheticAttitude(seed=3, lost=0)).recording
    gyro, reference = made.gyro, made.reference
    time = gyro.time[:ABB_ROWS].copy()
    rate, force = gyro["rate"][:ABB_ROWS].T.copy(), gyro["acceleration"][:ABB_ROWS].T.copy()
    row = np.searchsorted(time, reference.time)  # where the answer came, behind the last row at the end
    kept = np.concatenate([np.diff(row) > 0, [True]])
    row, at, quaternion = row[kept], reference.time[kept], reference["quaternion"][kept]
    every = np.array([np.interp(np.arange(len(time)), row, quaternion[:, k]) for k in range(4)])
    time[ABB_LOST], rate[:, ABB_LOST], force[:, ABB_LOST] = 0.0, np.nan, np.nan
    scipy.io.savemat(file, {
        "MATLABtime": time[None], "SENSgyro": rate, "SENSacc": force, "ABBquaternion": every, "ABBtime": at[None],
        "TokenPosition": (row + 1)[None].astype(np.uint16), "po": "q",
    })  # fmt: skip


# problems whose recording is not shipped: where it is, and what writes a synthetic one like it
NOT_SHIPPED = {
    "emps": (EMPS, write_synthetic_emps), "emps_pulses": (EMPS, write_synthetic_emps),
    "fusion_abb": (ABB_IMU, write_synthetic_abb),
}  # fmt: skip


def elsewhere(problem: str, folder: Path) -> tuple[str, ...]:
    """Settings for a problem whose recording is not shipped: from where it is, else a synthetic one in the folder."""
    if problem not in NOT_SHIPPED:
        return ()
    file, write = NOT_SHIPPED[problem]
    if not file.is_file():
        file = folder / "synthetic.mat"
        write(file)
    settings = (f"log.files=['{file}']",)
    if problem != "emps_pulses":
        return settings
    other = EMPS_PULSES
    if not (other.is_file() and EMPS.is_file()):
        other = folder / "synthetic_held_out.mat"
        write_synthetic_emps(other, (0.4, 1.05), seed=2)
    return (*settings, f"log.held_out=['{other}']")
