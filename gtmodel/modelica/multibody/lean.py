"""Selection of variables of parts: all with names in the text, or only those that are used."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from ..constraints import Flattened, ScalarEquation, ScalarIf, ScalarWhen
from ..scalars import Flat, Symbol, symbols


def shown(flat: Flattened) -> Flattened:
    """Return a flattened class with the positions of frames as variables, under their names in the text."""
    if not flat.parts:
        return flat
    positions: list[Flat] = []
    equations: list[Any] = []
    for item in flat.shown:
        variable = replace(item, replaced=None, kind="variable", bound=lambda: None, cache={})
        positions.append(variable)
        equations.append(ScalarEquation(Symbol(variable), item.replaced, item.at))
    optional = flat.optional | {id(f) for f in positions}
    return replace(flat, flats=[*flat.flats, *positions], equations=[*flat.equations, *equations], optional=optional)


def lean(flat: Flattened) -> Flattened:
    """Return a flattened class without variables and parameters of parts that nothing else uses."""
    if not flat.parts:
        return flat
    equations, removed = list(flat.equations), set[int]()
    while True:
        used = Counter(id(f) for e in equations for x in _sides(e) for f in symbols(x))
        used.update(id(f) for x in _others(flat) for f in symbols(x))
        dropped = {
            n: id(e.left.flat)
            for n, e in enumerate(equations)
            if isinstance(e, ScalarEquation) and isinstance(e.left, Symbol) and id(e.left.flat) in flat.optional
            and used[id(e.left.flat)] == 1 and e.left.flat.get("start") is None and e.left.flat.get("fixed") is None
        }  # fmt: skip
        if not dropped:
            break
        removed |= set(dropped.values())
        equations = [e for n, e in enumerate(equations) if n not in dropped]
    read = _read([x for e in equations for x in _sides(e)] + list(_others(flat)))
    unused = {id(f) for f in flat.flats if f.kind == "parameter" and not f.free} & flat.optional - read
    kept = [f for f in flat.flats if id(f) not in removed | unused]
    return replace(flat, flats=kept, equations=equations)


def _read(expressions: list[Any]) -> set[int]:
    """Return ids of variables and parameters in expressions and, recursively, in bindings of parameters."""
    read, waiting = set[int](), expressions
    while waiting:
        for f in symbols(waiting.pop()):
            if id(f) not in read:
                read.add(id(f))
                if f.kind in ("parameter", "constant") and f.binding is not None:
                    waiting.append(f.binding)
    return read


def _sides(e: ScalarEquation | ScalarIf | ScalarWhen) -> Iterator[Any]:
    if isinstance(e, ScalarEquation):
        yield from (e.left, e.right)
    elif isinstance(e, ScalarIf):
        yield e.condition
        for x in (*e.then, *e.otherwise):
            yield from (x.left, x.right)
    else:
        for branch in e.branches:
            yield branch.condition
            for x in branch.actions:
                yield from (x.left, x.right)
            for pair in branch.restarts:
                yield from pair


def _others(flat: Flattened) -> Iterator[Any]:
    for e in (*flat.initial, *flat.constraints):
        yield from (e.left, e.right)
    yield from (x for x in flat.header.values() if not isinstance(x, (int, float, bool, str)))
    yield from (value for _, value, _ in flat.branches)
    for part in flat.parts:
        for value in part.options.values():
            yield from value.ravel() if hasattr(value, "ravel") else ()
    for item in flat.flats:
        for name in ("start", "min", "max", "nominal"):
            if (value := item.get(name)) is not None:
                yield value
