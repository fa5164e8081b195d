"""What a type name means where it stands, a predefined type or a class; and which type may stand in for another."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from .modifications import NOTHING, Modifier, merged, modifier
from .scopes import PREDEFINED, Space
from .syntax import Component, Extends, ModelicaError, Place, Reference, ReferencePart, SyntaxNode

if TYPE_CHECKING:
    from .instances import Instance

LONGEST_CHAIN = 200  # types that are names of one another, classes that extend one another
DEEPEST = 60  # components in one another; a class that holds itself would never end
COMPARED = 6  # classes of components in one another that are compared
_SORTS = ("package", "function", "connector", "record")


@dataclass(eq=False)
class NameScope:
    """Where an expression stands: in an instance, in a class, with local names."""

    instance: Instance | None
    space: Space
    model: Any  # what is flattened: warnings, and the evaluator
    locals: dict[str, Any] = field(default_factory=dict)

    def holds(self, name: str) -> bool:
        """Is it a component that this class, not one that extends it, declares or inherits?"""
        return self.instance is not None and name in self.instance.elements and name in self.space.declared

    def inner(self, names: dict[str, Any]) -> NameScope:
        return NameScope(self.instance, self.space, self.model, {**self.locals, **names})


@dataclass(eq=False)
class TypeMeaning:
    """What a type name means: a predefined type with its attributes, or a class."""

    base: str
    space: Space | None
    modifier: Modifier
    dimensions: list[tuple[SyntaxNode, NameScope]]
    prefixes: frozenset[str]
    connector: bool
    literals: tuple[str, ...] = ()


def kind_of(reference: Reference, scope: NameScope) -> TypeMeaning:
    """What a type name means in a scope. Raises ModelicaError for one that means nothing."""
    first = reference.parts[0].name
    if len(reference.parts) == 1 and first in PREDEFINED:
        return TypeMeaning(first, None, NOTHING, [], frozenset(), False)
    return meaning_of(scope.space.find(reference), scope, reference)


def meaning_of(space: Space, scope: NameScope, reference: Reference) -> TypeMeaning:
    """What a class means that a reference names."""
    said, dimensions, prefixes, connector = NOTHING, [], frozenset[str](), False
    if space.outer is not None:
        refuse_redeclaration(space.outer, space.outer.text.at)
    for _ in range(LONGEST_CHAIN):
        text = space.text
        if text.refused:
            raise ModelicaError(f"{space.name} is not taken: {text.refused}", reference.at)
        connector = connector or text.restriction.endswith("connector")
        said = merged(said, space.said)
        if text.literals is not None:
            return TypeMeaning("enumeration", space, said, dimensions, prefixes, connector, tuple(text.literals))
        extends = [e for e in text.elements if isinstance(e, Extends)]
        simple = text.short or (len(extends) == 1 and len(text.elements) == 1 and not text.equations)
        if not text.short:
            said = _limited(said, space, scope)
        if not simple or not extends:
            return TypeMeaning("", space, said, dimensions, prefixes, connector)
        builtin = len(extends[0].base.parts) == 1 and extends[0].base.parts[0].name in PREDEFINED
        if not text.short and not builtin and not _ends_predefined(space, extends[0]):
            return TypeMeaning("", space, said, dimensions, prefixes, connector)
        around = space.outer if text.short and space.outer is not None else space
        own = NameScope(space.holder, around, scope.model)
        said = merged(said, modifier(extends[0].modification, own))
        if text.short:
            said = _limited(said, space, scope)
        dimensions = [*dimensions, *[(d, own) for d in text.dimensions]]
        prefixes |= text.type_prefixes
        if builtin:
            return TypeMeaning(extends[0].base.parts[0].name, None, said, dimensions, prefixes, connector)
        space = space.base(extends[0])
    raise ModelicaError(f"'{reference}' is another name of itself, or of more than {LONGEST_CHAIN}", reference.at)


def _limited(said: Modifier, space: Space, scope: NameScope) -> Modifier:
    """With what stands behind constrainedby, where nothing else is said."""
    for written, around in space.bounds:
        said = merged(said, modifier(written, NameScope(None, around, scope.model)))
    return said


def _ends_predefined(space: Space, extends: Extends) -> bool:
    """Is a class in the end one of Modelica's own types?"""
    for _ in range(DEEPEST):
        if extends.base.parts[0].name in PREDEFINED:
            return True
        space = space.base(extends)
        inside = [e for e in space.text.elements if isinstance(e, Extends)]
        if len(inside) != 1 or len(space.text.elements) != 1:
            return False
        extends = inside[0]
    return False


