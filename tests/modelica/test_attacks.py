"""Regression tests: texts that once gave a wrong number, a traceback or an endless loop."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import gtmodel as gt
from gtmodel.modelica import expressions
from gtmodel.modelica.translate import translated
from tests.modelica.values import one, values

pytest.importorskip("lark")
CHAIN = """function p input Real x; input Real k = 2; output Real y; algorithm y := k*x; end p;
function q = p(k = 5);
function r = q(k = 7);
function s extends p(k = 3); end s;
function sign input Real x; output Real y; algorithm y := 5*x; end sign;
"""
JOINED = """connector C parameter Integer n = 1; Real x; flow Real f; end C;
model A C c(n = 2); equation c.f = 1; end A;
model B C c(n = {n}); equation c.x = 1; end B;
"""
DOUBLED = "function f input Real x; output Real y; algorithm y := x; for i in 1:60 loop y := {step}; end for; end f;"


@pytest.mark.parametrize(
    ("expression", "value"),
    [
        ("q(1) + 10*r(1) + 100*s(1)", 375), ("sign(2)", 10), ("sum(i*j for i in 1:2, j in 1:3)", 18),
        ("1 + zeros(0)*zeros(0) + sum(zeros(2, 0)*zeros(0))", 1), ("(10^10)^10", 1e100),
        ("9999999999*9999999999*9999999999", 9999999999.0**3),
    ],
)  # fmt: skip
def test_expressions(tmp_path: Path, expression: str, value: float) -> None:
    assert one(tmp_path, expression, around=CHAIN) == pytest.approx(value, rel=1e-15)


@pytest.mark.parametrize(
    ("expression", "value"),
    [
        ("sum(r.v[1])", 11), ("sum(r[:].v[end])", 15), ("sum(r.v[2:3])", 28), ("sum(r.v)", 39), ("r[2].v[1]", 7),
        ("sum(c.r.v[1])", 22), ("sum(c[2].r.v[3])", 15), ("sum(c.r[1].v[2])", 10),
    ],
)  # fmt: skip
def test_a_subscript_belongs_to_its_own_name(tmp_path: Path, expression: str, value: float) -> None:
    around = "record R Real v[3]; end R; model C R r[2](v = {{4, 5, 6}, {7, 8, 9}}); end C;"
    assert one(tmp_path, expression, "R r[2](v = {{4, 5, 6}, {7, 8, 9}}); C c[2];", around) == value


@pytest.mark.parametrize(
    ("body", "wanted"),
    [
        ("Real x(start = 5); algorithm x := x + 1;", 6),
        ("parameter Real p = 2; Real x(start = 2*p); Real u = 3; algorithm x := x + u; x := 2*x;", 14),
        ("Real x; algorithm x := 3; x := x + 1;", 4),
    ],
)
def test_a_variable_of_an_algorithm_is_initialised_with_its_start(tmp_path: Path, body: str, wanted: float) -> None:
    assert values(tmp_path, f"model M {body} end M;", "x") == [wanted]


@pytest.mark.parametrize(
    ("body", "word"),
    [
        ("Real y = sum(transpose({1, 2}));", "transpose"), ("Real y = sum(skew({1, 2}));", "skew"),
        ("Real y = sum(symmetric({1, 2}));", "symmetric"), ("Real y = sum(diagonal(3));", "diagonal"),
        ("Real y = sum(identity(-2));", "identity"),
        ("Real y = String();", "String"), ("Real y = sum(fill());", "fill"),
        ("Real y = sum(zeros());", "zeros"), ("Real y = semiLinear(2, 3);", "semiLinear"),
        ("Real y = sum(cat(0, {1}, {2}));", "cat"), ("Real y = sum(cat(2, {1, 2}, {3, 4}));", "cat"),
        ("Real y = 2^2000;", "no value"), ("Real y = 1e400;", "larger"), ("Real y(max = 1e999) = 1;", "larger"),
        ("Real y = 10^(10^10);", "no value"),
        ("Real y = if true == 1 then 2 else 3;", "type"),
        ("parameter E e = E.a; Real y = if e == F.a then 1 else 2;", "type"),
        ("parameter E e = E.a; Real y = e + 1;", "'e'"),
        ("parameter E e = 1; Real y = 1;", "enumeration"), ("parameter Integer n = 2.5; Real y = n;", "Integer"),
        ("parameter Integer m = 7; parameter Integer n = m/2; Real y = n;", "Integer"),
        ("Real y = f(2.5); function f input Integer n; output Real y; algorithm y := n; end f;",
         "Integer"),
        ("Real x = 1; equation if x > 0 then connect(x, x); else connect(x, x); end if;", "connect"),
        ("Real y; equation assert(condition = false, message = \"so\");", "so"),
        ("T x; type T = U; type U = T;", "itself"),
        ("A a; model A extends B; end A; model B extends A; end B;", "itself"),
        ("Real y = 1; annotation(__gtmodel = 1);", "__gtmodel"),
        ("Real y = " + "if y > 0 then 1 else "*3000 + "2;", "deep"),
        ("Real x; equation " + "if true then "*2000 + "x = 1; " + "end if;"*2000, "deep"),
        ("".join(f"package P{i} " for i in range(150)) + "".join(f"end P{149 - i};" for i in range(150)), "classes"),
    ],
)  # fmt: skip
def test_unsupported_and_wrong_texts(tmp_path: Path, body: str, word: str) -> None:
    file = tmp_path / "text.mo"
    file.write_text(f"type E = enumeration(a, b);\ntype F = enumeration(a, b);\nmodel M\n  {body}\nend M;\n")
    with pytest.raises(gt.modelica.ModelicaError, match=word) as caught:
        gt.modelica.load(f"{file}:M")
    assert caught.value.where is not None and caught.value.where.line > 0


def test_parameters_of_connected_connectors_must_be_equal(tmp_path: Path) -> None:
    body = "A a; B b; Real y; equation connect(a.c, b.c); y = b.c.f;"
    assert values(tmp_path, f"{JOINED.format(n=2)} model M {body} end M;", "y") == [-1.0]
    with pytest.raises(gt.modelica.ModelicaError, match="differ"):
        values(tmp_path, f"{JOINED.format(n=3)} model M {body} end M;", "y")


@pytest.mark.parametrize(
    "text",
    [
        "model M Real x[1000, 1000]; end M;", "model M Real x[100000000]; end M;",
        "model A Real x = 1; end A; model M A a[100000, 1000]; end M;",
        "model M Real y = sum(1:1e308); end M;", "model M Real y = sum(-1e308:1e-308:1e308); end M;",
        "model M Real y = sum(identity(10000)); end M;", "model M Real y = sum(diagonal(zeros(9999))); end M;",
        "function f output Real y; protected Real x[99999, 99999]; algorithm y := 1; end f; "
        "model M Real y = f(); end M;",
        "model M Real y = sum(linspace(0, 1, 1000000000)); end M;",
        "model M Real y = sum(fill(zeros(9999), 9999)); end M;",
        "model M Real y = sum(outerProduct(zeros(9999), zeros(9999))); end M;",
        "model M Real y = sum({i*j for i in 1:9999, j in 1:9999}); end M;",
        "model M Real y; equation for i in 1:9999 loop for j in 1:9999 loop y = 1; end for; end for; end M;",
        "model M Real y = f(40); function f input Real x; output Real y; algorithm "
        "if x < 2 then y := 1; else y := f(x - 1) + f(x - 2); end if; end f; end M;",
        "model A0 Real x = 1; end A0; " + "".join(f"model A{i + 1} A{i} a, b; end A{i + 1}; " for i in range(30))
        + "model M A30 a; end M;",
        f"{DOUBLED.format(step='y*y + 1')} model M parameter Real u = 2; Real x[integer(f(u))]; end M;",
        'function f output String s; algorithm s := "a"; for i in 1:60 loop s := s + s; end for; end f; '
        'model M constant String s = f(); Real y = if s == "a" then 1 else 2; end M;',
    ],
)  # fmt: skip
def test_size_limits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str) -> None:
    monkeypatch.setattr(expressions, "MOST", 50_000)
    file = tmp_path / "text.mo"
    file.write_text(text)
    with pytest.raises(gt.modelica.ModelicaError, match=r"more|too|at most|finite"):
        gt.modelica.load(f"{file}:M")


@pytest.mark.parametrize("name", ["None", "True", "lambda", "gt", "objective"])
def test_names_reserved_in_python(tmp_path: Path, name: str) -> None:
    assert one(tmp_path, f"2*{name}", f"Real {name} = 3;") == 6.0


def test_an_end_before_a_comment(tmp_path: Path) -> None:
    text = "model M\n  Real x[2] = {1, 2};\n"
    text += "  Real y = x[end /* last */ - 1] + x[end/2] + x[end // last\n  ];\nend /* of */ M;"
    assert values(tmp_path, text, "y") == [4.0]


def test_a_form_feed_does_not_end_a_line(tmp_path: Path) -> None:
    file = tmp_path / "text.mo"
    file.write_text("model M\f\n  Real x = 1;\x0b\n  Real y = z;\nend M;\n")
    with pytest.raises(gt.modelica.ModelicaError, match="Real y = z") as caught:
        gt.modelica.load(file)
    where: Any = caught.value.where
    assert where.line == 3


def test_paths_that_are_not_readable_files(tmp_path: Path) -> None:
    (tmp_path / "endless.mo").symlink_to("/dev/zero")
    for path in (tmp_path / "endless.mo", tmp_path, tmp_path / "none.mo"):
        with pytest.raises(gt.modelica.ModelicaError, match="cannot be read"):
            gt.modelica.load(path)


@pytest.mark.parametrize(
    ("header", "parameters", "word"),
    [
        ("objective = true", {}, "objective"), ("finalTime(free = 1)", {}, "free"),
        ("finalTime(max = 3) = 4", {}, "min and max"),
        ("objectiveIntegrand = u^2", {"x": 3.0, "x.start": 3.0}, "two things"),
        ("objectiveIntegrand = u^2", {"x.start": 3.0, "x": 3.0}, "two things"),
    ],
)  # fmt: skip
def test_invalid_headers_and_parameters(tmp_path: Path, header: str, parameters: dict[str, float], word: str) -> None:
    file = tmp_path / "text.mop"
    file.write_text(
        f"optimization P({header})\n  Real x(start = 1);\n  input Real u;\nequation\n  der(x) = u;\nend P;\n"
    )
    with pytest.raises(gt.modelica.ModelicaError, match=word):
        gt.modelica.load(file, parameters=parameters)


def test_an_infeasible_static_optimization_is_not_solved(tmp_path: Path) -> None:
    file = tmp_path / "text.mop"
    file.write_text(
        "optimization P(objective = x, static = true) Real x; input Real u; equation x = u; x = 2; u = 3; end P;"
    )
    with pytest.raises(gt.NotSolved) as caught:
        gt.solve(gt.modelica.load(file)())
    assert "text.mop" in str(caught.value)


def test_a_sensor_rejects_frame_resolve(tmp_path: Path) -> None:
    file = tmp_path / "text.mo"
    sensor = "MB.Sensors.AbsolutePosition s(resolveInFrame = MB.Types.ResolveInFrameA.frame_resolve);"
    parts = f"inner MB.World world; MB.Joints.Revolute j; MB.Parts.Body b(m = 1, r_CM = {{0, 1, 0}}); {sensor}"
    joined = "connect(world.frame_b, j.frame_a); connect(j.frame_b, b.frame_a); connect(b.frame_a, s.frame_a);"
    file.write_text(f"model M import MB = Modelica.Mechanics.MultiBody; {parts} equation {joined} end M;")
    with pytest.raises(gt.modelica.ModelicaError, match="frame_resolve"):
        gt.modelica.load(file)


def test_ignored_attributes_give_warnings(tmp_path: Path) -> None:
    file = tmp_path / "text.mop"
    file.write_text(
        """optimization P(objectiveIntegrand = u^2, finalTime = 2)
  parameter Real p(min = 3) = 1;
  Real x(start = 1);
  input Real u(start = 2, fixed = true);
