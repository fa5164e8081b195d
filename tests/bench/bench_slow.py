"""The slow problems from two trees, interleaved: waiting time of a user now and before.

OMP_NUM_THREADS=1 python tests/bench/bench_slow.py [--other TREE] [--runs N] [PROBLEM ...]

Each solve is a process of its own with an empty cache of compiled code; its time is processor time, children (gcc)
counted. Of l1_min_time what its two optimisations take is measured apart. Prints Markdown; without another tree the
times of this one alone, which say nothing of fast or slow.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import median

OWN = Path(__file__).resolve().parents[2]
SLOW = ("f1_path", "plan_calibration_f1", "d1_six_link_line", "f1_motion", "excitation_l1")
SPLIT = "l1_min_time"
TARGET = 2.0
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
        command = [sys.executable, *how, "solve", file, "--out", f"{folder}/out"]
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
    options = parser.parse_args()
    if options.other is None:
        print("| problem | now [s] |\n|---|---:|", flush=True)
        for problem in options.problems:
            print(f"| {problem} | {median(seconds(OWN, problem)[0] for _ in range(options.runs)):.1f} |", flush=True)
        return 0
    print("| problem | before [s] | now [s] | ratio | at least | |\n|---|---:|---:|---:|---:|---|", flush=True)
    good = True
    for problem in options.problems:
        runs = [(seconds(options.other, problem), seconds(OWN, problem)) for _ in range(options.runs)]
        before, now = (median(r[n][0] - r[n][1] for r in runs) for n in (0, 1))
        ratio = median((a - x) / (b - y) for (a, x), (b, y) in runs)
        good &= ratio >= TARGET
        title = f"{problem}, without its optimisations" if problem == SPLIT else problem
        verdict = "pass" if ratio >= TARGET else "MISSED"
        print(f"| {title} | {before:.1f} | {now:.1f} | {ratio:.2f} | {TARGET:g} | {verdict} |", flush=True)
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
