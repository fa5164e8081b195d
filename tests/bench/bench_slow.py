"""The slow problems from two trees, interleaved: waiting time of a user now and before.

OMP_NUM_THREADS=1 python tests/bench/bench_slow.py [--other TREE] [--runs N] [--all] [PROBLEM ...]

Each solve is a process of its own with an empty cache of compiled code; its time is processor time, children (gcc)
counted. Of l1_min_time what its two optimisations take is measured apart. Prints Markdown; without another tree the
times of this one alone, which say nothing of fast or slow. --all: every shipped problem, then the slowest ten of the
other tree and the sums; problems that the other tree lacks, or whose recordings are not shipped, are left out.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path
from statistics import median

OWN = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(OWN))
SLOW = ("f1_path", "d1_six_link_line", "d1_six_link_motion", "plan_calibration_f1", "feedback_l1", "feedback_map_kr500",
        "feedback_pose_19", "fusion_5_axis", "learning_l1", "learning_case_1", "learning_case_2a", "learning_case_2b",
        "learning_case_3", "learning_identified", "lead_through_plate")  # fmt: skip
SPLIT = "l1_min_time"
SHIPPED = sorted(p.stem for p in (OWN / "problems").glob("*.toml"))
TARGET, THIRD = 2.0, 3.0  # goals of issue 46 against the tree of its day


def target(problem: str) -> float:
    """How many times faster than the other tree a problem should be."""
    return THIRD if problem.startswith(("fusion_5", "learning", "lead_through")) else TARGET


# solves as the command does, and says on the last line how long the optimisations took
TIMED = """
import sys, time
from importlib import import_module  # `import ... as` would give the function of the same name
ipopt, solve = import_module("gtmodel.optimize.ipopt"), import_module("gtmodel.optimize.solve")
taken, run = [], ipopt.run_ipopt
def timed(*a, **k):
    began = time.process_time()
    try:
        return run(*a, **k)
    finally:
        taken.append(time.process_time() - began)
solve.run_ipopt = timed
from runpy import run_module
try:
    run_module("gtmodel", run_name="__main__")
finally:
    print("optimisations", sum(taken), file=sys.stderr)
"""


def seconds(tree: Path, problem: str) -> tuple[float, float]:
    """Processor time of one solve, and of its optimisations where that is asked for."""
    with tempfile.TemporaryDirectory() as folder:
        one = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MPLBACKEND": "Agg"}
        env = {**os.environ, **one, "PYTHONPATH": str(tree), "GTMODEL_CACHE": f"{folder}/cache"}
        how = ["-c", TIMED] if problem == SPLIT else ["-m", "gtmodel"]
        file = str(tree / "problems" / f"{problem}.toml")
        code = tomllib.loads(Path(file).read_text())["kind"] == "codegen"
        what = ["codegen", file, "-o"] if code else ["solve", file, "--out"]
        command = [sys.executable, *how, *what, f"{folder}/out"]
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        done = subprocess.run(command, capture_output=True, text=True, check=False, env=env, cwd=tree)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        if done.returncode:
            raise SystemExit(f"{problem} in {tree}: {done.stderr.strip().splitlines()[-1:]}")
        total = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        words = done.stderr.strip().splitlines()[-1].split() if problem == SPLIT else ["", "0"]
        return total, float(words[1])


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--other", type=Path, help="the tree to be compared with")
    parser.add_argument("problems", nargs="*", default=[*SLOW, SPLIT])
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--all", action="store_true", help="every shipped problem")
    options = parser.parse_args()
    if options.all:
        from tests.support.recordings import NOT_SHIPPED

        there = options.other or OWN
        options.problems = [n for n in SHIPPED if n not in NOT_SHIPPED and (there / "problems" / f"{n}.toml").exists()]
    if options.other is None:
        print("| problem | now [s] |\n|---|---:|", flush=True)
        for problem in options.problems:
            print(f"| {problem} | {median(seconds(OWN, problem)[0] for _ in range(options.runs)):.1f} |", flush=True)
        return 0
    print("| problem | before [s] | now [s] | ratio | at least | |\n|---|---:|---:|---:|---:|---|", flush=True)
    good, table = True, list[tuple[float, float, str]]()
    for problem in options.problems:
        runs = [(seconds(options.other, problem), seconds(OWN, problem)) for _ in range(options.runs)]
        before, now = (median(r[n][0] - r[n][1] for r in runs) for n in (0, 1))
        ratio = median((a - x) / (b - y) for (a, x), (b, y) in runs)
        good &= ratio >= target(problem)
        table.append((before, now, problem))
        title = f"{problem}, without its optimisations" if problem == SPLIT else problem
        verdict = "pass" if ratio >= target(problem) else "MISSED"
        print(f"| {title} | {before:.1f} | {now:.1f} | {ratio:.2f} | {target(problem):g} | {verdict} |", flush=True)
    for title, rows in (("the slowest ten", sorted(table, reverse=True)[:10]), ("all of these", table)):
        before, now = sum(row[0] for row in rows), sum(row[1] for row in rows)
        names = ", ".join(row[2] for row in rows[:10])
        print(f"| {title} ({len(rows)}): {names} | {before:.1f} | {now:.1f} | {before / now:.2f} |||")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
