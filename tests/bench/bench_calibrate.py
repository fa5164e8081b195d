"""Calibration against scipy.optimize.least_squares: the same optimum, times and their ratio, growth with the poses.

OMP_NUM_THREADS=1 python tests/bench/bench_calibrate.py [--poses N ...]

Three-link robot, 21 parameters, 779 synthetic poses (seed 0, 50 um on T, 13 um on q) from starts 1 mm off; the F1 with
72 raw parameters and 185 poses. The model is compiled beforehand. The rival is a vectorised NumPy residual with finite
differences, beside it a loop in Python over the poses. Both end at their last digits. Least of the rounds by processor
time, rivals in turn within one process, one core. Ends with 1 where optima differ or a ratio is below its target.
"""

from __future__ import annotations

import argparse
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
from gtmodel.kinematics.rotations import matrices
from gtmodel.mechanics.rotation import rotation_about
from tests.calibrate.synthetic import measured, true_robot

NOISE = {"q": 13e-6, "T": 50e-6}
ROUNDS = 7
X, Y = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
TARGET = {"three_link": 2.0, "f1": 3.0}  # at least so many times faster than the vectorised residual
SAME = 1e-10  # relative difference of two minima: finite differences leave that


def least(runs: dict[str, Callable[[], Any]], rounds: int = ROUNDS) -> tuple[dict[str, float], dict[str, Any]]:
    """Processor times [s] of each, and what it found; all in turn, so that a slow moment of the machine meets all."""
    times, found = dict.fromkeys(runs, np.inf), {}
    for _ in range(rounds):
        for name, run in runs.items():
            begun = time.process_time()
            found[name] = run()
            times[name] = min(times[name], time.process_time() - begun)
    return times, found


def three_link(q: np.ndarray, T: np.ndarray, x: np.ndarray) -> np.ndarray:
    d = T[:, None] - x[:9].reshape(3, 3) - q[:, :, None] * x[9:18].reshape(3, 3)
    return (np.einsum("kij,kij->ki", d, d) - x[18:] ** 2).reshape(-1)


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


def compare(kind: str, poses: int) -> bool:
    """Prints the comparison; whether the optima agree and the target is met."""
    m = measured(kind, poses, NOISE if kind == "three_link" else {**NOISE, "e": 1e-4}, 0, known=False)
    problem = prepare(true_robot(kind), m)
    x0 = problem.unknowns.start + 1e-3 * np.random.default_rng(1).standard_normal(len(problem.unknowns.start))
    start = dict(zip(problem.unknowns.names, x0, strict=True))
    q, T = m.values["q"], m.values["T"]
    if kind == "three_link":
        vectorised = partial(three_link, q, T)
        one = lambda x, k: three_link(q[k : k + 1], T[k : k + 1], x)  # noqa: E731
    else:
        vectorised = f1_residual(problem, m)
        one = lambda x, k: vectorised(x, slice(k, k + 1))  # noqa: E731
    times, found = least(
        {
            "ours": lambda: calibrate(problem, cost="squared", start=start, confidence=False),
            "confidence": lambda: calibrate(problem, cost="squared", start=start),
            "NumPy": lambda: least_squares(vectorised, x0, x_scale="jac", xtol=1e-15, ftol=1e-15, gtol=1e-15),
            "usual": lambda: least_squares(vectorised, x0, x_scale="jac"),
        }
    )
    c, fit, usual = found["ours"], found["NumPy"], found["usual"]
    loop, _ = least({"loop": lambda: np.concatenate([one(x0, k) for k in range(poses)])}, 3)
    calls = fit.nfev + fit.njev * len(x0)
    mine, other = squares(problem, c.x), 2 * fit.cost
    ratio = times["NumPy"] / times["ours"]
    met = ratio >= TARGET[kind] and abs(mine - other) <= SAME * other
    print(f"{kind}: {len(x0)} unknowns, {poses} poses, {len(c.blocks)} blocks")
    print(f"  gtmodel: {1e3 * times['ours']:.1f} ms, {c.iterations} iterations, squares {mine:.10e}; with confidence "
          f"{1e3 * times['confidence']:.1f} ms, {times['NumPy'] / times['confidence']:.1f} times")  # fmt: skip
    print(f"  least_squares, NumPy: {1e3 * times['NumPy']:.1f} ms, {ratio:.1f} times, {fit.nfev} steps, squares "
          f"{other:.10e}; target {TARGET[kind]:g}: {'pass' if met else 'MISSED'}")  # fmt: skip
    print(f"  with its usual tolerances: {1e3 * times['usual']:.1f} ms, {times['usual'] / times['ours']:.1f} times, "
          f"{usual.nfev} steps, squares {2 * usual.cost / mine - 1:.0e} above")  # fmt: skip
    slow = calls * loop["loop"]
    print(f"  least_squares, Python loop: {slow:.1f} s, {slow / times['ours']:.0f} times ({calls} residuals at "
          f"{1e3 * loop['loop']:.1f} ms)")  # fmt: skip
    return met


def growth(sizes: list[int]) -> None:
    """Cost by the number of poses; functions for a number of poses are made once, before."""
    for n in sizes:
        problem = prepare(true_robot("three_link"), measured("three_link", n, NOISE, 0, known=False))
        times, _ = least(
            {
                "alone": lambda p=problem: calibrate(p, cost="squared", confidence=False),
                "whole": lambda p=problem: calibrate(p, cost="squared"),
            },
            4,
        )
        alone, whole = times["alone"], times["whole"]
        print(f"{n:7d} poses: {1e3 * alone:7.1f} ms, {1e6 * alone / n:.2f} us a pose; "
              f"with confidence {1e3 * whole:7.1f} ms, {1e6 * whole / n:.2f} us")  # fmt: skip


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--poses", type=int, nargs="*", default=[100, 1000, 10_000, 100_000])
    sizes = parser.parse_args().poses
    met = [compare("three_link", 779), compare("f1", 185)]
    growth(sizes)
    return 0 if all(met) else 1


if __name__ == "__main__":
    sys.exit(main())
