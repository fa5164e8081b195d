"""Two filters at 1 kHz for 5 s, gtmodel against filterpy: a linear one of 9 states and 6 readings, and an error state
of 18 states and 12 readings.

filterpy's user writes the same equations by hand in NumPy (tests/bench/rivals/with_filterpy.py). gtmodel also returns
innovations, their normalised squares, the log-likelihood and the covariances. The linear rival is timed with and
without them; the rival of 18 states does not compute them. Processor times of one process, interleaved, medians;
compilation apart.

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

import gtmodel as gt
from gtmodel.filtering import ErrorState, InitialState, ProcessModel, Readings, Sensor, System
from tests.bench.rivals import with_filterpy
from tests.support import turning_body as body

H, SECONDS, TURNS, SEED = 0.001, 5.0, 5, 22
AT_MOST = {"linear": 1.5, "body": 1.5}  # of the time of filterpy, for the same results if the rival has them
APART = {"linear": 1e-8, "body": 1e-2}  # standard deviations; the body's rival has F to the second order of the step

Methods = dict[str, Callable[[], Any]]


class Point(gt.Model):
    """A point driven by white jerk."""

    p = gt.variable(3, unit="m")
    v = gt.variable(3, unit="m/s")
    a = gt.variable(3, unit="m/s2")
    jerk = gt.input(3, unit="m/s3")

    def equations(self) -> Any:
        yield gt.der(self.p) == self.v
        yield gt.der(self.v) == self.a
        yield gt.der(self.a) == self.jerk


def linear() -> tuple[Methods, Callable[[Any, Any], float]]:
    """A point whose position and acceleration are read."""
    t, density, deviations = H * np.arange(round(SECONDS / H) + 1), 1e2, np.repeat([1e-4, 1e-2], 3)
    p = np.column_stack([0.3 * np.cos(2 * t), 0.2 * np.sin(2 * t), 0.1 * np.sin(2 * t)])
    noise = np.random.default_rng(SEED).normal(size=(len(t), 6)) * deviations
    z = np.concatenate([p, -4 * p], axis=1) + noise  # synthetic
    process = ProcessModel(Point(), {"jerk": density}, states=["p", "v", "a"])
    sensors = [Sensor("tape", "p", deviation=deviations[0]), Sensor("unit", "a", deviation=deviations[3])]
    filter = gt.filtering.kalman(System(process, sensors))
    log, start = (
        {"tape": Readings(t, z[:, :3]), "unit": Readings(t, z[:, 3:])},
        InitialState({}, dict.fromkeys("pva", 1)),
    )
    F = np.kron([[1, H, H * H / 2], [0, 1, H], [0, 0, 1]], np.eye(3))
    third = [[H**5 / 20, H**4 / 8, H**3 / 6], [H**4 / 8, H**3 / 3, H**2 / 2], [H**3 / 6, H**2 / 2, H]]
    Q, C = density * np.kron(third, np.eye(3)), np.kron([[1, 0, 0], [0, 0, 1]], np.eye(3))
    given = z, F, Q, C, np.diag(deviations**2), np.eye(9)

    def apart(ours: Any, rival: dict[str, np.ndarray]) -> float:
        y = np.concatenate([ours.innovations[n] * ours.innovation_deviations[n] for n in log], axis=2)[:, 0]
        return max(
            float(np.abs((rival["x"] - ours.x[:, 0]) / ours.deviations[:, 0]).max()),
            float(np.abs(rival["deviations"] / ours.deviations[:, 0] - 1).max()),
            float(np.abs((rival["y"] - y) / np.sqrt(rival["S"])).max()),
            float(np.abs(rival["nis"] - ours.nis[:, 0]).max()),
            abs(float(rival["likelihood"].sum() / ours.log_likelihood[0]) - 1),
        )

    return {
        "filterpy, states and deviations only": lambda: with_filterpy.run_linear(*given, whole=False),
        "filterpy": lambda: with_filterpy.run_linear(*given, whole=True),
        "gtmodel": lambda: filter.run(log, start),
    }, apart


def tracked() -> tuple[Methods, Callable[[Any, Any], float]]:
    """A rigid body with tracker and inertial unit."""
    t = H * np.arange(round(SECONDS / H) + 1)
    log, start, d = body.noisy(t, SEED), body.beginning(), body.DEVIATIONS
    system = body.tracked()
    filter = ErrorState(system)
    belief = start.belief(system, 0.0)
    first = np.concatenate([belief.x[0], np.sqrt(np.diag(belief.P[0]))])
    columns = {name: r.values for name, r in log.items()}
    deviations = np.repeat([d["position"], d["orientation"], d["force"], d["rate"]], 3)
    densities = (body.DENSITIES["jerk"], body.DENSITIES["angular_jerk"])

    def apart(ours: Any, rival: tuple[np.ndarray, np.ndarray]) -> float:
        difference = np.abs(system.space.minus(rival[0], ours.x[:, 0])) / ours.deviations[:, 0]
        return max(float(difference.max()), float(np.abs(rival[1] / ours.deviations[:, 0] - 1).max()))

    return {
        "filterpy": lambda: with_filterpy.run(columns, H, densities, deviations, first),
        "gtmodel": lambda: filter.run(log, start),
        "gtmodel, no covariances kept": lambda: filter.run(log, start, keep=False),
    }, apart


def main() -> int:
    failed = False
    for name, title, make in [
        ("linear", "9 states, 6 readings, linear", linear),
        ("body", "18 states, 12 readings, error state", tracked),
    ]:
        methods, apart = make()
        try:
            rival = methods["filterpy"]()
        except ImportError as error:
            print(f"filterpy is not installed ({error}): pip install 'gtmodel[oracle]'")
            return 0
        difference = apart(methods["gtmodel"](), rival)
        times: dict[str, list[float]] = {name: [] for name in methods}
        for _ in range(TURNS):
            for method, call in methods.items():
                begin = time.process_time()
                call()
                times[method].append(time.process_time() - begin)
        per_step = {method: H / SECONDS * statistics.median(each) for method, each in times.items()}
        base = per_step["filterpy"]
        print(f"| {title} | processor time per step [us] | times filterpy's |\n|---|---:|---:|")
        for method, each in per_step.items():
            print(f"| {method} | {1e6 * each:.0f} | {each / base:.2f} |")
        ratio = per_step["gtmodel"] / base
        wrong = ratio > AT_MOST[name] or difference > APART[name]
        print(f"\nresults are at most {difference:.1e} standard deviations apart")
        print(f"{'FAIL' if wrong else 'pass'}: at most {AT_MOST[name]:g} times filterpy's time\n")
        failed |= wrong
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
