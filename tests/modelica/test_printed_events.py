"""Variables of events in printed Python, and the approximation that replaces a delay."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gtmodel as gt

pytest.importorskip("lark")

TEXT = """model M
  Real x(start = 0, fixed = true), y(start = 0, fixed = true), z(start = 0, fixed = true), saw;
  Integer n(start = 0, fixed = true), k; Boolean b(start = false, fixed = true), up;
equation
  der(x) = cos(3*time);
  der(y) = (if initial() or x > 0.2 then 1 else -1) + floor(4*time);
  k = integer(3*x);
  b = pre(b) and x > -0.1 or x > 0.25;
  up = x > 0;
  der(z) = (if b and not pre(up) then 2 else k) + (if pre(k) > 0 then 1 else 0);
  saw = mod(time, 0.3) + ceil(2*x);
  when {x > 0.1, initial()} then n = pre(n) + 1; end when;
end M;
"""


def test_printed_python_runs_as_its_text_and_describes_its_helpers(tmp_path: Path) -> None:
    file = tmp_path / "m.mo"
    file.write_text(TEXT, encoding="utf-8")
    printed = gt.modelica.python_of(f"{file}:M")
    world: dict[str, Any] = {}
    exec(printed, world)
    a, b = gt.simulate(gt.modelica.load(f"{file}:M")(), 2.0), gt.simulate(world["M"](), 2.0)
    assert [e.time for e in a.events] == [e.time for e in b.events] and len(a.events) >= 15
    for name in a.trajectory.names:  # the same equations in the same order
        np.testing.assert_array_equal(a.trajectory[name], b.trajectory[name], err_msg=name)
    own = [line for line in printed.splitlines() if "gt.discrete(" in line and re.match(r" +(initial|floor|pre)", line)]
    assert len(own) >= 5 and all("description=" in line for line in own), own
    assert "floor_2_x = gt.discrete(0.0, description='floor(-(2*x)), which events count')" in printed
    assert "pre_k = gt.discrete(0.0, description='k before the event')" in printed


def test_the_pade_approximation_of_the_message_delays(tmp_path: Path) -> None:
    """The refusal's own text, of sin(2 t) by 0.2 s: Pade's phase is wrong by (w T)^5/720, its gain is 1."""
    file = tmp_path / "m.mo"
    head = "model M Real x, v, y(start = 0, fixed = true)"
    file.write_text(f"{head}; equation x = sin(2*time); der(y) = v; v = delay(x, 0.2); end M;", encoding="utf-8")
    with pytest.raises(gt.ModelError, match="Pade approximation") as refused:
        gt.modelica.load(f"{file}:M")
    declared, *chain = re.search(r"Real (p.*?\)), (q.*?\)); (.*?v = x - q)", str(refused.value)).groups()  # type: ignore[union-attr]
    start = declared.replace("x0", "0")
    file.write_text(f"{head}, {start}, {chain[0]}; equation x = sin(2*time); der(y) = v; {chain[1]}; end M;", "utf-8")
    trajectory = gt.simulate(gt.modelica.load(f"{file}:M")(), 6.0).trajectory
    t, v = trajectory.time, trajectory["v"]
    late = t > 3
    np.testing.assert_allclose(v[late], np.sin(2 * (t[late] - 0.2)), atol=2 * 0.4**5 / 720)
