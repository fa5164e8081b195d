"""Convergence of calibrations from distant starts: 100 random starts per size, for docs/kinds/calibration.md.

python -m tests.bench.basin_calibrate
"""

from __future__ import annotations

import gtmodel as gt
from gtmodel.calibrate import Fit, MeasuredPoses, calibrate
from gtmodel.calibrate.measured.poses import split
from gtmodel.calibrate.variants import prepared
from tests.support.basin import basin
from tests.support.commands import CLONE

STARTS, SEED = 100, 1
SIZES: dict[str, float] = dict.fromkeys(("A", "B", "L", "r3", "v", "u"), 0.01)  # m, rad or 1
TIMES = (1, 3, 10, 30, 100)


def main() -> None:
    print("problem  start error  rms length error  reached")
    for name in ("l1", "f1"):
        call = gt.load(CLONE / "problems" / f"calibrate_{name}.toml")
        model, poses, fit = call.arguments
        assert isinstance(poses, MeasuredPoses) and isinstance(fit, Fit)
        ready = prepared(fit, model, split(poses, model, call.options["held_out"]))
        x = calibrate(ready).x
        for times in TIMES[: 5 if name == "l1" else 4]:
            reached, rms = basin(ready, x, SIZES, times, STARTS, SEED)
            print(f"{name:7} {10 * times:6} mm {1e3 * rms:14.0f} mm {reached:8} of {STARTS}")


if __name__ == "__main__":
    main()
