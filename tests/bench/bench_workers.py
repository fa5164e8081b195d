"""Two workers against one on five maps, the start of workers and of a cluster, and a sweep of many cheap rows.

`--quick` takes small work. Runs are interleaved, and the best of each counts. Wall times hold for two idle cores only,
so the load of the machine is printed, and beside the ratio that is judged the one that processor times give: one core
does what this process does and then what the busiest worker does. Prints Markdown.
"""

from __future__ import annotations

import os
import resource
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import gtmodel as gt
from gtmodel.kinematics.assembly_modes import draw
from gtmodel.workers import each, using

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from tests.bench.worker_tasks import one_row, resident
from tests.workers.studies import Cart

QUICK = "--quick" in sys.argv
RATIO, PROCESS_S, DASK_S, SHARE = 1.7, 2.0, 5.0, 0.1  # issue 45
REPETITIONS = 2


def modes() -> Callable[[], Any]:
    hands = draw(128 if QUICK else 1600, seed=1)
    return lambda: gt.kinematics.modes_study(hands)


def points() -> Callable[[], Any]:
    robot = gt.robots.six_link_gantry_tau()
    q = np.random.default_rng(1).uniform(-0.25, -0.15, (20_000 if QUICK else 600_000, 3))
    return lambda: gt.kinematics.causality_study(robot, "q", "T", q)


def poses() -> Callable[[], Any]:
    robot = gt.robots.gantry_tau("l1_tape")
    grid = gt.calibrate.Synthetic(low=[0.0, -1.0, 0.2], high=[1.5, 0.5, 0.8], counts=[4, 4, 3 if QUICK else 12])
    c = gt.calibrate.calibrate(robot, gt.calibrate.made_poses(robot, grid).measurements)
    return lambda: gt.calibrate.leave_out(c)


def motions() -> Callable[[], Any]:
    robot = gt.robots.gantry_tau("l1_tape")
    family = gt.identify.Family(
        period=4.0, harmonics=5, place_low=[0.9, -0.9, 0.4], place_high=[1.1, -0.7, 0.6]
    )  # fmt: skip
    limits = gt.motion.Limits(force=700.0, tcp_low=[0.5, -1.1, 0.2], tcp_high=[1.5, -0.5, 0.8])
    search = gt.identify.ExcitationSearch(starts=8, max_iterations=10 if QUICK else 200)
    random = gt.identify.RandomMotions(draws=8)
    return lambda: gt.identify.excitation_study(robot, family, limits, search=search, random=random)


def gains() -> Callable[[], Any]:
    rng = np.random.default_rng(1)
    joints = np.deg2rad(rng.uniform([-65.0, 60.0], [-20.0, 115.0], (12, 2)))
    m, c, k = gt.control.delayed.true_plants(joints, gt.control.delayed.SyntheticCommands())
    field = gt.control.delayed.fit_gain_field(joints, m, c, k)
    margins = gt.control.delayed.GainMargins()
    draws = 201 if QUICK else 4000
    return lambda: gt.control.delayed.limits_over(
        field, joints, "y", cycle=0.004, delay=0.052, draws=draws, margins=margins
    )  # fmt: skip


def logs() -> Callable[[], Any]:
    time_s = 0.004 * np.arange(2000 if QUICK else 20000)
    q = gt.identify.multisine(time_s, np.zeros(1), np.array([0.2]), np.array([0.5, 1.1]), seed=1)[:, 0]
    simulator, regressor = gt.identify.LogSimulator(Cart(), q), gt.identify.Regressor(Cart(), ["m", "d"])
    sensors, runs = gt.identify.Sensors(effort_noise=0.5), 20 if QUICK else 200
    truth = {"m": 2.0, "d": 5.0}
    return lambda: gt.identify.repeat_identification(simulator, regressor, truth, sensors, runs, 1)


MAPS = {
    "assembly modes, 16 platforms a row": modes,
    "forward kinematics, 2000 points a row": points,
    "leave-one-out refits": poses,
    "excitation from 8 starts": motions,
    "gain limits with margins": gains,
    "synthetic identifications": logs,
}


