"""A full pose optimisation by exact discretisation against scipy.integrate.solve_ivp at the same accuracy.

361 angles, the twelve printed tests with time-varying forces, two seconds each. Exact discretisation runs all 4332
poses; the integrator runs a sample of them, interleaved in the same process, and its time is scaled up. Prints
Markdown: errors against a reference of much finer step beside the times. The dynamics over the angle are made up:
the printed ones of each place, moved over the circle by smooth factors (no data exist in between).
"""

from __future__ import annotations

import argparse
import time

import numpy as np
from scipy.integrate import solve_ivp

from gtmodel.milling import ANGLES, Oscillators, cutting_force, deflections, integrated_forces, responses
from tests.milling.thesis import CUT, CUTTER, OSCILLATORS, TOOTH_HZ, X

SECONDS = 2.0
WANTED = 20.0  # the bound
TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6)
TURN = 4096  # tabulated force of the integrator: a faster right-hand side than computing it anew


def over_the_circle(test: int) -> Oscillators:
    """361 oscillators around those of one printed test (1 to 12)."""
    o, a = OSCILLATORS[test - 1], ANGLES[:, None]
    m = o.m * np.exp(0.3 * np.sin(a + np.arange(3)))
    k = o.k * np.exp(0.3 * np.cos(a + np.arange(3)))
    return Oscillators.with_damping_ratio(m, k, np.tile(o.damping_ratio, (len(a), 1)))


def integrated(o: Oscillators, speed: float, tolerance: float) -> float:
    """Largest deflection of one pose by an adaptive Runge-Kutta method, its force interpolated from a table."""
    table = integrated_forces(CUTTER, CUT, 2 * np.pi * np.arange(TURN + 1) / TURN)
    m, c, k = o.m[0], o.c[0], o.k[0]
    rows = np.ascontiguousarray(table)

    def rate(t, s):
        place = (speed * t % 1.0) * TURN
        i = int(place)
        F = rows[i] + (place - i) * (rows[i + 1] - rows[i])
        return np.concatenate([s[3:], (F - c * s[3:] - k * s[:3]) / m])

    grid = np.arange(int(SECONDS * 20000) + 1) / 20000  # dense output: the largest value lies between steps
    run = solve_ivp(rate, (0, SECONDS), np.zeros(6), "DOP853", rtol=tolerance, atol=tolerance * 1e-4, max_step=2e-3,
                    t_eval=grid[grid <= SECONDS])  # fmt: skip
    return float(np.linalg.norm(run.y[:3], axis=0).max())


def reference(o: Oscillators, speed: float) -> float:
    """The same by exact discretisation at sixteen times the rate."""
    F, step = cutting_force(CUTTER, CUT, speed, X, seconds=SECONDS, rate=320_000)
    return float(np.linalg.norm(next(iter(responses(o, F, step))), axis=1).max())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sample", type=int, default=12, help="poses that the integrator runs per tolerance")
    sample = parser.parse_args().sample
    tests, rng = np.arange(1, 13), np.random.default_rng(9)
    picks = [(int(tests[i % 12]), int(rng.integers(361))) for i in range(sample)]
    fields = {int(t): over_the_circle(int(t)) for t in tests}
    exact_s, peaks = 0.0, {}
    rival_s, rival_error = dict.fromkeys(TOLERANCES, 0.0), dict.fromkeys(TOLERANCES, 0.0)
    exact_error = 0.0
    deflections(OSCILLATORS[0], CUTTER, CUT, 30.0, X)  # first call: imports
    for test in fields:  # interleaved: a share of the integrator's sample after each test
        begin = time.process_time()
        peaks[test] = deflections(fields[test], CUTTER, CUT, TOOTH_HZ[test - 1] / 2, X, seconds=SECONDS).peak
        exact_s += time.process_time() - begin
        for t, row in (p for p in picks if p[0] == test):
            o, speed = fields[t][row], TOOTH_HZ[t - 1] / 2
            best = reference(o, speed)
            exact_error = max(exact_error, abs(peaks[t][row] / best - 1))
            for tolerance in TOLERANCES:
                begin = time.process_time()
                found = integrated(o, speed, tolerance)
                rival_s[tolerance] += time.process_time() - begin
                rival_error[tolerance] = max(rival_error[tolerance], abs(found / best - 1))
    poses = 12 * len(ANGLES)
    print("| method | poses run | time for all 4332 [s] | largest relative error of the index | time ratio |")
    print("|---|---:|---:|---:|---:|")
    print(f"| exact discretisation, 20 kHz, linear hold | {poses} | {exact_s:.1f} | {exact_error:.1e} | 1 |")
    for tolerance in TOLERANCES:
        scaled = rival_s[tolerance] / sample * poses
        print(
            f"| solve_ivp, DOP853, rtol {tolerance:g} | {sample} | {scaled:.0f} | {rival_error[tolerance]:.1e} | "
            f"{scaled / exact_s:.0f} |",
            flush=True,
        )
    good = [t for t in TOLERANCES if rival_error[t] <= 2 * exact_error]
    loosest = max(good) if good else min(TOLERANCES)
    ratio = rival_s[loosest] / sample * poses / exact_s
    fastest = min(rival_s.values()) / sample * poses / exact_s
    verdict = "met" if ratio >= WANTED else "NOT met"
    print(f"\nAt the same accuracy {ratio:.0f} times faster (at least {WANTED:g}): {verdict}")
    print(f"Against the loosest integrator, which is less accurate, {fastest:.0f} times.")


if __name__ == "__main__":
    main()
