"""A filter of 18 states and 12 readings at 1 kHz for 5 s: gtmodel's error-state filter against filterpy.

filterpy's user writes the same equations by hand, as an error state in NumPy (tests/bench/rivals/with_filterpy.py).
gtmodel also keeps innovations, their normalised squares, the log-likelihood and the covariances, which filterpy's user
does not ask for here. Processor times of one process, interleaved, medians; compilation apart.

Run: python tests/bench/bench_filtering.py
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))

from gtmodel.filtering import ErrorState
from tests.bench.rivals import with_filterpy
from tests.support import turning_body as body

H, SECONDS, TURNS, SEED = 0.001, 5.0, 5, 22
AT_MOST = 3.0  # of filterpy's time
APART = 1e-2  # standard deviations, between the two: the rival's F is to the second order of the step


def methods() -> dict[str, Callable[[], Any]]:
    """Each filters the same log."""
    t = H * np.arange(round(SECONDS / H) + 1)
    log, start, d = body.noisy(t, SEED), body.beginning(), body.DEVIATIONS
    system = body.tracked()
    ours = ErrorState(system)
    belief = start.belief(system, 0.0)
    first = np.concatenate([belief.x[0], np.sqrt(np.diag(belief.P[0]))])
    columns = {name: r.values for name, r in log.items()}
    deviations = np.repeat([d["position"], d["orientation"], d["force"], d["rate"]], 3)
    densities = (body.DENSITIES["jerk"], body.DENSITIES["angular_jerk"])
    return {
        "filterpy": lambda: with_filterpy.run(columns, H, densities, deviations, first),
        "gtmodel": lambda: ours.run(log, start),
        "gtmodel, no covariances kept": lambda: ours.run(log, start, keep=False),
    }


def main() -> int:
    try:
        all_methods = methods()
        x, spread = all_methods["filterpy"]()
    except ImportError as error:
        print(f"filterpy is not installed ({error}): pip install 'gtmodel[oracle]'")
        return 0
    ours = all_methods["gtmodel"]()
    times: dict[str, list[float]] = {name: [] for name in all_methods}
    for _ in range(TURNS):
        for name, method in all_methods.items():
            begin = time.process_time()
            method()
            times[name].append(time.process_time() - begin)
    per_step = {name: statistics.median(each) / len(x) for name, each in times.items()}
    base = per_step["filterpy"]
    print("| 18 states, 12 readings, 5 s at 1 kHz | processor time per step [us] | times filterpy's |\n|---|---:|---:|")
    for name, each in per_step.items():
        print(f"| {name} | {1e6 * each:.0f} | {each / base:.2f} |")
    difference = np.abs(ours.system.space.minus(x, ours.x[:, 0])) / ours.deviations[:, 0]
    apart = max(float(difference.max()), float(np.abs(spread / ours.deviations[:, 0] - 1).max()))
    print(f"\nstates and deviations are at most {apart:.1e} standard deviations apart")
    ratio = per_step["gtmodel"] / base
    print(f"{'pass' if ratio <= AT_MOST and apart < APART else 'FAIL'}: at most {AT_MOST:g} times filterpy's time")
    return int(ratio > AT_MOST or apart > APART)


if __name__ == "__main__":
    sys.exit(main())
