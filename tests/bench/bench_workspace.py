"""Time to map a grid: a million tool centre points in chunks against a Python loop over the same function, and the
reachability with limits against NumPy by hand (tests/bench/rivals/workspace_by_hand.py).

Prints Markdown. All run in one process, the loop on a sample; processor times, the best of some interleaved
repetitions, so that the ratio is no gift of a busy machine. Codes may differ from those by hand in SAME of the points.
"""

from __future__ import annotations

import sys
import time
import tracemalloc

import numpy as np

import gtmodel as gt
from gtmodel.kinematics.mechanism import mechanism_of
from gtmodel.kinematics.workspace import BallJointCones, Grid, Reach, Singularities, map_grid
from gtmodel.kinematics.workspace.reach import FIRST_LIMIT
from tests.bench.rivals.l1_by_hand import data
from tests.bench.rivals.workspace_by_hand import reachability

SAMPLE, REPETITIONS, CHUNK = 1000, 3, 16384
AT_LEAST = 200.0  # issue 4, workspace
HALF_ANGLE, LEAST = np.radians(40.0), 1e-3  # rad, of cones and of singular poses
SAME = 1e-5  # of the points: at a limit round-off decides


def seconds(work) -> float:
    begin = time.process_time()
    work()
    return time.process_time() - begin


def mapped(function: gt.CausalFunction, grid: Grid) -> None:
    """The function itself on all points, chunk by chunk, the values not kept."""
    for begin in range(0, grid.size, CHUNK):
        function(grid.points(begin, min(begin + CHUNK, grid.size)))


def reason(codes: np.ndarray) -> np.ndarray:
    """0 reachable, 1 out of reach, 2 and 3 the limits."""
    return np.where(codes >= FIRST_LIMIT, codes.astype(int) - FIRST_LIMIT + 2, np.minimum(codes, 1))


def main() -> int:
    robot = mechanism_of(gt.robots.gantry_tau("l1_tape"))
    names = ["q", *(f"arm[{i}].rod.{end}.r" for i in range(3) for end in "ab")]
    function = robot.model.causal("T", names)
    limits = [Singularities(robot.directions, LEAST), BallJointCones.about_home(robot.home, HALF_ANGLE)]
    reach = Reach(robot.inverse, limits)
    ranges = ((0.5, 1.5), (-1.5, 0.3), (-0.2, 1.7))
    million = Grid(np.zeros(3), np.eye(3), tuple(np.linspace(*r, 100) for r in ranges))
    sample = million.points()[:: million.size // SAMPLE][:SAMPLE]
    rows = [
        ("inverse kinematics", lambda: mapped(function, million), lambda: [function(T) for T in sample]),
        ("reachability with limits", lambda: map_grid(reach, million), lambda: [reach(T) for T in sample]),
    ]
    print(f"L1 prototype, {million.size} points, Python loop on {len(sample)} of them.\n")
    print("| function | loop [us per point] | vectorised [us per point] | ratio | at least | |")
    print("|---|---:|---:|---:|---:|---|")
    good = True
    for name, vectorised, loop in rows:
        slow = min(seconds(loop) for _ in range(REPETITIONS)) / len(sample)
        fast = seconds(vectorised) / million.size
        passed = slow / fast >= AT_LEAST
        good &= passed
        verdict = "pass" if passed else "FAIL"
        print(f"| {name} | {1e6 * slow:.0f} | {1e6 * fast:.2f} | {slow / fast:.0f} | {AT_LEAST:.0f} | {verdict} |")
    tracemalloc.start()
    found = map_grid(reach, million)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    print(
        f"\nMemory beyond the result of {found.codes.nbytes / 1e6:.2f} MB: {(peak - found.codes.nbytes) / 1e6:.1f} MB."
    )
    points, own = million.points(), data(gt.robots.gantry_tau("l1_tape"))
    roads = [lambda: map_grid(reach, million), lambda: reachability(own, points, robot.home.T[0], HALF_ANGLE, LEAST)]
    times = [[seconds(road) for road in roads] for _ in range(REPETITIONS)]
    ours, by_hand = np.min(times, axis=0)
    differ = float(np.mean(reason(found.codes.ravel()) != reason(roads[1]().ravel())))
    print(
        f"\nReachability with limits takes {1e6 * ours / million.size:.2f} us per point, {ours / by_hand:.1f} times "
        f"NumPy by hand ({1e6 * by_hand / million.size:.2f} us); codes differ at {differ:.0e} of the points."
    )
    return 0 if good and differ <= SAME else 1


if __name__ == "__main__":
    sys.exit(main())
