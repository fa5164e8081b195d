"""Time-optimal motion of the L1 prototype: gtmodel's collocation beside plain CasADi, rockit and Pyomo.dae.

Prints Markdown. One process, one thread, processor times, runs interleaved, medians; all methods have the same points,
guess, tolerance and IPOPT options, and a ratio is given only where the optimum is the same to SAME. Ends with 1 where a
ratio misses its target. A rival that is not installed (`pip install '.[bench]'`) is named in a sentence and left out.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib.util
import multiprocessing
import os
import resource
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from statistics import median
from unittest.mock import patch

from gtmodel.compiler import toolchain
from gtmodel.compiler.columns import kernel
from gtmodel.compiler.tape.machine import interpreter
from tests.bench.rivals.l1_by_hand import Motion
from tests.bench.rivals.plain_casadi import solve_mx, solve_sx
from tests.bench.rivals.timing import Result
from tests.bench.rivals.with_gtmodel import compile_seconds, declared, solve_blocks
from tests.bench.rivals.with_pyomo import solve_pyomo
from tests.bench.rivals.with_rockit import solve_rockit

ELEMENTS, WEIGHTS, RUNS = 50, (0.0, 0.001, 0.01), 5
MESHES = (25, 50, 100, 200, 400)
SAME = 1e-4  # relative, of the cost: two local optima lie nearer than a method's own error only by chance
# (rival, ours) -> at least, the median over the weights, and at each of them
TARGETS = {("SX", "vm"): 1.8, ("rockit", "vm constant"): 4.0, ("SX", "C"): 2.5, ("rockit", "C constant"): 6.0}
EACH = {("SX", "vm"): 2.2, ("SX", "C"): 3.0}
SETUP_TARGET = 20.0
TITLES = {
    "vm": "gtmodel",
    "bare": "gtmodel, no C compiler",
    "C": "gtmodel, compiled C",
    "SX": "plain CasADi, SX",
    "MX": "CasADi, MX map of an SX element",
    "pyomo": "Pyomo.dae, lifted by hand",
    "vm constant": "gtmodel, constant force",
    "C constant": "gtmodel, constant force, compiled C",
    "rockit": "rockit, constant force",
}
RIVALS = {
    "vm": ("SX", "MX", "pyomo"),
    "bare": ("SX", "MX", "pyomo"),
    "C": ("SX", "MX", "pyomo"),
    "vm constant": ("rockit",),
    "C constant": ("rockit",),
}
OVER = {"vm": "over gtmodel", "bare": "over no compiler", "C": "over C"}
Method = Callable[[int], Result]


def methods(motion: Motion) -> dict[str, Method]:
    """Everyone's method from the number of elements to a result."""
    model = declared(motion)
    found: dict[str, Method] = {}
    for control, suffix in (("polynomial", ""), ("constant", " constant")):
        for name, machine_code in (("vm", False), ("C", True)):
            if machine_code and isinstance(toolchain.find(), str):
                continue
            found[name + suffix] = partial(_ours, motion, model, control, machine_code)
    found["bare"] = partial(_without_compiler, motion, model)
    found |= {"SX": partial(solve_sx, motion), "MX": partial(solve_mx, motion)}
    for module, name, method in (("pyomo", "pyomo", solve_pyomo), ("rockit", "rockit", solve_rockit)):
        if importlib.util.find_spec(module):
            found[name] = partial(method, motion)
    return found


def _ours(motion: Motion, model, control: str, machine_code: bool, elements: int) -> Result:
    return solve_blocks(motion, model, elements, control, machine_code)


def _without_compiler(motion: Motion, model, elements: int) -> Result:
    with patch.object(kernel, "interpreter", lambda build: None):
        return _ours(motion, model, "polynomial", False, elements)


