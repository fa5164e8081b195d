"""Flattening: each construct against the same model written by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import gtmodel as gt
from gtmodel.modelica.translate import translated
from tests.modelica.values import one, values

pytest.importorskip("lark")


@pytest.mark.parametrize(
    ("expression", "value"),
    [
        ("-2^2", -4.0), ("2/4/2", 0.25), ("7/2", 3.5), ("1e-3 + .5 + 1.", 1.501), ("if 2 > 1 then 3 else 4", 3.0),
        ("sum(i^2 for i in 1:4)", 30.0), ("sum({1, 2, 3})", 6.0), ("product(1:4)", 24.0), ("max({1, 5, 3})", 5.0),
        ("min(2, 3)", 2.0), ("{1, 2, 3}*{4, 5, 6}", 32.0), ("sum({{1, 2}, {3, 4}}*{1, 1})", 10.0),
        ("size({{1, 2, 3}, {4, 5, 6}}, 2)", 3.0), ("sum([1, 2; 3, 4]*[1; 1])", 10.0), ("sum(cat(1, {1}, {2, 3}))", 6.0),
        ("sum(linspace(0, 1, 5))", 2.5), ("sum(identity(3))", 3.0), ("sum({1, 1}*transpose([1, 2; 3, 4]))", 10.0),
        ("sum({10, 20, 30} .* {1, 0, 2})", 70.0), ("mod(7, 3) + div(7, 3)", 3.0),
        ("cross({1, 0, 0}, {0, 1, 0})*{0, 0, 1}", 1.0), ("sum(1:2:7)", 16.0), ("sum(5:-2:1)", 9.0),
        ("sum(fill(2, 3)) + sum(zeros(2)) + sum(ones(2))", 8.0), ("noEvent(smooth(0, 3))", 3.0),
        ("Modelica.Constants.pi", np.pi), ("sum({{1, 2}, {3, 4}}^2)", 54.0), ("sum(diagonal({1, 2}))", 3.0),
        ("sum({i + j for i in 1:2, j in 1:3})", 21.0), ("log10(1000) + abs(-2) + sign(-3)", 4.0),
        ("if not (1 > 2 and true) or false then 1 else 2", 1.0), ("atan2(1, 1)*4", np.pi), 
        ("sinh(1) - cosh(1)", -np.exp(-1)),
    ],
)  # fmt: skip
def test_expressions(tmp_path: Path, expression: str, value: float) -> None:
    assert one(tmp_path, expression) == pytest.approx(value, rel=1e-15)


def test_subscripts_count_from_one(tmp_path: Path) -> None:
    before = "  parameter Real a[2, 3] = {{1, 2, 3}, {4, 5, 6}};\n  Real b[3] = a[2, :];"
    assert one(tmp_path, "a[1, 3] + a[end, end] + sum(b[2:end]) + sum(a[:, 1]) + sum(a[{2, 1}, 3])", before) == 34.0


def test_the_outermost_modification_wins(tmp_path: Path) -> None:
    around = """model A parameter Real k = 1; parameter Real l = 2*k; end A;
model B extends A(k = 3); end B;
model C B b(l = 10); B d(k = 5); end C;"""
    assert (
        one(tmp_path, "c.b.k + c.b.l + c.d.k + c.d.l + e.b.k", "  C c; C e(b(k = 7));", around) == 3 + 10 + 5 + 10 + 7
    )


def test_arrays_of_components(tmp_path: Path) -> None:
    around = "model A parameter Real k = 1; parameter Real v[2] = {0, 0}; Real x = k + sum(v); end A;"
    before = "  A a[3](k = {1, 2, 3}, each v = {1, 1}); A b[2](v = {{1, 2}, {3, 4}});"
    assert one(tmp_path, "sum(a.x) + sum(a[2:3].k) + b[2].x + sum(b.v)", before, around) == 12 + 5 + 8 + 10


def test_functions_are_inlined(tmp_path: Path) -> None:
    around = """function f
  input Real x[:];
  input Real scale = 2;
  output Real total;
  output Real count;
algorithm
  total := 0;
  for i in 1:size(x, 1) loop
    if x[i] > 2 then
      total := total + scale*x[i];
    else
      total := total - x[i];
    end if;
  end for;
  count := size(x, 1);
  while count > 2 loop
    count := count - 1;
  end while;