def run(work: Callable[[], Any], workers: int) -> tuple[float, float]:
    """Wall time [s], and the time that idle cores need at most: processor time here, then in the busiest worker."""
    wall, here = time.perf_counter(), time.process_time()
    with using(workers=workers) as crew:
        work()
        assert crew.pool is not None, "no rows were shared"
        busiest = max(processor_time(pid) for pid in crew.pool._pool._processes)
    return time.perf_counter() - wall, time.process_time() - here + busiest


def processor_time(pid: int) -> float:
    with open(f"/proc/{pid}/stat") as file:
        user, system = file.read().rpartition(")")[2].split()[11:13]
    return (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")


def ratios() -> bool:
    print("| map | one worker [s] | two [s] | ratio | ratio on idle cores | at least | |")
    print("|---|---:|---:|---:|---:|---:|---|")
    passed = 0
    for name, made in MAPS.items():
        work = made()
        seen: dict[int, list[tuple[float, float]]] = {1: [], 2: []}
        for workers in (1 if QUICK else REPETITIONS) * [1, 2]:
            seen[workers].append(run(work, workers))
        (one, idle_one), (two, idle_two) = (np.min(seen[n], axis=0) for n in (1, 2))
        good = one / two >= RATIO
        passed += good
        print(
            f"| {name} | {one:.1f} | {two:.1f} | {one / two:.2f} | {idle_one / idle_two:.2f} | {RATIO} | "
            f"{'pass' if good else 'FAIL'} |",
            flush=True,
        )
    return passed >= 5


def starts() -> bool:
    begin = time.perf_counter()
    memory = [done.value for done in each(resident, range(8), workers=2)]
    process = (time.perf_counter() - begin) / 2
    print(f"\nStart of two processes with gtmodel: {process:.1f} s each (at most {PROCESS_S:g}).")
    print(f"Memory of a worker: {min(memory):.0f} MB with gtmodel loaded, {peak_with_a_model():.0f} MB after a model.")
    good = process <= PROCESS_S
    try:
        from distributed import Client, LocalCluster
    except ImportError:
        print("Dask is not installed: not measured.")
        return good
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster, Client(cluster) as client:
        begin = time.perf_counter()
        list(each(resident, range(2), executor=client))
        dask = time.perf_counter() - begin
    print(f"First rows on a Dask cluster that runs: {dask:.1f} s (at most {DASK_S:g}).")
    return good and dask <= DASK_S


def peak_with_a_model() -> float:
    with using(workers=1) as crew:
        points_of = np.tile([1.4, -0.9, 0.3], (2001, 1))
        gt.kinematics.causality_study(gt.robots.gantry_tau("l1_tape"), "T", "q", points_of)
        return float(crew.pool.submit(resident, 0).result())


def many_rows() -> bool:
    count = 10_000 if QUICK else 100_000
    parent = resource.getrusage(resource.RUSAGE_SELF)
    before, begin, seconds = resident(0), time.perf_counter(), 0.0
    most = before
    for done in each(one_row, range(count), workers=2, ordered=True):
        seconds += done.value
        if done.index % 1000 == 0:
            most = max(most, resident(0))
    end = resource.getrusage(resource.RUSAGE_SELF)
    wall_s = time.perf_counter() - begin
    own = end.ru_utime + end.ru_stime - parent.ru_utime - parent.ru_stime
    print(
        f"\n{count} rows of {1e3 * seconds / count:.2f} ms: {wall_s:.1f} s with two workers; this process took "
        f"{own:.1f} s, {100 * own / seconds:.1f} % of the rows' {seconds:.1f} s (at most {100 * SHARE:g} %); "
        f"its memory grew by {most - before:.0f} MB."
    )
    return own <= SHARE * seconds


def main() -> int:
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
    print(f"Load of the machine before: {load:.1f} on {gt.workers.usable_cores()} usable cores.\n")
    good = [starts(), many_rows()]
    print()
    good.append(ratios())
    return 0 if all(good) else 1


if __name__ == "__main__":
    sys.exit(main())
