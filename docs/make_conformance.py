"""Write conformance.md beside this file from tests/suites/conformance.toml and the solver: `make conformance`.

The data file is what the tests check; the table shows it beside what the solver gives.
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

Does the optimiser find the right answer? Here are optimal control problems whose optimum is known from somewhere
else: a closed form, a published value, or a value that another tool's own tests assert. Where it comes from another
tool's test, it was computed again independently, without gtmodel, on the same mesh. Each row gives the known cost,
the tolerance that a test holds it to, and what gtmodel finds. A simulation with a known answer stands at the end.

To repeat it: `make conformance` solves all of them and writes this page, in some seconds on any PC; no number here is
a time, so that the machine does not matter. The rows are kept in `tests/suites/conformance.toml`, the problems in
`tests/optimize/problems.py`, and `tests/optimize/test_conformance.py` checks them at every `make test`. The
column *computed* has seven digits: those behind them depend on the processor and on the version of IPOPT.

*Mesh*: elements x points, Radau unless it says gauss; a control polynomial per element, bounded at its points. *Known*:
where the mesh is the same, so are the digits, to 1e-6; a value of the continuous problem, or one printed with few
digits, has the tolerance that the mesh or the print loses. *Differs*: relative, rounded up to a power of ten,
1e-07 at the least.

"""
# relative: below it a cost depends on the processor and on the version of IPOPT
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
    """Lines of the table for the costs that the solver found, in the order of the data file."""
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
    """Lines of the second table: what is simulated."""
    rows = tomllib.loads(DATA.read_text(encoding="utf-8"))["simulation"]
    lines = ["| simulation | integrator tolerance | against | within [m] |", "|---|---:|---|---:|"]
    lines += [f"| {r['problem']} | {r['tolerance']:g} | {r['source']} | {r['below']:g} |" for r in rows]
    return lines


def main() -> int:
    """Solve all rows and write the page; 1 where a row misses its tolerance, and the page stays as it was."""
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
