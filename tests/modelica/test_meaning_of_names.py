"""Lookup of classes and values: inherited scopes, redeclarations, constrainedby, records, final."""

from __future__ import annotations

from pathlib import Path

import pytest

import gtmodel as gt
from tests.modelica.values import one

pytest.importorskip("lark")
PACKAGE = """package P
  constant Real k = 2;
  function f input Real x; output Real y; algorithm y := k*x; end f;
  model B Real x; equation x = k; end B;
  model C parameter Real q = k; Real x = q + k; end C;
end P;
"""
REPLACED = """model A1 Real x = 1; end A1;
model A2 Real x = 10; end A2;
model A3 parameter Real k = 4; Real x = k; end A3;
model A4 extends A3; parameter Real l = 100; Real y = k + l; end A4;
"""
CLASS = REPLACED + "model H replaceable model A = A1; A a; end H;\n"
PARTS = "package P replaceable model A Real x = 1; end A; model B A a; end B; end P;\n" + REPLACED
RECORD = """record R Real a; Real b = 2; end R;
record S extends R; Real c = 5; end S;
record N R r(b = 7); Real d = 1; end N;
function mk input Real x; output R r; algorithm r.a := x; r.b := 3*x; end mk;
"""
OUTER = "model W parameter Real g = 1; end W; model A outer W w; Real y = w.g; end A;"
TWO = "".join(
    f"package {p} constant Real k = {n}; function f output Real y; algorithm y := k; end f; end {p};"
    for n, p in enumerate("PQ")
)


@pytest.mark.parametrize(
    ("expression", "before", "around", "value"),
    [
        # an inherited equation speaks of what is around the class in which it stands
        ("d.x", "D d;", PACKAGE + "model D extends P.B; parameter Real k = 5; end D;", 2),
        ("d.x", "D d;", PACKAGE + "model D extends P.C; parameter Real k = 5; end D;", 4),
        # an inherited class, of the constants as they are changed
        ("Q.f(1) + Q.k", "", PACKAGE + "package Q extends P(k = 3); end Q;", 6),
        ("b.x", "Q.B b;", PACKAGE + "package Q extends P(k = 3); end Q;", 3),
        ("Q.f(1) + P.f(1)", "", PACKAGE + "package Q = P(k = 3);", 5),
        ("h.y", "H h(k = 5);", "model H constant Real k = 1; Real y = f(1);"
         "function f input Real x; output Real y; algorithm y := k*x; end f; end H;", 5),
        # redeclared classes
        ("b.a.x", "Q.B b;", PARTS + "package Q extends P(redeclare model A = A2); end Q;", 10),
        ("b.a.x", "Q.B b;", PARTS + "package Q extends P; redeclare model A = A2; end Q;", 10),
        ("b.a.x", "Q.B b;", PARTS + "package Q extends P; redeclare model A Real x = 9; end A; end Q;", 9),
        ("h.a.x", "I h;", CLASS + "model I extends H; redeclare model A = A2; end I;", 10),
        ("h.a.x", "I h;", CLASS + "model I extends H; redeclare model A Real x = 9; end A; end I;", 9),
        ("h.a.x", "I h;", CLASS + "model I extends H(redeclare model A = A3(k = 6)); end I;", 6),
        ("h.a.x", "I h(k = 8);",
         CLASS + "model I parameter Real k = 1; extends H(redeclare model A = A3(k = k)); end I;", 8),
        ("h.a.x", "H h(A(x = 10));", CLASS, 10),
        ("h.a.x", "I h;", CLASS + "model I extends H(A(x = 10)); end I;", 10),
        # redeclared components
        ("h.a.y", "I h;",
         REPLACED + "model H replaceable A3 a(k = 6); end H; model I extends H; redeclare A4 a; end I;", 106),
        ("h.a.x", "H h;", REPLACED + "model H replaceable A3 a constrainedby A3(k = 6); end H;", 6),
        ("h.a.y", "H h(redeclare A4 a);", REPLACED + "model H replaceable A3 a constrainedby A3(k = 6); end H;", 106),
        ("h.a.x", "H h;", REPLACED + "model H replaceable A3 a(k = 7) constrainedby A3(k = 6); end H;", 7),
        ("h.a.x", "H h;", REPLACED + "model H replaceable model M = A3 constrainedby A3(k = 6); M a; end H;", 6),
        ("h.a.y", "H h(redeclare model M = A4);",
         REPLACED + "model H replaceable model M = A3 constrainedby A3(k = 6); M a; end H;", 106),
        # the value of a record stands above the values of its fields
        ("r.a + r.b", "R r = R(4, 5);", RECORD, 9),
        ("r.a + r.b", "R r = mk(2);", RECORD, 8),
        ("s.a + 10*s.b + 100*s.c", "S s = S(1, 2, 3);", RECORD, 321),
        ("q.a + q.b", "parameter R p(a = 4, b = 8); R q = p;", RECORD, 12),
        ("n.r.a + 10*n.r.b", "N n = N(R(3, 4));", RECORD, 43),
        ("n.r.b", "N n(r(a = 1));", RECORD, 7),
        # packages by way of packages
        ("p.m.h + q.m.h", "Pipe p(redeclare package Medium = Water); Pipe q(redeclare package Medium = Water(cp = 5));",
         """partial package Fluid constant Real cp = 1; constant Real double = 2*cp;
           replaceable partial model Props Real h; Real T; end Props; end Fluid;
         package Water extends Fluid(cp = 4);
           redeclare model Props Real h; Real T; equation h = double*T; end Props; end Water;
         model Pipe replaceable package Medium = Fluid; Medium.Props m; equation m.T = 3; end Pipe;""", 54),
        ("1 + sum(c.y)", "C c[0];", "model C Real y = 1; end C;", 1),
        ("k", "import P.k; import Q.*;", TWO, 0),
        # one class inherited on two ways is there once
        ("d.x", "D d;", "model A Real x; equation x = 1; end A; model B extends A; end B; model C extends A; end C;"
         "model D extends B; extends C; end D;", 1),
    ],
)  # fmt: skip
def test_lookup_of_names(tmp_path: Path, expression: str, before: str, around: str, value: float) -> None:
    assert one(tmp_path, expression, before, around) == value


