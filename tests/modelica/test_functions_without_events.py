"""An if inside a function makes no events (Modelica 3.6, section 12.2), unless a branch of it may be undefined."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy

import gtmodel as gt

pytest.importorskip("lark")

FUNCTIONS = """
function root "y^2 = a by bisection: each turn asks on which side the middle is"
  input Real a; output Real y;
protected Real low, high;
algorithm
  low := 0; high := 4;
  for k in 1:30 loop
    y := (low + high)/2;
    if y*y > a then high := y; else low := y; end if;
  end for;
end root;
function guarded input Real x; output Real y; algorithm y := if x > 0.25 then log(x) else 0; end guarded;
function level input Real x; output Real y;
algorithm if x > 0.5 and not x >= 0.75 or x < -0.5 then y := 2.5; else y := 0.0; end if; end level;
function count input Real x; output Integer n; algorithm n := if x > 0.5 then 2 else 1; end count;
"""


def _run(tmp_path: Path, body: str, end: float) -> gt.Simulation:
    file = tmp_path / "functions.mo"
    file.write_text(f"{FUNCTIONS} model M {body} end M;", encoding="utf-8")
    return gt.simulate(gt.modelica.load(f"{file}:M")(), end)


def test_a_bisection_makes_no_events(tmp_path: Path) -> None:
    """Its ifs change some 2^29 times; the function is a square root to 4/2^30."""
    s = _run(tmp_path, "Real q(start = 0, fixed = true); equation der(q) = root(2 + sin(5*time));", 2.0)
    exact = scipy.integrate.quad(lambda t: np.sqrt(2 + np.sin(5 * t)), 0, 2.0)[0]
    assert not s.events and s.trajectory["q"][-1] == pytest.approx(exact, rel=1e-6)  # the default tolerance


def test_a_branch_that_may_be_undefined_keeps_its_event(tmp_path: Path) -> None:
    body = "Real x(start = 0, fixed = true), q(start = 0, fixed = true); equation der(x) = 1; der(q) = guarded(x);"
    s = _run(tmp_path, body, 1.25)
    assert [round(e.time, 9) for e in s.events] == [0.25]
    assert s.trajectory["q"][-1] == pytest.approx(1.25 * np.log(1.25) - 1.25 - 0.25 * np.log(0.25) + 0.25, abs=1e-6)


def test_an_equation_with_a_discontinuous_value_switches_at_the_jump(tmp_path: Path) -> None:
    """On both ways over the jump, and with a count that an Integer keeps."""
    body = """Real x(start = 0, fixed = true), q(start = 0, fixed = true); Integer n;
    equation der(x) = cos(time); der(q) = if level(x) > 1 then 1 else 0; n = count(x);"""
    s = _run(tmp_path, body, 6.0)
    edges = np.arcsin([0.5, 0.75])
    # on the way up, on the way down, and below -0.5, where it stays from pi + asin(0.5) to 2 pi - asin(0.5)
    inside = 2 * (edges[1] - edges[0]) + (np.pi - 2 * edges[0])
    assert s.trajectory["q"][-1] == pytest.approx(inside, abs=1e-6)
    up, down = edges[0], np.pi - edges[0]
    np.testing.assert_allclose([e.time for e in s.events if "n" in str(e.causes) and abs(e.time - up) < 1e-6], [up])
    assert min(abs(e.time - down) for e in s.events) < 1e-7
