"""What of the parts' variables is written: all that the text names them, or what the text asks for."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from ..constraints import Flattened, ScalarEquation, ScalarIf, ScalarWhen
from ..scalars import Flat, Symbol, symbols


def shown(flat: Flattened) -> Flattened:
    """With positions of frames as variables of their own, under their names in the text."""
    if not flat.parts:
        return flat
    made: list[Flat] = []
    equations: list[Any] = []
    for item in flat.shown:
        own = replace(item, replaced=None, kind="variable", bound=lambda: None, cache={})
        made.append(own)
        equations.append(ScalarEquation(Symbol(own), item.replaced, item.at))
    optional = flat.optional | {id(f) for f in made}
    return replace(flat, flats=[*flat.flats, *made], equations=[*flat.equations, *equations], optional=optional)


def lean(flat: Flattened) -> Flattened:
    """Without variables and parameters of the parts that nothing else asks for."""
    if not flat.parts:
        return flat
    equations, gone = list(flat.equations), set[int]()
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
        gone |= set(dropped.values())
        equations = [e for n, e in enumerate(equations) if n not in dropped]
    read = _read([x for e in equations for x in _sides(e)] + list(_others(flat)))
    silent = {id(f) for f in flat.flats if f.kind == "parameter" and not f.free} & flat.optional - read
    kept = [f for f in flat.flats if id(f) not in gone | silent]
    return replace(flat, flats=kept, equations=equations)


def _read(given: list[Any]) -> set[int]:
    """Variables and parameters in expressions, and in what parameters are bound to."""
    read, waiting = set[int](), given
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
