"""Fastest motion along a straight line: squared speeds over the path (optimize/path.py) against plain SX Radau, squared
speeds in CasADi by hand, and toppra.

Prints Markdown. Each method takes the smallest of its meshes whose final time is within WITHIN of the reference, there
and on the next finer one; the reference is our own method on FINE intervals, and Radau on its finest mesh must agree.
toppra cannot have friction, so a second table leaves it out. Processor times in one process, runs interleaved, medians.
Ends with 1 below AT_LEAST.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial
from statistics import median

import casadi as ca
import numpy as np

import gtmodel as gt
from gtmodel.compiler.causal import compile_causal
from gtmodel.optimize.path import PathTask, solve_path
from tests.bench.rivals.l1_by_hand import FORCE, GOAL, START, Motion
from tests.bench.rivals.line_by_speeds import solve_by_hand, solve_toppra
from tests.bench.rivals.line_in_sx import solve_line
from tests.bench.rivals.timing import Clock, Result

WITHIN = 1e-4
AT_LEAST = 4.0  # issue 5
RUNS = 5
INTERVALS, ELEMENTS = (25, 50, 75, 100, 150, 200, 300, 400), (5, 10, 15, 20, 30, 40, 60, 80, 120)
MORE = (*INTERVALS, 600, 800, 1200, 1600, 2400, 3200, 4800, 6400)
EQUAL = 300  # intervals on which all are compared once more
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


def symbolic(robot: gt.Model) -> ca.Function:
    """(T, T', T'') -> tau of the robot as one SX function."""
    given = [ca.SX.sym(n, 3) for n in ("T", "v", "a")]
    f = compile_causal(robot, known="T", targets="tau")
    return ca.Function("tau", given, f.casadi.call([given[s.pairs[0][1]] for s in f.inputs])[:1], {"cse": True})


def smallest(road: Callable[[int], Result], sizes: tuple[int, ...], reference: float) -> int | None:
    """The first size that is within the tolerance together with the next finer one."""
    good = [(r := road(n)).converged and abs(r.objective / reference - 1) <= WITHIN for n in sizes]
    return next((n for n, *both in zip(sizes, good, good[1:], strict=False) if all(both)), None)


Sizes = dict[str, tuple[Callable[[int], Result], int | None]]


def timed(sizes: Sizes, reference: float) -> dict[str, list[float]]:
    """Print a row for each method; return the times of its runs."""
    results: dict[str, list[Result]] = {name: [] for name in sizes}
    for _ in range(RUNS):
        for name, (road, n) in sizes.items():
            results[name] += [road(n)] if n is not None else []
    print("| method | mesh | final time [s] | error | iterations | total [s] |\n|---|---:|---:|---:|---:|---:|")
    totals = {name: [r.total for r in found] for name, found in results.items()}
    for name, found in results.items():
        if not found:
            print(f"| {name} | none within {WITHIN:g} | | | | |")
            continue
        r, t = found[0], totals[name]
        cells = f"{sizes[name][1]} | {r.objective:.6f} | {abs(r.objective / reference - 1):.1e} | {r.iterations or ''}"
        print(f"| {name} | {cells} | {median(t):.3f} ({min(t):.3f}-{max(t):.3f}) |")
    print()
    return totals


def main() -> int:
    motion = Motion(0.0)
    quantities = symbolic(motion.robot)
    ours, radau = partial(solve_squares, quantities), partial(solve_line, motion)
    by_hand = partial(solve_by_hand, quantities)
    reference = ours(FINE).objective
    agreed = abs(radau(ELEMENTS[-1]).objective / reference - 1)
    print(
        f"Final time {reference:.7f} s ({FINE} intervals); Radau on {ELEMENTS[-1]} elements differs by {agreed:.0e}.\n"
    )
    totals = timed({
        "squared speeds": (ours, smallest(ours, INTERVALS, reference)),
        "plain CasADi, SX Radau": (radau, smallest(radau, ELEMENTS, reference)),
        "plain CasADi, squared speeds": (by_hand, smallest(by_hand, MORE, reference)),
    }, reference)  # fmt: skip
    first, second, *_ = totals.values()
    if not first or not second:
        return 1
    ratio = median(b / a for a, b in zip(first, second, strict=True))
    verdict = "pass" if ratio >= AT_LEAST else "MISSED"
    print(f"Ratio to Radau {ratio:.1f}, at least {AT_LEAST:g}: {verdict}.\n")

    quantities = symbolic(motion.robot.with_(coulomb=np.zeros(3), viscous=np.zeros(3)))
    methods = {
        "squared speeds": partial(solve_squares, quantities),
        "plain CasADi, squared speeds": partial(solve_by_hand, quantities),
        "toppra": partial(solve_toppra, quantities),
    }
    try:
        methods["toppra"](INTERVALS[0])
    except ImportError:
        print("toppra is not installed (pip install 'gtmodel[oracle]'), so it is left out.\n")
        del methods["toppra"]
    reference = methods["squared speeds"](FINE).objective
    print(f"Without friction the final time is {reference:.7f} s ({FINE} intervals).\n")
    timed({name: (method, smallest(method, MORE, reference)) for name, method in methods.items()}, reference)
    print(f"The same on {EQUAL} intervals each:\n")
    timed({name: (method, EQUAL) for name, method in methods.items()}, reference)
    return 0 if ratio >= AT_LEAST else 1


if __name__ == "__main__":
    sys.exit(main())
