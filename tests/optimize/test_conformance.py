"""Problems with known optima, declared in tests/suites/conformance.toml."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

from gtmodel.optimize import Mesh, Phases, SolverOptions, solve, solve_phases
from tests.optimize import problems

SUITE = tomllib.loads((Path(__file__).parents[1] / "suites" / "conformance.toml").read_text(encoding="utf-8"))["row"]
# Two roads to one discrete optimum: IPOPT stops at 1e-8 of the scaled conditions, and relaxes bounds by as much.
SOLVER = 1e-6


def mesh_of(text: str) -> Mesh:
    size, _, scheme = text.partition(" ")
    elements, points = map(int, size.split("x"))
    return Mesh(elements, points, scheme or "radau")


def solved(row: dict[str, Any], **changes: Any) -> Any:
    """The solution of a row, after small changes to it."""
    row = {**row, **changes}
    guess = getattr(problems, row["guess"])() if "guess" in row else None
    options = SolverOptions(**row.get("solver", {}))
    problem = getattr(problems, row["problem"])()
    road = solve_phases if isinstance(problem, Phases) else solve
    return road(problem, mesh_of(row["mesh"]), guess=guess, solver=options)


def title(row: dict[str, Any]) -> str:
    return " ".join([row["problem"], row["mesh"], *row.get("solver", {}).values()])


@pytest.mark.parametrize("row", [pytest.param(r, id=title(r)) for r in SUITE])
def test_optimum(row):
    solution = solved(row)
    assert solution.objective == pytest.approx(row["objective"], rel=row["relative"])
    parts = solution.phases.values() if "phases" in row["problem"] else [solution]
    assert all(s.checks["constraint_violation"].passed for s in parts)


def test_rows_are_complete():
    for row in SUITE:
        assert {"problem", "mesh", "objective", "relative", "source"} <= set(row), title(row)
        assert set(row) <= {"problem", "mesh", "objective", "relative", "source", "guess", "solver"}, title(row)
    assert len({title(r) for r in SUITE}) == len(SUITE)


def test_a_constant_guess_for_the_way_back():
    """CONFORMANCE: a constant guess may fail, a guess by simulation must not. Here the constant one arrives too."""
    solution = solve(problems.DoubleIntegratorBack(), Mesh(50, 3), throw=False)
    assert solution.objective == pytest.approx(4.0, rel=1e-4)


def test_brachistochrone_is_a_cycloid():
    """x = a (w - sin w), y = a (1 - cos w) through (10, 5) below the start; it takes w sqrt(a / g)."""
    w = brentq(lambda w: (w - np.sin(w)) / (1 - np.cos(w)) - 2.0, 0.1, 6.0, xtol=1e-15)
    a = 5.0 / (1 - np.cos(w))
    solution = solve(problems.Brachistochrone(), Mesh(50, 3), guess=problems.brachistochrone_guess())
    assert solution.objective == pytest.approx(w * np.sqrt(a / 9.80665), rel=SOLVER)
    # the wheel turns evenly in time; the cost is flat in the path, which keeps fewer digits
    run, angle = solution.trajectory, np.sqrt(9.80665 / a) * solution.trajectory.time
    assert run["x"] == pytest.approx(a * (angle - np.sin(angle)), abs=1e-5)
    assert run["y"] == pytest.approx(10 - a * (1 - np.cos(angle)), abs=1e-5)


def test_bang_bang_switches_where_it_must():
    """0 -> 300 with u in [-2, 1]: accelerate for 20 s, brake for 10 s."""
    solution = solve(problems.LongWay(), Mesh(60, 3))
    time, u = solution.trajectory.time, solution.trajectory["u"]
    assert solution.final_time == pytest.approx(30.0, rel=SOLVER)  # 20 s is an edge of 60 elements
    assert np.all(np.abs(u[time < 19.9] - 1) < 1e-5) and np.all(np.abs(u[time > 20.6] + 2) < 1e-5)
