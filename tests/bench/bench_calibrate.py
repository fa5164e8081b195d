"""Calibration against scipy.optimize.least_squares: the same optimum, times and their ratio, growth with the poses.

python tests/bench/bench_calibrate.py [--poses N ...]

Three-link robot, 21 parameters, 779 synthetic poses (seed 0, 50 um on T, 13 um on q) from starts 1 mm off; the F1 with
72 raw parameters and 185 poses. The model is compiled beforehand; the rival is a vectorised NumPy residual with finite
differences, beside it a loop in Python over poses and links. Best of three by processor time, one core.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from gtmodel.calibrate import Measurements, Problem, calibrate, prepare
from gtmodel.kinematics.rotations import matrices
from gtmodel.mechanics.rotation import rotation_about
from tests.calibrate.synthetic import measured, true_robot

NOISE = {"q": 13e-6, "T": 50e-6}
ROUNDS = 3
X, Y = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])


def best(run) -> tuple[float, object]:
    times, found = [], None
    for _ in range(ROUNDS):
        begun = time.process_time()
        found = run()
        times.append(time.process_time() - begun)
    return min(times), found


def three_link(q: np.ndarray, T: np.ndarray, x: np.ndarray) -> np.ndarray:
    A, v, L = x[:9].reshape(3, 3), x[9:18].reshape(3, 3), x[18:]
    return (np.sum((T[:, None] - A - q[:, :, None] * v) ** 2, axis=2) - L**2).reshape(-1)


def three_link_loop(q: np.ndarray, T: np.ndarray, x: np.ndarray) -> np.ndarray:
    A, v, L = x[:9].reshape(3, 3), x[9:18].reshape(3, 3), x[18:]
    found = []
    for carts, t in zip(q, T, strict=True):
        found += [np.sum((t - A[i] - carts[i] * v[i]) ** 2) - L[i] ** 2 for i in range(3)]
    return np.array(found)


def f1_residual(problem: Problem, m: Measurements):
    """Squared closures of the F1 by NumPy, eqs. (5.10) to (5.12), in the problem's unknowns."""
    q, T, R = m.values["q"], m.values["T"], matrices(m.values["e"])
    names = problem.unknowns.names
    place = {n: k for k, n in enumerate(names)}
    turn = [np.array([rotation_about(axis, a) for a in q[:, 3 + k]]) for k, axis in enumerate((Y, Y, X))]
    fixed = {n: v for n, v in problem.values(problem.unknowns.start).items() if n not in place}

    def whole(x: np.ndarray, name: str, shape: tuple[int, ...]) -> np.ndarray:
        a = np.zeros(shape)
        for index in np.ndindex(shape):
            n = f"{name}[{','.join(map(str, index))}]"
            a[index] = x[place[n]] if n in place else fixed.get(n, 0.0)
        return a

    def rotation(u: np.ndarray) -> np.ndarray:
        return matrices(u) * (u @ u)  # raw, as the thesis has them

    # q4 turns joints of arm 2, q5 and q6 those of arm 3; the order of the axes is that of the model's shafts
    def residual(x: np.ndarray) -> np.ndarray:
        A0, v, L = whole(x, "A0", (3, 3)), whole(x, "v", (3, 3)), whole(x, "L", (6,))
        A, B, r3 = whole(x, "A", (6, 3)), whole(x, "B", (6, 3)), whole(x, "r3", (3,))
        R12, R13, R23 = (rotation(whole(x, n, (4,))) for n in ("u1_2", "u1_3", "u2_3"))
        cart = A0 + q[:, :3, None] * v
        joints = np.empty((len(q), 6, 3))
        joints[:, 0] = cart[:, 0]
        joints[:, 1:3] = cart[:, 1:2] + (turn[0] @ A[1:3].T).transpose(0, 2, 1) @ R12.T
        inner = r3 + (turn[2] @ A[3:].T).transpose(0, 2, 1) @ R23.T
        joints[:, 3:] = cart[:, 2:] + (turn[1] @ inner.transpose(0, 2, 1)).transpose(0, 2, 1) @ R13.T
        tips = T[:, None] + B @ R.transpose(0, 2, 1)
        return (np.sum((tips - joints) ** 2, axis=2) - L**2).reshape(-1)

    return residual


def squares(problem: Problem, x: np.ndarray) -> float:
    data = problem.reading.data
    return sum(float(np.sum(b.evaluate(data, x[b.columns])[0] ** 2)) for b in problem.squared)


def compare(kind: str, poses: int) -> None:
    m = measured(kind, poses, NOISE if kind == "three_link" else {**NOISE, "e": 1e-4}, 0, known=False)
    problem = prepare(true_robot(kind), m)
    x0 = problem.unknowns.start + 1e-3 * np.random.default_rng(1).standard_normal(len(problem.unknowns.start))
    start = dict(zip(problem.unknowns.names, x0, strict=True))
    if kind == "three_link":
        q, T = m.values["q"], m.values["T"]
        rivals = {"NumPy": lambda x: three_link(q, T, x), "Python loop": lambda x: three_link_loop(q, T, x)}
    else:
        rivals = {"NumPy": f1_residual(problem, m)}
    ours, c = best(lambda: calibrate(problem, cost="squared", start=start, confidence=False))
    more, _ = best(lambda: calibrate(problem, cost="squared", start=start))
    print(f"{kind}: {len(x0)} unknowns, {poses} poses: gtmodel {1e3 * ours:.1f} ms, with confidence {1e3 * more:.1f}, "
          f"{c.iterations} iterations, cost {squares(problem, c.x):.10e}")  # fmt: skip
    for name, residual in rivals.items():
        seconds, fit = best(lambda r=residual: least_squares(r, x0, x_scale="jac", xtol=1e-15, ftol=1e-15, gtol=1e-15))
        print(f"  least_squares, {name}: {1e3 * seconds:.1f} ms, {seconds / ours:.1f} times, {fit.nfev} evaluations, "
              f"cost {2 * fit.cost:.10e}")  # fmt: skip


def growth(sizes: list[int]) -> None:
    for n in sizes:
        m = measured("three_link", n, NOISE, 0, known=False)
        problem = prepare(true_robot("three_link"), m)
        seconds, _ = best(lambda p=problem: calibrate(p, cost="squared"))
        print(f"{n} poses: {1e3 * seconds:.1f} ms, {1e6 * seconds / n:.2f} us a pose")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--poses", type=int, nargs="*", default=[1000, 10_000, 100_000])
    compare("three_link", 779)
    compare("f1", 185)
    growth(parser.parse_args().poses)