@pytest.mark.parametrize(
    ("expression", "before", "around", "word"),
    [
        ("h.a.x", "H h(redeclare model A = A2);", CLASS.replace("replaceable ", ""), "not replaceable"),
        ("c.b.k", "C c(b(k = 3));", "model B parameter Real k = 1; end B; model C final B b(k = 2); end C;", "final"),
        ("c.k", "C c(k(min = 3));", "model C final parameter Real k(min = 1) = 5; end C;", "final"),
        ("d.x", "D d;", "model A parameter Real x = 1; end A; model B extends A(x = 2); end B;"
         "model C extends A(x = 3); end C; model D extends B; extends C; end D;", "inherited twice"),
        ("e.x", "P.E e;", "package P constant Real c = 1; encapsulated model E Real x = c; end E; end P;", "'c'"),
        ("h.y", "H h;", "model H A3 a; redeclare A4 a; end H;" + REPLACED, "declared twice"),
        ("h.y", "H h;", "model H redeclare A4 a; Real y = 1; end H;" + REPLACED, "redeclare"),
        ("P.k", "", "package P Real k = 1; end P;", "not a constant"),
        ("a.y", "inner W w; A a;", OUTER.replace("W w;", "W w(g = 5);"), "inner declaration"),
        ("a.y", "inner W w; A a(w(g = 5));", OUTER, "inner declaration"),
        ("a.y", "inner W w; A a;", OUTER.replace("outer", "inner outer"), "both inner and outer"),
        ("x", "Real x(value = 3) = 1;", "", "value"),
        ("P.k", "", "package P constant Real k = 1; end P; package P constant Real k = 2; end P;", "declared twice"),
        ("k", "import P.k; import Q.k;", TWO, "imported twice"),
        ("k", "import P.*; import Q.*;", TWO, "several"),
        ("f()", "import P.*; import Q.*;", TWO, "several"),
        ("p", "parameter Real p = time;", "", "varies"),
        ("p", "Real x = 1; parameter Real q = x; parameter Real p = q;", "", "varies"),
        ("H.k", "", "model H parameter Real k = 1; end H;", "not a constant"),
    ],
)  # fmt: skip
def test_invalid_names_and_modifications(tmp_path: Path, expression: str, before: str, around: str, word: str) -> None:
    with pytest.raises(gt.modelica.ModelicaError, match=word):
        one(tmp_path, expression, before, around)


def test_files_of_a_folder_with_within_clauses(tmp_path: Path) -> None:
    files = {
        "a.mo": "within P.Q; model X Real y = z + k; end X;", "b.mo": "within P; package Q constant Real z = 6; end Q;",
        "c.mo": "package P constant Real k = 1; end P;", "d.mo": "operator record C Real re; Real im; end C;",
    }  # fmt: skip
    folder = tmp_path / "library"
    folder.mkdir()
    for name, text in files.items():
        (folder / name).write_text(text)
    file = tmp_path / "text.mo"
    file.write_text("model M P.Q.X x; C c(re = 1, im = 2); Real y = x.y + c.im; end M;")
    model = gt.modelica.load(f"{file}:M", library=[folder])()
    assert float(model.causal(targets=["y"])()[0]) == 9.0
