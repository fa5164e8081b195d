"""gtmodel holds one zero-order hold and one bisection: others are found by name, by their text and by what they do."""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import cache
from importlib import import_module
from typing import Any

import numpy as np
import pytest
import scipy

from tests.support import sources

NAMES = re.compile(r"bisect|zoh|zero_order|c2d|held?_input$|discreti[sz]ed?_(system|plant|matri)", re.I)
NAMED = {"linear/roots.py:bisected", "cgen/proof.py:_bisected"}  # the second cuts a box in two, and finds no root
# matrix exponentials without an input, and Van Loan's of noise, are no hold
EXPONENTIALS = {
    "linear/state_space.py:held", "filtering/transition.py:_covariance", "loop/plant.py:__init__",
    "milling/stability.py:_step",
}  # fmt: skip
# the second takes many rows at once beyond bisection, the third needs the rates of an integrator: Brent's method does
# neither; the fourth halves what may be proved of a box, which is no function
HALVED = {
    "linear/roots.py:bisected", "geometry/chains/elbow.py:roots", "simulation/hybrid/comparisons.py:first_root",
    "certify/certificate_study.py:_largest",
}  # fmt: skip
SAME = 1e-9  # of a hold computed in another way, such as by eigenvectors
TRACE = {0.5, 0.25, 0.375}  # where a bisection looks for 1/3 in 0..1

PLAIN = (ast.BinOp, ast.Name, ast.Constant, ast.Load, ast.Add, ast.Sub, ast.Mult, ast.Div, ast.FloorDiv)

Functions = dict[str, ast.FunctionDef]


def functions(nodes: Iterable[ast.AST], file: str = "") -> Functions:
    return {f"{file}:{n.name}": n for n in nodes if isinstance(n, ast.FunctionDef)}


def of_text(text: str) -> list[ast.FunctionDef]:
    return list(functions(ast.walk(ast.parse(text))).values())


@cache
def house() -> Functions:
    files = {p.relative_to(sources.HOUSE).as_posix(): nodes for p, nodes in sources.house().items()}
    return {place: f for file, nodes in files.items() for place, f in functions(nodes, file).items()}


def named(f: ast.FunctionDef) -> bool:
    return bool(NAMES.search(f.name))


def exponential(f: ast.FunctionDef) -> bool:
    called = (n.func for n in ast.walk(f) if isinstance(n, ast.Call))
    return any(getattr(n, "attr", getattr(n, "id", "")) == "expm" for n in called)


def halves(f: ast.FunctionDef) -> bool:
    """A loop takes the middle of two names and puts it in place of one of them."""
    for loop in (n for n in ast.walk(f) if isinstance(n, ast.For | ast.While)):
        lines = [
            (n.targets if isinstance(n, ast.Assign) else [n.target], n.value)
            for n in ast.walk(loop)
            if isinstance(n, ast.Assign | ast.AnnAssign) and n.value is not None
        ]
        middles = {ast.unparse(targets[0]): ends for targets, value in lines if (ends := _ends(value))}
        for targets, value in lines:
            written, read = _names(targets), _names([value])
            if any(written & ends and middle in read and middle not in written for middle, ends in middles.items()):
                return True
    return False


def _ends(value: ast.AST) -> set[str]:
    """The two names that a part of an expression is the mean of, as (a + b) / 2, a + (b - a) // 2, 0.5 * (a + b)."""
    for n in (n for n in ast.walk(value) if isinstance(n, ast.BinOp)):
        names = sorted(_names([n]))
        plain = all(isinstance(x, PLAIN) for x in ast.walk(n))
        if plain and len(names) == 2 and any(isinstance(x, ast.Constant) and x.value in (2, 0.5) for x in ast.walk(n)):
            code = compile(ast.Expression(n), "middle", "eval")
            if all(eval(code, dict(zip(names, at, strict=True))) == sum(at) / 2 for at in ((2, 8), (4, 100))):
                return set(names)
    return set()


def _names(nodes: Iterable[ast.AST]) -> set[str]:
    return {n.id for node in nodes for n in ast.walk(node) if isinstance(n, ast.Name)}


def required(f: ast.FunctionDef) -> list[str]:
    """Annotations of the arguments that a call must give, "Any" where there is none."""
    must = f.args.args[: len(f.args.args) - len(f.args.defaults)]
    return [ast.unparse(a.annotation) if a.annotation else "Any" for a in must]


