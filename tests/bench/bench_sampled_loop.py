"""A controller at 4 ms for the L1: speed of a closed-loop simulation relative to real time.

By hand is what one would write without gtmodel's sampled blocks: SciPy's DOP853, anew from each sample, on the forward
dynamics and the law as CasADi functions, with the forces of two samples before. Processor times of one process,
interleaved, medians; the factor is simulated seconds by processor seconds.

Run: python tests/bench/bench_sampled_loop.py
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable

import numpy as np
import scipy

import gtmodel as gt
from gtmodel.control import ComputedTorque, law_function, sampled_loop

PERIOD, SECONDS, TOLERANCE, TURNS = 0.004, 1.0, 1e-9, 7
FROM, BY = np.array([0.5, -0.9, 0.3]), np.array([0.2, 0.1, 0.1])
AT_MOST = 1e-8  # m, between the two


def methods() -> dict[str, Callable[[], np.ndarray]]:
    """Each gives the positions at the samples."""
    robot = gt.robots.gantry_tau("l1_tape", "model_2")
    law = ComputedTorque(robot, stiffness=900.0, damping=60.0)
    t = PERIOD * np.arange(round(SECONDS / PERIOD) + 1)
    s = t / t[-1]
    q, _ = robot.causal("T", "q")(FROM + (10 * s**3 - 15 * s**4 + 6 * s**5)[:, None] * BY)
    reference = gt.Trajectory(t, {"reference": q}, {"reference": "m"})
    start = {"plant.T": FROM, "der(plant.T)": np.zeros(3)}

    def simulated(compiled: bool) -> Callable[[], np.ndarray]:
        loop = sampled_loop(robot, law, PERIOD, 2 * PERIOD, compiled=compiled)

        def run() -> np.ndarray:
            given = {"reference": (reference, "cubic")}
            simulation = gt.simulate(loop, SECONDS, inputs=given, start=start, step=PERIOD, tolerance=TOLERANCE)
            return simulation.samples["law"]["position"]

        return run

    forward = robot.causal(known="tau", targets="der(T,2)", prefer="T").casadi
    carts = robot.causal(known="T", targets=["q", "der(q)"]).casadi
    wanted = scipy.interpolate.CubicSpline(t, q)
    f = law_function(law, 3)

    def by_hand() -> np.ndarray:
        x, forces, positions = np.concatenate([FROM, np.zeros(3)]), [np.zeros(3)] * 2, []
        for k, now in enumerate(t):
            at, rate = (np.asarray(e.full()).reshape(-1) for e in carts(x[:3], x[3:])[:2])
            positions.append(at)
            forces.append(f(wanted(now), wanted(now, 1), wanted(now, 2), at, rate).full().reshape(-1))

            def rates(_: float, y: np.ndarray, tau: np.ndarray = forces[k]) -> np.ndarray:
                return np.concatenate([y[3:], forward(y[:3], y[3:], tau)[0].full().reshape(-1)])

            if k + 1 < len(t):
                step = scipy.integrate.solve_ivp(rates, (0, PERIOD), x, "DOP853", rtol=TOLERANCE, atol=TOLERANCE)
                x = step.y[:, -1]
        return np.array(positions)

    return {"gt.control.sampled_loop": simulated(False), "the same, law in C": simulated(True), "by hand": by_hand}


def main() -> int:
    all_methods = methods()
    positions = {name: method() for name, method in all_methods.items()}
    times: dict[str, list[float]] = {name: [] for name in all_methods}
    for _ in range(TURNS):
        for name, method in all_methods.items():
            begin = time.process_time()
            method()
            times[name].append(time.process_time() - begin)
    print("| L1 under computed torque, 4 ms, 8 ms late | processor time for 1 s [s] | times faster than real time |")
    print("|---|---:|---:|")
    for name, each in times.items():
        median = statistics.median(each)
        print(f"| {name} | {median / SECONDS:.2f} | {SECONDS / median:.1f} |")
    first, *others = positions.values()
    apart = max(float(np.max(np.abs(first - other))) for other in others)
    print(f"\npositions at the samples are at most {apart:.1e} m apart")
    return int(apart > AT_MOST)


if __name__ == "__main__":
    sys.exit(main())
