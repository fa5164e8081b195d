"""What stands under a name: in a component, in a record, or as a constant in a package."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from .._near import near
from .arrays import RecordValue, array, stacked
from .instances import Declared, Instance
from .meanings import refuse_redeclaration
from .modifications import NOTHING
from .scopes import Space
from .syntax import ModelicaError, Place

if TYPE_CHECKING:
    from .expressions import Evaluator


class Missing(ModelicaError):
    """A component is asked for whose condition is false."""


def declares(space: Space, name: str) -> bool:
    """Does a class declare, or inherit, a constant or parameter of this name?"""
    return name in space.declared


def package(space: Space, model: Evaluator) -> Instance:
    """A class as the holder of its constants."""
    refuse_redeclaration(space, space.text.at)
    space = space.derived or space
    if space.package is None or space.package.model is not model:
        space.package = Instance(space, NOTHING, space.name, None, model, frozenset({"static"}))
    return space.package


def constant(space: Space, name: str, at: Place, model: Evaluator, dotted: bool = False) -> Any:
    """A constant of a class that is named from outside of any component of it; dotted: behind the class's name."""
    holder = package(space, model)
    element = holder.elements.get(name)
    if element is not None and dotted:
        element.refuse_from_outside(at)
    if element is not None and "static" in holder.prefixes:
        known = {"constant", "parameter"} if holder.restriction == "package" else {"constant"}
        if not known & element.text.prefixes:
            raise ModelicaError(f"'{name}' of {space.name} is no constant; only those can be named from here", at)
    return member(holder, name, at)


def member(instance: Instance, name: str, at: Place) -> Any:
    """A component of an instance: symbols, an Instance, or an array of them."""
    element = instance.elements.get(name)
    if element is None:
        inside = instance.path or instance.space.name
        raise ModelicaError(f"'{inside}' has no '{name}'{near(name, list(instance.elements))}", at)
    made = element.made
    if made is None:
        raise Missing(f"'{instance.full(name)}' is not there: its condition is false", at)
    return made.symbols if isinstance(made, Declared) else made


def shown(value: Any, name: str, at: Place) -> Any:
    """As `field`, of what a text names with a dot: protected elements are the component's own."""
    first = value.ravel()[0] if isinstance(value, np.ndarray) and value.size else value
    if isinstance(first, Instance) and (element := first.elements.get(name)) is not None:
        element.refuse_from_outside(at)
    return field(value, name, at)


def field(value: Any, name: str, at: Place) -> Any:
    """What stands under a name in a component or a record, or in each of an array of them."""
    if isinstance(value, Instance):
        return member(value, name, at)
    if isinstance(value, RecordValue):
        if name not in value:
            raise ModelicaError(f"the record has no '{name}'{near(name, list(value))}", at)
        return value[name]
    if isinstance(value, np.ndarray) and value.ndim and not value.size:
        return value  # of no component
    if isinstance(value, np.ndarray) and value.size and isinstance(value.ravel()[0], (Instance, RecordValue)):
        inside = [field(item, name, at) for item in value.ravel()]
        joined = stacked(inside, at) if not isinstance(inside[0], Instance) else array(inside, (len(inside),))
        return joined.reshape(value.shape + joined.shape[1:])
    raise ModelicaError(f"there is no '{name}' inside a number", at)
