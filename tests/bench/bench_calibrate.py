"""Calibration against SciPy with an exact Jacobian and against Gauss-Newton by hand; growth and memory with the poses.

OMP_NUM_THREADS=1 python tests/bench/bench_calibrate.py [--poses N ...] [--memory N]

Three-link robot, 21 parameters, 779 synthetic poses (seed 0, 50 um on T, 13 um on q) from starts 1 mm off; the F1 with
72 raw parameters and 185 poses. The model is compiled beforehand. scipy.optimize.least_squares has its usual tolerances
and the exact Jacobian: for three links by hand (rivals/calibration_by_hand.py), for the F1, beside a residual in NumPy,
that of gtmodel. By hand: Gauss-Newton by normal equations, arm by arm, to the last digits as gtmodel, with a row per
pose and on contiguous columns. Least of the rounds by processor time, rivals in turn within one process, one core. Ends
with 1 where optima differ or a ratio misses its target.
"""

from __future__ import annotations

import argparse
import resource
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import least_squares

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from gtmodel.calibrate import CalibrationProblem, Measurements, calibrate, prepare
from gtmodel.geometry.rotations import matrices, rotation_about
from tests.bench.rivals import calibration_by_hand as by_hand
from tests.calibrate.synthetic import measured, true_robot

NOISE = {"q": 13e-6, "T": 50e-6}
ROUNDS = 7
X, Y = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
SAME = 1e-8  # relative difference of two minima: what the usual tolerances leave
METHODS = ("trf", "lm", "dogbox")  # the first is what least_squares takes by itself, and the one to beat
SLOWEST = 2.0  # of Gauss-Newton by hand on rows: at most so many times at 100,000 poses


def least(runs: dict[str, Callable[[], Any]], rounds: int = ROUNDS) -> tuple[dict[str, float], dict[str, Any]]:
    """Processor times [s] of each, and what it found; all in turn, so that a slow moment of the machine meets all."""
    times, found = dict.fromkeys(runs, np.inf), {}
    for _ in range(rounds):
        for name, run in runs.items():
            begun = time.process_time()
            found[name] = run()
            times[name] = min(times[name], time.process_time() - begun)
    return times, found


def f1_residual(problem: CalibrationProblem, m: Measurements) -> Callable[..., np.ndarray]:
    """Squared closures of the F1 by NumPy, eqs. (5.10) to (5.12), in the problem's unknowns; of some rows if asked."""
    q, T, R = m.values["q"], m.values["T"], matrices(m.values["e"])
    names = problem.unknowns.names
    turn = [np.array([rotation_about(axis, a) for a in q[:, 3 + k]]) for k, axis in enumerate((Y, Y, X))]
    fixed = {n: v for n, v in problem.values(problem.unknowns.start).items() if n not in names}
    shapes = {"A0": (3, 3), "v": (3, 3), "L": (6,), "A": (6, 3), "B": (6, 3), "r3": (3,), "u1_2": (4,), "u1_3": (4,),
              "u2_3": (4,)}  # fmt: skip
    all_names = [f"{n}[{','.join(map(str, i))}]" for n, shape in shapes.items() for i in np.ndindex(shape)]
    whole = np.array([fixed.get(n, 0.0) for n in all_names])
    place = np.array([all_names.index(n) for n in names])
    ends = np.cumsum([np.prod(s) for s in shapes.values()])[:-1]

    # q4 turns joints of arm 2, q5 and q6 those of arm 3; the order of the axes is that of the model's shafts
    def residual(x: np.ndarray, rows: Any = slice(None)) -> np.ndarray:
        values = whole.copy()
        values[place] = x
        parts = np.split(values, ends)
        A0, v, L, A, B, r3, *us = (p.reshape(s) for p, s in zip(parts, shapes.values(), strict=True))
        R12, R13, R23 = (matrices(u) * (u @ u) for u in us)  # raw, as the thesis has them
        about = [t[rows] for t in turn]
        cart = A0 + q[rows, :3, None] * v
        d = T[rows, None] + B @ R[rows].transpose(0, 2, 1)
        d[:, 0] -= cart[:, 0]
        d[:, 1:3] -= cart[:, 1:2] + A[1:3] @ about[0].transpose(0, 2, 1) @ R12.T
        inner = r3 + A[3:] @ about[2].transpose(0, 2, 1) @ R23.T
        d[:, 3:] -= cart[:, 2:] + inner @ about[1].transpose(0, 2, 1) @ R13.T
        return (np.einsum("kij,kij->ki", d, d) - L**2).reshape(-1)

    return residual


def squares(problem: CalibrationProblem, x: np.ndarray) -> float:
    data = problem.reading.data
    return sum(float(np.sum(b.evaluate(data, x[b.columns])[0] ** 2)) for b in problem.squared)


def start_of(problem: CalibrationProblem) -> np.ndarray:
    n = len(problem.unknowns.start)
    return problem.unknowns.start + 1e-3 * np.random.default_rng(1).standard_normal(n)


