"""Long expressions: repeated subexpressions in loops of functions, and sums of thousands of terms."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest

import gtmodel as gt
from gtmodel.modelica.translate import translated
from tests.modelica.values import one

pytest.importorskip("lark")
ROUND_OFF = 1e-13  # of some hundred operations, one after the other
LOOP = "function f input Real x; output Real y; algorithm y := x; for i in 1:{n} loop {body} end for; end f;"
TURNS = {
    "y := y + sin(y)/i;": lambda y, i: y + math.sin(y) / i,
    "if y > 0.3 then y := 0.5*(y + 0.2/y); else y := y + 0.01*i; end if;":
        lambda y, i: 0.5 * (y + 0.2 / y) if y > 0.3 else y + 0.01 * i,
    "y := sinh(0.4*y) + y/(1 + y*y);": lambda y, i: math.sinh(0.4 * y) + y / (1 + y * y),
}  # fmt: skip


@pytest.mark.parametrize("n", [20, 100])
@pytest.mark.parametrize("body", TURNS)
def test_a_loop_that_reads_its_own_variables_repeatedly(tmp_path: Path, body: str, n: int) -> None:
    y = 0.7
    for i in range(1, n + 1):
        y = TURNS[body](y, i)
    text = LOOP.format(n=n, body=body) + " model M Real u = 0.7 + time; Real y = f(u); end M;"
    (tmp_path / "m.mo").write_text(text)
    simulation = gt.simulate(gt.modelica.load(tmp_path / "m.mo")(), 1e-6)
    assert simulation.trajectory["y"][0] == pytest.approx(y, rel=ROUND_OFF)


def test_sixty_doublings_are_written_in_sixty_lines(tmp_path: Path) -> None:
    text = LOOP.format(n=60, body="y := 0.5*y + 0.5*y;") + " model M Real u = 3; Real y = f(u); end M;"
    (tmp_path / "m.mo").write_text(text)
    printed = gt.modelica.python_of(tmp_path / "m.mo")
    assert len(printed.splitlines()) < 80
    world: dict[str, Any] = {}
    exec(printed, world)
    y, status = world["M"]().causal(targets=["y"])()
    assert status.ok and float(y) == 3.0
    with pytest.raises(gt.modelica.ModelicaError, match="too long for flat text"):
        gt.modelica.flat_of_text(tmp_path / "m.mo")


def test_inconsistent_units_in_a_long_statement_give_a_warning_and_are_ignored(tmp_path: Path) -> None:
    text = LOOP.format(n=20, body="y := y + 0.01*y*y;")
    text += '\nmodel M Real u(unit = "m") = 0.7; Real v(unit = "s") = 2;\n  Real y = f(u);\nend M;'
    (tmp_path / "m.mo").write_text(text)
    item = translated(tmp_path / "m.mo")
    told = [w for w in item.warnings if "not checked" in w and "m.mo:3" in w]
    assert len(told) == 1 and item.units
    y, status = item.model().causal(targets=["y"])()
    expected = 0.7
    for _ in range(20):
        expected += 0.01 * expected * expected
    assert status.ok and float(y) == pytest.approx(expected, rel=ROUND_OFF)


def test_a_loop_of_an_optimization(tmp_path: Path) -> None:
    """u is chosen where y is least: the loop's derivative at it vanishes."""
    text = LOOP.format(
        n=20, body="if y > 0.2 then y := 0.9*y + 0.1*y*y; else y := 0.9*y + 0.004 - 0.01*(y - 0.2); end if;"
    )
    text += """ optimization M(objectiveIntegrand = (f(u) - 0.5)^2) input Real u(start = 1, min = 0, max = 2);
      Real x(start = 0, fixed = true); equation der(x) = u; end M;"""
    (tmp_path / "m.mop").write_text(text)
    solution = gt.solve(gt.modelica.load(tmp_path / "m.mop")(), gt.Mesh(2), throw=False)
    u = solution.trajectory["u"][-1]
    for _ in range(20):
        u = 0.9 * u + 0.1 * u * u if u > 0.2 else 0.9 * u + 0.004 - 0.01 * (u - 0.2)
    assert u == pytest.approx(0.5, abs=1e-5)  # of the optimiser's own tolerance


def test_two_thousand_terms(tmp_path: Path) -> None:
    signs = [-1 if i % 3 == 1 else 1 for i in range(2_000)]
    text = "".join(f" {'-' if s < 0 else '+'} {i}*u/{i + 7}" for i, s in enumerate(signs))
    exact = math.fsum(s * i * 0.7 / (i + 7) for i, s in enumerate(signs))
    assert one(tmp_path, text, "Real u = 0.7;") == pytest.approx(exact, rel=ROUND_OFF)
    # the value of a sum does not hang on how many terms are added in pairs
    assert one(tmp_path, "sum(i*u/(i + 7) for i in 0:1999)", "Real u = 0.7;") == pytest.approx(
        math.fsum(i * 0.7 / (i + 7) for i in range(2_000)), rel=ROUND_OFF
    )


def test_a_chain_of_products_and_of_conditions(tmp_path: Path) -> None:
    product = "*".join(f"(1 + u/{n})" for n in range(1_000, 2_000))
    assert one(tmp_path, product, "Real u = 0.7;") == pytest.approx(
        math.prod(1 + 0.7 / n for n in range(1_000, 2_000)), rel=ROUND_OFF
    )
    chain = " and ".join(f"u > {-n}" for n in range(1_000))
    (tmp_path / "m.mo").write_text(f"model M Real u = 0.7 + time; Real y = if {chain} then 1 else 2; end M;")
    assert gt.simulate(gt.modelica.load(tmp_path / "m.mo")(), 1e-6).trajectory["y"][0] == 1.0