def interpreter_seconds() -> float:
    """Processor time of the compiler for the interpreter, which is built once on a machine."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    interpreter(True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


@contextlib.contextmanager
def quiet():
    """Solvers write where Python does not see it; their last words come where something fails."""
    sys.stdout.flush()
    with tempfile.TemporaryFile() as sink:
        kept = os.dup(1), os.dup(2)
        for to in (1, 2):
            os.dup2(sink.fileno(), to)
        try:
            yield
        finally:
            sys.stdout.flush()
            for to, fd in zip((1, 2), kept, strict=True):
                os.dup2(fd, to)
                os.close(fd)


def spread(values: list[float]) -> str:
    return f"{median(values):.2f} ({min(values):.2f}-{max(values):.2f})"


def compare(weight: float, runs: int, met: dict[tuple[str, str], list[float]]) -> None:
    """One table: all methods at one weight of the energy."""
    motion = Motion(weight)
    assert len(motion.guess.time)  # robot and guess are made before any clock runs
    model_seconds = compile_seconds(motion)
    found: dict[str, list[Result]] = {}
    with quiet():
        all_methods = methods(motion)
        compiled = sum(all_methods[name](ELEMENTS).compile for name in ("C", "C constant") if name in all_methods)
        for _ in range(runs):
            for name, method in all_methods.items():
                found.setdefault(name, []).append(method(ELEMENTS))
    columns = ("cost", "iterations", "set-up [s]", "solve [s]", "total [s]", *OVER.values())
    print(f"\n| weight {weight:g}, {ELEMENTS} elements | {' | '.join(columns)} |")
    print(f"|---|{'---:|' * len(columns)}")
    for name in [n for n in TITLES if n in found]:
        results, cells = found[name], []
        for own in OVER:
            ours = next((o for o in (own, f"{own} constant") if name in RIVALS.get(o, ())), None)
            cells.append(_ratio(found, name, ours, met) if ours in found else "")
        first = results[0]
        print(
            f"| {TITLES[name]} | {first.objective:.6f} | {first.iterations} | {median(r.setup for r in results):.2f} | "
            f"{median(r.solve for r in results):.2f} | {spread([r.total for r in results])} | {' | '.join(cells)} |"
        )
    machine_code = f", C for both controls in {compiled:.1f} s by the clock" if compiled else ""
    print(f"\nOnce: the model compiled in {model_seconds:.2f} s{machine_code}.")
    checks = [1e3 * median(r.check for r in found[name]) for name in found if name in RIVALS]
    print(f"Not in the totals: the estimate of the error, {min(checks):.0f} to {max(checks):.0f} ms of each solution.")


def _ratio(found: dict[str, list[Result]], rival: str, ours: str, met: dict[tuple[str, str], list[float]]) -> str:
    a, b = found[rival], found[ours]
    if not all(r.converged for r in (*a, *b)):
        return "not solved"
    if abs(a[0].objective - b[0].objective) > SAME * abs(b[0].objective):
        return "another optimum"
    ratio = median(x.total / y.total for x, y in zip(a, b, strict=True))
    met.setdefault((rival, ours), []).append(ratio)
    return f"{ratio:.1f}"


def peak_memory() -> float:
    """Peak resident memory of this process [MB]; NaN where /proc does not tell."""
    with contextlib.suppress(OSError, StopIteration):  # ru_maxrss would keep the parent's peak across exec
        lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
        return int(next(line for line in lines if line.startswith("VmHWM")).split()[1]) / 1024
    return float("nan")


def _measured(weight: float, name: str, elements: int) -> tuple[Result, float]:
    """In a process of its own: the result, and how far the memory rose [MB]."""
    motion = Motion(weight)
    method = {"vm": partial(_ours, motion, declared(motion), "polynomial", False), "SX": partial(solve_sx, motion)}[
        name
    ]
    method(2)
    before = peak_memory()
    with quiet():
        result = method(elements)
    return result, peak_memory() - before


def curve(weight: float, meshes: tuple[int, ...]) -> float:
    """Set-up, solve and memory over the mesh; the ratio of the set-ups on the finest."""
    columns = "elements | cost | iterations | set-up [s] | solve [s] | error estimate [s] | memory [MB]"
    print(f"\n| weight {weight:g} | {columns} |")
    print("|---|---:|---:|---:|---:|---:|---:|---:|")
    setups: dict[str, float] = {}
    for name in ("vm", "SX"):
        for elements in meshes:
            with multiprocessing.get_context("spawn").Pool(1) as pool:
                r, memory = pool.apply(_measured, (weight, name, elements))
            setups[name] = r.setup
            print(
                f"| {TITLES[name]} | {elements} | {r.objective:.6f} | {r.iterations} | {r.setup:.2f} | {r.solve:.2f} | "
                f"{f'{r.check:.3f}' if r.check else ''} | {memory:.0f} |"
            )
    return setups["SX"] / setups["vm"]


def verdicts(met: dict[tuple[str, str], list[float]], setup: float | None) -> bool:
    print("\n| total time, median over the weights | ratio | at least | |\n|---|---:|---:|---|")
    rows = [(f"{TITLES[a]} over {TITLES[b]}", met[a, b], t) for (a, b), t in TARGETS.items() if (a, b) in met]
    if setup is not None:
        rows.append((f"set-up on {MESHES[-1]} elements, {TITLES['SX']} over {TITLES['vm']}", [setup], SETUP_TARGET))
    good = True
    for title, ratios, target in rows:
        good &= (passed := median(ratios) >= target)
        shown = f"{median(ratios):.1f} ({min(ratios):.1f}-{max(ratios):.1f})"
        print(f"| {title} | {shown} | {target:g} | {'pass' if passed else 'MISSED'} |")
    for (a, b), target in EACH.items():
        if (a, b) in met:
            good &= (passed := min(met[a, b]) >= target)
            shown = f"{min(met[a, b]):.2f}"
            print(f"| {TITLES[a]} over {TITLES[b]}, least | {shown} | {target:g} | {'pass' if passed else 'MISSED'} |")
    return good


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=RUNS, help="interleaved runs of each method")
    parser.add_argument("--no-curve", action="store_true", help="leave out the curve over the mesh")
    options = parser.parse_args()
    for module, title in (("rockit", "rockit"), ("pyomo", "Pyomo")):
        if importlib.util.find_spec(module) is None:
            print(f"{title} is not installed, so it is not compared: pip install '.[bench]' brings it.")
    if isinstance(lacking := toolchain.find(), str):
        print(f"Compiled C and the interpreter are left out: {lacking}.")
    print(f"Medians of {options.runs} interleaved runs, processor seconds, range of the total; ratios run by run.")
    met: dict[tuple[str, str], list[float]] = {}
    with tempfile.TemporaryDirectory() as folder:
        os.environ["GTMODEL_CACHE"] = folder
        if not isinstance(lacking, str):
            print(f"Once on a machine: the interpreter in C, {interpreter_seconds():.1f} s of the compiler.")
        for weight in WEIGHTS:
            compare(weight, options.runs, met)
        setup = None if options.no_curve else curve(WEIGHTS[1], MESHES)
    return 0 if verdicts(met, setup) else 1


if __name__ == "__main__":
    sys.exit(main())