end f;"""
    model = "model M Real y; parameter Real t = 3; Real n; Real r = f({1, 2, t}, scale = 10);"
    file = tmp_path / "f.mo"
    file.write_text(f"{around}\n{model} equation (y, n) = f({{t, t}}); end M;")
    made = gt.modelica.load(f"{file}:M")()
    assert made.causal(targets=["r", "y", "n"])()[:3] == (27.0, 12.0, 2.0)


def test_records_and_their_constructors(tmp_path: Path) -> None:
    around = """record R Real a; Real b[2] = {1, 2}; end R;
function g input R r; output Real y; algorithm y := r.a + sum(r.b); end g;"""
    before = "  R r(a = 1, b = {2, 3}); R s = R(a = 10); parameter R p(a = 4, b = {5, 6});"
    assert one(tmp_path, "g(r) + g(s) + g(R(1, {1, 1})) + p.b[2]", before, around) == 6 + 13 + 3 + 6


def test_packages_imports_enumerations(tmp_path: Path) -> None:
    around = """package P
  constant Real k = 3;
  type Mode = enumeration(slow, fast);
  package Q
    constant Real l = 2*k;
    model A parameter Mode mode = Mode.slow; Real x = if mode == Mode.fast then l else k; end A;
  end Q;
end P;"""
    before = "  import P.Q.A; import L = P.Q; import P.Mode; A a; L.A b(mode = Mode.fast);"
    assert one(tmp_path, "a.x + 10*b.x + P.k", before, around) == 3 + 60 + 3


def test_conditional_components_and_redeclaration(tmp_path: Path) -> None:
    around = """model A Real x = 1; end A; model B extends A; Real y = 5; end B;
model H replaceable A a; parameter Boolean more = false; A extra if more; end H;"""
    assert one(tmp_path, "h.a.x + g.a.y + g.extra.x", "  H h; H g(redeclare B a, more = true);", around) == 1 + 5 + 1


def test_inner_and_outer(tmp_path: Path) -> None:
    around = "model W parameter Real g = 9; end W; model S outer W w; Real x = w.g; end S;"
    assert one(tmp_path, "s.x", "  inner W w(g = 2); S s;", around) == 2.0


def test_connections_sum_flows_and_unconnected_ones_are_zero(tmp_path: Path) -> None:
    text = """connector Pin Real v; flow Real i; end Pin;
partial model Two Pin p; Pin n; Real u; equation u = p.v - n.v; p.i + n.i = 0; end Two;
model R extends Two; parameter Real R = 1; equation u = R*p.i; end R;
model V extends Two; equation u = 12; end V;
model G Pin p; equation p.v = 0; end G;
model Both Pin p; Pin n; R a(R = 6); R b(R = 3); equation
  connect(p, a.p); connect(p, b.p); connect(a.n, n); connect(b.n, n); end Both;
model M V v; Both both; R alone; G g; equation
  connect(v.p, both.p); connect(v.n, g.p); connect(both.n, g.p); connect(alone.n, g.p); end M;"""
    assert values(tmp_path, text, "v.p.i", "both.a.p.i", "both.p.i", "alone.p.i") == [-6.0, 2.0, 6.0, 0.0]


def test_inconsistent_units_are_warnings_with_their_lines(tmp_path: Path) -> None:
    file = tmp_path / "units.mo"
    file.write_text("""model M
  Real x(unit = "m"); Real t(unit = "s"); Real y[2](each unit = "m"); Real z(unit = "kg");
  Real v(unit = "m/s"); Real w(unit = "m/s");
equation
  x = 1;
  t = x;
  for i in 1:2 loop
    y[i] = i*t + x;
  end for;
  z = z_0 + t*x;
  v = x/t; w = v;
protected
  parameter Real z_0(unit = "kg") = 2;
