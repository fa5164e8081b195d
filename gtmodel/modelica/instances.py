"""Instantiation: components of a class with their modifications, each instantiated when first accessed."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np

from .._near import near
from .arrays import Values, array, entries, shape_words
from .meanings import (
    DEEPEST,
    LONGEST_CHAIN,
    NameScope,
    TypeMeaning,
    check_redeclaration,
    check_redeclared_classes,
    check_redeclared_type,
    kind_of,
)
from .modifications import Given, Modifier, merged, modifier_of, same
from .multibody.library import part_name, pictures
from .scalars import Flat, Symbol, fits, number_of
from .scopes import PREDEFINED, Space
from .syntax import ClassText, Component, ModelicaError, Place, SyntaxNode

ATTRIBUTES = {
    "quantity", "unit", "displayUnit", "min", "max", "start", "fixed", "nominal", "stateSelect", "unbounded",
    "free", "initialGuess", "absoluteValue",
}  # fmt: skip
HEADER = ("objective", "objectiveIntegrand", "startTime", "finalTime")
LONGEST = 100_000  # size of one dimension of an array


@dataclass(eq=False, slots=True)
class FieldOf(SyntaxNode):
    """One field of the record expression to which a component is bound."""

    given: Given
    name: str


@dataclass(eq=False)
class Section:
    """The equations of one class of an instance, with the scope of that class."""

    text: ClassText
    scope: NameScope


class Instance:
    """A component whose type is a class, or the whole model."""

    def __init__(
        self, space: Space, modifier: Modifier, path: str, parent: Instance | None, model: Any, prefixes: frozenset[str]
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
        self.below = 0  # depth of the extends clause that is being instantiated
        if self.depth > DEEPEST:
            raise ModelicaError(
                f"'{path}' is nested more than {DEEPEST} components deep; does {space.name} contain itself?",
                space.text.at,
            )
        self._take(space, modifier)
        self._check_modified_names(space, modifier)

    def __repr__(self) -> str:
        return f"Instance({self.path}: {self.space.name})"

    @property
    def at(self) -> Place:
        return self.space.text.at

    def full(self, name: str) -> str:
        return f"{self.path}.{name}" if self.path else name

    def _take(self, space: Space, modifier: Modifier, protected: bool = False) -> None:
        """Add elements and sections of a class and its base classes in order; protected: all are protected."""
        text = space.text
        if text.unsupported:
            raise ModelicaError(f"{space.name} is not supported: {text.unsupported}", text.at)
        self.below += 1
        self.model.spend(20, text.at)
        if self.below > LONGEST_CHAIN:
            raise ModelicaError(f"{space.name} extends itself, or has more than {LONGEST_CHAIN} base classes", text.at)
        replaced = {n: c for n, m in modifier.inside.items() if (c := _replacement(space, n, m)) is not None}
        if replaced or (text.classes and text.restriction != "package"):
            space = space.with_replaced(replaced, self)
            if self.space.text is text:
                self.space = space
        scope = NameScope(self, space, self.model)
        self._headers(text, modifier, scope)
        redeclared = {e.name: e for e in text.elements if isinstance(e, Component) and "redeclare" in e.prefixes}
        for element in text.elements:
            if isinstance(element, Component):
                if element.name in redeclared:
                    continue
                declaration_modifier = modifier_of(element.modification, scope)
                if "final" in element.prefixes:
                    declaration_modifier = replace(declaration_modifier, final=True)
                if element.constraint is not None:
                    declaration_modifier = merged(
                        declaration_modifier, modifier_of(element.constraint.modification, scope)
                    )
                element_modifier = merged(modifier.get(element.name), declaration_modifier)
                self.used.add(element.name)
                earlier = self.elements.get(element.name)
                if earlier is not None and earlier.text is not element and earlier.text.at != element.at:
                    raise ModelicaError(
                        f"'{element.name}' is declared again in {space.name}; first in line {earlier.text.at.line}",
                        element.at,
                    )
                if earlier is None:
                    is_protected = protected or element.protected
                    self.elements[element.name] = TextElement(element, element_modifier, scope, self, is_protected)
                elif not same(earlier.modifier, element_modifier):
                    raise ModelicaError(f"'{element.name}' is inherited twice, with different modifications", self.at)
            elif element.base.parts[0].name in PREDEFINED and len(element.base.parts) == 1:
                raise ModelicaError(
                    f"{space.name} extends {element.base}; it then must not declare components",
                    element.at,
                )
            else:
                extends_modifier = modifier_of(element.modification, scope)
                base = space.view(element)
                for name, item in redeclared.items():
                    if name in base.declared:
                        new = replace(modifier_of(item.modification, scope), at=item.at, redeclared=(item, scope))
                        extends_modifier = merged(Modifier(inside={name: new}), extends_modifier)
                self._take(
                    base, merged(merged(modifier, extends_modifier), base.modifier), protected or element.protected
                )
                self._check_modified_names(base, extends_modifier)
        if lost := [e for n, e in redeclared.items() if n not in self.elements]:
            raise ModelicaError(f"no base class of {space.name} has a '{lost[0].name}' to redeclare", lost[0].at)
        if text.redeclares:
            check_redeclared_classes(space, scope)
        self.below -= 1
        self.used |= set(text.classes) | pictures(text)
        if not any(s.text is text for s in self.sections):  # a class may be inherited along two paths
            self.sections.append(Section(text, scope))

    def _headers(self, text: ClassText, modifier: Modifier, scope: NameScope) -> None:
        if text.restriction != "optimization":
            return
        self.used |= {*HEADER, "static"}
        header = merged(modifier, modifier_of(text.header, scope))
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

    def _check_modified_names(self, space: Space, modifier: Modifier) -> None:
        for name, item in modifier.inside.items():
            if name not in self.used and space.member(name) is None:
                known = [n for n in self.elements]
                hint = near(name, known) or (f"; it has {', '.join(known)}" if part_name(space.text) else "")
                raise ModelicaError(f"{space.name} has no '{name}' to modify{hint}", item.at)

    def inner(self, name: str, at: Place) -> Any:
        """Return the component `inner name` of an enclosing instance. Raises ModelicaError if there is none."""
        above = self.parent
        while above is not None:
            element = above.elements.get(name)
            if element is not None and "inner" in element.text.prefixes:
                return element.component
            above = above.parent
        raise ModelicaError(f"there is no enclosing 'inner {name}' for this 'outer {name}'", at)

    def walk(self) -> Iterator[Instance]:
        """Yield this instance and all instances in it, in the order of the text."""
        yield self
        for element in self.elements.values():
            if "outer" in element.text.prefixes:
                continue
            component = element.component
            if isinstance(component, Instance):
                yield from component.walk()
            elif isinstance(component, np.ndarray) and component.size and isinstance(component.ravel()[0], Instance):
                for item in component.ravel():
                    yield from item.walk()


def _replacement(space: Space, name: str, modifier: Modifier) -> Space | None:
    """Return the class that replaces a local class, redeclared or modified; None if the modifier concerns no class."""
    if modifier.redeclared is None and not modifier.inside:
        return None
    original = space.member(name)
    if modifier.redeclared is not None and isinstance(modifier.redeclared[0], ClassText):
        redeclaration, scope = modifier.redeclared
        assert isinstance(redeclaration, ClassText)
        if original is None:
            return Space(redeclaration, scope.space, holder=scope.instance)
        new = Space(redeclaration, scope.space, holder=scope.instance, limits=original.bounds, limit=original.interface)
        new.replaces = original if original.text is not redeclaration else original.replaces
        check_redeclaration(new, modifier.at or redeclaration.at)
        return new
    return original.with_modifier(modifier) if original is not None and modifier.redeclared is None else None


VARIABILITY = ("constant", "parameter", "discrete", "input", "output", "flow")


@dataclass(eq=False)
class TextElement:
    """A declaration; `component` is a Declared, an Instance, an array of Instances, or None by its condition."""

    text: Component
    modifier: Modifier
    scope: NameScope
    owner: Instance
    protected: bool = False
    _made: Any = None
    _state: str = ""
    explicit: Modifier | None = None  # for a field of a bound record: the modifier from outside the record

    def check_accessible(self, at: Place | None) -> None:
        """Raises ModelicaError if the component is protected, for a reference or modification outside of its owner.

        at: place of the reference; None for `parameters` of a problem file or call: then the error names the
        declaration.
        """
        if self.protected:
            owner, line = self.owner.path or self.owner.space.name, self.text.at.line
            prefix = "" if at is not None else "parameters set a value from outside: "
            raise ModelicaError(
                f"{prefix}'{self.text.name}' of '{owner}' is protected (line {line}); only its class, and classes that "
                "extend it, can reference or modify it", at or self.text.at,
            )  # fmt: skip

    @property
    def component(self) -> Any:
        if self._state == "making":
            raise ModelicaError(
                f"the type or size of '{self.owner.full(self.text.name)}' depends on itself", self.text.at
            )
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
            if not number_of(truth[()], text.condition.at, f"the condition of '{text.name}'"):
                return None
        if "outer" in text.prefixes:
            if "inner" in text.prefixes:
                raise ModelicaError(f"'{text.name}' is both inner and outer, which is not supported", text.at)
            if self.modifier.value is not None or self.modifier.inside:
                raise ModelicaError(
                    f"'{owner.full(text.name)}' is outer and cannot be modified; modify its inner declaration",
                    self.modifier.at,
                )
            return owner.inner(text.name, text.at)
        if "stream" in text.prefixes:
            raise ModelicaError("stream variables are not supported", text.at)
        modifier, scope, declared = self.modifier, self.scope, text
        if modifier.redeclared is not None and isinstance(modifier.redeclared[0], Component):
            declared, scope = modifier.redeclared
            assert isinstance(declared, Component)
            if not {"replaceable"} & text.prefixes:
                raise ModelicaError(f"'{text.name}' is not replaceable", modifier.at)
        kind = kind_of(declared.type_name, scope)
        if declared is not text:
            limit = kind_of(text.type_name if text.constraint is None else text.constraint.base, self.scope)
            check_redeclared_type(kind, limit, declared, text, modifier.at or declared.at)
        modifier = merged(modifier, kind.modifier)
        prefixes = text.prefixes | declared.prefixes | kind.prefixes
        prefixes |= owner.prefixes & {"constant", "parameter", "input", "output", "discrete"}
        full = owner.full(text.name)
        dimensions = [(d, scope) for d in (declared.dimensions or text.dimensions)] + kind.dimensions
        shape = self._shape(dimensions, modifier, full)
        if kind.space is not None and kind.base != "enumeration":
            return self._instances(kind, modifier, prefixes, full, shape)
        return Declared(self, kind, modifier, prefixes, full, shape)

    def _shape(self, dimensions: list[tuple[SyntaxNode, NameScope]], modifier: Modifier, full: str) -> tuple[int, ...]:
        model, shape = self.owner.model, []
        open_connects = [n for n, (d, _) in enumerate(dimensions) if model.is_colon(d)]
        sizing_value: Any = None
        if open_connects:
            value = modifier.value or modifier.get("start").value
            if value is None:
                raise ModelicaError(f"'{full}' has size ':' and no value that determines its size", self.text.at)
            sizing_value = model.given(value)
        for n, (d, scope) in enumerate(dimensions):
            if n in open_connects:
                if n >= sizing_value.ndim:
                    raise ModelicaError(
                        f"'{full}' has {len(dimensions)} dimensions; its value has {sizing_value.ndim}", d.at
                    )
                shape.append(int(sizing_value.shape[n]))
                continue
            size = number_of(model.evaluate(d, scope)[()], d.at, f"the size of '{full}'")
            if isinstance(size, float) and size.is_integer():
                size = int(size)
            if isinstance(size, bool) or not isinstance(size, int) or size < 0:
                raise ModelicaError(f"the size of '{full}' must be a non-negative Integer; found {size}", d.at)
            if size > LONGEST:
                raise ModelicaError(f"the size of '{full}' is {size}; at most {LONGEST} is supported", d.at)
            shape.append(size)
        model.spend(math.prod(shape), self.text.at)
        return tuple(shape)

    def _instances(self, kind: TypeMeaning, modifier: Modifier, prefixes: frozenset[str], full: str, shape: Any) -> Any:
        assert kind.space is not None
        if kind.space.text.restriction in ("package", "function", "operator function"):
            raise ModelicaError(
                f"{kind.space.name} is a {kind.space.text.restriction} and cannot be the type of a component",
                self.text.at,
            )
        if "partial" in kind.space.text.prefixes:
            raise ModelicaError(f"{kind.space.name} is partial; '{full}' needs a type that is not", self.text.at)

        explicit = self.modifier if self.explicit is None else self.explicit

        def one(index: tuple[int, ...]) -> Instance:
            path = full + (f"[{','.join(str(i + 1) for i in index)}]" if index else "")
            own_modifier, outside = modifier.element(index, shape), explicit.element(index, shape)
            passed = prefixes & {"constant", "parameter", "input", "output", "discrete"}
            instance = Instance(kind.space, own_modifier, path, self.owner, self.owner.model, passed)  # type: ignore[arg-type]
            instance.connector = kind.connector
            for name, item in self.modifier.inside.items():
                if name in instance.elements:
                    instance.elements[name].check_accessible(item.at)
            if own_modifier.value is not None:
                for name, element in instance.elements.items():
                    element.explicit = outside.get(name)
                    if element.explicit.value is None:
                        field_of = FieldOf(self.text.at, own_modifier.value, name)
                        element.modifier = replace(element.modifier, value=Given(field_of, element.scope))
            return instance

        if not shape:
            return one(())
        return array([one(index) for index in product(*map(range, shape))], shape)


class Declared:
    """A component of a predefined type or enumeration: one scalar for each entry."""

    def __init__(
        self,
        element: TextElement,
        kind: TypeMeaning,
        modifier: Modifier,
        prefixes: frozenset[str],
        full: str,
        shape: tuple[int, ...],
    ) -> None:
        self.element, self.kind, self.modifier, self.prefixes, self.shape = element, kind, modifier, prefixes, shape
        self.full, self.at, self.model = full, element.text.at, element.owner.model
        for name, item in modifier.inside.items():
            if name not in ATTRIBUTES:
                raise ModelicaError(f"{kind.base} has no attribute '{name}'{near(name, ATTRIBUTES)}", item.at)
        self._attributes: dict[str, Any] = {}
        self.flats = [self._flat(index) for index in product(*map(range, shape))]
        self.symbols: Values = array([Symbol(f) for f in self.flats], shape)
        self.fixed_place: Place = modifier.value.node.at if modifier.value is not None else self.at

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
        if "'" in name:  # in flat text 'tank.u' was an input of a component
            flat.name = name.replace("'", "")
            flat.top = flat.top and "." not in flat.name
        return flat

    @staticmethod
    def _entry(value: Any, index: tuple[int, ...]) -> Any:
        if value is None:
            return None
        return value[index] if value.shape else value[()]

    def attribute(self, name: str) -> Values | None:
        """Return the values of an attribute, in the shape of the component or as a scalar; None if it is not set."""
        if name not in self._attributes:
            item = self.modifier.get(name)
            value = None if item.value is None else self.model.given(item.value)
            if value is not None and value.shape not in ((), self.shape):
                raise ModelicaError(
                    f"{name} of '{self.full}' has shape {value.shape}; expected {self.shape or 'a scalar'}", item.at
                )
            self._attributes[name] = value
        return self._attributes[name]

    def binding(self) -> Values | None:
        """Return the value of the declaration equation, or of the outermost modification; None without one."""
        if "=" not in self._attributes:
            bound = self.modifier.value
            if bound is None:
                self._attributes["="] = None
                return None
            value = self.model.given(bound)
            if not isinstance(value, np.ndarray):
                raise ModelicaError(f"'{self.full}' must be bound to numbers; found a record", bound.node.at)
            if value.shape not in ((), self.shape):
                raise ModelicaError(
                    f"'{self.full}' is {shape_words(self.shape)}; its value is {shape_words(value.shape)}",
                    bound.node.at,
                )
            for entry in entries(value):
                if not fits(entry, self.kind.base, self.kind.literals):
                    shown = entry.flat.name if isinstance(entry, Symbol) else entry
                    expected = "a number" if self.kind.base in ("Real", "Integer") else f"a value of {self.kind.base}"
                    raise ModelicaError(f"'{self.full}' must be {expected}; found {str(shown)!r}", bound.node.at)
            if value.shape == () and self.shape and not bound.each:
                raise ModelicaError(
                    f"'{self.full}' is an array of shape {self.shape}; write each, or fill(...), for one value",
                    bound.node.at,
                )
            self._attributes["="] = value
        return self._attributes["="]
