"""Models that hypothesis draws: as Modelica text, and as residuals that plain Python computes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from hypothesis import strategies as st

Node = tuple[Any, ...]
numbers = st.integers(1, 300).map(lambda n: n / 100)
FUNCTIONS = {"sin": math.sin, "cos": math.cos, "tanh": math.tanh, "atan": math.atan}


def expressions(names: tuple[str, ...], depth: int = 3) -> st.SearchStrategy[Node]:
    """Expressions in these names, which a function `f` of one argument may shape too."""
    leaves = st.one_of(numbers.map(lambda x: ("number", x)), st.sampled_from(names).map(lambda n: ("name", n)))
    if depth == 0:
        return leaves
    inner = expressions(names, depth - 1)
    one = st.sampled_from(names).map(lambda n: ("name", n))
    moving = st.sampled_from([n for n in names if n not in ("p", "w_i", "i")]).map(lambda n: ("name", n))
    return st.one_of(
        leaves,
        st.tuples(st.sampled_from(["+", "-", "*"]), inner, inner),
        st.tuples(st.just("/"), inner, inner),
        st.tuples(st.sampled_from([*FUNCTIONS, "neg", "^2", "f"]), inner),
        # the sides hold variables: a jump between numbers is refused in an optimization
        st.tuples(st.just("if"), st.sampled_from(["<", ">", "<=", ">="]), one, inner,
                  st.tuples(st.just("*"), moving, inner), st.tuples(st.just("+"), moving, inner)),
    )  # fmt: skip


def text(e: Node) -> str:
    kind, *rest = e
    if kind in ("number", "name"):
        return repr(rest[0]) if kind == "number" else rest[0]
    if kind == "if":
        relation, a, b, then, other = rest
        return f"(if {text(a)} {relation} {text(b)} then {text(then)} else {text(other)})"
    if kind == "neg":
        return f"(-{text(rest[0])})"
    if kind == "^2":
        return f"({text(rest[0])})^2"
    if kind == "/":  # never by zero
        return f"({text(rest[0])})/(1 + ({text(rest[1])})^2)"
    if kind in "+-*":
        return f"({text(rest[0])} {kind} {text(rest[1])})"
    return f"{kind}({text(rest[0])})"


@dataclass
class Evaluation:
    """Values of names; `largest` is the largest number that occurred, by which rounding is judged."""

    names: dict[str, float]
    f: Any
    largest: float = 1.0

    def __call__(self, e: Node) -> float:
        result = self._of(e)
        self.largest = max(self.largest, abs(result))
        return result

    def _of(self, e: Node) -> float:
        kind, *rest = e
        if kind == "number":
            return rest[0]
        if kind == "name":
            return self.names[rest[0]]
        if kind == "if":
            relation, a, b, then, other = rest
            x, y = self(a), self(b)
            holds = {"<": x < y, "<=": x <= y, ">": x > y, ">=": x >= y}[relation]
            return self(then if holds else other)
        values = [self(x) for x in rest]
        if kind in ("+", "-", "*"):
            a, b = values
            return a + b if kind == "+" else a - b if kind == "-" else a * b
        if kind == "/":
            return values[0] / (1 + values[1] ** 2)
        if kind == "neg":
            return -values[0]
        if kind == "^2":
            return values[0] ** 2
        return self.f(values[0], self) if kind == "f" else FUNCTIONS[kind](values[0])


@dataclass
class Drawn:
    """A base class with parameters, an array and loops; one that extends it; arrays of both; a function."""

    size: int
    count: int
    rate: Node  # of x, z[1], p and u
    loop: Node  # of x, p, w[i] and i
    more: Node  # of x, p and z[n]
    total: Node  # of s and u
    f_steps: int
    f_scale: float
    f_split: float
    base_p: float
    base_w: list[float]
    derived_p: float
    each_p: list[float]
    each_w: list[float]
    bent: bool

    def source(self) -> str:
        vector = "{" + ", ".join(map(repr, self.base_w)) + "}"
        ws = "{" + ", ".join(map(repr, self.each_w)) + "}"
        ps = "{" + ", ".join(map(repr, self.each_p)) + "}"
        return f"""package D
  function f "a sum in a loop, and a branch"
    input Real x; output Real y;
  protected
    Real s;
  algorithm
    s := 0;
    for i in 1:{self.f_steps} loop s := s*x/(1 + x^2) + i*{self.f_scale!r}; end for;
    if s > {self.f_split!r} then y := s - x; else y := s + 2*x; end if;
  end f;
  model Base
    parameter Integer n = 1;
    parameter Real p = {self.base_p!r};
    parameter Real w[n] = {{0.5*i for i in 1:n}};
    parameter Boolean bent = false;
    Real x(start = 1, fixed = true); Real z[n]; input Real u;
  equation
    der(x) = {text(self.rate).replace("z_1", "z[1]")};
    for i in 1:n loop z[i] = {text(self.loop).replace("w_i", "w[i]")}; end for;
  end Base;
  model Derived extends Base(p = {self.derived_p!r}, n = {self.size}, w = {vector});
    Real y[2];
  equation
    if bent then y[1] = z[n] - x; else y[1] = z[n] + x; end if;
    y[2] = {text(self.more).replace("z_n", "z[n]")};
  end Derived;
  optimization M(objective = s(finalTime)^2, finalTime = 1)
    Derived d[{self.count}](p = {ps}, each bent = {str(self.bent).lower()}, each u = u);
    Base b(n = 2, w = {ws}, u = 2*u);
    Real s; Real t; input Real u;
  equation
    s = sum(d.x) + d[end].y*{{1, 2}} + b.z*b.w;
    t = {text(self.total)};
  end M;
