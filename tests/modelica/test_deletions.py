"""Deletion of each keyword, bracket and semicolon of a text: an error with its place, or the same optimum."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import gtmodel as gt
from gtmodel.modelica.translate import translated

pytest.importorskip("lark")
TEXT = """within;
package Plant "of two tanks"
  connector Pipe
    Real p "pressure";
    flow Real m "mass flow";
  end Pipe;

  function outflow
    input Real level;
    input Real area = 0.2;
    output Real m;
  protected
    Real root;
  algorithm
    root := sqrt(level^2 + 0.01);
    if area > 0 then
      m := area*root;
    else
      m := 0;
    end if;
  end outflow;

  model Tank
    parameter Real A(min = 0.1) = 1;
    parameter Integer n = 2;
    Real level(start = 1, fixed = true);
    Real w[n];
    Pipe pipe;
  equation
    A*der(level) = pipe.m - outflow(level);
    pipe.p = level;
    for i in 1:n loop
      w[i] = i*level;
    end for;
  end Tank;

  model Source
    input Real u;
    Pipe pipe;
  equation
    pipe.m = -u;
  end Source;

  model Pair
    Tank tank[2](A = {1, 2});
    Source source(u = u);
    Real middle;
    input Real u;
  equation
    connect(source.pipe, tank[1].pipe);
    middle = if n > 1 then tank[2].level else 0;
  protected
    parameter Integer n = 2;
  end Pair;

  optimization Fill(objectiveIntegrand = (tank[1].level - 2)^2 + u^2 + 0.1*middle*tank[1].w[2], finalTime = 2)
    extends Pair(u(min = -1, max = 3));
  constraint
    tank[1].level(finalTime) = 2;
    tank[2].level <= 3;
  end Fill;
end Plant;
"""
TOKEN = re.compile(
    r'"[^"]*"|[()\[\]{};]|\b(?:within|package|connector|end|flow|function|input|output|protected|algorithm|if|then|else|'
    r"model|parameter|equation|for|in|loop|connect|optimization|extends|constraint|der|Integer|Real)\b"
)
# what is legal without the word and says something else: pressure and flow alike, an input that is a variable, ...
OTHERWISE = {"flow", "input", "der", "parameter", "output", "else"}
HORIZON = gt.Mesh(4, points=2)


def optimum(file: Path) -> float:
    made = translated(f"{file}:Fill")
    return gt.solve(made.model(), HORIZON, throw=False).objective


@pytest.mark.slow
def test_each_token_matters(tmp_path: Path) -> None:
    file = tmp_path / "plant.mop"
    file.write_text(TEXT)
    whole = optimum(file)
    places = [m for m in TOKEN.finditer(TEXT) if not m[0].startswith('"')]
    assert len(TEXT.splitlines()) >= 60 and len(places) > 140
    unsaid, otherwise = [], set()
    for m in places:
        file.write_text(TEXT[: m.start()] + " " * len(m[0]) + TEXT[m.end() :])
        line = TEXT.count("\n", 0, m.start()) + 1
        following = TEXT.count("\n", 0, next((n.start() for n in re.finditer(r"\S", TEXT) if n.start() >= m.end()),
                                             m.start())) + 1  # fmt: skip
        try:
            value = optimum(file)
        except gt.ModelError as error:
            named = error.where.line if error.where is not None and error.where.file.endswith("plant.mop") else 0
            if named in (line, following) or _begins(m[0], named, line):
                continue
            otherwise.add(m[0])
            if m[0] not in OTHERWISE:
                unsaid.append((m[0], line, str(error)))
            continue
        if value == whole:
            continue
        otherwise.add(m[0])
        if m[0] not in OTHERWISE:
            unsaid.append((m[0], line, f"another optimum, {value}"))
    assert not unsaid and otherwise == OTHERWISE, (unsaid, otherwise)


def _begins(token: str, named: int, line: int) -> bool:
    """A word without which a name and what follows it may still be a declaration: the text is legal a little longer."""
    return token in ("connector", "function", "model", "end") and 0 < named - line <= 2
