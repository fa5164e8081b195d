"""One pose, and few, through a causal function of the L1 prototype, beside its bare kernel, CasADi's call and NumPy.

python tests/bench/bench_call.py [--other TREE]

Prints Markdown. One process, interleaved, processor time, for each the least of many short runs: what another process
takes from the caches is not ours. The kernel is CasADi's virtual machine on kept memory. The goal of issue 46 is for
the call less its kernel, in microseconds, so it needs an idle machine; the ratio to CasADi's own call of the same
function, which returns no status, hardly depends on the load. With another tree its calls are measured by a process
that runs right after.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

OWN = Path(__file__).resolve().parents[2]
sys.path[:0] = [os.environ.get("GTMODEL_TREE", str(OWN)), str(OWN)]

import gtmodel as gt  # noqa: E402
from tests.bench.rivals import rows_by_hand as hand  # noqa: E402
from tests.bench.rivals.l1_by_hand import data  # noqa: E402

ROWS, CALLS, TIMES = (1, 10, 100), 20, 60
GOAL = 15.0  # issue 46: microseconds of a call less its kernel, at most


def kernel(f: ca.Function, arguments: list[Any]) -> Callable[[], Any]:
    """The function on kept memory."""
    n = len(arguments[0])
    results: list[Any] = [np.empty((n, f.numel_out(k))) for k in range(f.n_out())]
    buffer: Any
    buffer, run = (f if n == 1 else f.map(n)).buffer()
    for k, a in enumerate(arguments):
        buffer.set_arg(k, memoryview(a))
    for k, r in enumerate(results):
        buffer.set_res(k, memoryview(r))
    return lambda: (run(), buffer, arguments, results)


def least(works: list[Callable[[], Any]]) -> list[float]:
    """Microseconds of each, from the fastest of interleaved runs."""
    best = [float("inf")] * len(works)
    for work in works:
        work()
    for _ in range(TIMES):
        for k, work in enumerate(works):
            begin = time.process_time()
            for _ in range(CALLS):
                work()
            best[k] = min(best[k], 1e6 * (time.process_time() - begin) / CALLS)
    return best


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--other", type=Path, help="the tree to be compared with")
    options = parser.parse_args()
    robot = gt.robots.gantry_tau("l1_tape")
    d = data(robot)
    T = np.array(robot.home)
    v, a = np.array([0.3, -0.2, 0.1]), np.array([1.0, 2.0, -1.0])
    q = robot.causal("T", "q")(T)[0]
    print(f"{Path(gt.__file__).parents[1].name}: microseconds\n")
    print("| function | rows | call | kernel | less kernel | goal | | CasADi's call | call / CasADi's | by hand |")
    print("|---|---:|---:|---:|---:|---:|---|---:|---:|---:|")
    good, rng = True, np.random.default_rng(0)
    for name, f, by_hand, point in (
        ("inverse kinematics", robot.causal("T", "q"), hand.inverse_kinematics, (T,)),
        ("forward kinematics", robot.causal("q", "T"), hand.forward_kinematics, (q,)),
        ("inverse dynamics", robot.causal("T", "tau"), hand.inverse_dynamics, (T, v, a)),
    ):
        for n in ROWS:
            rows = [x + rng.uniform(-0.05, 0.05, (n, 3)) for x in point]
            given = list(point) if n == 1 else rows
            columns = [np.ascontiguousarray(r.T) for r in rows]
            mapped = f.closed if n == 1 else f.closed.map(n)
            whole, bare, casadi, numpy = least(
                [partial(f, *given), kernel(f.closed, rows), partial(mapped, *columns), partial(by_hand, d, *columns)]
            )
            passed = whole - bare <= GOAL
            good &= passed
            print(
                f"| {name} | {n} | {whole:.1f} | {bare:.1f} | {whole - bare:.1f} | {GOAL:.0f} "
                f"| {'pass' if passed else 'MISSED'} | {casadi:.1f} | {whole / casadi:.2f} | {numpy:.1f} |",
                flush=True,
            )
    if options.other:
        print(flush=True)
        env = {**os.environ, "GTMODEL_TREE": str(options.other.resolve()), "PYTHONPATH": ""}
        subprocess.run([sys.executable, __file__], env=env, check=False)
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