end M;""")
    made = translated(str(file))
    assert made.units
    lines = sorted(int(w.rpartition("units.mo:")[2].rstrip(")")) for w in made.warnings)
    assert lines == [6, 8, 10] and all("units differ" in w for w in made.warnings)
    assert made.model().causal(targets=["t", "v"])()[:2] == (1.0, 1.0)
    assert "plain(self.t) == plain(self.x)" in gt.modelica.python_of(file)
    # the others are still checked: a model that uses this class meets its units
    assert gt.modelica.load(file)._declared["v"].unit == "m/s"
    file.write_text('model M Real x(unit="m"); Real t(unit="m"); equation x = 1; t = x; end M;')
    assert translated(str(file)).units and not translated(str(file)).warnings


def test_parameters_from_outside_can_set_sizes(tmp_path: Path) -> None:
    file = tmp_path / "n.mo"
    file.write_text(
        "model M parameter Integer n = 2; parameter Real k = 1; Real x[n] = k*(1:n); Real s = sum(x); end M;"
    )
    assert gt.modelica.load(file, parameters={"n": 4, "k": 0.5})().causal(targets="s")()[0] == 5.0


def test_dependent_parameters_follow(tmp_path: Path) -> None:
    file = tmp_path / "p.mo"
    file.write_text("model M parameter Real a = 2; parameter Real b = 3*a; Real x = b; end M;")
    assert gt.modelica.load(file)(a=5.0).causal(targets="x")()[0] == 15.0


def test_errors_of_the_model_name_the_line_of_the_text(tmp_path: Path) -> None:
    file = tmp_path / "line.mo"
    file.write_text("model M\n  Real x;\n  Real y;\nequation\n  x = 1;\n  x = 2*time;\nend M;\n")
    with pytest.raises(gt.ModelError, match=r"line\.mo:[356]"):
        gt.modelica.load(file)().simulate(1.0)


def test_events(tmp_path: Path) -> None:
    file = tmp_path / "ball.mo"
    file.write_text(
        """model Ball
  Real h(start = 1, fixed = true); Real v(start = 0, fixed = true); discrete Real n(start = 0);
equation
  der(h) = v; der(v) = -9.81;
  when h <= 0 then
    reinit(v, -0.5*v);
    n = pre(n) + 1;
  end when;
end Ball;"""
    )
    run = gt.modelica.load(file)().simulate(0.9)
    assert run.events[0].time == pytest.approx(np.sqrt(2 / 9.81), rel=1e-6)


@settings(max_examples=25, deadline=None)
@given(st.lists(st.floats(0.1, 3.0), min_size=2, max_size=5), st.integers(0, 2**31))
def test_a_random_model_printed_and_read_again_has_equal_residuals(
    tmp_path_factory: pytest.TempPathFactory, numbers: list[float], seed: int
) -> None:
    """x[k] as products and sums of those before: the text, the class, and the printed class agree."""
    random = np.random.default_rng(seed)
    terms, by_hand = [], []
    for k, number in enumerate(numbers):
        before = int(random.integers(0, k)) if k else -1
        name = f"x[{before + 1}]" if k else "1"
        choice = int(random.integers(0, 4))
        form = ("{n}*{x} + 1", "sin({x}) - {n}", "{n}/({x}^2 + 1)", "exp(-{n}*{x})")[choice]
        terms.append(f"x[{k + 1}] = {form.format(n=repr(number), x=name)};")
        x = by_hand[before] if k else 1.0
        by_hand.append((number * x + 1, np.sin(x) - number, number / (x**2 + 1), np.exp(-number * x))[choice])
    file = tmp_path_factory.mktemp("drawn") / "drawn.mo"
    file.write_text(f"model M Real x[{len(numbers)}]; equation {' '.join(terms)} end M;")
    world: dict[str, object] = {"__name__": "printed"}
    exec(gt.modelica.python_of(file), world)
    printed = world["M"]
    assert isinstance(printed, type) and issubclass(printed, gt.Model)
    read = gt.modelica.load(file)().causal(targets=[f"x[{k + 1}]" for k in range(len(numbers))])()[:-1]
    again = printed().causal(targets=[f"x_{k + 1}" for k in range(len(numbers))])()[:-1]
    # exp(-600) is as many roundings away as its argument is large: against 1, not against itself
    np.testing.assert_allclose(read, by_hand, rtol=1e-13, atol=1e-13)
    assert read == again


def test_a_delayed_input_equals_gt_delayed(tmp_path: Path) -> None:
    file = tmp_path / "late.mop"
    file.write_text(
        "optimization Late(objectiveIntegrand = x^2 + u^2, finalTime = 2) Real x(start = 1, fixed = true); "
        "input Real u; equation der(x) = delay(u, 0.5); end Late;"
    )
    solution = gt.solve(gt.modelica.load(file)(), gt.Mesh(4))
    assert solution.objective == pytest.approx(0.5 + np.tanh(1.5), rel=1e-3)  # until 0.5 s nothing can be done


def test_an_array_of_a_function_has_a_size_before_it_has_values(tmp_path: Path) -> None:
    """As the filters of the standard library are written: protected arrays sized by one another."""
    text = """model M function f input Real a[:]; output Real y; protected Real b[size(a, 1) + 1]; Real c[size(b, 1)];
      algorithm b := cat(1, a, {1}); c := 2*b; y := sum(c); end f;
      Real y = f({time, 2}); end M;"""
    file = tmp_path / "m.mo"
    file.write_text(text)
    assert gt.modelica.load(f"{file}:M")().causal(targets="y")(5.0)[0] == 16.0
