"""Static optimizations against closed forms."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

import gtmodel as gt
from gtmodel.cli import main

pytest.importorskip("lark")
POINT = gt.Mesh(1, points=2)


def solved(tmp_path: Path, text: str, mesh: gt.Mesh = POINT) -> Any:
    file = tmp_path / "static.mop"
    file.write_text(text)
    return gt.solve(gt.modelica.load(f"{file}:O")(), mesh)


TANK = """model Tank
  parameter Real a = 1; Real h(start = 1, min = 0.01); input Real q;
equation
  der(h) = q - a*sqrt(h);
end Tank;
"""


@pytest.mark.parametrize("mesh", [POINT, gt.Mesh(4, points=3)])
def test_a_parameter_is_fitted_to_two_steady_states(tmp_path: Path, mesh: gt.Mesh) -> None:
    text = f"""{TANK}optimization O(objective = (one.h - 1.2)^2 + (two.h - 1)^2, static = true)
      parameter Real a(free = true, initialGuess = 2) = 1; Tank one(a = a); Tank two(a = a);
    equation one.q = 1; two.q = 1;
    initial equation der(one.h) = 0; der(two.h) = 0; end O;"""
    s = solved(tmp_path, text, mesh)  # h = 1 / a^2 = 1.1
    assert s.status.ok and s.objective == pytest.approx(0.02, rel=1e-9)
    assert s.free["a"] == pytest.approx(1.1**-0.5, rel=1e-7)
    assert s.trajectory["one.h"][-1] == pytest.approx(1.1, rel=1e-7) and abs(s.trajectory["der(two.h)"][-1]) < 1e-9


def test_undetermined_variables_are_optimized_and_bounds_have_multipliers(tmp_path: Path) -> None:
    text = f"""{TANK}optimization O(objective = (t.h - 4)^2 + 0*t.q, static = true)
      Tank t(q(max = 1.5, min = 0, start = 1)); initial equation der(t.h) = 0; end O;"""
    s = solved(tmp_path, text)  # h = q^2 = 2.25; d/dq (q^2 - 4)^2 = 4 q (q^2 - 4) = -10.5
    assert s.free["t.q"] == pytest.approx(1.5, abs=1e-7) and s.objective == pytest.approx(1.75**2, rel=1e-6)
    assert s.bound_multiplier("t.q")[0, 0] == pytest.approx(10.5, rel=1e-5)


def test_fixed_starts_rates_time_and_constraints(tmp_path: Path) -> None:
    text = """optimization O(
        objective = (der(x) - 3)^2 + (p - 1)^2 + (z(finalTime) - time)^2, startTime = 2, static = true)
      parameter Real p(free = true, max = 10); Real x(start = 2, fixed = true); input Real u; Real z;
    equation der(x) = -x + u; z = x*p;
    constraint u + p <= 4; end O;"""
    # der(x) = u - 2, z = 2 p: least (u - 5)^2 + (p - 1)^2 + (2 p - 2)^2 with u + p <= 4
    s = solved(tmp_path, text)
    # u = 5 - m / 2, p = 1 - m / 10: their sum is 4 at m = 10 / 3
    assert s.free["u"] == pytest.approx(5 - 10 / 6, rel=1e-6) and s.free["p"] == pytest.approx(2 / 3, rel=1e-6)
    assert s.trajectory["x"][-1] == 2.0 and s.trajectory["der(x)"][-1] == pytest.approx(3 - 10 / 6, rel=1e-6)


def test_equations_of_free_variables_only_are_constraints(tmp_path: Path) -> None:
    text = """optimization O(objective = a^2 + b^2, static = true)
      parameter Real a(free = true); parameter Real b(free = true); initial equation a + 2*b = 5; end O;"""
    s = solved(tmp_path, text)
    assert (s.free["a"], s.free["b"]) == pytest.approx((1.0, 2.0), abs=1e-8)


def test_a_static_optimization_at_the_command_line(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    file = tmp_path / "static.mop"
    file.write_text("""optimization O(objective = (x - 2)^2, static = true)
      parameter Real p(free = true, max = 1.5, start = 1); Real x(start = 1, fixed = false);
    equation der(x) = p - x; initial equation der(x) = 0; end O;""")
    assert main(["solve", str(file), "--json", "--out", str(tmp_path / "out")]) == 0
    assert json.loads(capsys.readouterr().out)["objective"] == pytest.approx(0.25, rel=1e-6)
    assert len(json.loads((tmp_path / "out" / "result.json").read_text())["trajectory"]["time_s"]) == 3
    (tmp_path / "o.toml").write_text('kind = "optimization"\nmodel = "static.mop:O"\n')
    assert main(["solve", str(tmp_path / "o.toml"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["objective"] == pytest.approx(0.25, rel=1e-6)
    assert main(["explain", f"{file}:O"]) == 0 and "free: p" in capsys.readouterr().out
    namespace: dict[str, Any] = {}
    exec(gt.modelica.python_of(f"{file}:O"), namespace)
    assert gt.solve(namespace["O"](), POINT).objective == solved(tmp_path, file.read_text()).objective


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("optimization O(objectiveIntegrand = x, static = true) Real x; equation x = 1; end O;", "integrate"),
        ("optimization O(objective = x, static = true, finalTime(free = true)) Real x; equation x = 1; end O;", "time"),
        ("optimization O(static = true) Real x; equation x = 1; end O;", "objective"),
        ("optimization O(objective = x, static = 1) Real x; equation x = 1; end O;", "true or false"),
    ],
)
def test_non_static_features_are_rejected_with_their_line(tmp_path: Path, text: str, word: str) -> None:
    with pytest.raises(gt.ModelError, match=rf"{word}.*static\.mop:1"):
        solved(tmp_path, text)
