"""Instances: components of a class with what modifications say, each made when it is first asked for."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np

from .._near import near
from .arrays import Values, array, entries
from .meanings import (
    DEEPEST,
    LONGEST_CHAIN,
    NameScope,
    TypeMeaning,
    kind_of,
    refuse_other_type,
    refuse_redeclaration,
    refuse_redeclared,
)
from .modifications import Given, Modifier, merged, modifier, same
from .multibody.library import part_name, pictures
from .scalars import Flat, Symbol, fits, number_of
from .scopes import PREDEFINED, Space
from .syntax import ClassText, Component, ModelicaError, Place, SyntaxNode

ATTRIBUTES = {
    "quantity", "unit", "displayUnit", "min", "max", "start", "fixed", "nominal", "stateSelect", "unbounded",
    "free", "initialGuess", "absoluteValue",
}  # fmt: skip
HEADER = ("objective", "objectiveIntegrand", "startTime", "finalTime")
LONGEST = 100_000  # entries along one dimension of an array


@dataclass(eq=False, slots=True)
class FieldOf(SyntaxNode):
    """A field of a record that a component is bound to."""

    given: Given
    name: str


@dataclass(eq=False)
class Section:
    """The equations of one class of an instance, in that class's scope."""

    text: ClassText
    scope: NameScope


class Instance:
    """A component of a class, or the whole model."""

    def __init__(
        self, space: Space, said: Modifier, path: str, parent: Instance | None, model: Any, prefixes: frozenset[str]
    ) -> None:
        self.space, self.path, self.parent, self.model, self.prefixes = space, path, parent, model, prefixes
        self.elements: dict[str, TextElement] = {}
        self.sections: list[Section] = []
        self.header: dict[str, Given] = {}
        self.finals: dict[str, Modifier] = {}
        self.connector = False
        self.used: set[str] = set()
        self.depth: int = 0 if parent is None else parent.depth + 1
        self.restriction = space.text.restriction
        self.below = 0  # classes that extend one another, while they are taken
        if self.depth > DEEPEST:
            raise ModelicaError(f"'{path}' is {DEEPEST} components deep; does {space.name} hold itself?", space.text.at)
        self._take(space, said)
        self._refuse_unknown(space, said)

    def __repr__(self) -> str:
        return f"Instance({self.path}: {self.space.name})"

    @property
    def at(self) -> Place:
        return self.space.text.at

    def full(self, name: str) -> str:
        return f"{self.path}.{name}" if self.path else name

    def _take(self, space: Space, said: Modifier, protected: bool = False) -> None:
        """Elements and sections of a class and of those it extends, in the order of the text; protected: all of it."""
        text = space.text
        if text.refused:
            raise ModelicaError(f"{space.name} is not taken: {text.refused}", text.at)
        self.below += 1
        self.model.spend(20, text.at)
        if self.below > LONGEST_CHAIN:
            raise ModelicaError(f"{space.name} extends itself, or more than {LONGEST_CHAIN} classes", text.at)
        replaced = {n: c for n, m in said.inside.items() if (c := _replacement(space, n, m)) is not None}
        if replaced or (text.classes and text.restriction != "package"):
            space = space.with_replaced(replaced, self)
            if self.space.text is text:
                self.space = space
        scope = NameScope(self, space, self.model)
        self._headers(text, said, scope)
        again = {e.name: e for e in text.elements if isinstance(e, Component) and "redeclare" in e.prefixes}
        for element in text.elements:
            if isinstance(element, Component):
                if element.name in again:
                    continue
                written = modifier(element.modification, scope)
                if "final" in element.prefixes:
                    written = replace(written, final=True)
                if element.constraint is not None:
                    written = merged(written, modifier(element.constraint.modification, scope))
                own = merged(said.get(element.name), written)
                self.used.add(element.name)
                before = self.elements.get(element.name)
                if before is not None and before.text is not element and before.text.at != element.at:
                    raise ModelicaError(
                        f"'{element.name}' is declared again in {space.name}; first in line {before.text.at.line}",
                        element.at,
                    )
                if before is None:
                    hidden = protected or element.protected
                    self.elements[element.name] = TextElement(element, own, scope, self, hidden)
                elif not same(before.said, own):
                    raise ModelicaError(f"'{element.name}' is inherited twice, modified in two ways", self.at)
            elif element.base.parts[0].name in PREDEFINED and len(element.base.parts) == 1:
                raise ModelicaError(f"{space.name} extends {element.base} and declares more", element.at)
            else:
                said_here = modifier(element.modification, scope)
                base = space.view(element)
                for name, item in again.items():
                    if name in base.declared:
                        new = replace(modifier(item.modification, scope), at=item.at, redeclared=(item, scope))
                        said_here = merged(Modifier(inside={name: new}), said_here)
                self._take(base, merged(merged(said, said_here), base.said), protected or element.protected)
                self._refuse_unknown(base, said_here)
        if lost := [e for n, e in again.items() if n not in self.elements]:
            raise ModelicaError(f"nothing that {space.name} extends has a '{lost[0].name}' to redeclare", lost[0].at)
        if text.redeclares:
            refuse_redeclared(space, scope)
        self.below -= 1
        self.used |= set(text.classes) | pictures(text)
        if not any(s.text is text for s in self.sections):  # of a class that is inherited on two ways
            self.sections.append(Section(text, scope))

    def _headers(self, text: ClassText, said: Modifier, scope: NameScope) -> None:
        if text.restriction != "optimization":
            return
        self.used |= {*HEADER, "static"}
        header = merged(said, modifier(text.header, scope))
        for name, item in header.inside.items():
            if name in (*HEADER, "static"):
                if item.value is not None:
                    self.header.setdefault(name, item.value)
                for attribute, inner in item.inside.items():
                    if attribute not in ATTRIBUTES:
                        raise ModelicaError(f"{name} has no attribute '{attribute}'{near(attribute, ATTRIBUTES)}",
                                            inner.at)  # fmt: skip
                    if inner.value is not None:
                        self.header.setdefault(f"{name}.{attribute}", inner.value)
            elif text.header is not None and any(a.name[0] == name for a in text.header.arguments):
                raise ModelicaError(
                    f"an optimization has no attribute '{name}'{near(name, HEADER)}; it has {', '.join(HEADER)}",
                    item.at,
                )

    def _refuse_unknown(self, space: Space, said: Modifier) -> None:
        for name, item in said.inside.items():
            if name not in self.used and space.member(name) is None:
                known = [n for n in self.elements]
                hint = near(name, known) or (f"; it has {', '.join(known)}" if part_name(space.text) else "")
                raise ModelicaError(f"{space.name} has no '{name}' to modify{hint}", item.at)

    def inner(self, name: str, at: Place) -> Any:
        """The component `inner name` of an enclosing one."""
        above = self.parent
        while above is not None:
            element = above.elements.get(name)
            if element is not None and "inner" in element.text.prefixes:
                return element.made
            above = above.parent
        raise ModelicaError(f"there is no enclosing 'inner {name}' for this 'outer {name}'", at)

    def walk(self) -> Iterator[Instance]:
        """This instance and all inside, in the order of the text."""
        yield self
        for element in self.elements.values():
            if "outer" in element.text.prefixes:
                continue
            made = element.made
            if isinstance(made, Instance):
                yield from made.walk()
            elif isinstance(made, np.ndarray) and made.size and isinstance(made.ravel()[0], Instance):
                for item in made.ravel():
                    yield from item.walk()


