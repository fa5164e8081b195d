"""Parts of gt.mechanics as Python's syntax tree."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterable
from typing import Any

from ..scalars import Operation, is_literal
from ..syntax import Place
from .parts import MechanicsPart


class PartWriter:
    """Names of parts in the class, none of which is a variable's, and what is written of them."""

    def __init__(
        self, parts: Iterable[MechanicsPart], naming: Callable[[str], str], taken: Iterable[str], units: bool
    ) -> None:
        self._names, seen, self._units = dict[str, str](), set(taken), units
        for part in parts:
            name = naming(part.name)
            while name in seen:
                name += "_"
            seen.add(name)
            self._names[part.name] = name

    def declared(
        self, part: MechanicsPart, resolved: Callable[[Any, Place], Any], written: Callable[[Any], ast.expr]
    ) -> Any:
        """`name = gt.part(gt.mechanics.Revolute, axis=[0.0, 0.0, 1.0])`."""

        def option(value: Any) -> ast.expr:
            """Numbers, or a function of the model where parameters decide."""
            if not hasattr(value, "ravel"):
                return ast.parse(repr(value), mode="eval").body
            items = [resolved(x, part.at) for x in value.ravel()]
            rows: list[ast.expr] = [written(float(x) if is_literal(x) else x) for x in items]
            for n in reversed(value.shape):
                rows = [ast.List(rows[k : k + n], ast.Load()) for k in range(0, len(rows), n)]
            if all(is_literal(x) for x in items):
                return rows[0]
            given = ast.arguments(posonlyargs=[], args=[ast.arg("self")], kwonlyargs=[], kw_defaults=[], defaults=[])
            return ast.Lambda(given, rows[0])

        options = [ast.keyword(k, option(v)) for k, v in part.options.items()]
        value = ast.Call(_attributes("gt", "part"), [_attributes("gt", "mechanics", part.cls)], options)
        return ast.Assign([ast.Name(self._names[part.name], ast.Store())], value)

    def connected(self, a: str, b: str) -> ast.stmt:
        """`yield gt.connect(self.joint.b, self.body.frame)`."""
        ports: list[ast.expr] = []
        for path in (a, b):
            part, port = path.rsplit(".", 1)
            ports.append(_attributes("self", self._names[part], port))
        return ast.Expr(ast.Yield(ast.Call(_attributes("gt", "connect"), ports, [])))

    def quantity(self, x: Operation) -> ast.expr:
        """`self.joint.shaft.phi`."""
        part, path, indices = x.arguments
        result = _attributes("self", self._names[part], *path.split("."))
        if indices:
            numbers: list[ast.expr] = [ast.Constant(int(i)) for i in indices.split(",")]
            index = numbers[0] if len(numbers) == 1 else ast.Tuple(numbers, ast.Load())
            result = ast.Subscript(result, index, ast.Load())
        return result if self._units else ast.Call(ast.Name("plain", ast.Load()), [result], [])


def _attributes(first: str, *names: str) -> ast.expr:
    result: ast.expr = ast.Name(first, ast.Load())
    for name in names:
        result = ast.Attribute(result, name, ast.Load())
    return result
