"""Time for a million rows: the vectorised functions of the L1 prototype beside NumPy by hand on contiguous columns.

Prints Markdown. One process, interleaved, processor time, the median of the ratios run by run. gtmodel takes and gives
rows (n, 3); the rival columns (3, n), which spares it two transpositions. Both give a status for every row. The bounds
are for whole columns by hand; the time of the same code in blocks of 4,096 is printed beside them. The F1's forward
kinematics, by Newton, stands beside CasADi's own way of the same evaluations: mapped functions on DM matrices and
singular values of every row.
"""

from __future__ import annotations

import argparse
import os
import statistics
import sys
import tempfile
import time
import tracemalloc
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import gtmodel as gt
from gtmodel.compiler import newton
from gtmodel.compiler.columns import machine
from tests.bench.rivals import rows_by_hand as hand
from tests.bench.rivals.l1_by_hand import data

SIZE, TIMES, NEWTON = 1_000_000, 7, 4000
# issue 18: times of NumPy by hand without a compiler, at most; with machine code, NumPy by hand over ours, at least
PLAIN, COMPILED, F1 = 2.0, {"inverse kinematics": 2.5, "forward kinematics": 2.5, "inverse dynamics": 1.5}, 5.0


def seconds(work: Callable[[], Any]) -> float:
    begin = time.process_time()
    work()
    return time.process_time() - begin


def interleaved(works: list[Callable[[], Any]], times: int) -> list[list[float]]:
    """Seconds of each, run by run."""
    for work in works:
        work()
    return [[seconds(work) for work in works] for _ in range(times)]


def casadi_map(f: ca.Function, columns: list[np.ndarray], _made: object = None) -> list[np.ndarray]:
    """As Newton blocks were evaluated before."""
    n = columns[0].shape[1]
    return [np.array(r.full()) for r in (f if n == 1 else f.map(n)).call([ca.DM(c) for c in columns])]


def every_singular_value(matrices: np.ndarray) -> np.ndarray:
    s = np.linalg.svd(matrices, compute_uv=False)
    return ~(s[:, -1] > newton.SINGULAR * s[:, 0])


def before(f: gt.CausalFunction, q: np.ndarray) -> Any:
    """The Newton blocks as they were before this comparison was made."""
    now = newton.map_columns, newton.is_singular
    newton.map_columns, newton.is_singular = casadi_map, every_singular_value
    try:
        return f(q)
    finally:
        newton.map_columns, newton.is_singular = now


def l1_rows(size: int, times: int, compiled: bool) -> bool:
    robot = gt.robots.gantry_tau("l1_tape")
    d = data(robot)
    rng = np.random.default_rng(0)
    T = np.array(robot.home) + rng.uniform(-0.3, 0.3, (size, 3))
    v, a = rng.standard_normal((2, size, 3))
    q = robot.causal("T", "q")(T)[0]
    good = True
    for name, function, by_hand, rows in (
        ("inverse kinematics", robot.causal("T", "q"), hand.inverse_kinematics, (T,)),
        ("forward kinematics", robot.causal("q", "T"), hand.forward_kinematics, (q,)),
        ("inverse dynamics", robot.causal("T", "tau"), hand.inverse_dynamics, (T, v, a)),
    ):
        if compiled and not function.compile():
            print("no C compiler")
            return True
        columns = [np.ascontiguousarray(r.T) for r in rows]
        ours, theirs = function(*rows), by_hand(d, *columns)
        assert np.array_equal(ours[1], theirs[1]), name
        assert np.allclose(ours[0].T, theirs[0], rtol=1e-9, atol=1e-9, equal_nan=True), name
        runs = interleaved(
            [
                partial(function, *rows),
                partial(by_hand, d, *columns),
                partial(hand.in_blocks, by_hand, d, *columns),
            ],
            times,
        )
        us = [1e6 * statistics.median(r[k] for r in runs) / size for k in range(3)]
        whole, blocks = (statistics.median(r[k] / r[0] for r in runs) for k in (1, 2))
        wanted = COMPILED[name] if compiled else 1 / PLAIN
        passed = whole >= wanted
        good &= passed
        way, verdict = "machine code" if compiled else "NumPy", "pass" if passed else "FAIL"
        print(
            f"| {name} | {way} | {us[0]:.4f} | {us[1]:.4f} | {whole:.2f} | {wanted:.1f} | {verdict} "
            f"| {us[2]:.4f} | {blocks:.2f} |"
        )
    return good


def f1_rows(rows: int, times: int) -> bool:
    f = gt.robots.f1_gantry_tau().causal("q", ["T", "e"])
    rng = np.random.default_rng(1)
    q = f.kernels[0].a0 + rng.uniform(-0.15, 0.15, (rows, 6))
    for x, y in zip(f(q), before(f, q), strict=True):
        assert np.array_equal(x, y, equal_nan=True)
    runs = interleaved([partial(f, q), partial(before, f, q)], max(times // 2, 1))
    us = [1e6 * statistics.median(r[k] for r in runs) / rows for k in range(2)]
    ratio = statistics.median(r[1] / r[0] for r in runs)
    print(f"\nF1, forward kinematics by Newton, {rows} rows: {us[0]:.1f} us per row; CasADi's map and singular values")
    print(f"{us[1]:.1f} us, {ratio:.1f} times as long, at least {F1:.0f}: {'pass' if ratio >= F1 else 'FAIL'}")
    return ratio >= F1


def memory(size: int) -> None:
    robot = gt.robots.gantry_tau("l1_tape")
    ik = robot.causal("T", "q")
    for n in (size // 10, size):
        T = np.tile(np.array(robot.home), (n, 1))
        tracemalloc.start()
        q, status = ik(T)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        print(
            f"Memory beyond the result, inverse kinematics, {n} rows: {(peak - q.nbytes - status.nbytes) / 1e6:.2f} MB."
        )


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--size", type=int, default=SIZE)
    parser.add_argument("--times", type=int, default=TIMES)
    options = parser.parse_args()
    print(f"{options.size} rows.\n")
    print("| function | gtmodel runs | us per row | by hand, columns | ratio | at least | | by hand, blocks | ratio |")
    print("|---|---|---:|---:|---:|---:|---|---:|---:|")
    make = machine.Prospect.make
    machine.Prospect.make = lambda self, build: False
    good = l1_rows(options.size, options.times, False)
    machine.Prospect.make = make
    with tempfile.TemporaryDirectory() as folder:
        os.environ["GTMODEL_CACHE"] = os.path.join(folder, "kept")
        good &= l1_rows(options.size, options.times, True)
    good &= f1_rows(NEWTON, options.times)
    print()
    memory(options.size)
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
