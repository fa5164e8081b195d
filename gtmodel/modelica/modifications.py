"""Modifications of extends clauses and declarations; outer modifications override inner ones."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

from .syntax import ClassText, Component, ModelicaError, Modification, Place, SyntaxNode


@dataclass(frozen=True, eq=False)
class Given:
    """The expression of a modification with the scope in which it was written.

    indices: of one component, for the expression of an array of components; sizes: of that array.
    """

    node: SyntaxNode
    scope: Any
    indices: tuple[int, ...] = ()
    sizes: tuple[int, ...] = ()
    each: bool = False


@dataclass(frozen=True, eq=False)
class Modifier:
    """The modification of one element: its value, and the modifiers of its own elements."""

    at: Place | None = None
    value: Given | None = None
    inside: dict[str, Modifier] = field(default_factory=dict)
    redeclared: tuple[Component | ClassText, Any] | None = None
    final: bool = False
    each: bool = False

    def get(self, name: str) -> Modifier:
        return self.inside.get(name, NOTHING)

    def element(self, index: tuple[int, ...], sizes: tuple[int, ...]) -> Modifier:
        """Return the modifier of one component of an array of components."""
        if not index:
            return self
        value = self.value
        if value is not None and not self.each and not value.each:
            value = replace(value, indices=(*value.indices, *index), sizes=(*value.sizes, *sizes))
        inside = {k: m if m.each else m.element(index, sizes) for k, m in self.inside.items()}
        return replace(self, value=value, inside=inside)


NOTHING = Modifier()


def same(a: Modifier, b: Modifier) -> bool:
    """True if two modifications come from the same expressions in the same instances."""
    x, y = a.value, b.value
    if (x is None) != (y is None) or a.inside.keys() != b.inside.keys():
        return False
    if x is not None and y is not None and (x.node is not y.node or x.scope.instance is not y.scope.instance):
        return False
    return all(same(m, b.inside[name]) for name, m in a.inside.items())


def modifier_of(written: Modification | None, scope: Any) -> Modifier:
    """Return a modification in a scope as a modifier. Raises ModelicaError if it modifies an element twice."""
    if written is None:
        return NOTHING
    inside: dict[str, Modifier] = {}
    for argument in written.arguments:
        *path, last = argument.name
        if argument.redeclared is not None:
            below = modifier_of(getattr(argument.redeclared, "modification", None), scope)
            item = replace(below, at=argument.at, redeclared=(argument.redeclared, scope))
        else:
            item = replace(modifier_of(argument.modification, scope), at=argument.at)
        each, final = "each" in argument.prefixes, "final" in argument.prefixes
        item = replace(item, each=each, final=final)
        if item.value is not None and each:
            item = replace(item, value=replace(item.value, each=True))
        for name in reversed(path):
            item, last = Modifier(argument.at, inside={last: item}), name
        if last in inside:
            if inside[last].value is not None and item.value is not None:
                raise ModelicaError(f"'{'.'.join(argument.name)}' is modified twice", argument.at)
            item = merged(item, inside[last])
        inside[last] = item
    value = None if written.value is None else Given(written.value, scope)
    return Modifier(written.at, value, inside)


def merged(outer: Modifier, inner: Modifier) -> Modifier:
    """Merge two modifiers; the outer one overrides. Raises ModelicaError if it modifies a final element."""
    if outer is NOTHING or (outer.value is None and not outer.inside and outer.redeclared is None):
        return inner
    if inner is NOTHING:
        return outer
    if inner.final and (outer.value is not None or outer.redeclared is not None or outer.inside):
        raise ModelicaError("this modifies an element that is declared final", outer.at)
    inside = dict(inner.inside)
    for name, item in outer.inside.items():
        inside[name] = merged(item, inside[name]) if name in inside else item
    return Modifier(
        outer.at or inner.at, outer.value if outer.value is not None else inner.value, inside,
        outer.redeclared or inner.redeclared, outer.final or inner.final, outer.each or inner.each,
    )  # fmt: skip
