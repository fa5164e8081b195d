"""Lookup of a name in a component, in a record value, or among the constants of a package."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from .._near import near
from .arrays import RecordValue, array, stacked
from .instances import Declared, Instance
from .meanings import check_redeclaration
from .modifications import NOTHING
from .scopes import Space
from .syntax import ModelicaError, Place

if TYPE_CHECKING:
    from .expressions import Evaluator


class Missing(ModelicaError):
    """A reference to a conditional component whose condition is false."""


def declares(space: Space, name: str) -> bool:
    """True if a class declares or inherits a component of this name."""
    return name in space.declared


def package(space: Space, model: Evaluator) -> Instance:
    """Return an instance of a class that holds its constants."""
    check_redeclaration(space, space.text.at)
    space = space.derived or space
    if space.package is None or space.package.model is not model:
        space.package = Instance(space, NOTHING, space.name, None, model, frozenset({"static"}))
    return space.package


def constant(space: Space, name: str, at: Place, model: Evaluator, dotted: bool = False) -> Any:
    """Return a constant of a class, named without a component of it; dotted: with the class name, as in `P.k`."""
    holder = package(space, model)
    element = holder.elements.get(name)
    if element is not None and dotted:
        element.check_accessible(at)
    if element is not None and "static" in holder.prefixes:
        known = {"constant", "parameter"} if holder.restriction == "package" else {"constant"}
        if not known & element.text.prefixes:
            raise ModelicaError(
                f"'{name}' of {space.name} is not a constant; only constants can be referenced without a component", at
            )
    return member(holder, name, at)


def member(instance: Instance, name: str, at: Place) -> Any:
    """Return a component of an instance: symbols, an Instance, or an array of Instances."""
    element = instance.elements.get(name)
    if element is None:
        owner = instance.path or instance.space.name
        raise ModelicaError(f"'{owner}' has no '{name}'{near(name, list(instance.elements))}", at)
    component = element.component
    if component is None:
        raise Missing(f"'{instance.full(name)}' does not exist: its condition is false", at)
    return component.symbols if isinstance(component, Declared) else component


def shown(value: Any, name: str, at: Place) -> Any:
    """As `field`, for dot access in the text. Raises ModelicaError also for a protected element."""
    first = value.ravel()[0] if isinstance(value, np.ndarray) and value.size else value
    if isinstance(first, Instance) and (element := first.elements.get(name)) is not None:
        element.check_accessible(at)
    return field(value, name, at)


def field(value: Any, name: str, at: Place) -> Any:
    """Return an element of a component or record, or the array of these elements for an array."""
    if isinstance(value, Instance):
        return member(value, name, at)
    if isinstance(value, RecordValue):
        if name not in value:
            raise ModelicaError(f"the record has no '{name}'{near(name, list(value))}", at)
        return value[name]
    if isinstance(value, np.ndarray) and value.ndim and not value.size:
        return value  # an array of no components
    if isinstance(value, np.ndarray) and value.size and isinstance(value.ravel()[0], (Instance, RecordValue)):
        fields = [field(item, name, at) for item in value.ravel()]
        stack = stacked(fields, at) if not isinstance(fields[0], Instance) else array(fields, (len(fields),))
        return stack.reshape(value.shape + stack.shape[1:])
    raise ModelicaError(f"a scalar has no '{name}'", at)
