"""A synthetic robot for the technician's loop: python robot.py RUN.csv SEED [INPUT.csv] writes the log of a run."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

TS, N = 0.004, 825


def reference() -> np.ndarray:
    """10 mm forth and back, twice, smooth (N,)."""
    t = np.arange(N) * TS - 0.4
    made = np.zeros(N)
    for k, by in enumerate((0.01, -0.01, 0.01, -0.01)):
        s = np.clip((t - 0.5 * k) / 0.25, 0.0, 1.0)
        made += by * s**3 * (10 - 15 * s + 6 * s**2)
    return made


def main(log: Path, seed: int, learned: Path | None) -> None:
    """Motors lag by 20 ms behind five samples; 1 um of noise."""
    u = np.zeros(N)
    if learned is not None:
        u = np.loadtxt(learned, delimiter=",", skiprows=2)[:, 1]
    r = reference()
    a = np.exp(-TS / 0.02)
    motor, wanted = np.zeros(N), r + u
    for k in range(6, N):  # without SciPy, which takes longer to import than this to run
        motor[k] = a * motor[k - 1] + (1 - a) * wanted[k - 6]
    motor = motor + 1e-6 * np.random.default_rng(seed).normal(size=N)
    rows = np.column_stack([TS * np.arange(N), 1e3 * r, 1e3 * u, 1e3 * motor])
    head = (
        f"# synthetic: a lag behind a delay, seed {seed}, 1 um of noise\ntime [s],wanted [mm],input [mm],motor [mm]\n"
    )
    log.write_text(head + "\n".join(",".join(f"{x:.12g}" for x in row) for row in rows) + "\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), Path(sys.argv[3]) if len(sys.argv) > 3 else None)
