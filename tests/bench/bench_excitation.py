"""Excitations for many settings from two trees: optima of each search, and whether IPOPT improves them.

OMP_NUM_THREADS=1 python tests/bench/bench_excitation.py [--other TREE] [--starts N] [--ipopt] [SETTING ...]

The criterion has many local minima, so searches are compared over many settings: cost (about twice the logarithm of
the condition number) and processor time of each, from the same random motions. --ipopt starts IPOPT with exact second
derivatives and a tolerance of 1e-6 from each of our answers, within the rows that were searched. Prints Markdown.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np

OWN = Path(__file__).resolve().parents[2]
PROBLEM = "excitation_l1"
JERK = "limits.tcp_jerk_m_s3=60"
D1 = [
    'robot="d1_nominal"', "parameters={}", 'identified=["m_p","m_c","viscous","coulomb"]', "limits.joint_cones=[]",
    "motion.place_low_m=[-1.9,-4.65,0.1]", "motion.place_high_m=[-1.5,-4.3,0.35]",
    "limits.tcp_low_m=[-2.2,-4.8,-0.05]", "limits.tcp_high_m=[-1.2,-4.15,0.5]",
    "limits.cart_low_m=[-9,-9,-9]", "limits.cart_high_m=[9,9,9]",
]  # fmt: skip
SETTINGS: dict[str, list[str]] = {
    "shipped": [],
    **{f"jerk {j}": [f"limits.tcp_jerk_m_s3={j}"] for j in (30, 60, 100, 200)},
    **{f"cart acceleration {a}": [f"limits.cart_acceleration_m_s2={a}"] for a in (4, 8)},
    "acceleration 6": ["limits.tcp_acceleration_m_s2=6"],
    **{f"speed {v}": [f"limits.tcp_velocity_m_s={v}"] for v in (0.7, 1.0, 2.5)},
    "cart speed 0.8": ["limits.cart_velocity_m_s=0.8"],
    **{f"harmonics {n}": [f"motion.harmonics={n}"] for n in (3, 4, 7)},
    **{f"period {T}": [f"motion.period_s={T}"] for T in (3, 6, 8)},
    **{f"force {F}": [f"limits.force_N={F}"] for F in (400, 1000)},
    **{f"seed {s}": [f"random.seed={s}"] for s in (2, 3, 4, 5)},
    **{f"jerk 60, seed {s}": [JERK, f"random.seed={s}"] for s in (2, 3)},
    "determinant": ['search.criterion="determinant"'],
    "variance": ['search.criterion="variance"'],
    "spline of 12": ['motion.family="spline"', "motion.intervals=12"],
    "spline of 8": ['motion.family="spline"', "motion.intervals=8"],
    "D1": D1,
    "D1, harmonics 3": [*D1, "motion.harmonics=3"],
    "D1, jerk 60": [*D1, JERK],
    "D1, period 3": [*D1, "motion.period_s=3"],
}
# runs in either tree: one line of JSON for each start
SEARCH = """
import importlib, json, sys, time
import numpy as np
import gtmodel as gt
from gtmodel.identify.excitation.information import condition
from gtmodel.identify.excitation.search import random_excitations
from gtmodel.identify.excitation.task import plan_of
module = importlib.import_module("gtmodel.identify.excitation.search")
path, starts, ipopt, *settings = sys.argv[1:]
call = gt.load(path, *settings)
(robot, motion, limits), options = call.arguments, call.options
plan = plan_of(robot, motion, limits, options["experiment"], options["search"].criterion)
task, seed = plan.task, options["random"].seed
draws = random_excitations(task, plan.centre, options["random"].draws, seed)
def conditioned(c): return condition(task.stacked(c, plan.times[:-1], plan.sharp), plan.regressor.nominal)
last = []
if hasattr(module, "interior_point"):
    search = module.interior_point
    def seen(rows, *a, **k):
        run = search(rows, *a, **k)
        last[:] = rows, run
        return run
    module.interior_point = seen
for c in sorted(draws, key=conditioned)[: int(starts)]:
    began = time.process_time()
    e = module.optimise_excitation(task, c)
    row = {"cost": e.objective, "condition": conditioned(e.c), "seconds": time.process_time() - began}
    row |= {"ok": e.status.ok and e.feasible, "message": e.message}
    if ipopt == "True":
        from tests.bench.bench_excitation import by_ipopt
        row["ipopt"] = last[1].objective - by_ipopt(task, last[0].reserve, last[1].x)
    print(json.dumps(row), flush=True)
