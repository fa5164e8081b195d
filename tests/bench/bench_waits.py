"""What stands around the numbers: commands that a person waits for, and small fits, beside their goals of issue 46,
and first calls.

OMP_NUM_THREADS=1 python tests/bench/bench_waits.py [--other TREE] [NAME ...]

Processor time, children (gcc) counted; with another tree each run is followed by one of that tree. Commands run in
processes of their own with an empty cache of compiled code. The small fit stands beside SciPy's `lm` in one process.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

OWN = Path(__file__).resolve().parents[2]
FIT = """
import sys
import tests.bench.bench_calibrate as b
from scipy.optimize import least_squares
m = b.measured("three_link", 100, b.NOISE, 0, known=False)
p = b.prepare(b.true_robot("three_link"), m)
x, q, T = b.start_of(p), m.values["q"], m.values["T"]
start = dict(zip(p.unknowns.names, x, strict=True))
t, _ = b.least({
    "ours": lambda: b.calibrate(p, cost="squared", start=start, confidence=False),
    "lm": lambda: least_squares(
        lambda x: b.by_hand.residual(x, q, T), x, lambda x: b.by_hand.jacobian(x, q, T), method="lm", x_scale=1.0),
}, 60)
print(t["ours"] / t["lm"])
"""
FMU = """
import time
import gtmodel as gt
class CartPole(gt.Model):
    g = gt.parameter(9.81, unit="m/s2")
    M = gt.parameter(1.0, unit="kg", positive=True)
    m = gt.parameter(0.3, unit="kg", positive=True)
    L = gt.parameter(0.5, unit="m", positive=True)
    x = gt.variable(unit="m", start=0.0)
    phi = gt.variable(unit="rad", start=0.3)
    F = gt.variable(unit="N")
    def equations(self):
        c, s, turned = gt.cos(self.phi), gt.sin(self.phi), gt.der(self.phi, 2)
        force = (self.M + self.m) * gt.der(self.x, 2) + self.m * self.L * (turned * c - gt.der(self.phi) ** 2 * s)
        yield force == self.F
        yield self.L * turned + gt.der(self.x, 2) * c == self.g * s
begun = time.process_time()
gt.fmu.export(CartPole(), None, known="F", targets=["x", "phi"], name="cart", start={"F": 0.0})
print(time.process_time() - begun)
"""
RUN = """
import time
import gtmodel as gt
class Decay(gt.Model):
    x = gt.variable(start=1.0)
    def equations(self):
        yield gt.der(self.x) == -self.x
gt.simulate(Decay(), 1.0)  # imports
robot = gt.robots.gantry_tau("l1_tape")
def run(k):
    begun = time.process_time()
    start = {"T": robot.home, "der(T)": [0.0, 0.0, 0.0]}
    gt.simulate(robot.with_(m_p=40.0 + k), 0.1, inputs={"tau": [0.0, 0.0, 0.0]}, start=start, tunable="m_p")
    return 1e3 * (time.process_time() - begun)
times = [run(k) for k in range(20)]
"""
CALL = """
import time
import numpy as np
import gtmodel as gt
class Line(gt.Model):
    x = gt.variable(start=1.0)
    y = gt.variable(start=1.0)
    def equations(self):
        yield self.y == 2 * self.x
Line().causal("x", "y")(1.0)  # imports
begun = time.process_time()
robot = gt.robots.gantry_tau("l1_tape")
"""
FIRST = f"{CALL}robot.causal('T', 'q')(robot.home)\nprint(1e3 * (time.process_time() - begun))"
MASSES = f"""{CALL}
f, zero = robot.causal("T", "tau", tunable="m_p"), np.zeros(3)
f(robot.home, zero, zero, 9.0)
begun = time.process_time()
for k in range(1000):
    f(robot.home, zero, zero, 9.0 + 0.1 * k)
print(time.process_time() - begun)
"""
MOTION = f"""{CALL}
from gtmodel.motion import Limits, study
study(robot, robot.home.tolist(), (robot.home + [0.1, 0.3, 0.2]).tolist(), limits=Limits(700.0))
print(1e3 * (time.process_time() - begun))
"""
MODES = """
import time
from gtmodel.kinematics.assembly_modes import assembly_modes_batch
from tests.bench.bench_modes import cases
legs, times = cases()["F1, alone"], []
for _ in range(10):
    begun = time.process_time()
    assembly_modes_batch(*legs)
    times.append(1e3 * (time.process_time() - begun))
"""
SOLVED = ("l1", "f1", "hexapod", "delta", "arm", "d1_model_5")
# name: (arguments of gtmodel, or a script that prints its number, goal of the issue)
WAITS: dict[str, tuple[list[str] | str, float | None]] = {
    "small fit over lm": (FIT, 2.0),
    "export of four states": (FMU, 2.0),
    "fresh L1 to the first row [ms]": (f"{RUN}print(times[0])", 250.0),
    "fresh L1 to its first inverse kinematics [ms]": (FIRST, None),
    "fresh L1 to its first optimal motion [ms]": (MOTION, None),
    "forces for another m_p, tunable [ms]": (MASSES, 20.0),
    "a run of with_(m_p=...), tunable [ms]": (f"{RUN}print(min(times[1:]))", 20.0),
    "all assembly modes of the F1 [ms]": (f"{MODES}print(min(times[1:]))", 20.0),
    **{f"solve calibrate_{n}": (["solve", f"problems/calibrate_{n}.toml"], 4.0) for n in SOLVED},
    "check of D1": (["codegen", "problems/d1_controller.toml", "--check"], 6.0),
    "check of F1": (["codegen", "problems/f1_controller.toml", "--check"], 6.0),
}


def measured(tree: Path, what: list[str] | str) -> float:
    """Seconds of a command, or the number that a script prints."""
    with tempfile.TemporaryDirectory() as folder:
        env = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MPLBACKEND": "Agg"}
        env |= {"PYTHONPATH": str(tree), "GTMODEL_CACHE": f"{folder}/cache"}
        script = isinstance(what, str)
        command = [sys.executable, str(Path(folder) / "wait.py")] if script else [
            sys.executable, "-m", "gtmodel", *what, "--quiet", "--out", f"{folder}/out"]  # fmt: skip
        if script:
            (Path(folder) / "wait.py").write_text(what)
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        done = subprocess.run(command, capture_output=True, text=True, check=False, env=env, cwd=tree)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        if done.returncode:
            raise SystemExit(f"{what} in {tree}: {done.stderr.strip().splitlines()[-1:]}")
        return float(done.stdout) if script else after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--other", type=Path, help="the tree to be compared with")
    parser.add_argument("--runs", type=int, default=2)
    parser.add_argument("names", nargs="*", default=[])
    options = parser.parse_args()
    good = True
    print("| what | now | before | ratio | goal | |\n|---|---:|---:|---:|---:|---|", flush=True)
    for name, (what, goal) in WAITS.items():
        if options.names and name not in options.names:
            continue
        trees = [OWN, *([options.other.resolve()] if options.other else [])]
        runs = [[measured(tree, what) for tree in trees] for _ in range(options.runs)]
        now, *before = (min(each) for each in zip(*runs, strict=True))
        good &= goal is None or now <= goal
        old, ratio = (f"{before[0]:.1f}", f"{before[0] / now:.1f}") if before else ("", "")
        verdict = "| | |" if goal is None else f"| {goal:g} | {'pass' if now <= goal else 'MISSED'} |"
        print(f"| {name} | {now:.3g} | {old} | {ratio} {verdict}", flush=True)
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
