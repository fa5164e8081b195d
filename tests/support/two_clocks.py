"""The synthetic recording of problems/resample_synthetic.toml: a robot and a tracker, each with its own clock."""

from __future__ import annotations

from pathlib import Path

import numpy as np

SEED = 2026
OFFSET, DRIFT = -103.2, 5e-5  # s, what the tracker's times want added in the middle; 1, how much slower it runs
ROBOT, TRACKER = "robot_synthetic.csv", "tracker_synthetic.csv"
NOISE = 0.02  # deg, of both angles; 0.5 N of the force
SECONDS = 12.0


def angle(t: np.ndarray) -> np.ndarray:
    """The motion that both show [deg] at times of the robot's clock [s]."""
    rates, phases, sizes = (0.31, 0.83, 1.71), (0.4, 2.0, 5.1), (35.0, 17.0, 8.0)
    return sum(a * np.sin(2 * np.pi * f * t + p) for f, p, a in zip(rates, phases, sizes, strict=True))


def force(t: np.ndarray) -> np.ndarray:
    """What the tracker's force sensor reads without noise [N]."""
    return 40.0 + 12.0 * np.cos(2 * np.pi * 0.5 * t)


def write(folder: Path) -> None:
    """Both files: even rows of the robot each 10 ms, uneven ones of the tracker each 8 ms with jitter and gaps."""
    rng = np.random.default_rng(SEED)
    t = 0.01 * np.arange(round(SECONDS / 0.01))
    note = f"seed {SEED}, noise {NOISE:g} deg"
    rows = [f"{1e3 * a:.0f},{b:.4f}" for a, b in zip(t, angle(t) + NOISE * rng.normal(size=len(t)), strict=True)]
    _write(folder / ROBOT, note, "t [ms],q1 [deg]", rows)
    n = round(SECONDS / 0.008)
    seen = 0.008 * (np.arange(n) + 0.3 * rng.uniform(-1, 1, n))
    keep = np.ones(n, bool)
    for begin in (300, 900, 1200):
        keep[begin : begin + 10] = False
    seen = np.round(seen[keep] + 0.013 - OFFSET, 6)  # as the tracker writes it, from about 103 s on
    true = seen + OFFSET + DRIFT * (seen - 0.5 * (seen[0] + seen[-1]))
    angles = angle(true) + NOISE * rng.normal(size=len(true))
    forces = force(true) + 0.5 * rng.normal(size=len(true))
    rows = [f"{s:.6f},{a:.4f},{f:.3f}" for s, a, f in zip(seen, angles, forces, strict=True)]
    clock = f"late by {-OFFSET:g} s, drift {1e6 * DRIFT:g} ppm, jitter 30 %, three gaps"
    _write(folder / TRACKER, f"{note}, 0.5 N, {clock}", "stamp [s],angle [deg],force [N]", rows)


def _write(path: Path, note: str, header: str, rows: list[str]) -> None:
    path.write_text("\n".join([f"# synthetic: {note}", header, *rows]) + "\n")
