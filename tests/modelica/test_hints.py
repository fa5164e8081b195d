"""Messages that say what to write instead: each names what was found, and the remedy."""

from __future__ import annotations

from pathlib import Path

import pytest

import gtmodel as gt
from gtmodel.optimize import Mesh

pytest.importorskip("lark")

CART = """
optimization P(objective = %(objective)s, finalTime(free = true, min = 0.1, initialGuess = 2))
  Real x(start = 1, fixed = true);
  Real v(start = 0, fixed = true);
  Real y;
  input Real u(min = -1, max = 1);
%(initial)s
equation
  der(x) = v;
  der(v) = u;
  %(equation)s
constraint
  x(finalTime) = 0;
  %(constraint)s
end P;
"""
USUAL = {"objective": "finalTime", "initial": "", "equation": "y = x;", "constraint": "v(finalTime) = 0;"}


def said(folder: Path, **parts: str) -> str:
    file = folder / "cart.mop"
    file.write_text(CART % (USUAL | parts))
    with pytest.raises(gt.ModelError) as caught:
        gt.solve(gt.modelica.load(f"{file}:P")(), Mesh(4))
    return str(caught.value)


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ({"constraint": "vv(finalTime) = 0;"}, ("no variable 'vv'", "did you mean 'v'", "cart.mop:14")),
        ({"constraint": "x(1) = 0;"}, ("x is asked for at the time 1", "x(finalTime)")),
        ({"constraint": "-1 <= x <= 1;"}, ("two constraints", "a <= x; x <= b;", "cart.mop:14")),
        ({"constraint": "if time > 1 then x <= 1; end if;"}, ("parameters only; found time", "cart.mop:14")),
        ({"equation": ""}, ("not determined: y (", "cart.mop:5", "is an equation missing?")),
        ({"equation": "y = delay(x, 0.1);"}, ("only inputs", "found 'x', a variable", "0.1*der(p) = q")),
        ({"objective": "x"}, ("x along the whole path", "x(finalTime), or objectiveIntegrand")),
        ({"initial": "initial equation v = 1;"}, ("bounds of 'v'", "(initial)", "fixed start of 'v'", "cart.mop:4")),
        ({"equation": "y = x; Modelica.Blocks.Math.Gain g;"}, ()),
    ],
)  # fmt: skip
def test_what_to_write_instead(tmp_path: Path, parts: dict[str, str], words: tuple[str, ...]) -> None:
    text = said(tmp_path, **parts)
    assert all(word in text for word in words), text
    assert "yield" not in text and ".at(" not in text, text


def test_an_import_is_not_inherited(tmp_path: Path) -> None:
    file = tmp_path / "imports.mo"
    file.write_text("""
package A
  import SI = Modelica.SIunits;
  model M
    SI.Position x(start = 1, fixed = true);
  equation
    der(x) = -x;
  end M;
end A;
model N
  extends A.M;
  parameter SI.Mass m = 2;
end N;
""")
    with pytest.raises(gt.ModelError) as caught:
        gt.modelica.load(f"{file}:N")
    assert "imports are not inherited: A imports it in line 3" in str(caught.value)
    assert "write import SI = Modelica.SIunits; in N too" in str(caught.value)


def test_a_library_that_is_not_loaded(tmp_path: Path) -> None:
    file = tmp_path / "gain.mo"
    file.write_text("model D Modelica.Blocks.Math.Gain g(k = 2); equation g.u = 1; end D;")
    with pytest.raises(gt.ModelError, match=r"no class 'Math' in Modelica.Blocks; .* is not loaded.*MODELICAPATH"):
        gt.modelica.load(f"{file}:D")


def test_constants_keep_their_unit_and_parameters_made_of_them_their_name(tmp_path: Path) -> None:
    file = tmp_path / "fall.mo"
    file.write_text("""
model Fall
  constant Modelica.SIunits.Acceleration g = Modelica.Constants.g_n;
  parameter Modelica.SIunits.Angle slope = 10*Modelica.Constants.pi/180;
  Modelica.SIunits.Velocity v(start = 0, fixed = true);
equation
  der(v) = g*sin(slope);
end Fall;
""")
    cls = gt.modelica.load(f"{file}:Fall")
    assert cls._notes == ()
    speeds = [cls(**given).simulate(1.0).trajectory["v"][-1] for given in ({}, {"slope": 0.0})]
    assert speeds == pytest.approx([9.80665 * 0.17364817766693033, 0.0], rel=1e-6, abs=1e-12)