def _replacement(space: Space, name: str, said: Modifier) -> Space | None:
    """A class that a modification puts in place of one of a class, or changes; None for what is no class."""
    if said.redeclared is None and not said.inside:
        return None
    original = space.member(name)
    if said.redeclared is not None and isinstance(said.redeclared[0], ClassText):
        written, scope = said.redeclared
        assert isinstance(written, ClassText)
        if original is None:
            return Space(written, scope.space, holder=scope.instance)
        new = Space(written, scope.space, holder=scope.instance, limits=original.bounds, limit=original.interface)
        new.instead = original if original.text is not written else original.instead
        refuse_redeclaration(new, said.at or written.at)
        return new
    return original.with_said(said) if original is not None and said.redeclared is None else None


VARIABILITY = ("constant", "parameter", "discrete", "input", "output", "flow")


@dataclass(eq=False)
class TextElement:
    """A declared component; `made` is a Declared, an Instance, an array of them, or None by its condition."""

    text: Component
    said: Modifier
    scope: NameScope
    owner: Instance
    protected: bool = False
    _made: Any = None
    _state: str = ""
    explicit: Modifier | None = None  # of a field of a record that is bound as a whole: said outside of the record

    def refuse_from_outside(self, at: Place | None) -> None:
        """Raises ModelicaError if the component is protected: what names or modifies it stands outside of its owner.

        at: where that stands; None of `parameters` of a problem file or a call, for which the declaration is named.
        """
        if self.protected:
            inside, line = self.owner.path or self.owner.space.name, self.text.at.line
            by = "" if at is not None else "parameters give a value from outside: "
            raise ModelicaError(
                f"{by}'{self.text.name}' of '{inside}' is protected since line {line}; only its class, and those that "
                "extend it, name it", at or self.text.at,
            )  # fmt: skip

    @property
    def made(self) -> Any:
        if self._state == "making":
            raise ModelicaError(f"what '{self.owner.full(self.text.name)}' is depends on itself", self.text.at)
        if not self._state:
            self._state = "making"
            try:
                self._made = self._make()
                self._state = "made"
            finally:
                if self._state == "making":
                    self._state = ""
        return self._made

    def _make(self) -> Any:
        text, owner, model = self.text, self.owner, self.owner.model
        if text.condition is not None:
            truth = model.evaluate(text.condition, self.scope)
            if not number_of(truth[()], text.condition.at, f"whether there is a '{text.name}'"):
                return None
        if "outer" in text.prefixes:
            if "inner" in text.prefixes:
                raise ModelicaError(f"'{text.name}' is inner and outer at once, which is not taken", text.at)
            if self.said.value is not None or self.said.inside:
                raise ModelicaError(f"'{owner.full(text.name)}' is outer: say this where its inner is", self.said.at)
            return owner.inner(text.name, text.at)
        if "stream" in text.prefixes:
            raise ModelicaError("stream variables are not taken", text.at)
        said, scope, declared = self.said, self.scope, text
        if said.redeclared is not None and isinstance(said.redeclared[0], Component):
            declared, scope = said.redeclared
            assert isinstance(declared, Component)
            if not {"replaceable"} & text.prefixes:
                raise ModelicaError(f"'{text.name}' is not replaceable", said.at)
        kind = kind_of(declared.type_name, scope)
        if declared is not text:
            limit = kind_of(text.type_name if text.constraint is None else text.constraint.base, self.scope)
            refuse_other_type(kind, limit, declared, text, said.at or declared.at)
        said = merged(said, kind.modifier)
        prefixes = text.prefixes | declared.prefixes | kind.prefixes
        prefixes |= owner.prefixes & {"constant", "parameter", "input", "output", "discrete"}
        full = owner.full(text.name)
        dimensions = [(d, scope) for d in (declared.dimensions or text.dimensions)] + kind.dimensions
        shape = self._shape(dimensions, said, full)
        if kind.space is not None and kind.base != "enumeration":
            return self._instances(kind, said, prefixes, full, shape)
        return Declared(self, kind, said, prefixes, full, shape)

    def _shape(self, dimensions: list[tuple[SyntaxNode, NameScope]], said: Modifier, full: str) -> tuple[int, ...]:
        model, shape = self.owner.model, []
        open_ones = [n for n, (d, _) in enumerate(dimensions) if model.is_colon(d)]
        given: Any = None
        if open_ones:
            value = said.value or said.get("start").value
            if value is None:
                raise ModelicaError(f"'{full}' has the size ':' and no value that gives it", self.text.at)
            given = model.given(value)
        for n, (d, scope) in enumerate(dimensions):
            if n in open_ones:
                if n >= given.ndim:
                    raise ModelicaError(f"'{full}' has {len(dimensions)} dimensions, its value {given.ndim}", d.at)
                shape.append(int(given.shape[n]))
                continue
            size = number_of(model.evaluate(d, scope)[()], d.at, f"the size of '{full}'")
            if isinstance(size, float) and size.is_integer():
                size = int(size)
            if isinstance(size, bool) or not isinstance(size, int) or size < 0:
                raise ModelicaError(f"the size of '{full}' is a whole number from 0 on; found {size}", d.at)
            if size > LONGEST:
                raise ModelicaError(
                    f"the size of '{full}' is {size}, which is too long; at most {LONGEST} are taken", d.at
                )
            shape.append(size)
        model.spend(math.prod(shape), self.text.at)
        return tuple(shape)

    def _instances(self, kind: TypeMeaning, said: Modifier, prefixes: frozenset[str], full: str, shape: Any) -> Any:
        assert kind.space is not None
        if kind.space.text.restriction in ("package", "function", "operator function"):
            raise ModelicaError(
                f"{kind.space.name} is a {kind.space.text.restriction} and no type of a component", self.text.at
            )
        if "partial" in kind.space.text.prefixes:
            raise ModelicaError(f"{kind.space.name} is partial: '{full}' needs a class that extends it", self.text.at)

        explicit = self.said if self.explicit is None else self.explicit

        def one(index: tuple[int, ...]) -> Instance:
            path = full + (f"[{','.join(str(i + 1) for i in index)}]" if index else "")
            own, outside = said.element(index, shape), explicit.element(index, shape)
            passed = prefixes & {"constant", "parameter", "input", "output", "discrete"}
            made = Instance(kind.space, own, path, self.owner, self.owner.model, passed)  # type: ignore[arg-type]
            made.connector = kind.connector
            for name, item in self.said.inside.items():
                if name in made.elements:
                    made.elements[name].refuse_from_outside(item.at)
            if own.value is not None:
                for name, element in made.elements.items():
                    element.explicit = outside.get(name)
                    if element.explicit.value is None:
                        field_of = FieldOf(self.text.at, own.value, name)
                        element.said = replace(element.said, value=Given(field_of, element.scope))
            return made

        if not shape:
            return one(())
        return array([one(index) for index in product(*map(range, shape))], shape)


