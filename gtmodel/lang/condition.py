"""Conditions: relations and logical combinations of them, true or false at each instant."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import casadi as ca

from .._lazy import hint
from .._pickling import Portable
from .source import ModelError, SourceLocation, here

if TYPE_CHECKING:
    from .expression import Relation
else:
    Relation = hint("gtmodel.lang.expression", "Relation")

Operation = Literal["relation", "and", "or", "not", "sample", "initial"]


@dataclass(frozen=True, eq=False)
class Condition(Portable):
    """A logical condition: a relation `a <= b`, or several combined with `&` (and), `|` (or) and `~` (not).

    Comparing two expressions creates a `Relation`, which can be used as a condition. Combining relations needs
    parentheses: `(a <= b) & (c >= d)`. For continuous quantities `<` means the same as `<=`: at the crossing itself
    the condition takes the value that it has just after. If a quantity jumps to equality, or an input reaches it, and
    stays there, `<=` is true and `<` is false.
    """

    operation: Operation
    parts: tuple[Condition, ...]
    relation: Relation | None
    where: SourceLocation
    every: ca.SX | None = None
    offset: ca.SX | None = None

    def __and__(self, other: Any) -> Condition:
        return joined("and", self, other)

    def __or__(self, other: Any) -> Condition:
        return joined("or", self, other)

    def __invert__(self) -> Condition:
        return joined("not", self)

    def __bool__(self) -> bool:
        raise ModelError(
            "a condition has no truth value while a model is being built; pass it to gt.when or gt.If", self.where
        )

    def condition(self) -> Condition:
        """Return the condition itself."""
        return self

    def walk(self) -> Iterator[Condition]:
        """Yield this condition and all conditions nested in it."""
        yield self
        for part in self.parts:
            yield from part.walk()


def condition_of(value: Any) -> Condition:
    """Return a relation or a condition as a condition. Raises ModelError for any other value."""
    if not hasattr(value, "condition"):
        raise ModelError(f"expected a condition, that is a relation such as x <= 0; found {value!r}", here())
    return value.condition()


def joined(operation: Operation, *parts: Any) -> Condition:
    """Combine conditions with a logical operation."""
    return Condition(operation, tuple(map(condition_of, parts)), None, here())
