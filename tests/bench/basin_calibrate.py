"""From how far away calibrations converge: 100 random starts for each size, as docs/calibration.md prints them.

python -m tests.bench.basin_calibrate
"""

from __future__ import annotations

from gtmodel.calibrate import calibrate
from gtmodel.calibrate.basin import basin
from gtmodel.kinds import calibration
from gtmodel.kinds.calibration_choice import prepared
from gtmodel.kinds.calibration_data import data_of
from gtmodel.problem_files import Context
from gtmodel.problem_files.load import validate
from tests.kinds.calibration_problems import PROBLEMS, keys

STARTS, SEED = 100, 1
SIZES: dict[str, float] = dict.fromkeys(("A", "B", "L", "r3", "v", "u"), 0.01)  # m, rad or 1
TIMES = (1, 3, 10, 30, 100)


def main() -> None:
    print("problem  start error  rms length error  reached")
    for name in ("l1", "f1"):
        problem, context = validate(calibration.Schema, keys(f"calibrate_{name}")), Context(folder=PROBLEMS)
        model = problem.model(context)
        data = data_of(problem, model, context)
        ready = prepared(problem, model, data.fitted, data.keys.actuators)
        x = calibrate(ready).x
        for times in TIMES[: 5 if name == "l1" else 4]:
            reached, rms = basin(ready, x, SIZES, times, STARTS, SEED)
            print(f"{name:7} {10 * times:6} mm {1e3 * rms:14.0f} mm {reached:8} of {STARTS}")


if __name__ == "__main__":
    main()