def compare(kind: str, poses: int) -> bool:
    """Prints the comparison; whether the optima agree and SciPy as it comes is not faster."""
    m = measured(kind, poses, NOISE if kind == "three_link" else {**NOISE, "e": 1e-4}, 0, known=False)
    problem = prepare(true_robot(kind), m)
    x0 = start_of(problem)
    start = dict(zip(problem.unknowns.names, x0, strict=True))
    q, T = m.values["q"], m.values["T"]
    if kind == "three_link":
        residual, jacobian = (lambda x: by_hand.residual(x, q, T)), (lambda x: by_hand.jacobian(x, q, T))
    else:
        residual, jacobian = f1_residual(problem, m), partial(whole_jacobian, problem)
    runs: dict[str, Callable[[], Any]] = {
        "gtmodel": lambda: calibrate(problem, cost="squared", start=start, confidence=False),
        "gtmodel, confidence": lambda: calibrate(problem, cost="squared", start=start),
        **{f"scipy, {k}": partial(least_squares, residual, x0, jacobian, method=k, x_scale="jac" if k == "trf" else 1.0)
           for k in METHODS if kind == "three_link" or k == "trf"},
        "scipy, differences": lambda: least_squares(residual, x0, x_scale="jac"),
    }  # fmt: skip
    if kind == "three_link":
        runs["by hand, rows"] = lambda: by_hand.by_arm(x0, q, T, columns=False)
        runs["by hand, columns"] = lambda: by_hand.by_arm(x0, q, T)
    times, ends = least(runs)
    own = ends["gtmodel"]
    print(f"{kind}: {len(x0)} unknowns, {poses} poses, {len(own.blocks)} blocks, {own.iterations} iterations")
    met, mine = True, squares(problem, own.x)
    for name, seconds in times.items():
        x = ends[name] if name.startswith("by hand") else ends[name].x
        ratio, other = seconds / times["gtmodel"], squares(problem, x)
        met &= abs(other - mine) <= SAME * mine and not (name == "scipy, trf" and ratio < 1)
        print(f"  {name:20s} {1e3 * seconds:8.2f} ms {ratio:7.2f} times, squares {other / mine - 1:+.0e}")
    print("  pass" if met else "  MISSED: an optimum differs, or SciPy is faster")
    return met


def whole_jacobian(problem: CalibrationProblem, x: np.ndarray) -> np.ndarray:
    """Of the squared closures, pose by pose, in all unknowns."""
    N, data = len(problem.measurements), problem.reading.data
    J = np.zeros((N, len(problem.labels), len(x)))
    for b in problem.squared:
        J[np.ix_(np.arange(N), b.rows, b.columns)] = b.evaluate(data, x[b.columns])[1]
    return J.reshape(-1, len(x))


def growth(sizes: list[int]) -> bool:
    """Cost by the number of poses, and whether many are solved within SLOWEST times what they cost by hand."""
    met = True
    for n in sizes:
        m = measured("three_link", n, NOISE, 0, known=False)
        problem = prepare(true_robot("three_link"), m)
        x0, q, T = start_of(problem), m.values["q"], m.values["T"]
        start = dict(zip(problem.unknowns.names, x0, strict=True))
        times, _ = least(
            {
                "alone": partial(calibrate, problem, cost="squared", start=start, confidence=False),
                "whole": partial(calibrate, problem, cost="squared", start=start),
                "rows": partial(by_hand.by_arm, x0, q, T, columns=False),
                "columns": partial(by_hand.by_arm, x0, q, T),
            },
            5,
        )
        alone, whole, rows, columns = times["alone"], times["whole"], times["rows"], times["columns"]
        met &= n < 100_000 or alone <= SLOWEST * rows
        print(f"{n:7d} poses: {1e3 * alone:6.1f} ms, {1e6 * alone / n:.2f} us per pose; with confidence "
              f"{1e3 * whole:6.1f} ms; by hand on rows {1e3 * rows:5.1f} ms, {alone / rows:.2f} times; on columns "
              f"{1e3 * columns:5.1f} ms, {alone / columns:.2f} times")  # fmt: skip
    return met


def memory(poses: int) -> None:
    """Largest memory of this process before and after a calibration with stated noise and confidence."""
    problem = prepare(true_robot("three_link"), measured("three_link", poses, NOISE, 0))
    before, begun = _peak(), time.process_time()
    c = calibrate(problem, start=dict(zip(problem.unknowns.names, start_of(problem), strict=True)))
    seconds = time.process_time() - begun
    print(f"{poses} poses: {c.status.name}, {seconds:.1f} s, {_peak():.0f} MB at most, {before:.0f} MB before")


def _peak() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--poses", type=int, nargs="*", default=[100, 1000, 10_000, 100_000])
    parser.add_argument("--memory", type=int, help="only this: memory with so many poses")
    given = parser.parse_args()
    if given.memory:
        memory(given.memory)
        return 0
    met = [compare("three_link", 779), compare("f1", 185), growth(given.poses)]
    return 0 if all(met) else 1


if __name__ == "__main__":
    sys.exit(main())
