"""Fastest motion along a straight line: squared speeds over the path (optimize/path.py) against plain SX Radau.

Prints Markdown. Each road takes the smallest of its meshes whose final time is within WITHIN of the reference, there
and on the next finer one; the reference is our own road on FINE intervals, and Radau on its finest mesh must agree.
Processor times in one process, runs interleaved, medians. Ends with 1 below AT_LEAST.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial
from statistics import median

import casadi as ca
import numpy as np

from gtmodel.compiler.causal import compile_causal
from gtmodel.optimize.path import PathTask, solve_path
from tests.bench.rivals.l1_by_hand import FORCE, GOAL, START, Motion
from tests.bench.rivals.line_in_sx import solve_line
from tests.bench.rivals.timing import Clock, Result

WITHIN = 1e-4
AT_LEAST = 4.0  # issue 5
RUNS = 5
INTERVALS, ELEMENTS = (25, 50, 75, 100, 150, 200, 300, 400), (5, 10, 15, 20, 30, 40, 60, 80, 120)
FINE = 4000


def line(s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The straight line, its slope and its curvature, at fractions s."""
    way = GOAL - START
    return START + s[:, None] * way, np.tile(way, (len(s), 1)), np.zeros((len(s), 3))


def solve_squares(quantities: ca.Function, intervals: int) -> Result:
    """gtmodel's road: from the compiled inverse dynamics to the motion."""
    clock = Clock()
    limit = np.full(3, FORCE)
    found = solve_path(PathTask(line, quantities, -limit, limit, np.zeros(3)), intervals)
    return Result(found.final_time, found.iterations, 0.0, clock.lap(), found.status.ok)


def symbolic(motion: Motion) -> ca.Function:
    """(T, T', T'') -> tau of the robot as one SX function."""
    given = [ca.SX.sym(n, 3) for n in ("T", "v", "a")]
    f = compile_causal(motion.robot, known="T", targets="tau")
    return ca.Function("tau", given, f.casadi.call([given[s.pairs[0][1]] for s in f.inputs])[:1], {"cse": True})


def smallest(road: Callable[[int], Result], sizes: tuple[int, ...], reference: float) -> int | None:
    """The first size that is within the tolerance together with the next finer one."""
    good = [(r := road(n)).converged and abs(r.objective / reference - 1) <= WITHIN for n in sizes]
    return next((n for n, *both in zip(sizes, good, good[1:], strict=False) if all(both)), None)


def main() -> int:
    motion = Motion(0.0)
    quantities = symbolic(motion)
    ours, radau = partial(solve_squares, quantities), partial(solve_line, motion)
    reference = ours(FINE).objective
    agreed = abs(radau(ELEMENTS[-1]).objective / reference - 1)
    sizes = {"squared speeds": (ours, smallest(ours, INTERVALS, reference))}
    sizes["plain CasADi, SX Radau"] = radau, smallest(radau, ELEMENTS, reference)
    print(
        f"Final time {reference:.7f} s ({FINE} intervals); Radau on {ELEMENTS[-1]} elements differs by {agreed:.0e}.\n"
    )
    if any(n is None for _, n in sizes.values()):
        print(f"No mesh reaches an error of {WITHIN:g}: {[name for name, (_, n) in sizes.items() if n is None]}.")
        return 1
    results: dict[str, list[Result]] = {name: [] for name in sizes}
    for _ in range(RUNS):
        for name, (road, n) in sizes.items():
            results[name].append(road(n or 0))
    totals = {name: [r.total for r in found] for name, found in results.items()}
    ratio = median(b / a for a, b in zip(*totals.values(), strict=True))
    print("| method | mesh | final time [s] | error | iterations | total [s] |\n|---|---:|---:|---:|---:|---:|")
    for name, found in results.items():
        r, t = found[0], totals[name]
        cells = f"{sizes[name][1]} | {r.objective:.6f} | {abs(r.objective / reference - 1):.1e} | {r.iterations}"
        print(f"| {name} | {cells} | {median(t):.3f} ({min(t):.3f}-{max(t):.3f}) |")
    verdict = "pass" if ratio >= AT_LEAST else "MISSED"
    print(f"\nRatio {ratio:.1f}, at least {AT_LEAST:g}: {verdict}.")
    return 0 if ratio >= AT_LEAST else 1


if __name__ == "__main__":
    sys.exit(main())