end D;
"""

    def residuals(self, v: dict[str, float]) -> tuple[list[float], list[str], float]:
        """Residuals at values of variables and derivatives, names of what was read, and the largest number."""
        largest, result, read = 1.0, [], []

        def f(x: float, own: Evaluation) -> float:
            s = 0.0
            for i in range(1, self.f_steps + 1):
                s = s * x / (1 + x**2) + i * self.f_scale
            own.largest = max(own.largest, abs(s), abs(x))
            return s - x if s > self.f_split else s + 2 * x

        def of(e: Node, **names: float) -> float:
            nonlocal largest
            at = Evaluation(names, f)
            value = at(e)
            largest = max(largest, at.largest)
            return value

        def get(name: str) -> float:
            read.append(name)
            return v[name]

        def base(path: str, n: int, p: float, w: list[float], u: float) -> None:
            x, zs = get(f"{path}.x"), [get(f"{path}.z[{i}]") for i in range(1, n + 1)]
            result.append(get(f"der({path}.x)") - of(self.rate, x=x, z_1=zs[0], p=p, u=get(f"{path}.u")))
            result.append(get(f"{path}.u") - u)
            for i in range(1, n + 1):
                result.append(zs[i - 1] - of(self.loop, x=x, p=p, w_i=w[i - 1], i=i))

        u = get("u")
        xs, last = 0.0, [0.0, 0.0]
        for k in range(1, self.count + 1):
            p = self.each_p[k - 1]
            base(f"d[{k}]", self.size, p, self.base_w, u)
            x, y = get(f"d[{k}].x"), [get(f"d[{k}].y[{i}]") for i in (1, 2)]
            z = get(f"d[{k}].z[{self.size}]")
            result.append(y[0] - (z - x if self.bent else z + x))
            result.append(y[1] - of(self.more, x=x, p=p, z_n=z))
            xs, last = (x if k == 1 else xs + x), y
        base("b", 2, self.base_p, self.each_w, 2 * u)
        zs = [get(f"b.z[{i}]") for i in (1, 2)]
        s = get("s")
        by_parts = xs + (last[0] * 1 + last[1] * 2) + (zs[0] * self.each_w[0] + zs[1] * self.each_w[1])
        result.append(s - by_parts)
        result.append(get("t") - of(self.total, s=s, u=u))
        return result, read, largest


@st.composite
def models(draw: Any) -> Drawn:
    size, count = draw(st.integers(1, 3)), draw(st.integers(1, 3))

    def some(n: int) -> list[float]:
        return draw(st.lists(numbers, min_size=n, max_size=n))

    made = Drawn(
        size, count, draw(expressions(("x", "z_1", "p", "u"))), draw(expressions(("x", "p", "w_i", "i"), 2)),
        draw(expressions(("x", "p", "z_n"))), draw(expressions(("s", "u"))), draw(st.integers(1, 4)), draw(numbers),
        draw(numbers), draw(numbers), some(size), draw(numbers), some(count), some(2), draw(st.booleans()),
    )  # fmt: skip
    return made
