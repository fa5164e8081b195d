"""Time for all assembly modes and statistics of the paths: Dietmaier's platform, the F1, random and special ones.

Prints Markdown. Times are processor time per pose; besides them stand counts that are the same at every run.
"""

from __future__ import annotations

import time
from collections import Counter

import numpy as np

from gtmodel.kinematics.assembly_modes import assembly_modes_batch
from tests.kinematics.support.f1 import random_f1_poses
from tests.kinematics.support.platforms import (
    DIETMAIER_A,
    DIETMAIER_B,
    DIETMAIER_L,
    exact_tau_platforms,
    planar_platforms,
    random_platforms,
    six_three_platforms,
)

SEED = 20121
Legs = tuple[np.ndarray, np.ndarray, np.ndarray]


def cases() -> dict[str, Legs]:
    """Name -> A, B, L of n poses."""
    f1 = random_f1_poses(50, SEED)
    return {
        "Dietmaier's, alone": (DIETMAIER_A, DIETMAIER_B, DIETMAIER_L),
        "F1, alone": (f1.A[0], f1.B, f1.L),
        "F1, batch": (f1.A, f1.B, f1.L),
        "random, batch": random_platforms(100, SEED).legs,
        "exact Tau, batch": exact_tau_platforms(20, SEED).legs,
        "planar, batch": planar_platforms(20, SEED).legs,
        "6-3, batch": six_three_platforms(20, SEED).legs,
    }


def main() -> None:
    assembly_modes_batch(DIETMAIER_A, DIETMAIER_B, DIETMAIER_L)  # reads the start systems
    print("| platforms | poses | complete | finite | real | steps mean / max | retries | condition | ms per pose |")
    print("|---|---:|---:|---|---|---:|---:|---:|---:|")
    for name, legs in cases().items():
        start = time.process_time()
        results = assembly_modes_batch(*legs)
        seconds = time.process_time() - start
        c = [modes.certificate for modes in results]
        steps = f"{np.mean([x.steps_mean for x in c]):.0f} / {max(x.steps_most for x in c)}"
        print(
            f"| {name} | {len(c)} | {sum(modes.ok for modes in results)} | {_counts(x.finite for x in c)} | "
            f"{_counts(x.real for x in c)} | {steps} | {sum(x.retries for x in c)} | "
            f"{max(x.worst_condition for x in c):.0e} | {1000 * seconds / len(c):.0f} |",
            flush=True,
        )


def _counts(values) -> str:
    """The different values, with how often each came where there are several."""
    counted = sorted(Counter(values).items())
    return str(counted[0][0]) if len(counted) == 1 else ", ".join(f"{v} ({n}x)" for v, n in counted)


if __name__ == "__main__":
    main()