"""


def by_ipopt(task: Any, reserve: np.ndarray, x: np.ndarray) -> float:
    """The least cost that IPOPT finds from unknowns x, where no row of the samples is broken."""
    import casadi as ca  # the search runs in another process

    from tests.identify.test_excitation import by_traces

    n, d, p = task.points, task.dimension, len(task.nominal)
    unknown = ca.MX.sym("c", len(x))
    c = ca.reshape(unknown, -1, d)
    orders = task.rows.n_in()
    motion = [ca.mtimes(ca.DM(task.basis.rows(task.times(), k)), c).T for k in range(orders)]
    at = [ca.SX.sym(name, d) for name in ("x", "v", "a", "j")[:orders]]
    Y = ca.mtimes(task.regressor(*at[:3]), ca.diag(ca.DM(task.nominal)))
    information = ca.Function("information", at[:3], [ca.mtimes(Y.T, Y) / (n * Y.shape[0])], {"cse": True})
    rows = ca.Function("rows", at, [task.rows(*at) / ca.DM(task.size)], {"cse": True})
    M = ca.reshape(ca.sum2(ca.reshape(information.map(n)(*motion[:3]), p * p, n)), p, p)
    f, g = by_traces(task.criterion, p)(M), ca.vec(rows.map(n)(*motion))
    near = dict.fromkeys(("bound_push", "bound_frac", "slack_bound_push", "slack_bound_frac"), 1e-7)
    options = {"print_level": 0, "sb": "yes", "tol": 1e-6, "max_iter": 60, "mu_init": 1e-6, **near}
    solver = ca.nlpsol("oracle", "ipopt", {"x": unknown, "f": f, "g": g}, {"ipopt": options, "print_time": False})
    low, high = (np.tile(b / task.size + s * reserve, n) for b, s in ((task.low, 1), (task.high, -1)))
    result = solver(x0=x, lbg=low, ubg=high)
    if not solver.stats()["success"]:
        raise SystemExit(f"IPOPT: {solver.stats()['return_status']}")
    return float(result["f"])


def searched(tree: Path, settings: list[str], starts: int, ipopt: bool = False) -> list[dict[str, Any]]:
    one = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    # the problem is that of this tree, for both
    command = [
        sys.executable,
        "-c",
        SEARCH,
        str(OWN / "problems" / f"{PROBLEM}.toml"),
        str(starts),
        str(ipopt),
        *settings,
    ]
    env = {**os.environ, **one, "PYTHONPATH": str(tree)}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=env, cwd=tree)
    if done.returncode:
        raise SystemExit(f"{settings} in {tree}: {done.stderr.strip().splitlines()[-1:]}")
    return [json.loads(line) for line in done.stdout.splitlines()]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--other", type=Path, help="the tree to be compared with")
    parser.add_argument("--starts", type=int, default=1)
    parser.add_argument("--ipopt", action="store_true", help="start IPOPT from our answers")
    parser.add_argument("settings", nargs="*", default=list(SETTINGS))
    options = parser.parse_args()
    print("| setting | start | cost | condition | seconds | before: cost | condition | seconds | IPOPT lower by |")
    print("|---|---:|---:|---:|---:|---:|---:|---:|---:|", flush=True)
    pairs, bettered, good = [], [], True
    for name in options.settings:
        ours = searched(OWN, SETTINGS[name], options.starts, options.ipopt)
        theirs = searched(options.other, SETTINGS[name], options.starts) if options.other else [None] * len(ours)
        for k, (a, b) in enumerate(zip(ours, theirs, strict=True)):
            good = good and a["ok"]
            before = "| | | " if b is None else f"| {b['cost']:.3f} | {b['condition']:.0f} | {b['seconds']:.1f} "
            more = f"{a['ipopt']:.1e}" if options.ipopt else ""
            print(
                f"| {name} | {k + 1} | {a['cost']:.3f} | {a['condition']:.0f} | {a['seconds']:.1f} {before}| {more} |",
                flush=True,
            )
            pairs += [] if b is None else [(a["cost"] - b["cost"], np.log(a["condition"] / b["condition"]))]
            bettered += [a["ipopt"]] if options.ipopt else []
    if pairs:
        cost, log = np.array(pairs).T
        print(
            f"\n{len(cost)} searches: cost {np.mean(cost):+.3f} in the mean, {np.median(cost):+.3f} in the median, "
            f"{np.min(cost):+.3f} to {np.max(cost):+.3f}; lower by 0.01 or more in {np.sum(cost < -0.01)}, higher in "
            f"{np.sum(cost > 0.01)}; condition number times {np.exp(np.mean(log)):.3f} in the geometric mean"
        )
    if bettered:
        print(f"\nIPOPT improves our optima by at most {max(bettered):.1e} of the cost")
    return 0 if good else 1


if __name__ == "__main__":
    raise SystemExit(main())