def may_hold(f: ast.FunctionDef) -> bool:
    a = required(f)
    return len(a) == 3 and a[2] in ("float", "Any") and all("rray" in x or x == "Any" for x in a[:2])


def may_bisect(f: ast.FunctionDef) -> bool:
    a = required(f)
    return 3 <= len(a) <= 5 and "Callable" in a[0] and all(x in ("float", "int", "Any") for x in a[1:])


def is_hold(function: Callable[..., Any]) -> bool:
    """Whether it gives F and G of x' = A x + B u."""
    A, B = np.array([[-1.0, 2.0], [0.5, -3.0]]), np.array([[1.0], [0.25]])
    E = scipy.linalg.expm(0.3 * np.block([[A, B], [np.zeros((1, 3))]]))
    try:
        F, G = function(A, B, 0.3)
        return bool(np.allclose(F, E[:2, :2], atol=SAME) and np.allclose(G, E[:2, 2:], atol=SAME))
    except Exception:  # it takes something else
        return False


def is_bisection(function: Callable[..., Any], arguments: int) -> bool:
    """Whether it looks for 1/3 where a bisection does, asked for a truth or for a sign."""
    for answer in (lambda x: x < 1 / 3, lambda x: 1 / 3 - x):
        tried: list[float] = []

        def asked(x: Any, answer: Any = answer, tried: list[float] = tried) -> Any:
            tried.append(float(x))
            return answer(x)

        with suppress(Exception):  # it takes something else
            function(asked, 0.0, 1.0, *[12] * (arguments - 3))
        if TRACE <= set(tried):
            return True
    return False


@pytest.mark.parametrize(("kind", "known"), [(named, NAMED), (exponential, EXPONENTIALS), (halves, HALVED)])
def test_no_second_one_is_written(kind: Callable[[ast.FunctionDef], bool], known: set[str]) -> None:
    assert {place for place, f in house().items() if kind(f)} == known


def test_no_second_one_does_the_same() -> None:
    same = set()
    for place, f in house().items():
        if may_hold(f) or may_bisect(f):
            file, name = place.removesuffix(f".py:{f.name}"), f.name
            function = getattr(import_module(f"gtmodel.{file.replace('/', '.')}"), name, None)  # None of a method
            if function and (is_hold(function) if may_hold(f) else is_bisection(function, len(required(f)))):
                same.add(place)
    assert same == {"linear/state_space.py:held", "linear/roots.py:bisected"}


HOLD = """
def sampled(a: np.ndarray, b: np.ndarray, t: float):
    w, v = np.linalg.eig(a)
    f = np.real(v * np.exp(w * t) @ np.linalg.inv(v))
    return f, np.linalg.solve(a, (f - np.eye(len(a))) @ b)
"""
ROOTS = [
    "    while high - low > 1e-3:\n        m = (low + high) / 2\n"
    "        low, high = (m, high) if f(m) > 0 else (low, m)\n",
    "    for _ in range(12):\n        m = low + (high - low) / 2\n        if f(m) > 0:\n            low = m\n"
    "        else:\n            high = m\n",
    "    for _ in range(12):\n        m = 0.5 * (low + high)\n        low = np.where(f(m) > 0, m, low)\n"
    "        high = np.where(low == m, high, m)\n",
]


@pytest.mark.parametrize("body", ROOTS)
def test_a_second_bisection_is_found(body: str) -> None:
    text = f"def edge(f: Callable[[float], float], low: float, high: float):\n{body}    return low\n"
    (planted,) = of_text(text)
    exec(compile(text, "planted", "exec"), room := {"np": np, "Callable": Callable})
    assert halves(planted) and may_bisect(planted) and is_bisection(room["edge"], 3)
    assert not halves(*of_text(text.replace("/ 2", "/ 3").replace("0.5", "0.3")))


def test_a_second_hold_is_found_and_others_are_left_alone() -> None:
    (planted,) = of_text(HOLD)
    exec(compile(HOLD, "planted", "exec"), room := {"np": np})
    assert may_hold(planted) and is_hold(room["sampled"]) and not exponential(planted)
    (another,) = of_text("def zoh(a, b, t):\n    return scipy.linalg.expm(a * t)\n")
    assert named(another) and exponential(another) and not halves(another)
    (mean,) = of_text("def f(a, b):\n    for c in a:\n        m = (a + b) / 2\n        c = m\n    return c\n")
    assert not halves(mean)
