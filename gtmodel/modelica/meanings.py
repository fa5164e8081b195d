"""Meaning of a type name in its scope, a predefined type or a class; and subtype rules for redeclarations."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from .modifications import NOTHING, Modifier, merged, modifier_of
from .scopes import PREDEFINED, Space
from .syntax import Component, Extends, ModelicaError, Place, Reference, ReferencePart, SyntaxNode

if TYPE_CHECKING:
    from .instances import Instance

LONGEST_CHAIN = 200  # short class definitions or extends clauses in a chain
DEEPEST = 60  # nested components; ends the recursion of a class that contains itself
COMPARED = 6  # levels of components that a subtype check compares
_SORTS = ("package", "function", "connector", "record")


@dataclass(eq=False)
class NameScope:
    """Scope of an expression: its instance, its class, and local names."""

    instance: Instance | None
    space: Space
    model: Any  # the Evaluator
    locals: dict[str, Any] = field(default_factory=dict)

    def holds(self, name: str) -> bool:
        """True for a component of the instance that this class, and not only a derived one, declares or inherits."""
        return self.instance is not None and name in self.instance.elements and name in self.space.declared

    def inner(self, names: dict[str, Any]) -> NameScope:
        return NameScope(self.instance, self.space, self.model, {**self.locals, **names})


@dataclass(eq=False)
class TypeMeaning:
    """Meaning of a type name: a predefined type with its attributes, or a class."""

    base: str
    space: Space | None
    modifier: Modifier
    dimensions: list[tuple[SyntaxNode, NameScope]]
    prefixes: frozenset[str]
    connector: bool
    literals: tuple[str, ...] = ()


def kind_of(reference: Reference, scope: NameScope) -> TypeMeaning:
    """Return the meaning of a type name in a scope. Raises ModelicaError for an unknown type."""
    first = reference.parts[0].name
    if len(reference.parts) == 1 and first in PREDEFINED:
        return TypeMeaning(first, None, NOTHING, [], frozenset(), False)
    return meaning_of(scope.space.find(reference), scope, reference)


def meaning_of(space: Space, scope: NameScope, reference: Reference) -> TypeMeaning:
    """Return the meaning of a class that a reference names, with short class definitions resolved."""
    modifier, dimensions, prefixes, connector = NOTHING, [], frozenset[str](), False
    if space.outer is not None:
        check_redeclaration(space.outer, space.outer.text.at)
    for _ in range(LONGEST_CHAIN):
        text = space.text
        if text.unsupported:
            raise ModelicaError(f"{space.name} is not supported: {text.unsupported}", reference.at)
        connector = connector or text.restriction.endswith("connector")
        modifier = merged(modifier, space.modifier)
        if text.literals is not None:
            return TypeMeaning("enumeration", space, modifier, dimensions, prefixes, connector, tuple(text.literals))
        extends = [e for e in text.elements if isinstance(e, Extends)]
        simple = text.short or (len(extends) == 1 and len(text.elements) == 1 and not text.equations)
        if not text.short:
            modifier = _limited(modifier, space, scope)
        if not simple or not extends:
            return TypeMeaning("", space, modifier, dimensions, prefixes, connector)
        builtin = len(extends[0].base.parts) == 1 and extends[0].base.parts[0].name in PREDEFINED
        if not text.short and not builtin and not _ends_predefined(space, extends[0]):
            return TypeMeaning("", space, modifier, dimensions, prefixes, connector)
        around = space.outer if text.short and space.outer is not None else space
        class_scope = NameScope(space.holder, around, scope.model)
        modifier = merged(modifier, modifier_of(extends[0].modification, class_scope))
        if text.short:
            modifier = _limited(modifier, space, scope)
        dimensions = [*dimensions, *[(d, class_scope) for d in text.dimensions]]
        prefixes |= text.type_prefixes
        if builtin:
            return TypeMeaning(extends[0].base.parts[0].name, None, modifier, dimensions, prefixes, connector)
        space = space.base(extends[0])
    raise ModelicaError(
        f"'{reference}' is defined by itself, or by a chain of more than {LONGEST_CHAIN} types", reference.at
    )


def _limited(modifier: Modifier, space: Space, scope: NameScope) -> Modifier:
    """Return a modifier with constrainedby modifications, which apply if not overridden."""
    for written, around in space.bounds:
        modifier = merged(modifier, modifier_of(written, NameScope(None, around, scope.model)))
    return modifier


def _ends_predefined(space: Space, extends: Extends) -> bool:
    """True if a chain of extends clauses ends at a predefined type."""
    for _ in range(DEEPEST):
        if extends.base.parts[0].name in PREDEFINED:
            return True
        space = space.base(extends)
        clauses = [e for e in space.text.elements if isinstance(e, Extends)]
        if len(clauses) != 1 or len(space.text.elements) != 1:
            return False
        extends = clauses[0]
    return False


# redeclarations


def check_subtype(new: Space, limit: Space, scope: NameScope, at: Place) -> None:
    """Raises ModelicaError if a redeclared class is not a subtype of its constraining class."""
    kinds = [_known(s, scope, at) for s in (new, limit)]
    if lack := _lack(kinds[0], kinds[1]):
        modifier, wanted = (k.space.name if k is not None and k.space is not None else k and k.base for k in kinds)
        raise ModelicaError(f"'{new.text.name}' must be redeclared as a subtype of {wanted}; {modifier} {lack}", at)


def check_redeclaration(new: Space, at: Place) -> None:
    """Raises ModelicaError if a class replaces one that is not replaceable, or is not a subtype of its constraint."""
    old = new.replaces
    if old is None:
        return
    if "replaceable" not in old.text.prefixes:
        owner = old.outer.name if old.outer is not None else "the text"
        raise ModelicaError(f"'{old.text.name}' of {owner} is not replaceable", at)
    check_subtype(new, old.interface, NameScope(None, new, None), at)


def check_redeclared_classes(space: Space, scope: NameScope) -> None:
    """As `check_subtype`, for inherited classes that a class redeclares as its own elements."""
    for text in space.text.classes.values():
        if "redeclare" in text.prefixes and (new := space.local_class(text.name)) is not None:
            for base, _ in space.bases():
                if (inherited := base.member(text.name)) is not None and inherited.text is not text:
                    check_subtype(new, inherited.interface, scope, text.at)


def check_redeclared_type(kind: TypeMeaning, limit: TypeMeaning, new: Component, old: Component, at: Place) -> None:
    """Raises ModelicaError if the type of a redeclared component is not a subtype of its constraining type."""
    if lack := _lack(kind, limit):
        expected = old.type_name if old.constraint is None else old.constraint.base
        raise ModelicaError(f"'{new.name}' must be redeclared as a subtype of {expected}; {new.type_name} {lack}", at)


def _known(space: Space, scope: NameScope, at: Place) -> TypeMeaning | None:
    """Return the meaning of a class; None if it has an error, which is reported when the class is used."""
    try:
        return meaning_of(space, scope, Reference(at, (ReferencePart(space.text.name, None),)))
    except ModelicaError:
        return None


def _lack(new: TypeMeaning | None, limit: TypeMeaning | None, depth: int = 0) -> str:
    """Return why a type is not a subtype of another, as the predicate of a sentence; "" if it is."""
    if new is None or limit is None or depth > COMPARED:
        return ""
    if new.base or limit.base:
        if new.base != limit.base:
            return f"is {new.base or 'a class'} and not {limit.base or 'a class'}"
        return "has different literals" if limit.literals and new.literals != limit.literals else ""
    assert new.space is not None
    assert limit.space is not None
    sorts = [next((s for s in _SORTS if x.text.restriction.endswith(s)), "model") for x in (new.space, limit.space)]
    if sorts[0] != sorts[1]:
        return f"is a {sorts[0]}, not a {sorts[1]}"
    if _derives(new.space, limit.space):
        return ""
    own_components, required = _public(new.space), _public(limit.space)
    for name, (their_component, their_space) in required.items():
        if name not in own_components:
            return f"has no public '{name}'"
        own_component, own_space = own_components[name]
        types = [_type_of(c, s) for c, s in ((own_component, own_space), (their_component, their_space))]
        for word in ("flow", "stream", "input", "output"):
            is_set, is_required = (word in c.prefixes or (k is not None and word in k.prefixes)
                          for c, k in zip((own_component, their_component), types, strict=True))  # fmt: skip
            if is_required and not is_set:
                return f"has a '{name}' that is not {word}"
        if lack := _lack(types[0], types[1], depth + 1):
            return f"has a different '{name}': it {lack}"
    if sorts[1] == "package":
        missing = [n for n in limit.space.text.classes if new.space.member(n) is None]
        return f"has no '{missing[0]}'" if missing else ""
    return ""


def _type_of(component: Component, space: Space) -> TypeMeaning | None:
    try:
        return kind_of(component.type_name, NameScope(None, space, None))
    except ModelicaError:
        return None


def _derives(space: Space, other: Space) -> bool:
    """True if two classes are the same, or if the first extends the second."""
    return space.text is other.text or any(_derives(base, other) for base, _ in space.bases())


def _public(space: Space) -> dict[str, tuple[Component, Space]]:
    """Return the public components of a class, declared and inherited, each with the class that declares it."""
    result: dict[str, tuple[Component, Space]] = {}
    for element in space.text.elements:
        if element.protected:
            continue
        if isinstance(element, Extends):
            if element.base.parts[0].name not in PREDEFINED:
                result |= _public(space.base(element))
        elif "outer" not in element.prefixes:
            result[element.name] = element, space
    return result
