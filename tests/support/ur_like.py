"""Synthetic logs problems/data/ur_like_*_synthetic.csv: joint positions and motor currents of a UR-like arm.

pinocchio computes the torques of an arm whose bodies, friction and drives differ from problems/models/ur_like.urdf.
Run as a module it writes the files.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gtmodel.identify import multisine

PROBLEMS = Path(__file__).resolve().parents[2] / "problems"
URDF = PROBLEMS / "models" / "ur_like.urdf"
SEED, NOISE = 43, 0.04  # A, white, of each current
SAMPLE_TIME, DURATION = 0.008, 12.0  # s
FREQUENCIES = np.array([0.17, 0.34, 0.59, 0.93])  # Hz
CENTRE = np.array([0.0, -1.2, 1.2, -0.6, 1.0, 0.0])
HALF_RANGE = np.array([1.2, 0.6, 0.8, 1.0, 1.0, 1.4])
GEAR, CONSTANT = 101.0, np.array([0.12, 0.12, 0.11, 0.1, 0.1, 0.1])  # N.m/A, of the data sheet
GAIN = np.array([0.94, 1.05, 1.08, 0.92, 1.04, 0.97])  # true constant over that of the data sheet
ROTOR = np.array([1.1, 1.1, 0.6, 0.12, 0.12, 0.11])  # kg.m2, at the joint
VISCOUS = np.array([9.0, 10.0, 6.5, 2.1, 2.3, 2.0])
COULOMB = np.array([8.0, 9.0, 5.5, 1.9, 2.0, 1.7])
OFFSET = np.array(
    [0.8, -0.6, 0.4, 0.15, -0.1, 0.1]
)  # N.m at the joint by the data sheet: of current sensor and friction
LOAD, LOAD_AT = 4.0, np.array([0.1, 0.0, 0.13])  # kg, and its centre in the frame of wrist_3
RECORDINGS = {"empty": 0.0, "loaded": LOAD, "held_out": 0.0}


def plant(load: float = 0.0):
    """The true arm in pinocchio; its links are up to 15 % lighter or heavier than in the URDF."""
    import pinocchio as pin

    model = pin.buildModelFromUrdf(str(URDF))
    model.armature = ROTOR
    for k, factor in enumerate(np.random.default_rng([SEED, 1]).uniform(0.85, 1.15, 6)):
        body = model.inertias[k + 1]
        centre = body.lever + np.array([0.01, -0.005, 0.008])
        model.inertias[k + 1] = pin.Inertia(factor * body.mass, centre, factor * body.inertia)
    if load:
        model.inertias[6] = model.inertias[6] + pin.Inertia(load, LOAD_AT, np.zeros((3, 3)))
    return model


def motion(name: str) -> tuple[np.ndarray, ...]:
    """Time (n,) [s], angles, speeds and accelerations (n, 6) of a recording."""
    from gtmodel.measurements import smooth_motion

    time = SAMPLE_TIME * np.arange(round(DURATION / SAMPLE_TIME))
    seed = [SEED, 2 + list(RECORDINGS).index(name)]
    q = multisine(time, CENTRE, HALF_RANGE, FREQUENCIES, seed=seed)
    return (time, *smooth_motion(time, q))


def torques(name: str) -> np.ndarray:
    """Torques of the drives at the joints (n, 6) [N.m]."""
    import pinocchio as pin

    model = plant(RECORDINGS[name])
    data = model.createData()
    _, q, v, a = motion(name)
    rigid = np.array([pin.rnea(model, data, *rows) for rows in zip(q, v, a, strict=True)])
    return rigid + VISCOUS * v + COULOMB * np.sign(v)


def text(name: str) -> str:
    """A file: a comment, a header, time in s, angles in rad and currents in A."""
    time, q, *_ = motion(name)
    rng = np.random.default_rng([SEED, 5 + list(RECORDINGS).index(name)])
    current = (torques(name) / GAIN + OFFSET) / (GEAR * CONSTANT)
    current += NOISE * rng.standard_normal(current.shape)
    load = RECORDINGS[name]
    lines = [
        f"# synthetic: seed {SEED}, noise {NOISE:g} A of each current, payload {load:g} kg; tests/support/ur_like.py "
        "writes it",
        ",".join(["timestamp", *(f"actual_q_{k}" for k in range(6)), *(f"actual_current_{k}" for k in range(6))]),
    ]
    for t, angles, amperes in zip(time, q, current, strict=True):
        lines.append(",".join([f"{t:.3f}", *(f"{x:.5f}" for x in angles), *(f"{x:.3f}" for x in amperes)]))
    return "\n".join([*lines, ""])


def file(name: str) -> Path:
    """Where a recording is."""
    return PROBLEMS / "data" / f"ur_like_{name}_synthetic.csv"


if __name__ == "__main__":
    for recording in RECORDINGS:
        file(recording).write_text(text(recording))
