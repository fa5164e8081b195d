"""Limits of the benefit of fusing tracker and inertial unit: docs/kinds/sensor_fusion.md against Table 10.

python tests/bench/fusion_limits.py [3] [5]; some minutes for both. All readings are synthetic, seed 1.
"""

from __future__ import annotations

import sys

import numpy as np

import gtmodel as gt

F = gt.filtering
DEG = np.pi / 180
VALUES = {
    "acceleration_noise": (0.00039, 0.0039, 0.039, 0.39),
    "acceleration_bias": (0.00025, 0.0025, 0.025, 0.25, 2.5),
    "rate_noise": tuple(DEG * np.array([0.0016, 0.016, 0.16, 1.6])),
    "rate_bias": tuple(DEG * np.array([0.0008, 0.08, 0.8, 8.0, 80.0])),
    "misalignment": tuple(DEG * np.array([0.0, 0.1, 1.0, 10.0])),
    "arm_error": (0.0, 2.54e-4, 2.54e-3, 2.54e-2, 0.254),
    "sample_time": (0.001, 0.002, 0.005, 0.01),
}
TURNING = ("rate_noise", "rate_bias", "arm_error")
TWO = F.FusionFilter(jerk_density=(0.1, 0.1, 0.1), fast_jerk_density=10.0, fast_angular_jerk_density=1e7)
DESIGNS = {3: {"consistent": F.FusionFilter(), "printed": F.FusionFilter(printed=True)}, 5: {"two filters": TWO}}


def main(axes: int) -> None:
    """Print one row for each parameter, SI units."""
    path = F.TrackedPath(axes=axes, duration=5.0 if axes == 3 else 2.5)
    for name, design in DESIGNS[axes].items():
        for parameter, values in VALUES.items():
            if axes == 3 and parameter in TURNING:
                continue
            sweep = F.FusionSweep(parameter, tuple(map(float, values)))
            study = F.fusion_study(path, filter=design, sweep=sweep, seed=1)
            ours = f"tracker's filter {study.limit_tracker}, slope {study.limit_slope}"
            print(f"{axes} axes, {name}: {parameter}: {ours}; printed {study.limit_printed}", flush=True)


if __name__ == "__main__":
    for number in sys.argv[1:] or ("3", "5"):
        main(int(number))
