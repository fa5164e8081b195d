"""A class as a Python syntax tree: compiled, with the line numbers of the text, or printed."""

from __future__ import annotations

import ast
import keyword
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any

import casadi as ca

from ..lang.expression import Expr
from ..lang.model import Model
from ..lang.optimization import Optimization
from ..lang.units import DIMENSIONLESS
from .syntax import ModelicaError, Place, Source

# relative round-off tolerance for a floor at the instant at which the value reaches an integer
ROUND_OFF = 1e-12
_TAKEN = frozenset(n for n in (*dir(Optimization), "time", "where", "gt", "der", "self") if not n.startswith("__"))


def identifier(name: str) -> str:
    """Return a name of the text as a Python identifier: `tank[2].x` becomes tank_2_x."""
    word = "".join(c if c.isalnum() and c.isascii() else "_" for c in name).strip("_") or "x"
    word = word if not word[0].isdigit() else f"n_{word}"
    while "__" in word:
        word = word.replace("__", "_")
    return f"{word}_" if keyword.iskeyword(word) or word in _TAKEN else word


def exact(name: str) -> str:
    """Return the name of the text, with an underscore added if every model has an attribute of that name."""
    if name.startswith("_"):
        raise ModelicaError(f"names that begin with an underscore are not supported; found '{name}'")
    return f"{name}_" if name in _TAKEN or name in ("None", "True", "False") else name


@dataclass(eq=False)
class Written:
    """A class as Python statements with their places in the text: of its body and of its methods."""

    name: str
    at: Place
    optimization: bool
    description: str
    body: list[tuple[Place, ast.stmt]] = field(default_factory=list)
    methods: dict[str, list[tuple[Place, ast.stmt]]] = field(default_factory=dict)
    helpers: list[str] = field(default_factory=list)  # discrete variables that results do not contain


def _method(name: str, statements: list[ast.stmt], line: int) -> ast.FunctionDef:
    arguments = ast.arguments(posonlyargs=[], args=[ast.arg("self")], kwonlyargs=[], kw_defaults=[], defaults=[])
    result = ast.FunctionDef(name=name, args=arguments, body=statements, decorator_list=[], returns=None)
    for node in (result, arguments, *arguments.args):
        node.lineno = node.end_lineno = line  # type: ignore[attr-defined]
        node.col_offset = node.end_col_offset = 0  # type: ignore[attr-defined]
    return result


def text_of(written: Written) -> str:
    """Return the class as the text of a Python module."""
    base = "gt.Optimization" if written.optimization else "gt.Model"
    words = written.description or f"{written.name}, from Modelica text."
    body: list[ast.stmt] = [ast.Expr(ast.Constant(words)), *[s for _, s in written.body]]
    for name, statements in written.methods.items():
        body.append(_method(name, [s for _, s in statements], 1))
    tree = ast.ClassDef(
        name=identifier(written.name), bases=[ast.parse(base, mode="eval").body], keywords=[], body=body,
        decorator_list=[],
    )  # fmt: skip
    module = ast.Module([tree], [])
    called = {n.func.id for n in ast.walk(module) if isinstance(n, ast.Call) and isinstance(n.func, ast.Name)}
    names = "".join(
        f"from {m} import {n}\n"
        for m, n in (("gtmodel", "der"), *(("gtmodel.modelica", n) for n in ("plain", "step", "whole")))
        if n in called
    )
    return f"import gtmodel as gt\n{names}\n\n{ast.unparse(ast.fix_missing_locations(module))}\n"


def plain(x: Any) -> Any:
    """Return an expression without its unit; a number is returned unchanged.

    Used for time in a text that declares no units, and for quantities of an equation whose units are inconsistent.

    >>> m = gt.Builder()
    >>> gt.modelica.plain(m.variable("x", unit="m"))
    Expr(x, shape=(), unit=None)
    """
    return Expr(x.sx, x.shape, None, x.scope) if isinstance(x, Expr) else x


def step(a: Any, b: Any) -> Any:
    """Return 1 if a >= b, otherwise 0, for the right side of an action of `gt.when`, which is evaluated at one instant.

    Elsewhere use `gt.If`, which switches at the exact time.

    >>> m = gt.Builder()
    >>> gt.modelica.step(m.variable("x", unit="m"), 1.0)
    Expr((1<=x), shape=(), unit=1)
    """
    left, right = (x.sx if isinstance(x, Expr) else ca.SX(x) for x in (a, b))
    scope = next(x.scope for x in (a, b) if isinstance(x, Expr))
    return Expr(ca.SX(left >= right), (), DIMENSIONLESS, scope)


def whole(x: Expr) -> Expr:
    """Return the floor of an expression, with a tolerance for round-off.

    As `step`, for the right side of an action of `gt.when`.

    >>> m = gt.Builder()
    >>> gt.modelica.whole(m.variable("x", unit="m")).shape
    ()
    """
    return Expr(ca.floor(x.sx + ROUND_OFF * (1 + ca.fabs(x.sx))), (), None, x.scope)


def class_of(written: Written, extra_names: dict[str, Any] | None = None) -> type[Model]:
    """Compile the class with the line numbers of the text. Executes translated statements only, with no builtins."""
    gt: Any = import_module("gtmodel")
    world: dict[str, Any] = {"gt": gt, "der": gt.der, "plain": plain, "step": step, "whole": whole}
    world |= {"__builtins__": {}, "__name__": "modelica", **(extra_names or {})}
    namespace: dict[str, Any] = {"__doc__": written.description, "__module__": "modelica"}
    for source, statements in _runs(written.body):
        code = compile(ast.Module(statements, []), source.name, "exec")
        exec(code, world, namespace)
    for name in written.helpers:
        namespace[name].helper = True
    for name, lines in written.methods.items():
        parts = []
        for source, statements in _runs(lines):
            methods_namespace: dict[str, Any] = {}
            first = getattr(statements[0], "lineno", 1)
            exec(
                compile(ast.Module([_method(name, statements, first)], []), source.name, "exec"),
                world,
                methods_namespace,
            )
            parts.append(methods_namespace[name])
        namespace[name] = parts[0] if len(parts) == 1 else _chained(parts)
    base = Optimization if written.optimization else Model

    def __init__(self: Any, **modifiers: Any) -> None:  # noqa: N807
        base.__init__(self, **modifiers)
        self._keep(where=written.at.where)  # the class in the text, not the caller

    attributes = {"__init__": __init__, "_written": written.at.where, "_counts_from_one": True}
    cls: Any = type(written.name, (base,), {**namespace, **attributes})
    return cls


def _chained(parts: list[Callable[[Any], Any]]) -> Callable[[Any], Any]:
    def method(self: Any) -> Any:
        for part in parts:
            yield from part(self)

    return method


def _runs(lines: list[tuple[Place, ast.stmt]]) -> Iterable[tuple[Source, list[ast.stmt]]]:
    """Group consecutive statements of one file, since a code object has one file name."""
    run: list[ast.stmt] = []
    for n, (place, statement) in enumerate(lines):
        run.append(statement)
        if n + 1 == len(lines) or lines[n + 1][0].source is not place.source:
            yield place.source, run
            run = []
