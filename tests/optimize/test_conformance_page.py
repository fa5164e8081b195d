"""docs/conformance.md is the table of the data file, and the data file has every problem that was asked for."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

from tests.optimize.test_conformance import SUITE

DOCS = Path(__file__).parents[2] / "docs"
# Problem, mesh, cost: as published or asserted elsewhere; written down here a second time, not read from the data file.
ASKED = {
    "Van der Pol, integral": ("VanDerPol", "50x3", 3.176195803),
    "Van der Pol, extra state": ("VanDerPolMayer", "50x3", 3.176195803),
    "Van der Pol, two points": ("VanDerPol", "40x2", 3.194950796),
    "Van der Pol, implicit Euler": ("VanDerPol", "100x1", 2.580462800),
    "Van der Pol, Gauss": ("VanDerPol", "40x2 gauss", 3.171799773),
    "Van der Pol, path constraint": ("VanDerPolPath", "50x3", 5.273481331),
    "Van der Pol, minimum time": ("VanDerPolTime", "50x3", 2.281159071),
    "stirred tank": ("StirredTank", "50x3", 1857.6873858),
    "stirred tank, not scaled": ("StirredTankUnscaled", "50x3", 1857.6873858),
    "stirred tank, minimum time": ("StirredTankTime", "50x3", 116.370201),
    "implicit, constraints": ("ImplicitDae", "50x3", 1.06183273),
    "implicit, torn by hand": ("ImplicitTorn", "50x3", 1.06183273),
    "implicit, block": ("ImplicitBlock", "50x3", 1.06183273),
    "linear block": ("LinearAlgebraic", "50x3", 2.5843277),
    "double integrator, end free": ("DoubleIntegrator", "50x3", 2.0),
    "double integrator, start free": ("DoubleIntegratorStart", "50x3", 2.0),
    "double integrator, both free": ("DoubleIntegratorBoth", "50x3", 2.0),
    "double integrator, way back": ("DoubleIntegratorBack", "50x3", 4.0),
    "dry friction": ("two_phases", "50x3", 1 / 3 + 4 / 3 * 1.75**0.5),
    "0 to 300": ("LongWay", "50x3", 30.0),
    "bilinear": ("Bilinear", "50x3", -0.0480556),
    "state constraint": ("StateConstraint", "50x3", 0.1698),
    "brachistochrone": ("Brachistochrone", "50x3", 1.80160),
}
SOLVERS = {
    "VanDerPolPath": [{}, {"hessian": "lbfgs"}],
    "ImplicitBlock": [{"formulation": "dae"}, {"formulation": "torn"}],
}


@pytest.fixture(scope="module")
def maker() -> ModuleType:
    spec = importlib.util.spec_from_file_location("make_conformance", DOCS / "make_conformance.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def rows_of(page: str) -> list[list[str]]:
    return [[c.strip() for c in line.strip("|").split(" | ")] for line in page.splitlines() if line.startswith("| ")]


@pytest.mark.parametrize("name", ASKED)
def test_every_problem_is_in_the_data_file(name):
    problem, mesh, cost = ASKED[name]
    found = [r for r in SUITE if (r["problem"], r["mesh"]) == (problem, mesh)]
    assert found and all(r["objective"] == pytest.approx(cost, rel=1e-12) for r in found)
    if problem in SOLVERS:
        assert [r.get("solver", {}) for r in found] == SOLVERS[problem]


def test_the_page_shows_the_data_file(maker):
    page = (DOCS / "conformance.md").read_text(encoding="utf-8")
    assert page.startswith(maker.HEAD)
    shown = rows_of(page)
    assert tuple(shown[0]) == maker.COLUMNS
    optima, rest = shown[1 : len(SUITE) + 1], shown[len(SUITE) + 1 :]
    assert [cells[:7] for cells in optima] == [maker.known_cells(row) for row in SUITE]
    assert rest == rows_of("\n".join(maker.simulations()))
    for row, cells in zip(SUITE, optima, strict=True):
        assert float(cells[7]) == pytest.approx(row["objective"], rel=row["relative"] + 1e-8), cells[1]
        assert float(cells[8]) <= 10 * row["relative"]


def test_a_wrong_cost_shows(maker):
    """The last column tells a cost that is off by a ten-thousandth."""
    lines = maker.table([1.0001 * row["objective"] for row in SUITE])
    assert all(line.endswith("| 1e-04 |") or line.endswith("| 1e-03 |") for line in lines[2:])


def test_the_page_has_no_digit_that_depends_on_the_machine(maker):
    """A cost that is off by less than the reproducible part of it gives the same row."""
    costs = [float(f"{row['objective']:.6g}") for row in SUITE]  # away from where the last digit is rounded
    assert maker.table([cost * (1 + 0.1 * maker.REPRODUCIBLE) for cost in costs]) == maker.table(costs)