equation
  der(x) = u;
end P;
"""
    )
    said = " ".join(translated(str(file)).warnings)
    assert "input 'u'" in said and "'p' is outside" in said


@pytest.mark.parametrize(
    ("bound", "value"), [("q^n - 1", 4.0), ("if q > 0 then 1 else 3", 4.0), ("max(q, 3)", 4.0), ("log(q)", None)]
)
def test_a_bound_that_depends_on_parameters(tmp_path: Path, bound: str, value: float | None) -> None:
    file = tmp_path / "text.mop"
    file.write_text(
        f"""optimization P(objectiveIntegrand = (u - 5)^2)
  parameter Real q = -2;
  parameter Real n = 2;
  Real x(start = 1, fixed = true);
  input Real u(max = {bound});
equation
  der(x) = u;
end P;
"""
    )
    problem = gt.modelica.load(file)()
    if value is None:
        with pytest.raises(gt.ModelError, match=r"max of 'u' is not a number"):
            gt.solve(problem, gt.Mesh(2))
    else:
        assert gt.solve(problem, gt.Mesh(2)).objective == pytest.approx(value, rel=1e-6)


def test_a_start_must_be_a_number(tmp_path: Path) -> None:
    file = tmp_path / "text.mo"
    file.write_text("model M parameter Real q = -2; Real x(start = log(q), fixed = true); equation der(x) = -x; end M;")
    with pytest.raises(gt.ModelError, match="start values"):
        gt.modelica.load(file)().simulate(1.0)


def test_built_in_types_have_the_bounds_of_the_library(tmp_path: Path) -> None:
    file = tmp_path / "text.mop"
    file.write_text(
        """optimization P(objectiveIntegrand = (x - 2)^2 + u^2)
  Modelica.Units.SI.MassFraction x(start = 0.5);
  Modelica.SIunits.Temperature T = 300*x;
  input Real u;
