"""Write docs/conformance.md from tests/suites/conformance.toml and the solver: `make conformance`.

The tests check the data file; the table compares it with the solver's results.
"""

from __future__ import annotations

import inspect
import sys
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from gtmodel.simulation import simulate
from tests.optimize import problems
from tests.optimize.test_conformance import SUITE, solved
from tests.support.models import Pendulum

HERE = Path(__file__).resolve().parent
DATA = HERE.parent / "tests" / "suites" / "conformance.toml"
PAGE = HERE / "conformance.md"
HEAD = """\
# Conformance

Does the optimiser find the right answer? This page lists optimal control problems whose optimum is known
independently: from a closed form, a published value, or the tests of another tool. Values from another tool's tests
were recomputed on the same mesh without gtmodel. Each row gives the known cost, the tolerance of the test, and the cost
that gtmodel finds. A simulation with a known answer is at the end.

`make conformance` solves all problems in some seconds and writes this page. It contains no times, so it does not depend
on the speed of the machine. The rows come from `tests/suites/conformance.toml`, the problems from
`tests/optimize/problems.py`; `tests/optimize/test_conformance.py` checks them in every `make test`. The column
*computed* has seven digits, because further ones depend on the processor and on the version of IPOPT.

*Mesh*: elements x points, Radau unless marked gauss; the control is a polynomial on each element, bounded at its
points. *Known* and *within*: on the same mesh the values agree to 1e-6; for a value of the continuous problem, or one
printed with few digits, the tolerance covers what the mesh or the print loses. *Differs*: relative, rounded up to a
power of ten, at least 1e-07.

"""
# relative; smaller differences of a cost depend on the processor and on the version of IPOPT
REPRODUCIBLE = 1e-7
COLUMNS = ("problem", "class", "mesh", "options", "known", "within", "known from", "computed", "differs")


def known_cells(row: dict[str, Any]) -> list[str]:
    """The cells of a row that come from the data file."""
    problem = getattr(problems, row["problem"])
    text = (inspect.getdoc(problem) or "").split("\n")[0].rstrip(".").replace("|", "\\|")
    options = [f"{k} = {v}" for k, v in row.get("solver", {}).items()]
    if "guess" in row:
        options.append("guess by " + ("a line" if "brachistochrone" in row["guess"] else "simulation"))
    known, within = repr(row["objective"]), f"{row['relative']:g}"
    return [text, row["problem"], row["mesh"], ", ".join(options), known, within, row["source"]]


def _differs(found: float, known: float) -> str:
    relative = abs(found / known - 1)
    return f"1e{int(np.ceil(np.log10(max(relative, REPRODUCIBLE)))):+03d}"


def table(computed: list[float]) -> list[str]:
    """Lines of the table for the costs found by the solver, in the order of the data file."""
    lines = ["| " + " | ".join(COLUMNS) + " |", "|---|---|---|---|---:|---:|---|---:|---:|"]
    for row, value in zip(SUITE, computed, strict=True):
        cells = [*known_cells(row), f"{value:.7g}", _differs(value, row["objective"])]
        lines.append("| " + " | ".join(cells) + " |")
    return lines


def pendulum_distance(tolerance: float) -> float:
    """Largest distance [m] between the Cartesian pendulum and the angle model over ten seconds."""
    run = simulate(Pendulum(), 10.0, start={"x": 1.0}, tolerance=tolerance)
    options = dict(rtol=1e-13, atol=1e-13, t_eval=run.trajectory.time)
    phi = solve_ivp(lambda _, y: [y[1], -9.81 * np.sin(y[0])], (0.0, 10.0), [np.pi / 2, 0.0], "DOP853", **options).y[0]
    return float(np.max(np.hypot(run.trajectory["x"] - np.sin(phi), run.trajectory["y"] + np.cos(phi))))


def simulations() -> list[str]:
    """Lines of the second table, the simulations."""
    rows = tomllib.loads(DATA.read_text(encoding="utf-8"))["simulation"]
    lines = ["| simulation | integrator tolerance | against | within [m] |", "|---|---:|---|---:|"]
    lines += [f"| {r['problem']} | {r['tolerance']:g} | {r['source']} | {r['below']:g} |" for r in rows]
    return lines


def main() -> int:
    """Solve all rows and write the page. If a row misses its tolerance, return 1 and leave the page unchanged."""
    computed = [solved(row).objective for row in SUITE]
    for row, value in zip(SUITE, computed, strict=True):
        if abs(value - row["objective"]) > row["relative"] * abs(row["objective"]):
            print(f"{row['problem']} {row['mesh']}: found {value:.10g}; expected {row['objective']!r}", file=sys.stderr)
            return 1
    for row in tomllib.loads(DATA.read_text(encoding="utf-8"))["simulation"]:
        if pendulum_distance(row["tolerance"]) > row["below"]:
            print(f"{row['problem']}: off by more than {row['below']:g} m", file=sys.stderr)
            return 1
    lines = [*table(computed), "", *simulations()]
    PAGE.write_text(HEAD + "\n".join(lines) + "\n", encoding="utf-8", newline="\n")
    print(f"{PAGE.name}: {len(SUITE)} optima")
    return 0


if __name__ == "__main__":
    sys.exit(main())