class Declared:
    """A component of a predefined type: one scalar for each entry."""

    def __init__(
        self,
        element: TextElement,
        kind: TypeMeaning,
        said: Modifier,
        prefixes: frozenset[str],
        full: str,
        shape: tuple[int, ...],
    ) -> None:
        self.element, self.kind, self.said, self.prefixes, self.shape = element, kind, said, prefixes, shape
        self.full, self.at, self.model = full, element.text.at, element.owner.model
        for name, item in said.inside.items():
            if name not in ATTRIBUTES:
                raise ModelicaError(f"{kind.base} has no attribute '{name}'{near(name, ATTRIBUTES)}", item.at)
        self._attributes: dict[str, Any] = {}
        self.flats = [self._flat(index) for index in product(*map(range, shape))]
        self.symbols: Values = array([Symbol(f) for f in self.flats], shape)
        self.fixed_place: Place = said.value.node.at if said.value is not None else self.at

    def _flat(self, index: tuple[int, ...]) -> Flat:
        prefixes, owner = self.prefixes, self.element.owner
        role = next((p for p in ("constant", "parameter", "discrete", "input") if p in prefixes), "variable")
        name = self.full + (f"[{','.join(str(i + 1) for i in index)}]" if index else "")
        flat = Flat(
            name, role, self.kind.base, self.at, lambda n: self._entry(self.attribute(n), index),
            lambda: self._entry(self.binding(), index), flow="flow" in prefixes,
            description=self.element.text.description,
        )  # fmt: skip
        flat.top = owner.parent is None or (owner.connector and owner.parent.parent is None)
        if "'" in name:  # of flat text: 'tank.u' was an input of a component
            flat.name = name.replace("'", "")
            flat.top = flat.top and "." not in flat.name
        return flat

    @staticmethod
    def _entry(value: Any, index: tuple[int, ...]) -> Any:
        if value is None:
            return None
        return value[index] if value.shape else value[()]

    def attribute(self, name: str) -> Values | None:
        """An attribute's values, in the shape of the component or as one scalar; None where it is not given."""
        if name not in self._attributes:
            item = self.said.get(name)
            value = None if item.value is None else self.model.given(item.value)
            if value is not None and value.shape not in ((), self.shape):
                raise ModelicaError(
                    f"{name} of '{self.full}' has the shape {value.shape}; expected {self.shape or 'a scalar'}", item.at
                )
            self._attributes[name] = value
        return self._attributes[name]

    def binding(self) -> Values | None:
        """The value that the declaration, or the outermost modification of it, gives."""
        if "=" not in self._attributes:
            said = self.said.value
            if said is None:
                self._attributes["="] = None
                return None
            value = self.model.given(said)
            if not isinstance(value, np.ndarray):
                raise ModelicaError(f"'{self.full}' takes numbers; found a record", said.node.at)
            if value.shape not in ((), self.shape):
                raise ModelicaError(
                    f"'{self.full}' has the shape {self.shape or 'of a scalar'}; its value has "
                    f"{value.shape or 'that of a scalar'}",
                    said.node.at,
                )
            for entry in entries(value):
                if not fits(entry, self.kind.base, self.kind.literals):
                    shown = entry.flat.name if isinstance(entry, Symbol) else entry
                    wanted = "a number" if self.kind.base in ("Real", "Integer") else f"a value of {self.kind.base}"
                    raise ModelicaError(f"'{self.full}' takes {wanted}; found {str(shown)!r}", said.node.at)
            if value.shape == () and self.shape and not said.each:
                raise ModelicaError(
                    f"'{self.full}' is an array of shape {self.shape}; write each, or fill(...), for one value",
                    said.node.at,
                )
            self._attributes["="] = value
        return self._attributes["="]