equation
  der(x) = u;
end P;
"""
    )
    solution = gt.solve(gt.modelica.load(file)(), gt.Mesh(2))
    assert solution.objective == pytest.approx(1.0, rel=1e-6)  # x stays at its largest, 1


HIDDEN = """model Inner parameter Real open = 1; protected parameter Real k = 2; end Inner;
model M parameter Real open = 1; Inner a; Real y = open + a.open;
protected
  parameter Real k = 2; Inner b; end M;
"""


@pytest.mark.parametrize(("name", "line"), [("k", 4), ("a.k", 1), ("b.open", 4)])
def test_parameters_cannot_set_protected_components(tmp_path: Path, name: str, line: int) -> None:
    (tmp_path / "m.mo").write_text(HIDDEN)
    with pytest.raises(gt.modelica.ModelicaError, match=r"parameters set a value from outside.*protected") as caught:
        gt.modelica.load(f"{tmp_path / 'm.mo'}:M", parameters={name: 3.0})
    assert caught.value.where is not None and caught.value.where.line == line


def test_parameters_can_set_public_components(tmp_path: Path) -> None:
    (tmp_path / "m.mo").write_text(HIDDEN)
    model = gt.modelica.load(f"{tmp_path / 'm.mo'}:M", parameters={"open": 3.0, "a.open": 4.0})()
    y, status = model.causal(targets=["y"])()
    assert status.ok and float(y) == 7.0