# redeclarations


def refuse_another(new: Space, limit: Space, scope: NameScope, at: Place) -> None:
    """Raises ModelicaError if a class that is redeclared is no subtype of the one that limits it."""
    kinds = [_known(s, scope, at) for s in (new, limit)]
    if lack := _lack(kinds[0], kinds[1]):
        said, wanted = (k.space.name if k is not None and k.space is not None else k and k.base for k in kinds)
        raise ModelicaError(f"'{new.text.name}' is redeclared, and takes a subtype of {wanted}; {said} {lack}", at)


def refuse_redeclaration(new: Space, at: Place) -> None:
    """Raises ModelicaError if a modification puts a class in place of one that is not replaceable, or of which it is no
    subtype."""
    old = new.instead
    if old is None:
        return
    if "replaceable" not in old.text.prefixes:
        owner = old.outer.name if old.outer is not None else "the text"
        raise ModelicaError(f"'{old.text.name}' of {owner} is not replaceable", at)
    refuse_another(new, old.interface, NameScope(None, new, None), at)


def refuse_redeclared(space: Space, scope: NameScope) -> None:
    """As `refuse_another`, of the classes that a class redeclares among its own elements."""
    for text in space.text.classes.values():
        if "redeclare" in text.prefixes and (new := space.own(text.name)) is not None:
            for base, _ in space.bases():
                if (inherited := base.member(text.name)) is not None and inherited.text is not text:
                    refuse_another(new, inherited.interface, scope, text.at)


def refuse_other_type(kind: TypeMeaning, limit: TypeMeaning, new: Component, old: Component, at: Place) -> None:
    """Raises ModelicaError if the type of a component that is redeclared is no subtype of the one that limits it."""
    if lack := _lack(kind, limit):
        wanted = old.type_name if old.constraint is None else old.constraint.base
        raise ModelicaError(f"'{new.name}' is redeclared, and takes a subtype of {wanted}; {new.type_name} {lack}", at)


def _known(space: Space, scope: NameScope, at: Place) -> TypeMeaning | None:
    """What a class means; None of one that is wrong itself, which is said where it is used."""
    try:
        return meaning_of(space, scope, Reference(at, (ReferencePart(space.text.name, None),)))
    except ModelicaError:
        return None


def _lack(new: TypeMeaning | None, limit: TypeMeaning | None, depth: int = 0) -> str:
    """Why a type is no subtype of another; nothing where it is one."""
    if new is None or limit is None or depth > COMPARED:
        return ""
    if new.base or limit.base:
        if new.base != limit.base:
            return f"is {new.base or 'a class'} and not {limit.base or 'a class'}"
        return "has other literals" if limit.literals and new.literals != limit.literals else ""
    assert new.space is not None
    assert limit.space is not None
    sorts = [next((s for s in _SORTS if x.text.restriction.endswith(s)), "model") for x in (new.space, limit.space)]
    if sorts[0] != sorts[1]:
        return f"is a {sorts[0]} and no {sorts[1]}"
    if _derives(new.space, limit.space):
        return ""
    mine, wanted = _public(new.space), _public(limit.space)
    for name, (theirs, there) in wanted.items():
        if name not in mine:
            return f"has no public '{name}'"
        own, here = mine[name]
        types = [_type_of(c, s) for c, s in ((own, here), (theirs, there))]
        for word in ("flow", "stream", "input", "output"):
            has, asked = (word in c.prefixes or (k is not None and word in k.prefixes)
                          for c, k in zip((own, theirs), types, strict=True))  # fmt: skip
            if asked and not has:
                return f"has a '{name}' that is no {word}"
        if lack := _lack(types[0], types[1], depth + 1):
            return f"has another '{name}': it {lack}"
    if sorts[1] == "package":
        lost = [n for n in limit.space.text.classes if new.space.member(n) is None]
        return f"has no '{lost[0]}'" if lost else ""
    return ""


def _type_of(component: Component, space: Space) -> TypeMeaning | None:
    try:
        return kind_of(component.type_name, NameScope(None, space, None))
    except ModelicaError:
        return None


def _derives(space: Space, other: Space) -> bool:
    """Is a class another one, or does it extend it?"""
    return space.text is other.text or any(_derives(base, other) for base, _ in space.bases())


def _public(space: Space) -> dict[str, tuple[Component, Space]]:
    """What a class shows, declared or inherited, each with the class that declares it."""
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
